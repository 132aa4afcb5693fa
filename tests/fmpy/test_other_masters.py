"""Example 3.2.1 in the masters ecos and libcosim: the same numbers as in FMPy."""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from master import Loop, closed_loop
from masters import run_in

STEP, COUNT = 1e-3, 5000
TOLERANCE = 1e-9


def pack(loop: str | Path, out: Path) -> Path:
    """A loop as one .ssp file, by the command that a user has."""
    packed = adaptive_fmu("export", "--ssp", loop, "--out", out, "--json")
    assert (packed.returncode, packed.stderr) == (0, ""), packed
    return Path(json.loads(packed.stdout)["ssps"][0])


@pytest.fixture(scope="module", params=["ecos", "libcosim"])
def master(request: pytest.FixtureRequest) -> str:
    """Each master in turn."""
    return request.param


@pytest.fixture(scope="module")
def run(master: str, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str | Path, float, int], Loop]:
    """Runs a loop in a master."""

    def packed(loop: str | Path, step: float, count: int) -> Loop:
        folder = tmp_path_factory.mktemp(master)
        return run_in(master, pack(loop, folder), step, count, folder)

    return packed


@pytest.fixture(scope="module")
def run_of_example(run) -> Loop:
    """The first 5 s of the example at 1 ms in each master."""
    return run("3.2.1-cosine", STEP, COUNT)


@pytest.fixture(scope="module")
def run_in_fmpy(fmu) -> Callable[..., Loop]:
    """The same in FMPy."""
    return partial(closed_loop, fmu, STEP * COUNT, STEP)


def differences(one: Loop, other: Loop) -> dict[str, float]:
    """Greatest difference of each signal and of the time."""
    assert len(one.time) == len(other.time)
    return {name: np.abs(values - getattr(other, name)).max() for name, values in vars(one).items()}


def test_the_loop_has_the_values_that_it_has_in_fmpy_at_every_communication_point(
    master: str, run_of_example: Loop, run_in_fmpy
) -> None:
    # Both masters hand on all outputs in Initialization Mode, then step all units before they hand on any output.
    # ecos reads the outputs once more after it has set the inputs.
    in_fmpy = run_in_fmpy("jacobi", read_again=master == "ecos")
    found = differences(run_of_example, in_fmpy)
    assert all(difference <= TOLERANCE for difference in found.values()), found
    assert np.ptp(run_of_example.y) > 1.0 and np.ptp(run_of_example.u) > 1.0


def test_the_order_of_steps_shows_in_the_values_that_are_compared(run_of_example: Loop, run_in_fmpy) -> None:
    found = differences(run_of_example, run_in_fmpy("gauss-seidel"))
    assert min(found["x"], found["y"], found["u"]) > 1e5 * TOLERANCE, found


def test_a_parameter_file_of_the_loop_reaches_its_unit(run, tmp_path: Path) -> None:
    folder = tmp_path / "loop"
    shutil.copytree(ROOT / "examples" / "3.2.1-cosine", folder)
    parameters = (folder / "reference.ssv").read_text()
    (folder / "reference.ssv").write_text(parameters.replace('value="2.0"', 'value="1.5"'))
    loop = run(folder, 0.01, 100)
    assert np.abs(loop.r - 1.5 * np.cos(0.2 * 0.01 * np.arange(101))).max() <= TOLERANCE


def test_the_square_wave_is_one_in_every_master(run) -> None:
    loop = run("3.2.1-square", 0.01, 300)
    assert np.abs(loop.r).max() == pytest.approx(1.0, abs=1e-12) and len(np.unique(np.round(loop.r, 9))) == 2
