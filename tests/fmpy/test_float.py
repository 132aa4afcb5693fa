"""How far laws in float are from those in double: docs/firmware.md tells it for each law; the tests hold them to it."""

import math

import numpy as np
import pytest
from laws import Laws, table

each_law = pytest.mark.parametrize("row", table("controller in float"), ids=lambda row: row["controller in float"])
# Rounding differs between compilers, and what adaptation makes of it with it.
OTHER_COMPILERS = 2.0
# Over the first steps of its loop.
STEPS = 2000


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> Laws:
    """The sources of all laws of the table."""
    return Laws(tmp_path_factory.mktemp("laws"), [row["controller in float"] for row in table("controller in float")])


@each_law
def test_a_law_in_float_is_as_close_to_double_as_documented(row, laws) -> None:
    name, substeps = row["controller in float"], int(row["substeps"])
    inputs = laws.inputs(name, row["loop"], STEPS)
    double = laws.outputs(name, substeps, inputs)
    assert np.ptp(double, axis=0).max() > 0
    apart = np.abs(laws.outputs(name, substeps, inputs, f"-D{name}_FLOAT") - double)
    relative = float(apart.max() / np.abs(double).max())
    assert math.isfinite(relative) and relative <= OTHER_COMPILERS * float(row["apart"]), f"{relative:.1e}"
    # What the page tells isn't far from what is.
    assert relative >= float(row["apart"]) / 10, f"{relative:.1e}"
