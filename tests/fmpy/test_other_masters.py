"""Example 3.2.1 in the masters ecos and libcosim: the same numbers as in FMPy."""

import re
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from master import CONTROLLER, PLANT, REFERENCE, Loop, closed_loop
from masters import PARAMETER_SET, run_in

STEP, COUNT = 1e-3, 5000
TOLERANCE = 1e-9


def pack(structure: str, fmus: Path, package: Path) -> Path:
    """A structure and its FMUs as one .ssp file."""
    with zipfile.ZipFile(package, "w") as archive:
        archive.writestr("SystemStructure.ssd", structure)
        for name in (REFERENCE, PLANT, CONTROLLER):
            archive.write(fmus / f"{name}.fmu", f"resources/{name}.fmu")
    return package


def example(parameter: str) -> str:
    """The example with this parameter of the reference instead of its signal, which is a cosine anyway.

    ecos and libcosim read no structure that sets an enumeration.
    """
    structure = (ROOT / "examples" / "3.2.1-cosine" / "SystemStructure.ssd").read_text()
    structure = structure.replace('ParameterSet name="3.2.1-cosine"', f'ParameterSet name="{PARAMETER_SET}"')
    structure, replaced = re.subn(r'<ssv:Parameter name="signal">.*?</ssv:Parameter>', parameter, structure)
    assert replaced == 1
    return structure


@pytest.fixture(scope="module", params=["ecos", "libcosim"])
def master(request: pytest.FixtureRequest) -> str:
    """Each master in turn."""
    return request.param


@pytest.fixture(scope="module")
def run(master: str, fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, float, int], Loop]:
    """Runs a structure in a master."""

    def with_structure(structure: str, step: float, count: int) -> Loop:
        folder = tmp_path_factory.mktemp(master)
        return run_in(master, pack(structure, fmu_folder, folder / "loop.ssp"), step, count, folder)

    return with_structure


@pytest.fixture(scope="module")
def run_of_example(run) -> Loop:
    """The first 5 s of the example at 1 ms in each master."""
    return run(example(""), STEP, COUNT)


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


def test_a_parameter_of_the_structure_reaches_its_unit(run) -> None:
    parameter = '<ssv:Parameter name="cosine_amplitude[1]"><ssv:Real value="1.5"/></ssv:Parameter>'
    loop = run(example(parameter), 0.01, 100)
    assert np.abs(loop.r - 1.5 * np.cos(0.2 * 0.01 * np.arange(101))).max() <= TOLERANCE
