"""fmusim, the simulator of the FMI project, with a unit of FMI 2.0 and with the same of FMI 3.0.

Its options follow the help of fmusim 0.0.39. Its CVode continues past an input that jumps: in model exchange
inputs stay as they are.
"""

import csv
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from conftest import adaptive_fmu
from drive import Drive, by_plain_calls, drive, grid
from master import Fmu, Loop, duration
from master3 import Fmu3, Unit3
from masters import TOLERANCE, largest
from programs import run
from units import SOLVERS

FMUSIM = "fmusim"
# Times that differ by no more than this, in s, are one for it.
SAME = 1e-5
# Variables by their names, and the names that their elements have in FMI 2.0.
Elements = dict[str, list[str]]


def co_simulation(fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    """Both versions, and FMI 3.0 in Event Mode, with inputs that jump before every step."""
    of, new = drive(fmu, count), _of_fmi_3(fmu, folder)
    plain, by_events = by_plain_calls(of, *grid(of)), _by_event_mode(of, new)
    single = {name: [name] for name in fmu.variables}
    events = ["--event-mode-used", "--early-return-allowed"]
    runs = [(fmu.path, single, [], plain), (new.file, new.elements, [], plain), (new.file, new.elements, events, by_events)]
    found = [largest(_simulated(of, file, names, folder, "cs", *more), expected) for file, names, more, expected in runs]
    return float(np.max(found)), TOLERANCE


def model_exchange(fmu: Fmu, count: int, folder: Path) -> tuple[float, float]:
    """Both versions with inputs that stay as they are, beside co-simulation by an accurate general method."""
    of, new = drive(fmu, count), _of_fmi_3(fmu, folder)
    whole = duration(fmu, of.typed(of.first))
    # CVode takes 500 steps at most from one output to the next.
    step = max(whole / 200, 4 * SAME)
    count = int(whole / step)
    of = replace(of, step=step, count=count, parameters=of.start, inputs=[], rows=np.zeros((count, 0)))
    general = {"relative_tolerance": 1e-9, "integration_method": 2.0} if "relative_tolerance" in fmu.variables else {}
    expected = by_plain_calls(replace(of, parameters=of.parameters | general), *grid(of))
    files = [(fmu.path, {name: [name] for name in fmu.variables}), (new.file, new.elements)]
    cvode = ["--solver", "cvode", "--tolerance", 1e-10]
    found = [_simulated(of, file, names, folder, "me", *cvode) for file, names in files]
    # What is not continuous jumps where each solver places it.
    names = [name for name in of.outputs if fmu.variables[name].variability == "continuous"]
    continuous = lambda loop: Loop(loop.time, {name: loop[name] for name in names})  # noqa: E731
    return max(largest(continuous(loop), continuous(expected)) for loop in found), SOLVERS


def _of_fmi_3(fmu: Fmu, folder: Path) -> Fmu3:
    exported = adaptive_fmu("export", "--fmi", "3", fmu.name, "--out", folder)
    assert exported.returncode == 0, exported.stderr
    return Fmu3(folder / f"{fmu.name}.fmu", folder / "unpacked")


def _by_event_mode(of: Drive, new: Fmu3) -> Loop:
    """Outputs in co-simulation before the event at each time, at which the next inputs are set."""
    times, steps = grid(of)
    rows = [of.typed(dict(zip(of.inputs, row, strict=True))) for row in of.rows.tolist()]
    with Unit3(new, event_mode=True, early_return=True) as unit:
        unit.put(of.typed(of.start))
        unit.start(**rows[0])
        unit.update()
        unit.instance.enterStepMode()
        read = lambda: [value for name in new.named(causality="output") for value in unit[name]]  # noqa: E731
        found = [read()]
        for time, step, inputs in zip(times[:-1].tolist(), steps.tolist(), [*rows[1:], None], strict=True):
            begin, end = time, time + step
            while begin < end:
                needed, _, early, reached = unit.instance.doStep(begin, end - begin)
                begin = reached if early else end
                jumps = inputs is not None and begin == end
                if begin == end:
                    found.append(read())
                if needed or jumps:
                    unit.instance.enterEventMode()
                    unit.put(inputs if jumps else {})
                    unit.update()
                    unit.instance.enterStepMode()
    names = [one for name in new.named(causality="output") for one in new.elements[name]]
    return Loop(times, dict(zip(names, np.array(found, dtype=float).T, strict=True)))


def _simulated(of: Drive, file: Path, elements: Elements, folder: Path, interface: str, *options: object) -> Loop:
    """At an event outputs are those before it in co-simulation, in which inputs jump, and those after it in model exchange."""
    times, _ = grid(of)
    result = folder / "fmusim.csv"
    result.unlink(missing_ok=True)
    words = ["--interface-type", interface, "--stop-time", repr(float(times[-1])), "--output-interval", repr(of.step)]
    for name, own in elements.items():
        if any(one in of.start for one in own):
            texts = [_text(of, one, of.start[one]) if one in of.start else of.fmu.variables[one].start for one in own]
            words += ["--start-value", name, " ".join(texts)]
    if of.inputs:
        words += ["--input-file", _table(of, elements, folder / "inputs.csv")]
    output = run(FMUSIM, *words, *options, "--output-file", result, file, folder=folder)
    assert result.is_file(), output[-300:]
    with result.open(newline="") as text:
        names, *rows = csv.reader(text)
    columns = {name: np.array([cells[k].split() for cells in rows], dtype=float) for k, name in enumerate(names)}
    reached = columns.pop("time")[:, 0]
    near = 1e-3 * of.step
    at = np.searchsorted(reached, times - near) if interface == "cs" else np.searchsorted(reached, times + near) - 1
    assert reached[-1] > times[-1] - near, f"ended at {reached[-1]} s of {times[-1]} s: {output[-200:]}"
    found = {one: columns[name][at, k] for name in columns for k, one in enumerate(elements[name])}
    return Loop(reached[at], found)


def _table(of: Drive, elements: Elements, file: Path) -> Path:
    """Inputs that stay from each point to the next."""
    times, _ = grid(of)
    own = {name: ones for name, ones in elements.items() if set(ones) <= set(of.inputs)}
    lines = [_line(f'"{name}"' for name in ["time", *own])]
    for start, end, row in zip(times[:-1].tolist(), times[1:].tolist(), of.rows.tolist(), strict=True):
        inputs = dict(zip(of.inputs, row, strict=True))
        cells = [" ".join(_text(of, one, inputs[one]) for one in ones) for ones in own.values()]
        lines += [_line([repr(time), *cells]) for time in (start, end)]
    file.write_text("".join(lines))
    return file


def _line(cells: Iterable[str]) -> str:
    return ",".join(cells) + "\n"


def _text(of: Drive, name: str, number: float) -> str:
    return repr(float(number)) if of.kind(name) == "Real" else str(int(number))
