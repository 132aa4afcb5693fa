"""Loops whose units are compiled from their C sources, in other masters: the same numbers as in FMPy.

ADAPTIVE_FMU_COMPILED_LOOPS=all takes every loop in place of some, which takes minutes.
"""

import os
from pathlib import Path

import pytest
from conftest import LOOP_NAMES, adaptive_fmu
from loops import pack
from masters import TOLERANCE, differences, in_fmpy, run_in, steps_of
from package import Package

# They set what the design of a unit reads, which a compiled one was designed with.
DESIGNED = ["3.3.1-case2", "3.3.1-case2-bench", "4-case3", "4-case3-fuzzy", "7.5.2"]
LOOPS = ["3.2.1-cosine", "6.5.1-mrac", "7.5.1"]
if os.environ.get("ADAPTIVE_FMU_COMPILED_LOOPS") == "all":
    LOOPS = [name for name in LOOP_NAMES if name not in DESIGNED]


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Package]:
    """Loops, packed with compiled units."""
    files = pack(tmp_path_factory.mktemp("packed"), *LOOPS, form="--compile")
    return {file.stem: Package(file, tmp_path_factory.mktemp(file.stem)) for file in files}


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("master", ["ecos", "libcosim"])
def test_every_output_has_the_value_that_it_has_in_fmpy(master: str, name: str, packages, tmp_path: Path) -> None:
    package = packages[name]
    assert all((fmu.folder / "sources" / "unit.c").exists() for fmu in package.fmus.values())
    recorded = run_in(master, package, steps_of(package), tmp_path)
    found = differences(recorded, in_fmpy(package, master, "jacobi"))
    assert found and all(difference <= TOLERANCE for difference in found.values()), found


@pytest.mark.parametrize("name", DESIGNED[:1])
def test_a_loop_that_sets_what_a_design_reads_is_refused(name: str, tmp_path: Path) -> None:
    packed = adaptive_fmu("export", "--source", "--ssp", name, "--out", tmp_path)
    assert packed.returncode == 1
    assert "`controller.pole_real[1]` can't be set: the FMU was designed with the value that it has" in packed.stderr
    assert not list(tmp_path.iterdir())
