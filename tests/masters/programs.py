"""Masters and checkers that are programs: fmutool and fmucontainer of the toolbox, and two that are used where found.

What OMSimulator and fmuCheck are told follows their documentation; fmuCheck has no maintainer any more.
"""

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import fmpy
import numpy as np
from drive import by_plain_calls, grid, resting
from master import FMICallException, Fmu, Loop
from masters import TOLERANCE, largest, points, steps_of
from package import Package

OMSIMULATOR, FMUCHECK = "OMSimulator", "fmuCheck.linux64"
TIMEOUT = 300.0


def run(program: str | Path, *arguments: object, folder: Path) -> str:
    """All that a program says; its exit code tells nothing that its results don't."""
    command = [str(program), *map(str, arguments)]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "timeout": TIMEOUT, "check": False}
    return subprocess.run(command, cwd=folder, **options).stdout


def toolbox(program: str) -> Path:
    """A program of the toolbox, beside this Python."""
    return Path(sys.executable).parent / program


def fmutool(fmu: Fmu, _count: int, folder: Path) -> str:
    """Schema and rules of the standard, as fmutool checks them."""
    printed = run(toolbox("fmutool"), "-input", fmu.path, "-check", folder=folder)
    complaints = [line for line in printed.splitlines() if line.startswith(("ERROR", "WARNING", "CRITICAL"))]
    assert not complaints, complaints[0]
    assert "compliant with FMI-2.0" in printed and "No semantic error" in printed, printed[-200:]
    return "ok"


def fmucontainer(package: Package, count: int, folder: Path) -> tuple[float, float]:
    """A loop as one FMU that holds the others: in FMPy, beside the loop in FMPy."""
    split = lambda name: name.split(".", 1)  # noqa: E731
    ends = [(*split(source), *split(target)) for source, target in package.connections]
    outputs = package.outputs("Real", "Integer", "Boolean")
    described = {
        "name": "whole.fmu",
        "step_size": package.step,
        "auto_link": False,
        "auto_input": False,
        "auto_output": False,
        "fmu": list(package.fmus),
        "path": {unit: str(fmu.path.resolve()) for unit, fmu in package.fmus.items()},
        "link": [list(end) for end in ends],
        # Names with a dot are those that it gives to what its links hand on.
        "output": [[*split(name), name.replace(".", "::", 1)] for name in outputs],
        "start": [[unit, value.name, value.value] for unit, value in package.values],
    }
    (folder / "whole.json").write_text(json.dumps(described))
    printed = run(toolbox("fmucontainer"), "-container", "whole.json", "-fmu-directory", folder, folder=folder)
    assert (folder / "whole.fmu").is_file(), printed[-300:]
    times, steps = points("fmucontainer", package.step, steps_of(package, count))
    recorded = fmpy.simulate_fmu(
        str(folder / "whole.fmu"), stop_time=float(times[-1]), output_interval=package.step, fmi_type="CoSimulation"
    )
    columns = {name: recorded[name.replace(".", "::", 1)].astype(float) for name in outputs}
    return largest(Loop(recorded["time"], columns), package.run(times, steps, "jacobi")), TOLERANCE


def fmucheck(fmu: Fmu, count: int, folder: Path) -> tuple[float, float] | str:
    """fmuCheck in co-simulation."""
    result = folder / "fmucheck.csv"

    def checked(step: float, stop: float) -> tuple[str, Path]:
        arguments = ["-k", "cs", "-n", 0, "-h", repr(step), "-s", repr(stop), "-o", result, fmu.path]
        return run(FMUCHECK, *arguments, folder=folder), result

    return _at_its_start_values(fmu, count, checked)


def omsimulator_unit(fmu: Fmu, count: int, folder: Path) -> tuple[float, float] | str:
    """OMSimulator with a unit alone."""
    simulated = lambda step, stop: _omsimulator(fmu.path, step, stop, folder, "--mode=cs")  # noqa: E731
    return _at_its_start_values(fmu, count, simulated)


def _at_its_start_values(
    fmu: Fmu, count: int, simulated: Callable[[float, float], tuple[str, Path]]
) -> tuple[float, float] | str:
    """A unit in a master that is told no values but those of the description."""
    of = resting(fmu, count)
    times, steps = grid(of)
    try:
        expected = by_plain_calls(of, times, steps)
    except FMICallException:
        return "needs values"
    printed, result = simulated(of.step, float(times[-1]))
    return largest(_read(result, of.outputs, printed), expected), TOLERANCE


def omsimulator_loop(package: Package, count: int, folder: Path) -> tuple[float, float]:
    """OMSimulator with a packed loop; it reads outputs again after it has set inputs."""
    times, steps = points("FMPy", package.step, steps_of(package, count))
    printed, result = _omsimulator(package.path, package.step, float(times[-1]), folder)
    found = _read(result, package.outputs("Real", "Integer", "Boolean"), printed)
    return largest(found, package.run(times, steps, "jacobi", read_again=True)), TOLERANCE


def _omsimulator(path: Path, step: float, stop: float, folder: Path, *options: str) -> tuple[str, Path]:
    result = folder / "omsimulator.csv"
    settings = [f"--resultFile={result}", f"--tempDir={folder}", f"--stepSize={step!r}", f"--stopTime={stop!r}"]
    settings += ["--startTime=0", f"--intervals={round(stop / step)}"]
    printed = run(OMSIMULATOR, *options, *settings, path, folder=folder)
    return printed, result


def _read(result: Path, outputs: Iterable[str], printed: str) -> Loop:
    """A table whose columns end in the names of the outputs."""
    assert result.is_file(), printed[-300:]
    with result.open(newline="") as text:
        names, *rows = csv.reader(text)
    numbers = {"true": 1.0, "false": 0.0}
    columns = np.array([[numbers[x] if x in numbers else float(x) for x in row] for row in rows if row]).T
    place = {output: next(i for i, name in enumerate(names) if _ends_in(name, output)) for output in outputs}
    return Loop(columns[0], {output: columns[i] for output, i in place.items()})


def _ends_in(name: str, output: str) -> bool:
    return name == output or name.endswith("." + output)


def found(program: str) -> bool:
    """Whether a program is on PATH."""
    return shutil.which(program) is not None
