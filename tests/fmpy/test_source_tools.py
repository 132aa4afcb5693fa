"""What other tools say of units as C source: clang, cppcheck with its MISRA add-on, valgrind, zig for other platforms.

Each of these is skipped where its tool isn't installed.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections import Counter
from pathlib import Path

import fmpy
import pytest
import sample
from conftest import ROOT, adaptive_fmu, files_in
from laws import WARNINGS
from test_platforms import OLDEST_GLIBC, STANDARD, glibc

PAGE = ROOT / "docs" / "source_units.md"
# Together they have all of the runtime but what is for integer inputs and for sparse Jacobians; and cppcheck is soon done.
SMALL = ["NonlinearSiso", "StateSpace", "ReferenceNonlinearSiso"]
DEFINES = [[], ["-DUNIT_FLOAT"], ["-DFMI2_STATIC_INSTANCES=2"], ["-DUNIT_FLOAT", "-DFMI2_STATIC_INSTANCES=2"]]
PLATFORMS = {
    "linux64": ".so",
    "aarch64-linux": ".so",
    "win64": ".dll",
    "aarch64-windows": ".dll",
    "darwin64": ".dylib",
    "aarch64-darwin": ".dylib",
}
# Other versions of cppcheck find other things.
COUNTED_BY = "Cppcheck 2.10"
# Of the platforms in this table, with the sources; measured at 426,309 bytes.
MOST_BYTES = 500_000


def tool(name: str) -> str:
    """The path of a tool; the test is skipped where there is none."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} isn't installed")
    return found


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sources of all units, in folders of their names."""
    folder = tmp_path_factory.mktemp("sources")
    exported = adaptive_fmu("export", "--source-only", "--all", "--out", folder)
    assert exported.returncode == 0, exported.stderr
    for name in {*sample.FMUS, *SMALL, "ActuatorTwoLinkRobot"}:
        with zipfile.ZipFile(folder / f"{name}.fmu") as archive:
            archive.extractall(folder / name, [file for file in archive.namelist() if file.startswith("sources/")])
    return folder


@pytest.mark.parametrize("compiler", ["gcc", pytest.param("clang", marks=pytest.mark.slow)])
def test_no_unit_has_a_warning(compiler: str, sources: Path) -> None:
    command = [tool(compiler), *WARNINGS, "-fsyntax-only"]
    for name in sample.FMUS:
        for defines in DEFINES:
            written = [*command, *defines, sources / name / "sources" / "all.c"]
            compiled = subprocess.run(written, capture_output=True, text=True, check=False)
            assert compiled.returncode == 0, f"{name} {defines}: {compiled.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize("defines", [[], ["-DFMI2_STATIC_INSTANCES=2", "-DFMI2_STATIC_STATES=100"]])
@pytest.mark.parametrize("name", [*SMALL, "ActuatorTwoLinkRobot"])
def test_valgrind_finds_neither_errors_nor_leaks(name: str, defines: list[str], sources: Path, tmp_path: Path) -> None:
    valgrind, program, folder = tool("valgrind"), tmp_path / "program", sources / name / "sources"
    flags = ["-std=c99", "-O1", "-g", *defines, f"-I{folder}"]
    main = ROOT / "tests" / "fmpy" / "one_unit.c"
    subprocess.run([tool("gcc"), *flags, main, folder / "all.c", "-lm", "-o", program], check=True)
    options = ["-q", "--leak-check=full", "--show-leak-kinds=all", "--errors-for-leak-kinds=all", "--error-exitcode=9"]
    watched = subprocess.run([valgrind, *options, program], capture_output=True, text=True, check=False)
    assert (watched.returncode, watched.stdout + watched.stderr) == (0, "")


def findings(file: Path, *options: str) -> list[tuple[str, str, str, str]]:
    """What cppcheck finds: file, line, column and what. A define that means nothing keeps it to one configuration."""
    template = "--template={file}:{line}:{column}:{id}"
    command = [tool("cppcheck"), "--std=c99", "--quiet", "-DONE_CONFIGURATION", template, *options, file]
    error = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    found = [line.rsplit(":", 3) for line in error.splitlines() if line.count(":") >= 3]
    return [(Path(where).name, line, column, what) for where, line, column, what in found]


@pytest.mark.parametrize("define", ["-DUNIT_ANY", "-DUNIT_FLOAT", "-DFMI2_STATIC_INSTANCES=2"])
@pytest.mark.parametrize("name", SMALL)
def test_cppcheck_finds_nothing(name: str, define: str, sources: Path) -> None:
    assert findings(sources / name / "sources" / "all.c", define, "--enable=warning,portability,performance") == []


def counted(sources: Path) -> tuple[Counter[str], Counter[str]]:
    """How often the MISRA add-on names a rule: in the runtime, each place once, and in what is generated."""
    runtime, generated = set(), Counter[str]()
    for name in SMALL:
        for found in findings(sources / name / "sources" / "all.c", "--addon=misra"):
            rule = found[3].removeprefix("misra-c2012-")
            if found[0] not in ("unit.c", "unit.h"):
                runtime.add((*found[:3], rule))
            else:
                generated[rule] += 1
    return Counter(rule for *_, rule in runtime), generated


@pytest.mark.slow
def test_misra_counts_are_not_above_those_of_the_page(sources: Path) -> None:
    version = subprocess.run([tool("cppcheck"), "--version"], capture_output=True, text=True, check=True).stdout.strip()
    if not (version == COUNTED_BY or version.startswith(f"{COUNTED_BY}.")):
        pytest.skip(f"{version} is installed, and the page's counts are those of {COUNTED_BY}")
    # | rules | runtime | unit.c | why |
    rows = re.findall(r"^\| (\d+\.\d+(?:, \d+\.\d+)*) \| (\d+) \| (\d+) \|[^|]*\|$", PAGE.read_text(), re.M)
    known = {tuple(rules.split(", ")): (int(runtime), int(generated)) for rules, runtime, generated in rows}
    named = [rule for rules in known for rule in rules]
    assert len(named) == len(set(named)), "a rule stands in one row"
    runtime, generated = counted(sources)
    assert set(runtime) | set(generated) <= set(named)
    for rules, most in known.items():
        found = tuple(sum(counts[rule] for rule in rules) for counts in (runtime, generated))
        assert found[0] <= most[0] and found[1] <= most[1], (rules, found, most)


@pytest.fixture(scope="module")
def of_six_platforms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked FMU of a unit that zig has compiled for each platform. Its first build takes a minute or three."""
    if importlib.util.find_spec("ziglang") is None and shutil.which("zig") is None:
        pytest.skip("zig isn't installed (pip install ziglang)")
    folder = tmp_path_factory.mktemp("zig")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    platforms = ",".join(PLATFORMS)
    exported = adaptive_fmu("export", "--compile", "--platforms", platforms, "NonlinearSiso", "--out", folder, PATH=path)
    assert exported.returncode == 0, exported.stderr
    zipfile.ZipFile(folder / "NonlinearSiso.fmu").extractall(folder / "unpacked")
    return folder / "unpacked"


