"""What `check` says of a design with an uncertain plant, and what loops of FMUs with plants within its bounds have."""

import csv
import json
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np
from conftest import PROGRAM
from random_plants import Plant

PART = 0.2
# `new reference` steps at 1 s.
STEP_TIME = 1.0
# How much longer than it should take to settle a loop is run: its end is what the band of 2 % is about.
LONGER = 3.0


@dataclass
class Predicted:
    """The worst of the plants: settling time, s, overshoot, range of the control, how far it rests beside the reference."""

    sound: bool
    settling: float
    overshoot: float
    control: list[tuple[float, float]]
    # Largest error in parts of its bound, of a funnel.
    part: float = 1.0


@dataclass
class Had:
    """The worst of the steps of each reference in a loop."""

    settling: float
    overshoot: float
    control: list[tuple[float, float]]


def program(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=300)


def model(plant: Plant) -> dict:
    n, m = plant.B.shape
    names = {key: [f"{name}{i}" for i in range(count)] for key, name, count in [("states", "s", n), ("inputs", "force", m), ("outputs", "tracked", m)]}
    return plant.json() | names


def design(kind: str, plant: Plant, folder: Path) -> Predicted | str:
    """What `check` says of what `new` writes, or why there is no design."""
    (folder / "plant.json").write_text(json.dumps(model(plant)))
    options = ["--plant", "plant.json", "--bandwidth", repr(plant.bandwidth), "--uncertainty", "20%", "--no-schema", "--force"]
    made = program(folder, "new", kind, "--name", "C", "--out", "C.toml", *options)
    if made.returncode == 1:
        return made.stderr
    assert made.returncode in (0, 3), made.stderr
    checked = program(folder, "check", "C.toml", "--json")
    assert checked.returncode == made.returncode, f"`new` and `check` say different things: {made.stderr}\n{checked.stdout}"
    report = json.loads(checked.stdout)
    found = {finding["name"]: finding["value"] for finding in report["findings"] if finding["section"] == "Uncertain plants"}
    control = [tuple(found[f"range of force{j}"][0]) for j in range(plant.B.shape[1])] if "range of force0" in found else []
    if "largest error" in found and report["sound"]:
        # A reference that starts smoothly from 0 s on, which is followed for 15/W.
        return Predicted(True, 15 / plant.bandwidth, float("inf"), control, found["largest error"])
    if "settling time" not in found:
        assert not report["sound"]
        return "not sound"
    return Predicted(report["sound"], found["settling time"], found["overshoot"] / 100, control)


def within(plant: Plant, random: Random, corner: bool) -> Plant:
    """A plant each of whose entries differs by up to 20 %; rows of 0 and ±1 without input are kinematics."""

    def factor() -> float:
        value = random.uniform(-1, 1)
        return 1 + PART * (float(np.sign(value)) if corner else value)

    A, B = plant.A.copy(), plant.B.copy()
    for i, row in enumerate(plant.A):
        if not (np.isin(row, [-1, 0, 1]).all() and not plant.B[i].any()):
            A[i] = [entry * factor() for entry in row]
    B[:] = [[entry * factor() for entry in row] for row in plant.B]
    return Plant(A, B, plant.C, plant.bandwidth, plant.delay)


def loop(plant: Plant, predicted: Predicted, folder: Path) -> Had:
    """The steps of the references, one after the other, of the loop of C.toml with another plant."""
    (folder / "other.json").write_text(json.dumps(model(plant)))
    for kind, name in [("state-space", "P"), ("reference", "R")]:
        made = program(folder, "new", kind, "--name", name, "--plant", "other.json", "--out", f"{name}.toml", "--no-schema", "--force")
        assert made.returncode == 0, made.stderr
    until = STEP_TIME + LONGER * predicted.settling
    made = program(folder, "new", "loop", "--units", "P.toml", "C.toml", "R.toml", "--until", f"{until:.9g}", "--out", ".", "--force")
    assert made.returncode == 0, made.stderr
    m = plant.B.shape[1]
    worst = Had(0.0, 0.0, [(0.0, 0.0)] * m)
    for i in range(m):
        others = [option for j in range(m) if j != i for option in ("--set", f"reference.step_height[{j + 1},1]=0")]
        ran = program(folder, "run", ".", "--out", "results", "-q", "--every", f"{LONGER * predicted.settling / 4000:.6g}", *others)
        assert ran.returncode == 0, ran.stderr
        take(worst, i, folder / "results")
    return worst


def signals(results: Path) -> dict[str, np.ndarray]:
    """The signals of a run."""
    with next(results.rglob("result.csv")).open() as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))


def part_of_funnel(folder: Path) -> float:
    """The largest error of the last run of a loop of one channel, in parts of its bound."""
    start, columns = tomllib.loads((folder / "C.toml").read_text())["start"], signals(folder / "results")
    psi_0, psi_inf, rate = (start[name][0] for name in ("psi_0", "psi_inf", "decay_rate"))
    y = columns.get("plant.tracked0_output", columns.get("plant.tracked0"))
    psi = (psi_0 - psi_inf) * np.exp(-rate * columns["time"]) + psi_inf
    return float(np.max(np.abs(y - columns["reference.tracked0_reference"]) / psi))


def take(worst: Had, i: int, results: Path) -> None:
    """The step of a reference."""
    columns = signals(results)
    t = columns["time"] - STEP_TIME
    for j in range(len(worst.control)):
        y, u = columns.get(f"plant.tracked{j}_output", columns.get(f"plant.tracked{j}")), columns[f"controller.force{j}"]
        outside = np.flatnonzero(np.abs(y - y[-1]) > 0.02)
        worst.settling = max(worst.settling, float(t[outside[-1]]) if len(outside) else 0.0)
        worst.overshoot = max(worst.overshoot, float(y.max()) - 1 if j == i else 0.0)
        low, high = worst.control[j]
        worst.control[j] = (min(low, float(u.min())), max(high, float(u.max())))


def is_true(predicted: Predicted, had: Had) -> bool:
    """True if nothing is more than 10 % beyond what was said, the overshoot 2 % of the step more."""
    size = max(max(map(abs, control)) for control in predicted.control)
    return (
        had.settling <= 1.1 * predicted.settling
        and had.overshoot <= 1.1 * predicted.overshoot + 0.02
        and all(low >= least - 0.1 * size and high <= most + 0.1 * size for (least, most), (low, high) in zip(predicted.control, had.control, strict=True))
    )
