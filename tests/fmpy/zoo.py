"""From each plant of examples/zoo to a loop: `new KIND`, `new loop`, `run`, and what the result has against what `new` said."""

import csv
import json
import re
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from conftest import PROGRAM
from sample import ROOT

FOLDER = ROOT / "examples/zoo"
PLANTS = tomllib.loads((FOLDER / "plants.toml").read_text())
KINDS = ["pid", "ladrc", "funnel", "l1", "l1-limit"]
# How much longer than it should take to settle a loop is run.
LONGER = 1.6
# A funnel's reference is followed for so long, in 1/W.
FOLLOWED = 15.0
# A ripple of 2 % may be one of 2.1 % with sampling: what is said to settle to 2 % must settle to this.
BAND = 0.025
# `new reference` steps at 1 s.
STEP_TIME = 1.0


@dataclass
class Predicted:
    """What `new` said of a design."""

    settling: float | None
    overshoot: float | None
    modulus: float | None
    # λ* of an L1 design.
    proof: float | None
    left: float | None
    notes: str
    # The step that was asked for, or the largest within the limits.
    reference: float


    def __str__(self) -> str:
        """The cell of the table in examples/zoo/README.md."""
        if self.left is not None:
            return f"{self.left:g} % left"
        return f"{self.settling:g} s, {self.overshoot:g} %, {self.modulus or self.proof:g}"


@dataclass
class Had:
    """What the loop of the FMUs had: the worst of all outputs, in parts of the step; s."""

    left: float
    overshoot: float
    settling: float | None


@dataclass
class Refused:
    """Why there is no design."""

    reason: str

    def __str__(self) -> str:
        return "–"


@dataclass
class NotSound:
    """Why some plants within the uncertainty aren't stable."""

    reason: str

    def __str__(self) -> str:
        return "not sound"


def program(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=300)


def new(folder: Path, kind: str, name: str, plant: str, *options: str) -> subprocess.CompletedProcess:
    file = str(FOLDER / f"{plant}.json")
    return program(folder, "new", kind, "--name", name, "--plant", file, "--out", f"{name}.toml", "--no-schema", "--force", *options)


def row(plant: str, designs: list[Predicted | Refused | NotSound]) -> str:
    """A line of the table in examples/zoo/README.md."""
    of = PLANTS[plant]
    return f"| `{plant}` | {of['bandwidth']:g} | " + " | ".join(map(str, designs)) + " |"


def design(plant: str, kind: str, folder: Path) -> Predicted | Refused | NotSound:
    """C.toml for a plant, at the bandwidth and for the reference that belong to it."""
    bandwidth, reference = PLANTS[plant]["bandwidth"], PLANTS[plant]["reference"]
    made = new(folder, kind, "C", plant, "--bandwidth", repr(bandwidth), "--reference", repr(reference))
    if made.returncode == 3:
        return NotSound(made.stderr)
    if made.returncode:
        assert made.returncode == 1 and "panic" not in made.stderr, made.stderr
        return Refused(made.stderr.split(".json: ", 1)[1].strip())
    text = (folder / "C.toml").read_text()

    def number(pattern: str) -> float | None:
        found = re.search(pattern, text.replace("\n# ", " "))
        return float(found[1]) if found else None

    allowed = number(r"A step to ([-\d.e]+) stays within")
    return Predicted(
        settling=number(r"settles to 2 % in ([-\d.e]+) s"),
        overshoot=number(r"overshoot ([-\d.e]+) %"),
        modulus=number(r"sensitivity M_s (\d+(?:\.\d+)?)"),
        proof=number(r"λ\* ([-\d.e]+)\."),
        left=number(r"and ([-\d.e]+) % of the reference is left"),
        notes=made.stderr,
        reference=reference if allowed is None else 0.98 * allowed,
    )


def closed(plant: str, predicted: Predicted, folder: Path) -> Had:
    """Runs the loop of C.toml."""
    for kind, name in [("state-space", "P"), ("reference", "R")]:
        made = new(folder, kind, name, plant, *(["--reference", repr(predicted.reference)] if name == "R" else []))
        assert made.returncode == 0, made.stderr
    until = STEP_TIME + LONGER * predicted.settling if predicted.settling else FOLLOWED / PLANTS[plant]["bandwidth"]
    made = program(folder, "new", "loop", "--units", "P.toml", "C.toml", "R.toml", "--until", f"{until:.9g}", "--out", ".", "--force")
    assert made.returncode == 0 and "to decide" not in made.stderr, made.stderr
    begins = STEP_TIME if predicted.settling else 0.0
    ran = program(folder, "run", ".", "--out", "results", "-q", "--every", f"{(until - begins) / 4000:.6g}")
    assert ran.returncode == 0, f"{plant}: {ran.stderr}"
    with next((folder / "results").rglob("result.csv")).open() as file:
        rows = list(csv.reader(file))
    columns = dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))
    t = columns["time"] - begins
    left, overshoot, settling = 0.0, 0.0, 0.0
    for name in json.loads((FOLDER / f"{plant}.json").read_text())["outputs"]:
        y = columns.get(f"plant.{name}_output", columns.get(f"plant.{name}"))
        error = y / predicted.reference - 1
        outside = np.flatnonzero(np.abs(error) > BAND)
        left, overshoot = max(left, abs(error[-1])), max(overshoot, error.max())
        last = outside[-1] if len(outside) else 0
        settling = float("nan") if last + 1 >= len(t) else max(settling, t[last + 1])
    return Had(left, overshoot, None if np.isnan(settling) else settling)
