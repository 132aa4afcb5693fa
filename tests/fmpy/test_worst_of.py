"""Searches for the worst of several plants, and columns of tunable parameters in tables of inputs."""

from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
from recorded import program
from sample import NUMBER
from scipy.linalg import expm

LOOP = "3.2.1-cosine"
LABEL = "max |u|"
GAIN = "controller.feedback_gain[1,1]"
SET = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="corner"><ssv:Parameters>
<ssv:Parameter name="plant.omega"><ssv:Real value="{omega}"/></ssv:Parameter>
<ssv:Parameter name="plant.a1"><ssv:Real value="{a1}"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>
"""


def corners(folder: Path) -> dict[Path, dict[str, float]]:
    rng = np.random.default_rng([NUMBER, 95])
    found = {}
    for name in ("light", "heavy"):
        values = {"omega": rng.uniform(1, 2.5), "a1": rng.uniform(0.5, 1.5)}
        (file := folder / f"{name}.ssv").write_text(SET.format(**values))
        found[file] = {f"plant.{key}": value for key, value in values.items()}
    return found


@pytest.mark.parametrize("separate", [True, False])
def test_the_largest_metric_of_all_plants_is_minimised(tmp_path: Path, separate: bool) -> None:
    loop, sets = adaptive_fmu.Loop(LOOP), corners(tmp_path)
    asked = {"parameters": {GAIN: (10.0, 40.0)}, "metric": LABEL, "until": 6, "particles": 3, "generations": 2, "separate": separate}
    tuned = loop.tune(**asked, worst_of=list(sets))

    def worst(values: dict[str, float]) -> float:
        runs = [loop.run(until=6, composite=not separate, values={**values, **plant}) for plant in [{}, *sets.values()]]
        return max(run.metrics.loc[LABEL, "value"] for run in runs)

    tolerance = 1e-12 if separate else 2e-3  # A search of one FMU has a wider tolerance of its own.
    assert tuned.before == pytest.approx(worst({}), rel=tolerance)
    assert tuned.objective == pytest.approx(worst(tuned.values), rel=tolerance) and tuned.objective <= tuned.before
    if not separate:
        assert tuned.verified == pytest.approx(max(
            loop.run(until=6, values={**tuned.values, **plant}).metrics.loc[LABEL, "value"] for plant in [{}, *sets.values()]
        ), rel=1e-9)
    assert tuned.before > loop.tune(**asked).before or worst({}) == loop.run(until=6).metrics.loc[LABEL, "value"]


def test_a_search_for_other_plants_does_not_go_on_with_an_earlier_one(tmp_path: Path) -> None:
    loop, [first, second] = adaptive_fmu.Loop(LOOP), corners(tmp_path)
    asked = {"parameters": {GAIN: (10.0, 40.0)}, "metric": LABEL, "until": 6, "particles": 2, "out": tmp_path / "out"}
    loop.tune(**asked, generations=1, worst_of=[first])
    loop.tune(**asked, generations=2, worst_of=[first])
    with pytest.raises(adaptive_fmu.Error, match="second|worst"):
        loop.tune(**asked, generations=2, worst_of=[first, second])
    with pytest.raises(adaptive_fmu.Error, match=r"gone\.ssv"):
        loop.tune(**asked, generations=1, worst_of=[tmp_path / "gone.ssv"], force=True)


@pytest.mark.parametrize("interface", ["cs", "me"])
def test_columns_of_tunable_parameters_hold_from_row_to_row(tmp_path: Path, interface: str) -> None:
    rng = np.random.default_rng([NUMBER, 96])
    rows = np.sort(rng.choice(np.arange(1, 300), 8, replace=False)) / 100
    times = np.concatenate([[0.0], rows])
    stiffness, u = rng.uniform(-6, -1, len(times)), rng.uniform(-1, 1)
    table = pd.DataFrame({"A[2,1]": stiffness, "u[1]": u}, index=times)
    values = {"A": [[0, 1], [-1, -0.5]], "x0": [1, 0]}
    result = adaptive_fmu.simulate("StateSpace", input=table, values=values, until=4, step=0.01, interface=interface)
    x, expected = np.array([1.0, 0.0]), []
    for time in result.data.index:
        expected.append(x[0])
        both = np.zeros((3, 3))
        both[:2] = [[0, 1, 0], [stiffness[np.searchsorted(times, time + 1e-9, side="right") - 1], -0.5, u]]
        x = (expm(0.01 * both) @ [*x, 1.0])[:2]
    np.testing.assert_allclose(result.data["y[1]"], expected, atol=2e-5, err_msg=f"{NUMBER}")
    (tmp_path / "in.csv").write_text("time,x0[1]\n0,1\n1,2\n")
    refused = program(tmp_path, "simulate", "StateSpace", "--input", "in.csv", "--until", "2")
    assert refused.returncode == 1 and "`x0[1]`" in refused.stderr
