"""Each master with one unit alone: how far its outputs are from those of plain calls at the very same times."""

import subprocess
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
from drive import Drive, by_plain_calls, by_plain_exchange, drive, grid, untouched
from master import Fmu, Loop, duration
from masters import RECORDED, TOLERANCE, in_process, largest, points

ROOT = Path(__file__).resolve().parents[2]
IMPORTER = ROOT / "target" / "rust_importer" / "debug" / "rust-importer"
# Between two solvers, of which CVode's relative tolerance is 1e-10 and that of the unit 1e-9.
SOLVERS = 1e-6
# CVode starts anew at each change of inputs, and takes 500 steps at most from one output to the next.
CHANGES, OUTPUTS = 25, 20


def fmpy_co_simulation(fmu: Fmu, count: int, _: Path) -> tuple[float, float]:
    """FMPy's own master."""
    of = drive(fmu, count)
    expected = by_plain_calls(of, *grid(of))
    return largest(_simulated(of, fmi_type="CoSimulation"), expected), TOLERANCE


def fmpy_model_exchange(fmu: Fmu, _count: int, _: Path) -> tuple[float, float]:
    """FMPy with CVode, beside co-simulation by an accurate general method, midway between changes of the inputs."""
    # A part of a swing: no plant answers, and the more inputs move the faster an adaptation turns.
    of = drive(fmu, 40 * CHANGES)
    # Truth values stay as they are: FMPy would set them in Continuous-Time Mode, too, which the standard forbids.
    reals = [i for i, name in enumerate(of.inputs) if of.kind(name) == "Real"]
    rows = np.repeat(of.rows[:CHANGES, reals], 2, axis=0)
    step = duration(fmu, of.typed(of.first)) / (2 * CHANGES + 0.37)
    of = replace(of, step=step, count=2 * CHANGES, inputs=[of.inputs[i] for i in reals], rows=rows)
    # By a general method, whose tolerance that is.
    general = {"relative_tolerance": 1e-9, "integration_method": 2.0}
    accurate = general if "relative_tolerance" in fmu.variables else {}
    expected = by_plain_calls(replace(of, parameters=of.parameters | accurate), *grid(of))
    cvode = {"solver": "CVode", "relative_tolerance": 1e-10, "output_interval": step / OUTPUTS}
    found = _simulated(of, fmi_type="ModelExchange", **cvode)
    # What is not continuous jumps where each solver places it.
    names = [name for name in of.outputs if fmu.variables[name].variability == "continuous"]
    middle = [Loop(loop.time[1::2], {name: loop[name][1::2] for name in names}) for loop in (found, expected)]
    return largest(*middle), SOLVERS


def _simulated(of: Drive, **options: object) -> Loop:
    """In FMPy; at a time at which inputs jump, outputs are those before the jump."""
    times, _ = grid(of)
    kinds = [np.bool_ if of.kind(name) == "Boolean" else np.float64 for name in of.inputs]
    table = np.zeros(2 * of.count, dtype=[("time", float), *zip(of.inputs, kinds, strict=True)])
    table["time"][0::2], table["time"][1::2] = times[:-1], times[1:]
    for name, column in zip(of.inputs, of.rows.T, strict=True):
        table[name] = np.repeat(column, 2)
    recorded = fmpy.simulate_fmu(
        str(of.fmu.folder),
        model_description=of.fmu.description,
        stop_time=float(times[-1]),
        output=list(of.outputs),
        start_values=of.typed(of.start),
        input=table if of.inputs else None,
        **({"output_interval": of.step} | options),
    )
    recorded = recorded[np.searchsorted(recorded["time"], times - 1e-3 * of.step)]
    return Loop(recorded["time"], {name: recorded[name].astype(float) for name in of.outputs})


def ecos(fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    """ecos."""
    return _elsewhere("ecos", fmu, count, folder)


def libcosim(fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    """libcosim."""
    return _elsewhere("libcosim", fmu, count, folder)


def _elsewhere(master: str, fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    of = drive(fmu, count, enumerations=False)
    outputs = {name: kind for name, kind in of.outputs.items() if kind in RECORDED[master]}
    start = of.typed(of.start)
    inputs = {name: of.kind(name) for name in of.inputs}
    task = [str(fmu.path), of.step, start, inputs, of.rows.tolist(), outputs]
    expected = by_plain_calls(of, *points(master, of.step, count))
    return largest(in_process(master, "unit", task, folder), expected), TOLERANCE


def rust_co_simulation(fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    """The crate fmi."""
    of = drive(fmu, count)
    return largest(_in_rust(of, "co-simulation", folder), by_plain_calls(of, *grid(of))), TOLERANCE


def rust_model_exchange(fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    """The crate fmi with Euler's steps, beside the same by plain calls."""
    # Euler's steps have to be shorter than the fastest adaptation.
    of = drive(fmu, count, 1e-7 if "adaptation_frequency" in fmu.variables else 1e-5)
    return largest(_in_rust(of, "model-exchange", folder), by_plain_exchange(of)), TOLERANCE


def rust_untouched(fmu: Fmu, interface: str, folder: Path) -> Loop:
    """The crate fmi with nothing set and nothing connected; what its outputs do."""
    return _in_rust(untouched(fmu, 1e-4), interface, folder)


def _in_rust(of: Drive, interface: str, folder: Path) -> Loop:
    assert IMPORTER.is_file(), f"{IMPORTER.relative_to(ROOT)} is not built"
    times, steps = grid(of)
    start, given = folder / "start.tsv", folder / "points.tsv"
    start.write_text("".join(f"{name}\t{number!r}\n" for name, number in of.start.items()))
    rows = np.column_stack([times[:-1], steps, of.rows]).tolist()
    lines = [["time", "step", *of.inputs], *([repr(number) for number in row] for row in rows)]
    given.write_text("".join("\t".join(line) + "\n" for line in lines))
    command = [str(IMPORTER), interface, str(of.fmu.path), str(start), str(given)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    names, *printed = [line.split("\t") for line in done.stdout.splitlines()] or [[]]
    assert len(printed) == of.count + 1, f"{len(printed)} of {of.count + 1} rows: {done.stderr.strip()}"
    columns = np.array(printed, dtype=float).T
    assert names == list(of.outputs), names
    return Loop(times, dict(zip(names, columns, strict=True)))
