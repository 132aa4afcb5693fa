"""Units as C source in hosts that trap floating-point exceptions, as TwinCAT's do: division by zero, invalid operations and
overflow end the program (`trapping.c`).

A commit tries some units, `tests/all` all of them, each by one of the compilers and levels in turn.
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
from laws import PLANTS, Law, kind

# A law with limits and a barrier, and what isn't a law.
SOME = ["FunnelNonlinearSiso", "Sensor"]
NAMES = sample.FMUS if sample.ALL else SOME
# Without its option clang computes quotients ahead of the branch that uses them.
TRAPPING_MATH = {"gcc": [], "clang": ["-ffp-exception-behavior=maytrap"]}
COMPILERS = [[compiler, level] for compiler in TRAPPING_MATH for level in ["-O0", "-O2"] if shutil.which(compiler)]
BUILDS = COMPILERS if sample.ALL else COMPILERS[1:2]


def each(names: list[str]) -> pytest.MarkDecorator:
    """Units with a compiler and its level."""
    built = [(name, BUILDS[(k + sample.NUMBER) % len(BUILDS)]) for k, name in enumerate(names if BUILDS else [])]
    return pytest.mark.parametrize(("name", "build"), built, ids=[f"{name} {' '.join(build)}" for name, build in built])


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


def ran_without_exception(build: list[str], file: str, folder: Path, program: Path, *words: object) -> str:
    """What a program tells that traps exceptions."""
    flags = [*build, *TRAPPING_MATH[build[0]], "-std=c99", "-g", "-ffp-contract=off", "-no-pie", "-I", folder]
    sources = [ROOT / "tests/fmpy" / file, *folder.glob("*_law.c")]
    compiled = subprocess.run([*flags, *sources, "-o", program, "-lm"], capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stderr
    ran = started(program, *words)
    where = ran.stderr.split(" at ")[-1].strip()
    line = subprocess.run(["addr2line", "-fe", program, where], capture_output=True, text=True, check=False).stdout
    assert ran.returncode == 0, f"{ran.stderr}{line}"
    return ran.stdout


@each(NAMES)
def test_no_exception_is_raised_from_the_start_and_from_random_states(name, build, sources, tmp_path) -> None:
    program = tmp_path / "trapping"
    step = fmpy.read_model_description(str(sources / name)).defaultExperiment.stepSize
    output = ran_without_exception(build, "trapping.c", sources / name / "sources", program, step)
    # A point that is refused shows nothing. A unit refuses most of those at states of a million nominal values.
    assert int(output.split()[0]) >= 120, output
    # A unit computes as it always does, however its host rounds.
    assert started(program, step, "downward").stdout == output


@each([name for name in NAMES if kind(name) not in PLANTS])
def test_no_exception_is_raised_by_a_law_for_a_target(name, build, sources, tmp_path) -> None:
    variables = fmpy.read_model_description(str(sources / name)).modelVariables
    # A law with a funnel takes any inputs where that is wide: outside it, its transformed error is no number.
    wide = {"rho_0": lambda start: 1000 * start, "rho_inf": lambda start: 1000 * start, "overshoot": lambda _: 1.0}
    of_funnel = [(v, wide[v.name.split("[")[0]]) for v in variables if v.name.split("[")[0] in wide]
    values = {v.name: widened(float(v.start)) for v, widened in of_funnel}
    parameters = "".join(f'<Parameter name="{of}"><Real value="{value}"/></Parameter>' for of, value in values.items())
    (tmp_path / "wide.ssv").write_text(
        '<ParameterSet xmlns="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="wide">'
        f"<Parameters>{parameters}</Parameters></ParameterSet>"
    )
    options = ["--values", tmp_path / "wide.ssv"] if values else []
    exported = adaptive_fmu("export", "--firmware", name, "--substeps", "2000", *options, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    (tmp_path / f"{name}.c").rename(tmp_path / f"{name}_law.c")
    header, members = (tmp_path / f"{name}.h").read_text(), Law.members_of
    read = [v for v in variables if v.causality == "input" and v.type == "Real" and not v.name.startswith("u_manual")]
    sizes = {of: sum(members(header, name, of).values()) for of in ("inputs", "states")}
    types = "".join(f"typedef {name}_{of} law_{of};\n" for of in ("real", "inputs", "outputs"))
    states = "(law_real *)(void *)&(self).x" if sizes["states"] else "(law_real *)NULL"
    (tmp_path / "law.h").write_text(
        f'#include "{name}.h"\ntypedef {name} law;\n{types}#define law_init {name}_init\n#define law_step {name}_step\n'
        f"#define LAW_REFUSED {name}_REFUSED\n#define LAW_INPUTS {sizes['inputs']}\n#define LAW_STATES {sizes['states']}\n"
        f"#define STATES(self) ({states})\nstatic const law_real starts[] = {{ {', '.join(v.start for v in read)} }};\n"
    )
    output = ran_without_exception(build, "trapping_law.c", tmp_path, tmp_path / "trapping")
    assert int(output) >= 48, output
