"""Each master with a packed loop: how far its signals are from those in FMPy at the very same times."""

import json
from pathlib import Path

from conftest import adaptive_fmu, read_csv
from master import Loop
from masters import RECORDED, TOLERANCE, in_fmpy, largest, points, run_in, steps_of
from package import Package


def pack(out: Path, *loops: str | Path, form: str = "") -> list[Path]:
    """Loops as .ssp files, by the command that a user has; their units in a form."""
    words = [word for loop in loops for word in ("--ssp", loop)] + [form] * bool(form)
    packed = adaptive_fmu("export", *words, "--out", out, "--json")
    # Nothing that another master would leave out.
    assert (packed.returncode, packed.stderr) == (0, ""), packed
    return [Path(file) for file in json.loads(packed.stdout)["ssps"]]


def in_fmpy_and_by_the_program(package: Package, count: int, folder: Path) -> tuple[float, float]:
    """FMPy, beside the loop that the program runs with the units of the package."""
    times, steps = points("FMPy", package.step, steps_of(package, count))
    until, fmus = repr(float(times[-1])), package.folder / "resources"
    options = ["--order", "jacobi", "--until", until, "--fmus", fmus, "--out", folder, "--json"]
    answer = adaptive_fmu("run", package.path.stem, *options)
    assert answer.returncode in (0, 3), answer.stderr
    rows = read_csv(Path(json.loads(answer.stdout)["results"]) / "result.csv")
    expected = Loop(rows["time"], {signal: rows[signal] for signal in package.outputs("Real", "Integer", "Boolean")})
    return largest(package.run(times, steps, "jacobi"), expected), TOLERANCE


def ecos(package: Package, count: int, folder: Path) -> tuple[float, float]:
    """ecos."""
    return _elsewhere("ecos", package, count, folder)


def libcosim(package: Package, count: int, folder: Path) -> tuple[float, float]:
    """libcosim."""
    return _elsewhere("libcosim", package, count, folder)


def _elsewhere(master: str, package: Package, count: int, folder: Path) -> tuple[float, float]:
    recorded = run_in(master, package, steps_of(package, count), folder)
    assert set(recorded.signals) == set(package.outputs(*RECORDED[master]))
    return largest(recorded, in_fmpy(package, master, "jacobi", count)), TOLERANCE
