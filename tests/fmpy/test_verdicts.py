"""A design that `check` calls sound does what it says with other plants than the nominal one, within the bounds."""

from pathlib import Path
from random import Random

import pytest
from random_plants import CLASSES, plant
from sample import ALL, NUMBER
from verdicts import Predicted, design, is_true, loop, part_of_funnel, within

KINDS = ["pid", "ladrc", "l1", "l1-limit", "l1-sampled"]
# What is stable in continuous time with dead times of many steps: L1 takes none.
OTHERS = 4 if ALL else 2
EACH = 4 if ALL else 1


@pytest.mark.parametrize("number", range(EACH))
@pytest.mark.parametrize("kind", KINDS)
def test_what_check_reports_on_uncertain_plants_is_true(kind: str, number: int, tmp_path: Path):
    random = Random(f"verdict {kind} {NUMBER} {number}")
    nominal = plant(random.choice(CLASSES), random)
    predicted = design(kind, nominal, tmp_path)
    if not isinstance(predicted, Predicted) or not predicted.sound:
        return
    for k in range(OTHERS):
        had = loop(within(nominal, random, k % 2 == 0), predicted, tmp_path)
        assert is_true(predicted, had), f"{predicted} {had}"


@pytest.mark.parametrize("number", range(EACH))
def test_what_check_reports_on_funnels_with_uncertain_plants_is_true(number: int, tmp_path: Path):
    random = Random(f"verdict funnel {NUMBER} {number}")
    nominal = plant("minimum phase", random)
    predicted = design("funnel", nominal, tmp_path)
    if not isinstance(predicted, Predicted) or not predicted.sound:
        return
    for k in range(OTHERS):
        # An error that leaves its funnel ends the run.
        had = loop(within(nominal, random, k % 2 == 0), predicted, tmp_path)
        assert is_true(predicted, had), f"{predicted} {had}"
        assert part_of_funnel(tmp_path) <= 1.1 * predicted.part + 0.02
