"""Builds the program and exports all FMUs, once, and hands them to the tests.

    tests/prepare
    target/venv/bin/python -m pytest tests/fmpy

With `-n 2 --dist loadgroup` two processes share the tests: those of a file stay together, and those that build by cargo.

With ADAPTIVE_FMU_FMUS = a folder, FMUs that are compiled from C sources are tested, which are exported into it. With ADAPTIVE_FMU_TESTED =
a program, that one is tested (target/debug/adaptive-fmu, say), and none is built.
"""

import csv
import fcntl
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(Path(__file__).parent), str(_TESTS / "masters"), str(_TESTS.parent / "python")]

import sample  # noqa: E402
from master import Fmu, Unit  # noqa: E402
from sample import FMU_NAMES, LOOP_NAMES, ROOT  # noqa: E402, F401
GIVEN = os.environ.get("ADAPTIVE_FMU_TESTED")
COMPILED = "ADAPTIVE_FMU_FMUS" in os.environ
PROGRAM = Path(GIVEN).resolve() if GIVEN else ROOT / "target" / "release" / "adaptive-fmu"
# The Python package as it is in the sources, with this program, also in processes that the tests start.
os.environ["ADAPTIVE_FMU_PROGRAM"] = str(PROGRAM)
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT / "python"), os.environ.get("PYTHONPATH")]))
# What the program keeps of one run for the next stays here, not in the folder of whoever runs the tests.
os.environ.setdefault("ADAPTIVE_FMU_CACHE", str(ROOT / "target" / "cache"))
# Programs under test end at a hangup, though whoever runs the tests does so by nohup.
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
# Files whose tests build by cargo, or run the commands of pages as they stand: they lie in one process.
IN_THE_CHECKOUT = {"test_readme", "test_my_controller", "test_my_plant", "test_peers", "test_notebook", "test_pip", "test_publishing"}

# Files that a commit takes whole. Of all others it takes every 13th test, as its number without the third of loops says: in turn every
# test meets every loop.
WHOLE = {"test_sample", "test_words", "test_readme", "test_my_controller"}

# Folders of a run of tests that stay until its end.
SHARED = {"exported", "fmus", "unpacked"}


def pytest_report_header() -> str:
    """What is looked at."""
    return sample.SUMMARY


def pytest_configure(config: pytest.Config) -> None:
    """What `tests/all` alone runs is marked."""
    config.addinivalue_line("markers", "slow: takes more than 20 s, or goes through all FMUs or platforms: tests/all runs it")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """A test that is named runs, slow or not; of the others every 13th, of FMUs that are compiled from C sources, too."""
    if sample.ALL or not COMPILED and any("::" in name or name.endswith(".py") for name in config.args):
        return
    left = {item for item in items if item.get_closest_marker("slow")}
    for file, tests in groupby(items, key=lambda item: item.path.stem):
        left |= {item for k, item in enumerate(tests) if file not in WHOLE and k % sample.PARTS != sample.part_of_tests(sample.NUMBER)}
    config.hook.pytest_deselected(items=[item for item in items if item in left])
    items[:] = [item for item in items if item not in left]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """A failure tells what was looked at."""
    if terminalreporter.stats.get("failed") or terminalreporter.stats.get("error"):
        terminalreporter.write_line(sample.SUMMARY)


def pytest_sessionstart(session: pytest.Session) -> None:
    """The program is built where the tests begin, before any process that shares them."""
    if not GIVEN and not hasattr(session.config, "workerinput"):
        built = subprocess.run(["cargo", "build", "--release", "-q"], cwd=ROOT, check=False)
        if built.returncode != 0:
            pytest.exit("the program can't be built", built.returncode)


def pytest_itemcollected(item: pytest.Item) -> None:
    """The tests of a file share what its fixtures make."""
    item.add_marker(pytest.mark.xdist_group("checkout" if item.path.stem in IN_THE_CHECKOUT else item.path.stem))


def pytest_collection_finish(session: pytest.Session) -> None:
    """xdist tells groups apart by the names of tests: with a pytest in which it can't, what fixtures make is made twice."""
    if getattr(session.config.option, "loadgroup", False) and hasattr(session.config, "workerinput"):
        assert all("@" in item.nodeid for item in session.items), "pytest-xdist gives the tests no groups"


def adaptive_fmu(*arguments: str | Path, folder: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs the project's program as a user would, from the repository root or another folder."""
    command = [PROGRAM, *map(str, arguments)]
    environment = {**os.environ, **environment}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="session")
def fmu_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all FMUs, which the processes that share the tests share too."""
    if given := os.environ.get("ADAPTIVE_FMU_FMUS"):
        return Path(given).resolve()
    base = tmp_path_factory.getbasetemp()
    # Each of several processes has a folder of its own in that of the run.
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "fmus"
    with (folder.parent / "fmus.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.is_dir():
            exported = adaptive_fmu("export", "--all", "--out", folder.parent / "exported")
            assert exported.returncode == 0, exported.stderr
            (folder.parent / "exported").rename(folder)
    return folder


@pytest.fixture(scope="module", autouse=True)
def room_is_given_back(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What the tests of a file made on the disk goes with them, unless one of them failed: all of it together is 10 GB. The folders
    stay, empty: a library that is loaded from a path is not loaded again from there, so no path may be used twice."""
    base, failed = tmp_path_factory.getbasetemp(), request.session.testsfailed
    before = set(base.iterdir())
    yield
    if request.session.testsfailed == failed:
        for made in set(base.iterdir()) - before:
            if made.is_dir() and not made.is_symlink() and made.name not in SHARED:
                for inside in made.iterdir():
                    if inside.is_dir() and not inside.is_symlink():
                        shutil.rmtree(inside, ignore_errors=True)
                    else:
                        inside.unlink()


