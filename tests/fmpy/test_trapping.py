"""Units as C source in hosts that trap floating-point exceptions, as TwinCAT's do: division by zero, invalid operations and
overflow end the program (`trapping.c`).

A commit tries some units, `tests/all` all of them, by each compiler and level.
"""

import platform
import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import pytest
import sample
from conftest import ROOT, adaptive_fmu

# A law with limits and a barrier, and a unit that need not sample.
SOME = ["FunnelNonlinearSiso", "Sensor"]
NAMES = sample.FMUS if sample.ALL else SOME
# Without its option clang computes quotients ahead of the branch that uses them.
TRAPPING_MATH = {"gcc": [], "clang": ["-ffp-exception-behavior=maytrap"]}
COMPILERS = [[compiler, level] for compiler in TRAPPING_MATH for level in ["-O0", "-O2"] if shutil.which(compiler)]
BUILDS = COMPILERS if sample.ALL else COMPILERS[1:2]

pytestmark = pytest.mark.skipif(
    platform.system() != "Linux" or platform.machine() != "x86_64" or not COMPILERS,
    reason="exceptions are trapped by functions of glibc, on x86-64",
)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sources of units, in folders of their names."""
    folder = tmp_path_factory.mktemp("sources")
    exported = adaptive_fmu("export", "--source-only", *NAMES, "--out", folder)
    assert exported.returncode == 0, exported.stderr
    for name in NAMES:
        zipfile.ZipFile(folder / f"{name}.fmu").extractall(folder / name)
    return folder


def started(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize("form", ["unit", "law"])
@pytest.mark.parametrize("build", BUILDS, ids=" ".join)
@pytest.mark.parametrize("name", NAMES)
def test_no_exception_is_raised_from_the_start_and_from_random_states(name, build, form, sources, tmp_path) -> None:
    program = tmp_path / "trapping"
    defines = ["-DLAW"] if form == "law" else []
    flags = [*build, *TRAPPING_MATH[build[0]], "-std=c99", "-g", "-ffp-contract=off", "-no-pie", *defines, "-I", sources / name / "sources"]
    compiled = subprocess.run(
        [*flags, ROOT / "tests/fmpy/trapping.c", "-o", program, "-lm"], capture_output=True, text=True, check=False
    )
    assert compiled.returncode == 0, compiled.stderr
    step = fmpy.read_model_description(str(sources / name)).defaultExperiment.stepSize
    ran = started(program, step)
    where = ran.stderr.split(" at ")[-1].strip()
    line = subprocess.run(["addr2line", "-fe", program, where], capture_output=True, text=True, check=False).stdout
    assert ran.returncode == 0, f"{ran.stderr}{line}"
    # A point that is refused shows nothing. A unit refuses most of those at states of a million nominal values.
    assert int(ran.stdout.split()[0]) >= (48 if form == "law" else 120), ran.stdout
    # A unit computes as it always does, however its host rounds.
    assert form == "law" or started(program, step, "downward").stdout == ran.stdout
