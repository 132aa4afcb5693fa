"""What the shared library asks of a machine, libraries for several platforms, and the archive for users without Rust."""

import ctypes
import json
import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from fmpy.fmi2 import fmi2CallbackFunctions
from fmpy.fmi3 import _FMU3
from master import PLANT

# What fmi2Functions.h of FMI 2.0 declares, but for the types: the common functions, and those of either interface.
STANDARD = """
    GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance SetupExperiment EnterInitializationMode
    ExitInitializationMode Terminate Reset GetReal GetInteger GetBoolean GetString SetReal SetInteger SetBoolean SetString
    GetFMUstate SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate
    GetDirectionalDerivative
    EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep SetTime SetContinuousStates
    GetDerivatives GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates
    SetRealInputDerivatives GetRealOutputDerivatives DoStep CancelStep GetStatus GetRealStatus GetIntegerStatus
    GetBooleanStatus GetStringStatus
""".split()
# Those of FMI 3.0, as FMPy declares them; and those by which a runner hands its compiled equations over.
STANDARD_3 = {name for name in dir(_FMU3) if name.startswith("fmi3")}
OWN = {f"adaptive_fmu_{name}" for name in ("kernel_functions", "take_kernel", "has_kernel", "do_steps")}
EXPORTED = {f"fmi2{name}" for name in STANDARD} | STANDARD_3 | OWN
OLDEST_GLIBC = (2, 17)
SYSTEM = {"libc.so.6", "libm.so.6", "libgcc_s.so.1", "libpthread.so.0", "libdl.so.2", "ld-linux-x86-64.so.2"}


def output_of(*command: str | Path) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def library(fmu) -> Path:
    """The shared library as an FMU holds it."""
    return fmu(PLANT).folder / "binaries" / "linux64" / f"{PLANT}.so"


def glibc(library: Path) -> tuple[int, ...]:
    """The newest version of glibc that a library asks for."""
    versions = re.findall(r"GLIBC_([0-9.]+)", output_of("readelf", "--version-info", library))
    return max(tuple(map(int, version.split("."))) for version in versions)


def test_the_library_exports_the_functions_of_the_standard_and_those_for_compiled_equations(library: Path) -> None:
    symbols = {line.split()[-1] for line in output_of("nm", "-D", "--defined-only", library).splitlines()}
    assert len(STANDARD_3) == 75 and symbols == EXPORTED


def test_the_library_needs_the_system_alone_and_lacks_nothing(library: Path) -> None:
    needed = set(re.findall(r"NEEDED.*\[(.*)\]", output_of("readelf", "-d", library)))
    assert needed <= SYSTEM
    checked = subprocess.run(["ldd", "-r", library], capture_output=True, text=True, check=True)
    assert "undefined" not in checked.stdout + checked.stderr and "not found" not in checked.stdout


# Functions by which a library reaches the network, other programs, threads, signals, files to change, or the tool's settings.
REACHING = """
    socket connect bind send sendto recv getaddrinfo fork vfork execve execvp posix_spawn posix_spawnp system popen
    pthread_create signal sigaction sigaltstack kill raise exit _exit atexit unlink unlinkat rename renameat mkdir rmdir
    truncate ftruncate64 chmod chown link symlink creat creat64 fopen fopen64 setenv unsetenv putenv setlocale chdir
    fesetround fesetenv feenableexcept srand dlopen
""".split()


def test_the_library_has_no_way_to_the_network_other_programs_threads_or_files_to_change(library: Path) -> None:
    imported = {line.split()[-1].split("@")[0] for line in output_of("nm", "-D", "--undefined-only", library).splitlines()}
    assert "open64" in imported and imported.isdisjoint(REACHING)


def test_the_library_asks_for_an_old_glibc_though_it_was_built_with_the_one_here(library: Path) -> None:
    assert glibc(library) <= OLDEST_GLIBC