def compile_once(name: str, folder: Path) -> None:
    """Exports an FMU of this package with a library that is compiled from its C sources, unless it is in the folder."""
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / f"{name}.fmu").is_file():
            exported = adaptive_fmu("export", "--compile", name, "--out", folder)
            assert exported.returncode == 0, exported.stderr


@pytest.fixture(scope="session")
def fmu(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Fmu]:
    """An FMU by its name, unpacked once."""
    opened: dict[str, Fmu] = {}

    def get(name: str) -> Fmu:
        if name not in opened:
            if COMPILED:
                compile_once(name, fmu_folder)
            unpacked = tmp_path_factory.getbasetemp() / "unpacked" / name
            opened[name] = Fmu(fmu_folder / f"{name}.fmu", unpacked)
        return opened[name]

    return get


@pytest.fixture(params=sample.FMUS)
def each_fmu(request: pytest.FixtureRequest, fmu: Callable[[str], Fmu]) -> Fmu:
    """Every FMU of the sample in turn."""
    return fmu(request.param)


@pytest.fixture
def unit(fmu: Callable[[str], Fmu]) -> Iterator[Callable[..., Unit]]:
    """Makes instances of an FMU by its name; they are freed after the test."""
    made: list[Unit] = []

    def make(name: str, **values: float) -> Unit:
        made.append(Unit(fmu(name), f"{name} {len(made)}"))
        for variable, value in values.items():
            made[-1][variable] = value
        return made[-1]

    yield make
    for instance in made:
        instance.free()


@pytest.fixture(autouse=True)
def design_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Units that are compiled from C sources were designed when they were exported: what a design reads can't be set, and
    tests that set it are about the generic form."""
    if "ADAPTIVE_FMU_FMUS" not in os.environ:
        return
    set_value = Unit.__setitem__

    def checked(unit: Unit, name: str, value: float | str) -> None:
        if unit.fmu.variables[name].variability == "constant":
            pytest.skip(f"{unit.fmu.name} was designed at export with its {name}")
        set_value(unit, name, value)

    monkeypatch.setattr(Unit, "__setitem__", checked)


# Bounds within which the program reads files that may be anything.
MEMORY, SECONDS = 1 << 30, 10


@pytest.fixture(scope="session")
def bounded() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs the program within bounds; its answer, where it did nothing that it may never do."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def run(*arguments: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
        answer = subprocess.run(
            [PROGRAM, *map(str, arguments)],
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},
            capture_output=True,
            text=True,
            timeout=SECONDS,
            preexec_fn=limit,
            check=False,
        )
        # A signal is a negative number: an abort, a stack that overflowed. 3 is a run beyond a limit of its loop.
        assert answer.returncode in (0, 1, 3), answer
        assert "panicked" not in answer.stderr and "internal fault" not in answer.stderr, answer
        if answer.returncode == 1:
            assert answer.stderr.splitlines()[-1].startswith("error: ") and answer.stderr.count("error: ") == 1, answer
        return answer

    return run


def files_in(folder: Path) -> set[str]:
    """All files below a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir()}


def read_csv(file: Path) -> dict[str, np.ndarray]:
    with file.open() as text:
        rows = list(csv.reader(text))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=False))


# A loop that is run: what it tells, and what was recorded of it.
Ran = tuple[dict, dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def ran(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Ran]:
    """Runs a loop by the program, with these options, once."""
    done: dict[tuple[str, ...], Ran] = {}

    def run(loop: str, *options: str | float) -> Ran:
        words = (loop, *map(str, options))
        if words not in done:
            fmus = [] if "--composite" in words else ["--fmus", fmu_folder]
            answer = adaptive_fmu("run", *words, *fmus, "--json", "--out", tmp_path_factory.mktemp("run"))
            # 3: a peak beyond its limit, with another step than the loop's own.
            assert answer.returncode in (0, 3) and answer.stderr == "", answer
            output = json.loads(answer.stdout)
            done[words] = output, read_csv(Path(output["results"]) / "result.csv")
        return done[words]

    return run


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loop with a controller that was designed for a plant of a file, as the page on own controllers does it."""
    folder, example = tmp_path_factory.mktemp("own"), ROOT / "examples" / "own" / "dc_motor"
    plant = ["--plant", example / "model.json"]
    for kind, name, options in [
        ("state-space", "DcMotor", []),
        ("l1", "DcMotorController", ["--bandwidth", 20, "--reference", 100]),
        ("reference", "DcMotorReference", ["--reference", 100]),
    ]:
        made = adaptive_fmu("new", kind, "--name", name, *plant, *options, "--out", folder / f"{name}.toml")
        assert made.returncode == 0, made
    shutil.copy(example / "SystemStructure.ssd", folder)
    return folder
