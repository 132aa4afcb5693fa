"""Other masters than FMPy: each runs a packaged closed loop (an .ssp file) in a process of its own.

A process, because these masters end it where others report an error, and because ecos finds its threading library
by the environment that a process starts with. What a run is worth is seen by its values, never by its exit code.
"""

import os
import subprocess
import sys
from importlib.metadata import files
from pathlib import Path

import numpy as np
from master import OUTPUTS, Loop

NAMES = [(component, output) for component, outputs in OUTPUTS.items() for output in outputs]
PARAMETER_SET = "parameters"
TIMEOUT = 60.0


def run_in(master: str, package: Path, step: float, count: int, folder: Path) -> Loop:
    """The loop after 0 to `count` steps; `folder` takes what the master leaves behind."""
    threads = next(file for file in files("tbb") if file.name == "libtbb.so.12").locate().resolve().parent
    libraries = os.pathsep.join(filter(None, [str(threads), os.environ.get("LD_LIBRARY_PATH")]))
    environment = {**os.environ, "LD_LIBRARY_PATH": libraries, "TMPDIR": str(folder)}
    result = folder / f"{master}.npy"
    command = [sys.executable, __file__, master, str(package), repr(step), str(count), str(result)]
    options = {"capture_output": True, "text": True, "timeout": TIMEOUT, "check": False}
    done = subprocess.run(command, env=environment, cwd=folder, **options)
    assert result.is_file(), f"{master}: {done.stdout}{done.stderr}"
    rows = np.load(result)
    return Loop(rows[:, 0], rows[:, 1], rows[:, 2:4], rows[:, 4], rows[:, 5])


def ecos(package: str, step: float, count: int) -> np.ndarray:
    """Time and outputs at every communication point in ecos."""
    from ecospy import EcosSimulation

    with EcosSimulation(step_size=step, ssp_path=package) as simulation:
        # Parameters are taken over only from a set that is asked for by its name.
        simulation.init(parameter_set=PARAMETER_SET)
        rows = []
        for k in range(count + 1):
            if k > 0:
                simulation.step()
            values = [simulation.get_real(f"{component}::{output}") for component, output in NAMES]
            rows.append([simulation.get_time(), *values])
        return np.array(rows)


def libcosim(package: str, step: float, count: int) -> np.ndarray:
    """Time and outputs at every communication point in libcosim."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(package, round(step * 1e9))
    observer = CosimObserver.create_time_series()
    execution.add_observer(observer)
    slaves = {info.name.decode(): info.index for info in execution.slave_infos()}
    observed = []
    for component, output in NAMES:
        slave = slaves[component]
        reference = next(v.reference for v in execution.slave_variables(slave) if v.name.decode() == output)
        observer.start_time_series(slave, reference, CosimVariableType.REAL)
        observed.append((slave, reference))
    # A step more than is asked for: the reader of samples leaves out the last one where it gives that of step 0.
    execution.step(count + 1)
    series = [observer.time_series_real_samples(*which, from_step=0, sample_count=count + 2) for which in observed]
    return np.column_stack([np.array(series[0][0]) * 1e-9, *(values for _, _, values in series)])


if __name__ == "__main__":
    master, package, step, count, result = sys.argv[1:]
    np.save(result, {"ecos": ecos, "libcosim": libcosim}[master](package, float(step), int(count)))
