"""What units cost by themselves: steps, lifetimes of instances, loading, export."""

import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from machine import MY_PLANT, PROGRAM, ROOT, Workshop, timed
from master import Fmu
from table import Row, alternately

HORIZON = 10.0  # s, after which Van der Pol's oscillator is compared with its solution
ALLOWED = 1e-6
EULER = 1e-7  # s, of which Euler's method needs steps to be as accurate as that
SIZES = (4, 8, 16, 32, 60)
LIFETIMES = 20
REFERENCE_FMUS = "REFERENCE_FMUS"  # names the folder of their sources, github.com/modelica/Reference-FMUs
COMPILER = subprocess.run(["cc", "-dumpfullversion"], capture_output=True, text=True, check=True).stdout.strip()


@dataclass
class Driven:
    """What the master in C measured, s, and the outputs that it was asked for."""

    load: float
    lifetime: float
    step: float
    outputs: np.ndarray


class Driver:
    """The master in C, and units as it takes them: library, GUID and resources."""

    def __init__(self, workshop: Workshop) -> None:
        self.workshop, self.program = workshop, workshop.compile("unit.c", "-ldl")

    def ours(self, path: Path) -> tuple[Fmu, list[str]]:
        """An FMU, and the words by which the master in C finds it."""
        fmu = Fmu(path, self.workshop.folder / "unpacked" / path.parent.name / path.stem)
        identifier = fmu.description.coSimulation.modelIdentifier
        library = fmu.folder / "binaries" / "linux64" / f"{identifier}.so"
        return fmu, [str(library), fmu.description.guid, f"file://{fmu.folder}/resources"]

    def drive(
        self,
        unit: list[str],
        step: float,
        check: int,
        count: int,
        outputs: list[int],
        inputs: dict[int, float] | None = None,
        choices: dict[int, int] | None = None,
    ) -> Driven:
        """Steps a unit `check` times, reads its outputs, and measures `count` more steps; or lives, without steps."""
        lifetimes = 0 if count else LIFETIMES
        given = [f"{reference}={value}" for reference, value in (inputs or {}).items()]
        given += [f"{reference}:{item}" for reference, item in (choices or {}).items()]
        words = [*map(str, (lifetimes, step, check, count)), ",".join(map(str, outputs)), *given]
        command = [str(self.program), *unit, *words]
        lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
        return Driven(*map(float, lines[:3]), np.array(lines[3].split(","), float))


def oscillator() -> np.ndarray:
    """The solution of Van der Pol's equation at HORIZON, by many small Runge-Kutta steps."""
    x, h = np.array([2.0, 0.0]), 5e-4
    rate = lambda x: np.array([x[1], (1 - x[0] ** 2) * x[1] - x[0]])  # noqa: E731
    for _ in range(round(HORIZON / h)):
        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3))
    return x


@dataclass
class Euler:
    """Van der Pol's oscillator in C, by steps of Euler's method of a length; how many steps are timed."""

    step: float
    how: str
    timed: int = 1_000_000

    def peer(self, workshop: Workshop) -> tuple[list[str], list[int]]:
        """The words by which the master in C finds it, and the places of its outputs."""
        return [str(workshop.compile("van_der_pol.c", "-lm", f"-DSTEP={self.step}", shared=True)), "-", "-"], [1, 3]

    def against(self, workshop: Workshop, file: Path, step: float, goal: float, what: str = "") -> Row:
        """It and an FMU, alternately."""
        driver, exact, found = Driver(workshop), oscillator(), dict[str, Driven]()
        fmu, unit = driver.ours(file)
        places = [fmu.variables[f"x[{i}]"].valueReference for i in (1, 2)]
        peer, outputs = self.peer(workshop)

        def run(name: str, unit: list[str], places: list[int], count: int) -> float:
            found[name] = driver.drive(unit, step, round(HORIZON / step), workshop.long(count), places)
            return found[name].step

        own = partial(run, "ours", unit, places, 1_000_000)
        times = alternately(workshop.repeats, own, partial(run, "peer", peer, outputs, self.timed))
        errors = tuple(float(np.abs(found[name].outputs - exact).max()) for name in ("ours", "peer"))
        allowed = (ALLOWED, ALLOWED if self.step == EULER else math.inf)
        title = f"Van der Pol, a step of {step * 1e3:g} ms{what}"
        return Row(title, times[0], goal, f"C (gcc {COMPILER}), {self.how}", times[1], errors, allowed)


