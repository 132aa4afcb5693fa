"""What a run of the tests looks at: all FMUs and loops (tests/all), or a sample (tests/run).

A sample has one FMU of each kind and every third loop. TEST_SAMPLE=N in the environment chooses it; tests/run takes N from the
commit, so that all are met in turn.
"""

import os
import tomllib
from collections import defaultdict
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]
# What a person wrote an FMU's description or a loop's structure for, known before anything is exported.
FMU_NAMES = sorted(file.stem for file in (ROOT / "modelDescription").glob("*.toml"))
LOOP_NAMES = sorted(file.parent.name for file in ROOT.glob("examples/*/SystemStructure.ssd"))

ALL = os.environ.get("TEST_ALL") == "1"
NUMBER = int(os.environ.get("TEST_SAMPLE", "0"))


def one_of_each_kind(number: int) -> list[str]:
    """An FMU of each kind."""
    kinds = defaultdict(list)
    for name in FMU_NAMES:
        kinds[tomllib.loads((ROOT / "modelDescription" / f"{name}.toml").read_text())["model"]].append(name)
    return sorted(Random(f"{number} {kind}").choice(names) for kind, names in kinds.items())


def every_third_loop(number: int) -> list[str]:
    """A third of the loops."""
    return LOOP_NAMES[number % 3 :: 3]


# Parts into which the tests of a file are divided; a commit takes one.
PARTS = 13


def part_of_tests(number: int) -> int:
    """Which part of the tests of each file: each meets each third of the loops."""
    return number // 3 % PARTS


# For tests of what follows from the framework or from the kind.
FMUS = FMU_NAMES if ALL else one_of_each_kind(NUMBER)
LOOPS = LOOP_NAMES if ALL else every_third_loop(NUMBER)
SUMMARY = f"TEST_SAMPLE={NUMBER}: {'all ' if ALL else ''}{len(FMUS)} FMUs, {len(LOOPS)} loops"
