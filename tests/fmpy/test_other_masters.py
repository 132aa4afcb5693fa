"""Every loop in the masters ecos and libcosim: the same numbers as in FMPy."""

import re
import shutil
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import sample
from conftest import ROOT, adaptive_fmu
from loops import in_fmpy_and_by_the_program, pack
from master import Loop
from masters import COUNT, RECORDED, TOLERANCE, differences, in_fmpy, points, run_in, steps_of
from package import Package

EXAMPLE = ROOT / "examples" / "3.2.1-cosine"


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Package]:
    """Loops, packed once."""
    files = pack(tmp_path_factory.mktemp("packed"), *{*sample.LOOPS, EXAMPLE.name})
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


@pytest.mark.parametrize("name", sample.LOOPS)
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
    assert max(other.values()) > 1e3 * TOLERANCE, other


@pytest.mark.parametrize("name", ["6.5.2-mrac", "6.5.2-l1"])
def test_masters_differ_by_amplified_rounding_as_far_as_documented(name: str, tmp_path: Path) -> None:
    exported = adaptive_fmu("export", "--ssp", name, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    package = Package(tmp_path / f"{name}.ssp", tmp_path / "unpacked")
    at = lambda master: package.run(*points(master, package.step, 100), "jacobi")
    runs = [at(master) for master in ("FMPy", "ecos", "libcosim")]
    signals = ["plant.x[1]", "controller.u[1]"]
    found = [max(np.abs(one[it] - other[it]).max() for one, other in combinations(runs, 2)) for it in signals]
    page = (ROOT / "docs" / "thesis_loops.md").read_text()
    documented = [float(number) for number in re.search(rf"^\| `{name}`, .* ms \| (\S+) \| (\S+) \|$", page, re.M).groups()]
    # By how much rounding is amplified is no sharper than that: it differs from one compiler to another.
    assert all(number / 3 < value < 3 * number for number, value in zip(documented, found, strict=True)), found
    again = at("FMPy")
    assert all(np.array_equal(again[it], runs[0][it]) for it in again.signals), "at the same points the bits are the same"


@pytest.mark.parametrize("name", sample.LOOPS)
def test_a_packed_loop_in_fmpy_is_the_loop_that_the_program_runs(name, packages, tmp_path) -> None:
    difference, limit = in_fmpy_and_by_the_program(packages[name], COUNT, tmp_path)
    assert difference <= limit


def test_a_parameter_file_of_the_loop_reaches_its_unit(run, tmp_path: Path) -> None:
    folder = shutil.copytree(EXAMPLE, tmp_path / "loop")
    parameters = (folder / "reference.ssv").read_text()
    (folder / "reference.ssv").write_text(parameters.replace('value="2.0"', 'value="1.5"'))
    loop = run(folder, 0.01, 100)
    assert np.abs(loop.r - 1.5 * np.cos(0.2 * 0.01 * np.arange(101))).max() <= TOLERANCE


def test_the_square_wave_is_one_in_every_master(run) -> None:
    loop = run(ROOT / "examples" / "3.2.1-square", 0.01, 300)
    assert np.abs(loop.r).max() == pytest.approx(1.0, abs=1e-12) and len(np.unique(np.round(loop.r, 9))) == 2