@dataclass
class Reference(Euler):
    """The unit of the same name of Reference-FMUs, which takes one step of Euler's method each 10 ms."""

    sources: Path = Path()

    def peer(self, workshop: Workshop) -> tuple[list[str], list[int]]:
        model, common = self.sources / "VanDerPol", self.sources / "src"
        others = [str(common / file) for file in ("fmi2Functions.c", "cosimulation.c")]
        options = ["-DFMI_VERSION=2", "-DDISABLE_PREFIX", f"-I{self.sources / 'include'}", f"-I{model}", "-lm"]
        library = workshop.compile(str(model / "model.c"), *options, shared=True, others=others)
        token = re.search(r'INSTANTIATION_TOKEN "(.*)"', (model / "config.h").read_text())
        return [str(library), token[1], "file:///"], [1, 3]


def against_reference(workshop: Workshop, file: Path, what: str = "") -> list[Row]:
    """Against the unit of Reference-FMUs, where its sources are there."""
    if not (sources := os.environ.get(REFERENCE_FMUS)):
        message = f"rows against Reference-FMUs are left out: let {REFERENCE_FMUS} name a folder of its sources"
        print(message, file=sys.stderr)
        return []
    unit = Reference(1e-2, "Reference-FMUs' unit, one Euler step", sources=Path(sources))
    return [unit.against(workshop, file, 1e-2, 2 / 3, what)]


REFINED = Euler(EULER, f"Euler steps of {EULER:.0e} s, as accurate as {ALLOWED:.0e}", 2_000)


def van_der_pol(workshop: Workshop) -> list[Row]:
    """Against a unit in C: with one Euler step a communication step, and with steps as short as accuracy asks."""
    file = workshop.export(ROOT / "examples" / "my_plant" / "VanDerPol.toml", "--library", MY_PLANT)
    return against_reference(workshop, file) + [
        row
        for step in (1e-2, 1e-3)
        for row in (
            Euler(step, "one Euler step").against(workshop, file, step, 2 / 3),
            REFINED.against(workshop, file, step, 2500),
        )
    ]


def lifetimes(workshop: Workshop) -> list[Row]:
    """Lives and loading of all FMUs, of which the slowest counts."""
    driver, names = Driver(workshop), sorted(file.stem for file in (ROOT / "modelDescription").glob("*.toml"))
    measured: dict[str, list[Driven]] = {}
    for name in names:
        fmu, unit = driver.ours(workshop.fmus / f"{name}.fmu")
        output = [fmu.variables[fmu.named(causality="output", type="Real")[0]].valueReference]
        measured[name] = [driver.drive(unit, 1e-3, 0, 0, output) for _ in range(workshop.repeats)]

    def slowest(what: str, goal: float, figure: Callable[[Driven], float]) -> Row:
        worst = max(names, key=lambda name: median(map(figure, measured[name])))
        return Row(f"{what}, the slowest of {len(names)} FMUs: {worst}", list(map(figure, measured[worst])), goal)

    return [
        slowest("instance made, initialised, terminated, freed", 1e-4, lambda driven: driven.lifetime),
        slowest("library loaded", 5e-3, lambda driven: driven.load),
    ]


def exports(workshop: Workshop) -> list[Row]:
    """The program's `export`, from start to end."""
    one, every = (
        [timed([PROGRAM, "export", *what, "--out", workshop.folder / "exported"]) for _ in range(workshop.repeats)]
        for what in (["L1MaresAuv"], ["--all"])
    )
    return [Row("`export L1MaresAuv`", one, 0.1), Row("`export --all`", every, 3.0)]