def test_a_library_without_a_resource_location_finds_resources_by_its_own_path(fmu) -> None:
    plant = fmu(PLANT)
    for name in (PLANT, "L1TwoLinkRobot"):
        unit = fmu(name)
        loaded = ctypes.CDLL(str(unit.folder / "binaries" / "linux64" / f"{name}.so"))
        loaded.fmi2Instantiate.restype = ctypes.c_void_p
        loaded.fmi2FreeInstance.argtypes = [ctypes.c_void_p]
        callbacks = fmi2CallbackFunctions()
        own, other = unit.description.guid.encode(), plant.description.guid.encode()
        instance = loaded.fmi2Instantiate(b"unit", 1, own, None, ctypes.byref(callbacks), 0, 0)
        assert instance, "each finds its own, though both lie in this process"
        loaded.fmi2FreeInstance(instance)
        assert name == PLANT or not loaded.fmi2Instantiate(b"unit", 1, other, None, ctypes.byref(callbacks), 0, 0)


def asked(fmu: Path) -> dict[str, dict[str, str]]:
    """What `info` tells of the libraries in an FMU."""
    return json.loads(adaptive_fmu("info", fmu, "--json").stdout)["binaries"]


def test_info_shows_what_the_library_in_an_fmu_asks_for(fmu, library: Path) -> None:
    version = ".".join(map(str, glibc(library)))
    place = f"binaries/linux64/{PLANT}.so"
    assert asked(fmu(PLANT).path) == {place: {"processor": "x86-64", "glibc": version}}
    line = f"{place}: for x86-64, requires glibc {version} or newer"
    assert line in adaptive_fmu("info", fmu(PLANT).path).stdout.splitlines()


@pytest.fixture
def of_arm(library: Path, tmp_path: Path):
    """Makes what looks like this library for Linux on ARM, and asks for another glibc; it can't be run."""

    def make(version: str) -> Path:
        whole = library.read_bytes()
        # The target is a letter longer, the compiler a letter shorter: nothing else moves.
        mark = rb'"target":"x86_64-unknown-linux-gnu","compiler":"r'
        assert whole.count(mark) == 1 and whole.count(b"\0GLIBC_2.14\0") == 1
        whole = whole.replace(mark, rb'"target":"aarch64-unknown-linux-gnu","compiler":"')
        whole = whole.replace(b"\0GLIBC_2.14\0", b"\0GLIBC_" + version.encode() + b"\0")
        file = tmp_path / f"arm-{version}.so"
        # The processor stands in the eighteenth byte.
        file.write_bytes(whole[:18] + b"\xb7\0" + whole[20:])
        return file

    return make


@pytest.mark.parametrize("version", ["2.17", "2.18", "2.41"])
def test_an_export_reports_what_a_library_needs_if_old_systems_lack_it(version: str, of_arm, tmp_path: Path) -> None:
    library, out = of_arm(version), tmp_path / "out"
    answer = adaptive_fmu("export", PLANT, "--library", library, "--out", out)
    assert answer.returncode == 0 and answer.stdout == f"{out}/{PLANT}.fmu\n"
    if tuple(map(int, version.split("."))) <= OLDEST_GLIBC:
        assert answer.stderr == ""
    else:
        (line,) = answer.stderr.splitlines()
        assert line.startswith("warning: ") and library.name in line and f"glibc {version}" in line
        assert "cargo zigbuild --release --target aarch64-unknown-linux-gnu.2.17" in line
    needed = asked(out / f"{PLANT}.fmu")[f"binaries/aarch64-linux/{PLANT}.so"]
    assert needed == {"processor": "ARM, 64 bits", "glibc": version}


def test_a_library_built_for_old_systems_asks_for_an_old_glibc() -> None:
    target, library = ROOT / "target", "libadaptive_fmu_library.so"
    places = [target / "x86_64-unknown-linux-gnu" / "release" / library]
    # Where tests/platforms/build leaves it.
    places += [target / "old_linux" / "x86_64-unknown-linux-gnu" / "platforms" / library]
    built = [place for place in places if place.is_file()]
    if not built:
        pytest.skip("no library for old systems was built (docs/platforms.md tells how)")
    assert all(glibc(library) <= OLDEST_GLIBC for library in built)


@pytest.fixture
def foreign(library: Path, tmp_path: Path):
    """Makes what looks like this library for another target: what says how it was built, and nothing that runs."""

    def make(name: str, target: str, source: str | None = None) -> Path:
        (mark,) = re.findall(rb'\{"adaptive-fmu library":\{"version.*?\}\}', library.read_bytes())
        mark = re.sub(rb'"target":".*?"', f'"target":"{target}"'.encode(), mark)
        if source:
            mark = re.sub(rb'"source":".*?"', f'"source":"{source}"'.encode(), mark)
        file = tmp_path / name
        file.write_bytes(b"MZ\0" + mark + b"\0" * 1000)
        return file

    return make


