"""The loops with prescribed performance: as one unit, and through separate units."""

from pathlib import Path

import numpy as np
import pytest
from conftest import adaptive_fmu, read_csv

# As one unit, with points at every millisecond, whatever the loop's own step is.
WHOLE = ("--composite", "--step", 1e-3)
# The continuous loops, converged: the largest |e|/rho, and the largest |u|, both over the whole run.
PARTS = {"6.5.1-neuro": (0.78, 0.95, 0.26), "6.5.2-neuro": (0.79, 0.96, 0.28)}
ROBOT_ERRORS, ROBOT_PEAKS = (0.00266, 0.00250), (30.94, 28.96)
CHANNELS = {"5": 2, "5-wide": 2, "6.5.1-neuro": 3, "6.5.2-neuro": 3}


def values(output: dict, label: str) -> list[float]:
    return [metric["value"] for metric in output["metrics"] if label in metric["label"]]


@pytest.mark.parametrize("loop", CHANNELS)
def test_as_a_composite_every_error_stays_within_its_funnel(ran, loop: str) -> None:
    output, _ = ran(loop, *WHOLE)
    parts = values(output, "/rho")
    assert output["ended"] == "complete" and len(parts) == CHANNELS[loop] and max(parts) < 1


@pytest.mark.parametrize(("loop", "end"), [("5", 0.005), ("5-wide", 0.1)])
def test_the_robots_errors_never_overshoot(ran, loop: str, end: float) -> None:
    _, table = ran(loop, *WHOLE)
    rho = (1.1 - end) * np.exp(-2 * table["time"]) + end
    for i, side in [(1, -1), (2, 1)]:
        error = side * (table[f"plant.y[{i}]"] - table[f"reference.r[{i}]"])
        assert (error > 0).all() and (error < rho).all()


def test_as_a_composite_the_robots_loop_has_the_figures_of_the_continuous_one(ran) -> None:
    output, _ = ran("5", *WHOLE)
    assert np.round(values(output, "t >= 5 s"), 5).tolist() == list(ROBOT_ERRORS)
    assert np.round(values(output, "max |u"), 2).tolist() == list(ROBOT_PEAKS)


@pytest.mark.parametrize("loop", PARTS)
def test_as_a_composite_the_coupled_loops_have_the_figures_of_the_continuous_ones(ran, loop: str) -> None:
    output, _ = ran(loop, *WHOLE)
    assert np.round(values(output, "/rho"), 2).tolist() == list(PARTS[loop])


def test_the_control_of_a_loop_that_begins_on_its_model_stays_small(ran) -> None:
    # At points of a millisecond the peak of channel 2 is 239.9, over all solver steps 242.
    output, _ = ran("6.5.2-neuro", *WHOLE)
    assert np.allclose(values(output, "max |u"), (28, 242, 25), rtol=0.02)


@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("loop", ["5-wide", *PARTS])
def test_through_separate_units_it_is_the_same_loop(ran, loop: str, order: str) -> None:
    output, _ = ran(loop, "--order", order)
    whole, _ = ran(loop, *WHOLE)
    assert output["ended"] == "complete"
    assert np.allclose(values(output, "/rho"), values(whole, "/rho"), atol=2e-3)


def lost(fmu_folder: Path, out: Path, *options: str | float) -> tuple[str, float]:
    """What a run of the robot's loop that fails says, and the last time that it recorded."""
    answer = adaptive_fmu("run", "5", *map(str, options), "--fmus", fmu_folder, "--out", out)
    assert answer.returncode != 0 and answer.stderr.count("error:") == 1
    return answer.stderr, read_csv(out / "5" / "result.csv")["time"][-1]


@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
def test_sampled_signals_lose_the_robots_narrow_funnel_with_an_error(fmu_folder, tmp_path, order: str) -> None:
    error, end = lost(fmu_folder, tmp_path, "--order", order)
    assert "left its funnel" in error
    assert all(word in error for word in ("e[1]", "rho_inf[1]", "smaller communication step"))
    assert 1.4 <= end <= 1.8


def test_a_smaller_step_only_loses_it_later(fmu_folder, tmp_path) -> None:
    steps = (1e-3, 1e-4, 5e-5)
    ends = [lost(fmu_folder, tmp_path, "--step", step, "--until", 3)[1] for step in steps]
    assert 0.9 < ends[0] < ends[1] < ends[2] < 2.0
