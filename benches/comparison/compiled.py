"""Units and whole loops that are compiled from their C sources, against the generic form by the same method."""

from functools import partial
from pathlib import Path

from machine import MY_PLANT, ROOT, Workshop, program, run_json
from steps import REFINED, Driven, Driver, Euler, against_reference
from table import Row, alternately

# Controllers, and what they read in the middle of their loops; what isn't named is 0.
CONTROLLERS = {
    "L1NonlinearSiso": {"r[1]": 0.9, "x[1]": 0.88, "x[2]": 0.1},
    "L1TwoLinkRobot": {"r[1]": 0.9, "r[2]": 0.4, "x[1]": 0.88, "x[2]": 0.41, "x[3]": 0.1, "x[4]": -0.1},
    "L1Quadrotor": {"r[3]": 1.0, "x[7]": 0.05, "x[8]": -0.05, "x[9]": 0.1},
    "L1MaresAuv": {"r[1]": 0.1, "x[1]": 0.08, "x[7]": 0.2},
    "L1UnmatchedMimo": {"r[1]": 0.9, "x[1]": 0.88, "x[2]": 0.1},
    "L1TwinRotor": {"r[1]": 0.3, "x[1]": 0.28, "x[3]": 0.1},
}
WHOLE_LOOPS = ["3.2.1-cosine", "3.3.1-case1", "3.3.2-case1", "3.3.3", "3.4.2", "7.5.3-case1"]
SEPARATE = {"3.2.1-cosine": "NonlinearSiso", "3.3.1-case1": "TwoLinkRobot", "3.3.2-case1": "Quadrotor"}
METHODS = {"explicit": 2, "stiff": 3}
STEP = 1e-3
GOAL = 4.0  # times as fast as the generic form
ALLOWED = 0.01  # of a metric: the generic form has one more method that it may choose


def folders(workshop: Workshop, *words: str | Path) -> list[Path]:
    """Folders with the same FMUs in both forms."""
    found = [workshop.folder / "generic", workshop.folder / "compiled"]
    for folder, form in zip(found, ([], ["--compile"]), strict=True):
        program("export", *form, *words, "--out", folder)
    return found


def some(workshop: Workshop, cases: list[str]) -> list[str]:
    """All of them, or the first in a quick run."""
    return cases[:1] if workshop.quick else cases


def steps_of(workshop: Workshop, what: str, files: list[Path], inputs: dict[str, float], method: str) -> Row:
    """A step of both forms, alternately; how far their outputs are apart after some of them."""
    driver, last = Driver(workshop), dict[Path, Driven]()

    def run(file: Path) -> float:
        fmu, unit = driver.ours(file)
        reference = lambda name: fmu.variables[name].valueReference  # noqa: E731
        outputs = [reference(name) for name in fmu.named(causality="output", type="Real")]
        given = {reference(name): value for name, value in inputs.items()}
        choices = {reference("integration_method"): METHODS[method]}
        last[file] = driver.drive(unit, STEP, 100, workshop.long(2000), outputs, given, choices)
        return last[file].step

    generic, compiled = alternately(workshop.repeats, *(partial(run, file) for file in files))
    apart = float(abs(last[files[0]].outputs - last[files[1]].outputs).max())
    return Row(f"a step of {what}, {method}, compiled", compiled, GOAL, "the generic form", generic, (apart,), (0.0,))


def controllers(workshop: Workshop) -> list[Row]:
    """L1 controllers alone, with what they read in their loops."""
    names = some(workshop, list(CONTROLLERS))
    both = folders(workshop, *names)
    return [
        steps_of(workshop, name, [folder / f"{name}.fmu" for folder in both], CONTROLLERS[name], "explicit")
        for name in names
    ]


def composites(workshop: Workshop) -> list[Row]:
    """Whole loops as one unit, by both methods."""
    loops = some(workshop, WHOLE_LOOPS)
    both = folders(workshop, *(word for loop in loops for word in ("--composite", loop)))
    return [
        steps_of(workshop, f"{loop} as a single FMU", [folder / f"{name}.fmu" for folder in both], {}, method)
        for loop in loops
        for name in [f"Loop_{loop.replace('.', '_').replace('-', '_')}"]
        for method in METHODS
    ]


def separate_units(workshop: Workshop) -> list[Row]:
    """`run` of loops whose units are compiled, by their own methods."""
    loops = some(workshop, list(SEPARATE))
    both = folders(workshop, *(prefix + SEPARATE[loop] for loop in loops for prefix in ("", "L1", "Reference")))

    ended = dict[Path, dict]()

    def seconds(loop: str, folder: Path) -> float:
        out = workshop.folder / "separate" / folder.name
        ended[folder] = run_json("run", loop, "--until", workshop.stop, "--fmus", folder, "--in-process", "--out", out)
        return ended[folder]["seconds"]

    rows = []
    for loop in loops:
        generic, compiled = alternately(workshop.repeats, *(partial(seconds, loop, folder) for folder in both))
        metrics = [[m["value"] for m in ended[folder]["metrics"] if m["value"] is not None] for folder in both]
        apart = max(abs(a - b) / abs(a) for a, b in zip(*metrics, strict=True))
        what = f"`run {loop}`, {workshop.stop:g} s, compiled units"
        rows.append(Row(what, compiled, GOAL, "generic units", generic, (apart,), (ALLOWED,)))
    return rows


def van_der_pol(workshop: Workshop) -> list[Row]:
    """A model in Rust, compiled from C sources, against a unit in C with one Euler step a communication step."""
    description = ROOT / "examples" / "my_plant" / "VanDerPol.toml"
    folder = workshop.folder / "compiled"
    program("export", "--compile", description, "--library", MY_PLANT, "--out", folder)
    file = folder / "VanDerPol.fmu"
    return against_reference(workshop, file, ", compiled") + [
        row
        for step in (1e-2, 1e-3)
        for row in (
            Euler(step, "one Euler step").against(workshop, file, step, 2 / 3, ", compiled"),
            REFINED.against(workshop, file, step, 2500, ", compiled"),
        )
    ]
