"""Other masters than FMPy: each runs a packaged closed loop (an .ssp file) in a process of its own.

A process, because these masters end it where others report an error, and because ecos finds its threading library
by the environment that a process starts with. What a run is worth is seen by its values, never by its exit code.
"""

import json
import os
import subprocess
import sys
from importlib.metadata import files
from pathlib import Path

import numpy as np
from master import Loop
from package import Package

PARAMETER_SET = "parameters"
TIMEOUT = 60.0
# Types of outputs that each can record: libcosim keeps no history of truth values.
RECORDED = {"ecos": ["Real", "Integer", "Boolean"], "libcosim": ["Real", "Integer"]}
# Outputs by their names, unit.variable, each with its type.
Outputs = dict[str, str]
Rows = tuple[list[float], list[list[float]]]


def points(master: str, step: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Communication points and steps between them as units are told them: loops of high gain amplify a rounding error
    of 1e-19 s to 1e-6 of a control within a hundred steps."""
    if master == "ecos":  # adds up steps
        steps = np.full(count, step)
        return np.concatenate([[0.0], np.cumsum(steps)]), steps
    times = np.arange(count + 1) * round(step * 1e9) / 1e9  # counts nanoseconds
    return times, np.diff(times)


def run_in(master: str, package: Package, count: int, folder: Path, step: float | None = None) -> Loop:
    """The loop after 0 to `count` steps, its own or others; `folder` takes what the master leaves behind."""
    threads = next(file for file in files("tbb") if file.name == "libtbb.so.12").locate().resolve().parent
    libraries = os.pathsep.join(filter(None, [str(threads), os.environ.get("LD_LIBRARY_PATH")]))
    environment = {**os.environ, "LD_LIBRARY_PATH": libraries, "TMPDIR": str(folder)}
    outputs = {name: kind for kind in RECORDED[master] for name in package.outputs(kind)}
    result, task = folder / f"{master}.npz", folder / f"{master}.json"
    task.write_text(json.dumps([str(package.path), step or package.step, count, outputs]))
    command = [sys.executable, __file__, master, str(task), str(result)]
    options = {"capture_output": True, "text": True, "timeout": TIMEOUT, "check": False}
    done = subprocess.run(command, env=environment, cwd=folder, **options)
    assert result.is_file(), f"{master}: {done.stdout}{done.stderr}"
    with np.load(result) as recorded:
        return Loop(recorded["time"], dict(zip(outputs, recorded["columns"], strict=True)))


def ecos(path: str, step: float, count: int, outputs: Outputs) -> Rows:
    """Times and columns of outputs at every communication point in ecos."""
    from ecospy import EcosSimulation

    with EcosSimulation(step_size=step, ssp_path=path) as simulation:
        # Parameters are taken over only from a set that is asked for by its name.
        simulation.init(parameter_set=PARAMETER_SET)
        get = {"Real": simulation.get_real, "Integer": simulation.get_integer, "Boolean": simulation.get_bool}
        read = [(get[kind], name.replace(".", "::", 1)) for name, kind in outputs.items()]
        times, rows = [], []
        for k in range(count + 1):
            if k > 0:
                simulation.step()
            times.append(simulation.get_time())
            rows.append([float(of(name)) for of, name in read])
        return times, list(zip(*rows, strict=True))


def libcosim(path: str, step: float, count: int, outputs: Outputs) -> Rows:
    """Times and columns of outputs at every communication point in libcosim."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(path, round(step * 1e9))
    observer = CosimObserver.create_time_series()
    execution.add_observer(observer)
    slaves = {info.name.decode(): info.index for info in execution.slave_infos()}
    variables = {name: execution.slave_variables(slave) for name, slave in slaves.items()}
    samples = {"Real": observer.time_series_real_samples, "Integer": observer.time_series_integer_samples}
    observed = []
    for name, kind in outputs.items():
        unit, output = name.split(".", 1)
        which = slaves[unit], next(v.reference for v in variables[unit] if v.name.decode() == output)
        observer.start_time_series(*which, CosimVariableType[kind.upper()])
        observed.append((samples[kind], which))
    # A step more than is asked for: the reader of samples leaves out the last one where it gives that of step 0.
    execution.step(count + 1)
    series = [of(*which, from_step=0, sample_count=count + 2) for of, which in observed]
    return np.array(series[0][0]) / 1e9, [values for _, _, values in series]


if __name__ == "__main__":
    master, task, result = sys.argv[1:]
    times, columns = {"ecos": ecos, "libcosim": libcosim}[master](*json.loads(Path(task).read_text()))
    np.savez(result, time=np.array(times), columns=np.array(columns, dtype=float))
