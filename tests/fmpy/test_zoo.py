"""Plants of textbooks and data sheets: each has a design that does what `new` says of it, in a loop of FMUs, or a reason."""

import json
from pathlib import Path
from random import Random

import numpy as np
import pytest
from sample import ALL, NUMBER, ROOT
from zoo import FOLDER, KINDS, PLANTS, NotSound, Refused, closed, design

SAMPLE = sorted(PLANTS) if ALL else sorted(Random(NUMBER).sample(sorted(set(PLANTS) - {"buck", "cd_radial", "piezo_stage"}), 8))

TABLE = (ROOT / "examples/zoo/README.md").read_text().splitlines()

# What has no design, by the words of the reason; every other pair has one.
REFUSED = {
    ("boost", "funnel"): "zero at",
    ("cart_pendulum", "pid"): "M_s of at least 12",
    ("cart_pendulum", "ladrc"): "M_s of at least 12",
    ("cart_pendulum", "funnel"): "zero at",
    ("quarter_car", "funnel"): "zero at ±56.7j",
    ("furuta_arm", "pid"): "M_s of at least",
    ("furuta_arm", "ladrc"): "M_s of at least",
    ("furuta_arm", "funnel"): "zero at",
    ("furuta_flat", "pid"): "unstable pole at",
    ("furuta_flat", "ladrc"): "unstable pole at",
    ("furuta_flat", "funnel"): "relative degree 4",
    ("pmsm_speed", "funnel"): "no dead time",
    ("heat_exchanger", "funnel"): "no dead time",
    ("wing_flutter", "pid"): "unstable pole at",
    ("wing_flutter", "ladrc"): "unstable pole at",
    ("wing_flutter", "funnel"): "zero at",
    ("cd_radial", "funnel"): "no dead time",
    ("maglev", "pid"): "unstable pole at",
    ("pendulum_velocity", "pid"): "zero at 0",
    ("pendulum_velocity", "ladrc"): "zero at 0",
    ("pendulum_velocity", "funnel"): "zero at 0",
    ("buck", "funnel"): "no dead time",
    ("distillation", "funnel"): "no dead time",
    ("hot_air_blower", "funnel"): "no dead time",
    ("paper_headbox", "funnel"): "independently of each other",
    ("boiler_drum", "funnel"): "zero at",
    ("servo_cylinder", "funnel"): "relative degree 4",
    ("paper_headbox", "l1"): "can't be decoupled",
    ("paper_headbox", "l1-limit"): "can't be decoupled",
    ("pendulum_velocity", "l1"): "zero at 0",
    ("pendulum_velocity", "l1-limit"): "zero at 0",
}
# Its lightly damped mode of 1 kHz makes the funnel's step shorter than those that are tried: the file says so, and no loop is run.
TOO_FINE = [("piezo_stage", "funnel")]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("plant", SAMPLE)
def test_a_plant_has_a_design_that_does_what_is_predicted_or_a_reason(plant: str, kind: str, tmp_path: Path):
    predicted = design(plant, kind, tmp_path)
    cells = next(line for line in TABLE if line.startswith(f"| `{plant}` |")).split(" | ")
    assert cells[2 + KINDS.index(kind)].removesuffix(" |") == str(predicted), "benches/zoo writes the table anew"
    if isinstance(predicted, Refused) or (plant, kind) in REFUSED:
        assert isinstance(predicted, Refused) and REFUSED.get((plant, kind), "no reason is known") in predicted.reason, predicted
        return
    if isinstance(predicted, NotSound):
        # The table says which these are.
        assert "some plants are not stable" in predicted.reason, predicted
        return
    if (plant, kind) in TOO_FINE:
        assert "No communication step was found that is short enough" in predicted.notes
        return
    had = closed(plant, predicted, tmp_path)
    several = len(json.loads((FOLDER / f"{plant}.json").read_text())["outputs"]) > 1
    assert had.left < 0.05 and had.overshoot < (0.4 if several else 0.3), f"{predicted} {had}"
    if kind == "funnel":
        assert had.left == pytest.approx(predicted.left / 100, abs=0.005), f"{predicted} {had}"
    elif not several:
        # What is said is of the nominal loop without sampling.
        assert had.overshoot * 100 <= 1.1 * predicted.overshoot + 2 and had.settling <= 1.1 * predicted.settling, f"{predicted} {had}"


def test_what_is_known_of_the_plants_is_so():
    for name, of in PLANTS.items():
        model = json.loads((FOLDER / f"{name}.json").read_text())
        poles = np.linalg.eigvals(np.array(model["A"], float))
        assert ("unstable" in of["traits"]) == bool((poles.real > 1e-6 * abs(poles).max()).any()), name
        assert ("delay" in of["traits"]) == ("delay" in model), name
        assert ("mimo" in of["traits"]) == (len(model["inputs"]) > 1), name
        assert len(model["inputs"]) == len(model["outputs"]) == len(model["u_max"]), name
    assert len(PLANTS) >= 30


def test_the_page_counts_the_designs_of_the_table():
    page = (ROOT / "docs/first_designs.md").read_text().split("| kind | designs | not sound")[1].splitlines()
    rows = [line for line in TABLE if line.startswith("| `") and line.split("`")[1] in PLANTS]
    designs = [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in rows]
    assert len(designs) == len(PLANTS)
    for kind, cells in zip(KINDS, list(zip(*designs, strict=True))[2:], strict=True):
        refused, not_sound = cells.count("–"), cells.count("not sound")
        counts = [len(cells) - refused - not_sound, *([not_sound] if not_sound else []), refused]
        row = next(line for line in page if line.startswith(f"| `{kind}` |"))
        assert [int(cell) for cell in row.split("|")[2:] if cell.strip()] == counts, kind