def all_loops(workshop: Workshop) -> Row:
    """The program's `run --all`."""
    until = ["--until", "0.1"] if workshop.quick else []
    command = [PROGRAM, "run", "--all", "--fmus", workshop.fmus, "--out", workshop.folder / "results", *until]
    return Row("`run --all`", [timed(command, codes=(0, 3)) for _ in range(workshop.repeats)], 4.0)


def chains(n: int) -> tuple[list[list[float]], list[list[float]], list[list[float]]]:
    """A, B and C of n/2 double integrators."""
    m = n // 2
    return np.eye(n, k=m).tolist(), np.eye(n, m, k=-m).tolist(), np.eye(m, n).tolist()


def l1_text(n: int) -> str:
    """The description of an L1 controller for them, of the kind of the robot's."""
    a, b, c = chains(n)
    m = n // 2
    start = {
        "adaptation_gain": 1e4,
        "feedback_gain": (20 * np.eye(m)).tolist(),
        "pole_real": [-20.0, -30.0] * m,
        "pole_imag": [0.0] * n,
        "omega_min": [0.5] * m,
        "omega_max": [3.0] * m,
        "theta_bound": [10.0] * m,
        "sigma_bound": [10.0] * m,
    }
    values = "".join(f"{name} = {value}\n" for name, value in start.items())
    return (
        f'name = "L1Of{n}"\nmodel = "l1"\ndescription = "L1 controller of {n} states"\n\n[structure]\nA = {a}\n'
        f'B = {b}\nC = {c}\nregressor = "infinity_norm"\ninput_gain = "diagonal"\nbaseline = "outside"\n\n'
        f"[start]\n{values}"
    )


def plant_text(n: int) -> str:
    """The description of a damped linear plant of that size whose matrix is full."""
    a = (-np.eye(n) + 0.5 / n * np.sin(np.arange(n * n).reshape(n, n))).tolist()
    b, c = np.ones((n, 1)).tolist(), np.eye(1, n).tolist()
    return (
        f'name = "PlantOf{n}"\nmodel = "state-space"\ndescription = "Linear plant of {n} states"\n\n[structure]\n'
        f"A = {a}\nB = {b}\nC = {c}\n"
    )


def growth(workshop: Workshop) -> list[Row]:
    """The exponent by which a step of 1 ms grows with the number of states: the slope in logarithms."""
    return [
        grown(workshop, "L1 controller", "L1Of{}", l1_text, {"r[1]": 0.1, "x[1]": 0.05}),
        grown(workshop, "state-space plant", "PlantOf{}", plant_text, {"u[1]": 1.0}),
    ]


def grown(workshop: Workshop, what: str, name: str, text: Callable[[int], str], inputs: dict[str, float]) -> Row:
    driver, steps, exponents = Driver(workshop), [], []
    sizes = SIZES[:3] if workshop.quick else SIZES
    for n in sizes:
        file = workshop.folder / f"{name.format(n)}.toml"
        file.write_text(text(n))
        fmu, unit = driver.ours(workshop.export(file))
        reference = lambda name, fmu=fmu: fmu.variables[name].valueReference  # noqa: E731
        outputs = [reference(name) for name in fmu.named(causality="output", type="Real")]
        given = {reference(name): value for name, value in inputs.items()}
        steps.append(partial(driver.drive, unit, 1e-3, 100, workshop.long(200_000 // n), outputs, given))
    for _ in range(workshop.repeats):
        times = [step().step for step in steps]
        exponents.append(float(np.polyfit(np.log(sizes), np.log(times), 1)[0]))
    title = f"exponent of a step's cost in the number of states ({sizes[0]} … {sizes[-1]}), {what}"
    return Row(title, exponents, 2.0, show="{:.2f}".format)

