"""Whole loops as one FMU: what the loops of separate units come to as their step gets small."""

import numpy as np
import pytest
from conftest import adaptive_fmu
from independent import CONVERGED, Experiment, continuous_loop
from master import Fmu, Unit, closed_loop
from test_closed_loop import metrics

@pytest.fixture(scope="module")
def composite(tmp_path_factory: pytest.TempPathFactory):
    """A loop as one FMU, exported by the command that a user has."""
    folder = tmp_path_factory.mktemp("composites")
    loops = ["3.2.1-cosine", "3.2.1-square"]
    exported = adaptive_fmu("export", *(word for name in loops for word in ("--composite", name)), "--out", folder)
    assert exported.returncode == 0, exported.stderr
    files = {"cosine": folder / "Loop_3_2_1_cosine.fmu", "square": folder / "Loop_3_2_1_square.fmu"}
    assert sorted(files.values()) == sorted(folder.iterdir()), "only what was asked for"
    return {signal: Fmu(file, tmp_path_factory.mktemp(signal)) for signal, file in files.items()}


def run(fmu: Fmu, stop: float, step: float) -> np.ndarray:
    """Rows x1, x2, u at multiples of the step."""
    names = ["plant.x[1]", "plant.x[2]", "controller.u[1]"]
    with Unit(fmu) as unit:
        unit.start(stop=stop)
        rows = [[unit[name] for name in names]]
        for k in range(round(stop / step)):
            unit.step(k * step, step)
            rows.append([unit[name] for name in names])
    return np.array(rows)


@pytest.mark.parametrize("signal", ["cosine", "square"])
def test_a_whole_loop_has_the_metrics_of_the_continuous_one(composite, signal: str) -> None:
    rows, time = run(composite[signal], 60.0, 1e-2), np.linspace(0.0, 60.0, 6001)
    error, rms, control = metrics(time, rows[:, 0], rows[:, 2], signal)
    # To the digits that are printed of them.
    assert (error, rms) == pytest.approx(CONVERGED[signal][:2], rel=2e-3)
    assert control <= CONVERGED[signal][3] * 1.001


@pytest.mark.parametrize("signal", ["cosine", "square"])
def test_a_whole_loop_is_the_continuous_one(composite, signal: str) -> None:
    rows, solution = run(composite[signal], 5.0, 1e-2), continuous_loop(Experiment(5.0, signal))
    assert np.abs(rows[:, :2] - solution.x).max() < 1e-5
    assert np.abs(rows[:, 2] - solution.u).max() < 1e-4


def test_separate_units_come_to_the_whole_loop_as_their_step_gets_small(composite, fmu) -> None:
    whole, steps = run(composite["cosine"], 5.0, 1e-2), [2e-3, 1e-3, 5e-4, 2.5e-4]
    loops = [closed_loop(fmu, 5.0, step) for step in steps]
    errors = [np.abs(loop.x[:: round(1e-2 / step)] - whole[:, :2]).max() for loop, step in zip(loops, steps, strict=True)]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] >= 0.8, errors


def test_a_whole_loop_has_the_outputs_of_its_units_and_no_inputs(composite) -> None:
    whole = composite["cosine"]
    assert set(whole.named(causality="output")) == {
        *(f"reference.{name}[1]" for name in ("r", "dr", "ddr")),
        *("plant.y[1]", "plant.x[1]", "plant.x[2]", "controller.u[1]"),
    }
    assert whole.named(causality="input") == []
    assert whole.variables["controller.adaptation_gain"].variability == "tunable"


def test_a_communication_step_is_only_a_point_to_look_at(composite) -> None:
    coarse, fine = run(composite["cosine"], 5.0, 0.1), run(composite["cosine"], 5.0, 1e-3)
    assert np.abs(coarse - fine[::100])[:, :2].max() < 1e-5


def test_a_loop_that_does_not_exist_is_no_composite(tmp_path) -> None:
    exported = adaptive_fmu("export", "--composite", "9.9", "--out", tmp_path)
    assert exported.returncode == 1 and "no loop named `9.9`" in exported.stderr
