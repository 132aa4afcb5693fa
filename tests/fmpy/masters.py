"""Other masters than FMPy: each runs a packaged closed loop (an .ssp file) or a unit alone in a process of its own.

A process, because these masters end it where others report an error, and because ecos finds its threading library
by the environment that a process starts with. What a run is worth is seen by its values, never by its exit code.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from importlib.metadata import files
from pathlib import Path

import numpy as np
from master import Loop
from package import Package

PARAMETER_SET = "parameters"
TIMEOUT = 60.0
# Allowed difference, of the largest magnitude of a signal, where that is above 1.
TOLERANCE = 1e-9
# Steps of a short run.
COUNT = 1000
# Types of outputs that each can record: libcosim keeps no history of truth values.
RECORDED = {"ecos": ["Real", "Integer", "Boolean"], "libcosim": ["Real", "Integer"]}
# Variables by their names (in a loop, unit.variable), each with its type.
Variables = dict[str, str]
# Start values by their names, and numbers as values of a type.
Values = dict[str, float | int | bool]
PYTHON = {"Real": float, "Integer": int, "Boolean": bool}
Rows = tuple[list[float], list[list[float]]]


def points(master: str, step: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Communication points and steps between them as units are told them: loops of high gain amplify a rounding error
    of 1e-19 s to 1e-6 of a control within a hundred steps."""
    multiples, alike = np.arange(count + 1), np.full(count, step)
    if master == "ecos":  # adds up steps
        return np.concatenate([[0.0], np.cumsum(alike)]), alike
    if master == "fmucontainer":  # multiplies, and tells all steps to be equal
        return step * multiples, alike
    # FMPy multiplies; libcosim counts nanoseconds.
    times = multiples * round(step * 1e9) / 1e9 if master == "libcosim" else step * multiples
    return times, np.diff(times)


def steps_of(package: Package, count: int = COUNT) -> int:
    """How many steps a short run has; it ends well before a failure that the loop is there to show."""
    return min(count, int(0.8 * package.fails_at / package.step)) if np.isfinite(package.fails_at) else count


def in_fmpy(package: Package, master: str, order: str, count: int = COUNT) -> Loop:
    """A short run in FMPy, at the times of a master.

    Both masters hand on all outputs in Initialization Mode, then step all units before they hand on any output. ecos
    reads the outputs once more after it has set the inputs.
    """
    return package.run(*points(master, package.step, steps_of(package, count)), order, read_again=master == "ecos")


def differences(found: Loop, expected: Loop) -> dict[str, float]:
    """Greatest difference of each signal and of the time."""
    assert len(found.time) == len(expected.time), f"{len(found.time)} of {len(expected.time)} communication points"
    scale = {name: max(1.0, np.abs(values).max()) for name, values in expected.signals.items()}
    of = {name: np.abs(values - expected[name]).max() / scale[name] for name, values in found.signals.items()}
    return of | {"time": np.abs(found.time - expected.time).max()}


def largest(found: Loop, expected: Loop) -> float:
    """The greatest of all differences; no number where any value is none."""
    return float(np.max(list(differences(found, expected).values())))


def run_in(master: str, package: Package, count: int, folder: Path, step: float | None = None) -> Loop:
    """The loop after 0 to `count` steps, its own or others; `folder` takes what the master leaves behind."""
    outputs = {name: kind for kind in RECORDED[master] for name in package.outputs(kind)}
    return in_process(master, "loop", [str(package.path), step or package.step, count, outputs], folder)


def in_process(master: str, what: str, task: list, folder: Path) -> Loop:
    """What a master records of a `loop` or a `unit`; the last entry of its task are the outputs."""
    threads = next(file for file in files("tbb") if file.name == "libtbb.so.12").locate().resolve().parent
    libraries = os.pathsep.join(filter(None, [str(threads), os.environ.get("LD_LIBRARY_PATH")]))
    environment = {**os.environ, "LD_LIBRARY_PATH": libraries, "TMPDIR": str(folder)}
    result, given = folder / f"{master}.npz", folder / f"{master}.json"
    given.write_text(json.dumps(task))
    command = [sys.executable, __file__, f"{master}_{what}", str(given), str(result)]
    options = {"capture_output": True, "text": True, "timeout": TIMEOUT, "check": False}
    done = subprocess.run(command, env=environment, cwd=folder, **options)
    assert result.is_file(), f"{master}: {done.stdout}{done.stderr}"
    with np.load(result) as recorded:
        return Loop(recorded["time"], dict(zip(task[-1], recorded["columns"], strict=True)))


def ecos_loop(path: str, step: float, count: int, outputs: Variables) -> Rows:
    """Times and columns of outputs at every communication point in ecos."""
    from ecospy import EcosSimulation

    with EcosSimulation(step_size=step, ssp_path=path) as simulation:
        # Parameters are taken over only from a set that is asked for by its name.
        simulation.init(parameter_set=PARAMETER_SET)
        named = {name.replace(".", "::", 1): kind for name, kind in outputs.items()}
        return _ecos_rows(simulation, named, [lambda: None] * count)