def library_of(folder: Path, platform: str) -> Path:
    return folder / "binaries" / platform / f"NonlinearSiso{PLATFORMS[platform]}"


@pytest.mark.slow
def test_zig_compiles_a_unit_for_six_platforms(of_six_platforms: Path) -> None:
    made = {f"{platform}/NonlinearSiso{suffix}" for platform, suffix in PLATFORMS.items()}
    assert made <= files_in(of_six_platforms / "binaries")
    assert (of_six_platforms.parent / "NonlinearSiso.fmu").stat().st_size <= MOST_BYTES


@pytest.mark.slow
@pytest.mark.parametrize("platform", [platform for platform, suffix in PLATFORMS.items() if suffix == ".so"])
def test_libraries_for_linux_ask_for_an_old_glibc(platform: str, of_six_platforms: Path) -> None:
    assert glibc(library_of(of_six_platforms, platform)) <= OLDEST_GLIBC


@pytest.mark.slow
@pytest.mark.parametrize("platform", PLATFORMS)
def test_libraries_of_all_platforms_offer_the_functions_of_the_standard(platform: str, of_six_platforms: Path) -> None:
    library = library_of(of_six_platforms, platform)
    commands: dict[str, list[str]] = {
        ".so": ["nm", "-D", "--defined-only"],
        ".dll": ["llvm-readobj", "--coff-exports"],
        ".dylib": ["llvm-nm", "-gU"],
    }
    program, *options = commands[PLATFORMS[platform]]
    output = subprocess.run([tool(program), *options, library], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"\b_?fmi2(\w+)", output)) == set(STANDARD)


@pytest.mark.slow
@pytest.mark.parametrize("platform", PLATFORMS)
def test_libraries_name_no_folder_of_the_machine(platform: str, of_six_platforms: Path) -> None:
    library = library_of(of_six_platforms, platform).read_bytes()
    folders = [tempfile.gettempdir(), str(ROOT), str(Path.home())]
    assert [folder for folder in folders if f"{folder}/".encode() in library] == []


@pytest.mark.slow
def test_what_zig_compiles_gives_the_bits_of_the_generic_form(of_six_platforms: Path, fmu) -> None:
    settings = {"stop_time": 1.0, "output_interval": 0.01, "start_values": {"integration_method": 2}}
    files = (of_six_platforms, fmu("NonlinearSiso").path)
    results = [fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", **settings) for file in files]
    assert all((results[0][name] == results[1][name]).all() for name in results[0].dtype.names)