def refusal(*libraries: str | Path, out: Path) -> str:
    options = [part for library in libraries for part in ("--library", str(library))]
    answer = adaptive_fmu("export", PLANT, *options, "--out", out)
    assert answer.returncode == 1 and answer.stderr.startswith("error: ") and len(answer.stderr.splitlines()) == 1
    assert not list(out.glob("*"))
    return answer.stderr


@pytest.mark.parametrize("named", ["win64=", ""])
def test_an_fmu_holds_the_libraries_of_all_platforms_that_are_given(named: str, foreign, tmp_path) -> None:
    windows, arm = foreign("a.dll", "x86_64-pc-windows-gnu"), foreign("a.so", "aarch64-unknown-linux-gnu")
    out = tmp_path / "out"
    answer = adaptive_fmu("export", PLANT, "--library", f"{named}{windows}", "--library", arm, "--out", out)
    assert (answer.returncode, answer.stderr) == (0, "")
    with zipfile.ZipFile(out / f"{PLANT}.fmu") as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/")}
        assert archive.read(f"binaries/win64/{PLANT}.dll") == windows.read_bytes()
        assert archive.read(f"binaries/aarch64-linux/{PLANT}.so") == arm.read_bytes()
    assert binaries == {
        f"binaries/{place}" for place in (f"linux64/{PLANT}.so", f"win64/{PLANT}.dll", f"aarch64-linux/{PLANT}.so")
    }
    assert fmpy.simulate_fmu(str(out / f"{PLANT}.fmu"), stop_time=0.1)["time"][-1] == pytest.approx(0.1)


@pytest.mark.parametrize("other", [None, "x86_64-apple-darwin"])
def test_a_library_for_arm_lies_in_both_folders_where_masters_look_unless_one_is_taken(other, foreign, tmp_path) -> None:
    libraries = [foreign("arm.dylib", "aarch64-apple-darwin")]
    libraries += [foreign("intel.dylib", other)] if other else []
    given = [part for library in libraries for part in ("--library", library)]
    assert adaptive_fmu("export", PLANT, *given, "--out", tmp_path / "out").returncode == 0
    with zipfile.ZipFile(tmp_path / "out" / f"{PLANT}.fmu") as archive:
        names = [name for name in archive.namelist() if "darwin" in name]
        contents = {name.split("/")[1]: archive.read(name) for name in names}
    assert contents == {"aarch64-darwin": libraries[0].read_bytes(), "darwin64": libraries[-1].read_bytes()}
    assert len(names) == 2 and names[0] == f"binaries/aarch64-darwin/{PLANT}.dylib"
    platforms = "platforms: aarch64-darwin, darwin64, linux64"
    assert platforms in adaptive_fmu("info", tmp_path / "out" / f"{PLANT}.fmu").stdout.splitlines()
    assert fmpy.supported_platforms(str(tmp_path / "out" / f"{PLANT}.fmu")) == ["darwin64", "linux64"]


def test_a_library_that_does_not_fit_is_refused_and_nothing_is_written(foreign, library, tmp_path) -> None:
    out, text = tmp_path / "out", tmp_path / "notes.txt"
    text.write_text("no library")
    windows = foreign("a.dll", "x86_64-pc-windows-gnu")
    assert "notes.txt" in refusal(text, out=out)
    assert "not a library of this package" in refusal(f"win64={text}", out=out)
    assert "is for linux64, not for win64" in refusal(f"win64={library}", out=out)
    arm = foreign("a.dylib", "aarch64-apple-darwin")
    assert "is for aarch64-darwin, not for darwin64" in refusal(f"darwin64={arm}", out=out)
    assert "other sources" in refusal(foreign("b.dll", "x86_64-pc-windows-gnu", "0" * 16), out=out)
    assert "already given for win64" in refusal(windows, foreign("c.dll", "x86_64-pc-windows-msvc"), out=out)
    assert "which FMUs do not support" in refusal(foreign("d.wasm", "wasm32-unknown-unknown"), out=out)


