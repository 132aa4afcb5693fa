"""Closed loops: against other masters, a controller in Python, and other methods of the program itself."""

import csv
import math
import tempfile
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import robot_controller
from machine import ROOT, Workshop, program, run_json
from master import Fmu
from package import Package
from pythonfmu.builder import FmuBuilder
from table import Row, alternately

ALLOWED = 1e-3  # of the largest magnitude of each of the plant's states
TIGHT = 1e-10
ROBOT, QUADROTOR, ACTUATED = "3.3.1-case2", "3.3.2-case1", "4-case1"
FMPY, PYTHONFMU = (f"{name} {version(name)}" for name in ("FMPy", "PythonFMU"))


def states(columns: dict[str, np.ndarray]) -> np.ndarray:
    """The plant's states, a column each."""
    return np.column_stack([values for name, values in columns.items() if name.startswith("plant.x[")])


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest, relative to the largest magnitude of each column; no number where the rows differ in number."""
    if found.shape != expected.shape:
        return float("nan")
    return float(np.max(np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)))


class Native:
    """A loop in the program, with options; what it recorded. With an empty cache nothing is compiled."""

    def __init__(
        self, workshop: Workshop, loop: str, *options: str | float, longest: float = math.inf, generic: bool = False
    ) -> None:
        self.workshop, self.generic = workshop, generic
        whole, out = "--composite" in options, Path(tempfile.mkdtemp(dir=workshop.folder))
        units = [] if whole else ["--fmus", workshop.fmus]
        self.words = ["run", loop, *options, "--until", min(workshop.stop, longest), *units, "--out", out]
        self.file = out / (loop + "-composite" * whole) / "result.csv"

    def seconds(self) -> float:
        """How long the simulation takes."""
        return run_json(*self.words, generic=self.generic)["seconds"]

    def settle(self) -> None:
        """A run that isn't timed: files are read once."""
        if not self.workshop.quick:
            self.seconds()

    def states(self) -> np.ndarray:
        """Of the plant."""
        if not self.file.exists():
            self.seconds()
        rows = list(csv.reader(self.file.open()))
        return states(dict(zip(rows[0], np.array(rows[1:], float).T, strict=True)))


def tightly(unit: str) -> list[str]:
    """Options by which a unit integrates tightly, by a general method."""
    return ["--set", f"{unit}relative_tolerance={TIGHT}", "--set", f"{unit}integration_method=explicit"]


class InFmpy:
    """A packed loop in FMPy."""

    def __init__(self, workshop: Workshop, loop: str) -> None:
        program("export", "--ssp", loop, "--out", workshop.folder)
        self.path, self.stop = workshop.folder / f"{loop}.ssp", workshop.stop
        self.package = Package(self.path, workshop.folder / loop)
        self.columns: dict[str, np.ndarray] = {}

    def seconds(self) -> float:
        """How long a loop in Python around the functions of FMI takes, all values of a unit in one call."""
        times = self.package.step * np.arange(round(self.stop / self.package.step) + 1)
        begun = time.perf_counter()
        self.columns = self.package.run(times, np.diff(times), "gauss-seidel").signals
        return time.perf_counter() - begun


def by_separate_units(workshop: Workshop, loop: str, peer: InFmpy, how: str, goal: float) -> Row:
    """A loop in the program and in FMPy."""
    own, tight = Native(workshop, loop), Native(workshop, loop, *tightly("plant."), *tightly("controller."))
    times, expected = alternately(workshop.repeats, own.seconds, peer.seconds), tight.states()
    errors = difference(own.states(), expected), difference(states(peer.columns), expected)
    what = f"{loop}, {workshop.stop:g} s by separate FMUs"
    return Row(what, times[0], goal, how, times[1], errors, (ALLOWED, ALLOWED))


def against_fmpy(workshop: Workshop) -> list[Row]:
    """The loops of separate units."""
    how = f"{FMPY}, a loop in Python around its calls"
    return [by_separate_units(workshop, loop, InFmpy(workshop, loop), how, 6) for loop in (ROBOT, QUADROTOR)]


def against_python(workshop: Workshop) -> Row:
    """The robot's loop with its controller in Python."""
    peer = InFmpy(workshop, ROBOT)
    built = FmuBuilder.build_FMU(ROOT / "benches" / "comparison" / "robot_controller.py", workshop.folder)
    peer.package.fmus["controller"] = Fmu(Path(built), workshop.folder / "in_python")
    peer.package.values.clear()
    how = f"controller in {PYTHONFMU}, {robot_controller.SUBSTEPS} RK4 steps a ms, in {FMPY}"
    return by_separate_units(workshop, ROBOT, peer, how, 80)


def compiled_equations(workshop: Workshop) -> list[Row]:
    """Separate units whose equations the program compiles, as it does by default, against the generic ones."""
    return [by_compiled_equations(workshop, loop) for loop in (ROBOT, QUADROTOR, ACTUATED)]


def by_compiled_equations(workshop: Workshop, loop: str) -> Row:
    own, generic = Native(workshop, loop), Native(workshop, loop, generic=True)
    tight = Native(workshop, loop, *tightly("plant."), *tightly("controller."))
    own.settle()
    times, expected = alternately(workshop.repeats, own.seconds, generic.seconds), tight.states()
    errors = difference(own.states(), expected), difference(generic.states(), expected)
    what = f"{loop}, {workshop.stop:g} s by separate FMUs, equations compiled"
    return Row(what, times[0], 4, "generic equations", times[1], errors, (ALLOWED, ALLOWED))


def closed_form(workshop: Workshop) -> list[Row]:
    """The closed form of an L1 controller against the general method as accurate, in the loop of chapter 4."""
    wide = ["--set", "controller.omega_min[1,1]=-10", "--set", "controller.theta_bound[1]=100"]
    return [
        by_closed_form(workshop, "4-case1, as it is: estimates at their bounds", []),
        by_closed_form(workshop, "4-case1, bounds that leave room", wide),
    ]


def by_closed_form(workshop: Workshop, what: str, options: list[str]) -> Row:
    plant = ["--step", 1e-3, "--set", f"plant.relative_tolerance={TIGHT}", *options]
    native = partial(Native, workshop, "4-case1", *plant, longest=4.0)
    own, expected = native(), native(*tightly("controller.")).states()
    error = difference(own.states(), expected)

    def general(tolerance: float) -> Native:
        explicit = ["--set", "controller.integration_method=explicit"]
        return native(*explicit, "--set", f"controller.relative_tolerance={tolerance}")

    grid = [10.0**-k for k in range(4, 9)]
    tolerance = next((t for t in grid if difference(general(t).states(), expected) <= error), grid[-1])
    peer = general(tolerance)
    times = alternately(workshop.repeats, own.seconds, peer.seconds)
    errors = error, difference(peer.states(), expected)
    how = f"general explicit method, tolerance {tolerance:.0e}"
    return Row(f"{what}: closed form", times[0], 20, how, times[1], errors, (ALLOWED, ALLOWED))
