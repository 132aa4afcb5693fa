"""Every loop in the masters ecos and libcosim: the same numbers as in FMPy."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import LOOP_NAMES, ROOT, adaptive_fmu
from master import Loop
from masters import RECORDED, points, run_in
from package import Package

COUNT = 1000
# Of the largest magnitude of a signal, where that is above 1.
TOLERANCE = 1e-9
EXAMPLE = ROOT / "examples" / "3.2.1-cosine"


def pack(out: Path, *loops: str | Path) -> list[Path]:
    """Loops as .ssp files, by the command that a user has."""
    packed = adaptive_fmu("export", *(word for loop in loops for word in ("--ssp", loop)), "--out", out, "--json")
    # Nothing that another master would leave out.
    assert (packed.returncode, packed.stderr) == (0, ""), packed
    return [Path(file) for file in json.loads(packed.stdout)["ssps"]]


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Package]:
    """All loops, packed once."""
    files = pack(tmp_path_factory.mktemp("packed"), *LOOP_NAMES)
    return {file.stem: Package(file, tmp_path_factory.mktemp(file.stem)) for file in files}


@pytest.fixture(params=["ecos", "libcosim"])
def master(request: pytest.FixtureRequest) -> str:
    """Each master in turn."""
    return request.param


@pytest.fixture
def run(master: str, tmp_path: Path) -> Callable[..., Loop]:
    """Runs the loop of a changed folder in a master."""

    def packed(folder: Path, step: float, count: int) -> Loop:
        (file,) = pack(tmp_path, folder)
        return run_in(master, Package(file, tmp_path / "unpacked"), count, tmp_path, step)

    return packed


def steps_of(package: Package) -> int:
    """How many steps a short run has; it ends well before a failure that the loop is there to show."""
    return min(COUNT, int(0.8 * package.fails_at / package.step)) if np.isfinite(package.fails_at) else COUNT


def in_fmpy(package: Package, master: str, order: str) -> Loop:
    """A short run in FMPy, at the times of a master.

    Both masters hand on all outputs in Initialization Mode, then step all units before they hand on any output. ecos
    reads the outputs once more after it has set the inputs.
    """
    return package.run(*points(master, package.step, steps_of(package)), order, read_again=master == "ecos")


def differences(found: Loop, expected: Loop) -> dict[str, float]:
    """Greatest difference of each signal and of the time."""
    assert len(found.time) == len(expected.time)
    scale = {name: max(1.0, np.abs(values).max()) for name, values in expected.signals.items()}
    of = {name: np.abs(values - expected[name]).max() / scale[name] for name, values in found.signals.items()}
    return of | {"time": np.abs(found.time - expected.time).max()}


@pytest.mark.parametrize("name", LOOP_NAMES)
def test_every_output_has_the_value_that_it_has_in_fmpy_at_every_communication_point(
    master: str, name: str, packages: dict[str, Package], tmp_path: Path
) -> None:
    package = packages[name]
    recorded = run_in(master, package, steps_of(package), tmp_path)
    assert set(recorded.signals) == set(package.outputs(*RECORDED[master]))
    found = differences(recorded, in_fmpy(package, master, "jacobi"))
    assert all(difference <= TOLERANCE for difference in found.values()), found
    # With another order of steps they would be others.
    other = differences(recorded, in_fmpy(package, master, "gauss-seidel"))
    assert max(other.values()) > 1e4 * TOLERANCE, other


@pytest.mark.parametrize("name", LOOP_NAMES)
def test_a_packed_loop_in_fmpy_is_the_loop_that_the_program_runs(name, packages, fmu_folder, tmp_path) -> None:
    package = packages[name]
    times = package.step * np.arange(steps_of(package) + 1)
    options = [
        "--order",
        "jacobi",
        "--until",
        repr(float(times[-1])),
        "--fmus",
        fmu_folder,
        "--out",
        tmp_path,
        "--json",
    ]
    assert adaptive_fmu("run", name, *options).returncode in (0, 3)
    rows = np.genfromtxt(tmp_path / name / "result.csv", delimiter=",", names=True, deletechars="", replace_space=" ")
    expected = Loop(rows["time"], {signal: rows[signal] for signal in package.outputs("Real", "Integer", "Boolean")})
    found = differences(package.run(times, np.diff(times), "jacobi"), expected)
    assert all(difference <= TOLERANCE for difference in found.values()), found


def test_a_parameter_file_of_the_loop_reaches_its_unit(run, tmp_path: Path) -> None:
    folder = shutil.copytree(EXAMPLE, tmp_path / "loop")
    parameters = (folder / "reference.ssv").read_text()
    (folder / "reference.ssv").write_text(parameters.replace('value="2.0"', 'value="1.5"'))
    loop = run(folder, 0.01, 100)
    assert np.abs(loop.r - 1.5 * np.cos(0.2 * 0.01 * np.arange(101))).max() <= TOLERANCE


def test_the_square_wave_is_one_in_every_master(run) -> None:
    loop = run(ROOT / "examples" / "3.2.1-square", 0.01, 300)
    assert np.abs(loop.r).max() == pytest.approx(1.0, abs=1e-12) and len(np.unique(np.round(loop.r, 9))) == 2