def test_what_was_built_next_to_the_program_of_the_same_sources_goes_into_every_fmu(foreign, library, tmp_path) -> None:
    """Libraries for other targets lie where cargo leaves them; one for older systems takes the place of this one's."""
    target = tmp_path / "target"
    built = {
        target / "release" / "libadaptive_fmu_library.so": library,
        target / "x86_64-pc-windows-gnu" / "release" / "adaptive_fmu_library.dll": foreign("a.dll", "x86_64-pc-windows-gnu"),
        target / "aarch64-unknown-linux-gnu" / "release" / "libadaptive_fmu_library.so": foreign(
            "a.so", "aarch64-unknown-linux-gnu", "0" * 16
        ),
    }
    older = target / "x86_64-unknown-linux-gnu" / "release" / "libadaptive_fmu_library.so"
    for place, file in built.items():
        place.parent.mkdir(parents=True)
        shutil.copy(file, place)
    older.parent.mkdir(parents=True)
    # Bytes behind its end, which no loader reads, tell it from the other one.
    older.write_bytes(library.read_bytes() + b"older")
    program = shutil.copy(PROGRAM, target / "release")
    command = [program, "export", PLANT, "--out", str(tmp_path / "out")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    with zipfile.ZipFile(tmp_path / "out" / f"{PLANT}.fmu") as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/")}
        assert binaries == {f"binaries/linux64/{PLANT}.so", f"binaries/win64/{PLANT}.dll"}
        assert archive.read(f"binaries/linux64/{PLANT}.so") == older.read_bytes()
    assert "aarch64" in done.stderr and "other sources" in done.stderr


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the archive for users without Rust."""
    out = tmp_path_factory.mktemp("dist")
    answer = adaptive_fmu("dist", "--out", out)
    assert (answer.returncode, answer.stderr) == (0, "")
    archive = next(out.glob("adaptive-fmu-*-linux64.zip"))
    # As `unzip` does, with the permissions.
    with zipfile.ZipFile(archive) as files:
        for entry in files.infolist():
            Path(files.extract(entry, out)).chmod(entry.external_attr >> 16)
    return out / archive.stem


def without_rust(folder: Path, *arguments: str) -> str:
    environment = {"PATH": "/nowhere", "HOME": str(folder)}
    command = [str(folder / "adaptive-fmu"), *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    # Without a compiler either.
    assert (done.returncode, done.stderr) == (0, ""), done
    return done.stdout


def test_an_archive_exports_an_fmu_from_a_text_without_rust(unpacked: Path) -> None:
    description = (unpacked / "modelDescription" / f"{PLANT}.toml").read_text().replace(PLANT, "MyPlant")
    (unpacked / "mine.toml").write_text(description)
    without_rust(unpacked, "export", "mine.toml", "--out", "mine")
    result = fmpy.simulate_fmu(str(unpacked / "mine" / "MyPlant.fmu"), stop_time=1.0)
    assert np.isfinite(result["x[1]"]).all()


def test_an_archive_closes_a_loop_without_rust(unpacked: Path) -> None:
    assert "max |u|" in without_rust(unpacked, "run", "3.2.1-cosine")


def test_an_archive_contains_what_its_checksums_and_licences_list(unpacked: Path) -> None:
    assert (
        "FAILED"
        not in subprocess.run(
            ["sha256sum", "--check", "SHA256SUMS"], cwd=unpacked, capture_output=True, text=True, check=True
        ).stdout
    )
    table = (unpacked / "licences" / "PACKAGES.txt").read_text()
    locked = (ROOT / "Cargo.lock").read_text()
    for package in ("nalgebra", "num-traits", "toml", "zip", "clap"):
        version = re.search(rf'name = "{package}"\nversion = "(.*?)"', locked)[1]
        assert f"{package} {version}: " in table
    # What tests and benchmarks alone need isn't in the program.
    assert "\ncriterion " not in table
    # Their texts follow; the packages of this workspace are under its own.
    assert "Permission is hereby granted" in table and "Apache License" in table
    assert "\nadaptive-fmu" not in table
    assert (unpacked / "docs" / "loops.md").is_file() and (unpacked / "README.md").is_file()
    assert os.access(unpacked / "adaptive-fmu", os.X_OK)