def ecos_unit(
    path: str, step: float, start: Values, inputs: Variables, rows: list[list[float]], outputs: Variables
) -> Rows:
    """The same of a unit that is handed its inputs before each step."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("unit", path)
    structure.add_parameter_set(PARAMETER_SET, {f"unit::{name}": value for name, value in start.items()})
    with EcosSimulation(step_size=step, structure=structure) as simulation:
        simulation.init(parameter_set=PARAMETER_SET)
        set_of = {"Real": simulation.set_real, "Integer": simulation.set_integer, "Boolean": simulation.set_bool}
        setters = [(set_of[kind], f"unit::{name}", PYTHON[kind]) for name, kind in inputs.items()]

        def hand(row: list[float]) -> None:
            for (to, name, number), value in zip(setters, row, strict=True):
                to(name, number(value))

        named = {f"unit::{name}": kind for name, kind in outputs.items()}
        return _ecos_rows(simulation, named, [partial(hand, row) for row in rows])


def _ecos_rows(simulation, outputs: Variables, before: list[Callable[[], None]]) -> Rows:
    """Steps it, each time after the call that belongs before that step."""
    get = {"Real": simulation.get_real, "Integer": simulation.get_integer, "Boolean": simulation.get_bool}
    read = lambda: [float(get[kind](name)) for name, kind in outputs.items()]  # noqa: E731
    times, rows = [simulation.get_time()], [read()]
    for prepare in before:
        prepare()
        simulation.step()
        times.append(simulation.get_time())
        rows.append(read())
    return times, list(zip(*rows, strict=True))


def libcosim_loop(path: str, step: float, count: int, outputs: Variables) -> Rows:
    """Times and columns of outputs at every communication point in libcosim."""
    from libcosimpy.CosimExecution import CosimExecution

    execution = CosimExecution.from_ssp_file(path, round(step * 1e9))
    slaves = {info.name.decode(): info.index for info in execution.slave_infos()}
    places = [(slaves[unit], output) for unit, output in (name.split(".", 1) for name in outputs)]
    series = _libcosim_series(execution, places, outputs)
    # A step more than is asked for: the reader of samples leaves out the last one where it gives that of step 0.
    execution.step(count + 1)
    return series(count)


def libcosim_unit(
    path: str, step: float, start: Values, inputs: Variables, rows: list[list[float]], outputs: Variables
) -> Rows:
    """The same of a unit that is handed its inputs before each step."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(step * 1e9))
    unit = execution.add_local_slave(CosimLocalSlave(path, "unit"))
    references = {v.name.decode(): v.reference for v in execution.slave_variables(unit)}
    initial = {
        float: execution.real_initial_value,
        int: execution.integer_initial_value,
        bool: execution.boolean_initial_value,
    }
    for name, value in start.items():
        assert initial[type(value)](unit, references[name], value), name
    series = _libcosim_series(execution, [(unit, name) for name in outputs], outputs)
    by_hand = CosimManipulator.create_override()
    execution.add_manipulator(by_hand)
    hand = {"Real": by_hand.slave_real_values, "Integer": by_hand.slave_integer_values}
    hand["Boolean"] = by_hand.slave_boolean_values
    # The last row again, for the step that is more than is asked for.
    for row in [*rows, rows[-1]]:
        for (name, kind), value in zip(inputs.items(), row, strict=True):
            assert hand[kind](unit, [references[name]], [PYTHON[kind](value)]), name
        execution.step()
    return series(len(rows))


def _libcosim_series(execution, places: list[tuple[int, str]], outputs: Variables) -> Callable[[int], Rows]:
    """Records outputs, each of a slave; gives their values after 0 to `count` steps."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimObserver import CosimObserver

    observer = CosimObserver.create_time_series()
    execution.add_observer(observer)
    variables = {slave: execution.slave_variables(slave) for slave, _ in places}
    samples = {"Real": observer.time_series_real_samples, "Integer": observer.time_series_integer_samples}
    observed = []
    for (slave, output), kind in zip(places, outputs.values(), strict=True):
        which = slave, next(v.reference for v in variables[slave] if v.name.decode() == output)
        observer.start_time_series(*which, CosimVariableType[kind.upper()])
        observed.append((samples[kind], which))

    def series(count: int) -> Rows:
        all_of = [of(*which, from_step=0, sample_count=count + 2) for of, which in observed]
        return np.array(all_of[0][0]) / 1e9, [values for _, _, values in all_of]

    return series


if __name__ == "__main__":
    run, task, result = sys.argv[1:]
    runs = {of.__name__: of for of in (ecos_loop, ecos_unit, libcosim_loop, libcosim_unit)}
    times, columns = runs[run](*json.loads(Path(task).read_text()))
    np.savez(result, time=np.array(times), columns=np.array(columns, dtype=float))
