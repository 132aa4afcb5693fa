"""Whole loops as one FMU: what the loops of separate units come to as their step gets small."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import adaptive_fmu, read_csv
from independent import CONVERGED, Experiment, continuous_loop
from lxml import html
from master import Fmu, Unit, closed_loop
from test_closed_loop import metrics
from test_command_line import LOOPS
from test_loops import SQUARE


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
def test_a_composite_has_the_metrics_of_the_continuous_one(composite, signal: str) -> None:
    rows, time = run(composite[signal], 60.0, 1e-2), np.linspace(0.0, 60.0, 6001)
    error, rms, control = metrics(time, rows[:, 0], rows[:, 2], signal)
    # To the digits that are printed of them.
    assert (error, rms) == pytest.approx(CONVERGED[signal][:2], rel=2e-3)
    assert control <= CONVERGED[signal][3] * 1.001


@pytest.mark.parametrize("signal", ["cosine", "square"])
def test_a_composite_is_the_continuous_one(composite, signal: str) -> None:
    rows, solution = run(composite[signal], 5.0, 1e-2), continuous_loop(Experiment(5.0, signal))
    assert np.abs(rows[:, :2] - solution.x).max() < 1e-5
    assert np.abs(rows[:, 2] - solution.u).max() < 1e-4


def test_separate_fmus_converge_to_the_composite_as_their_step_gets_small(composite, fmu) -> None:
    whole, steps = run(composite["cosine"], 5.0, 1e-2), [2e-3, 1e-3, 5e-4, 2.5e-4]
    loops = [closed_loop(fmu, 5.0, step) for step in steps]
    errors = [
        np.abs(loop.x[:: round(1e-2 / step)] - whole[:, :2]).max() for loop, step in zip(loops, steps, strict=True)
    ]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] >= 0.8, errors


def test_a_composite_has_the_outputs_of_its_units_and_the_inputs_that_nothing_is_connected_to(composite) -> None:
    whole = composite["cosine"]
    assert set(whole.named(causality="output")) == {
        *(f"reference.{name}[1]" for name in ("r", "dr", "ddr")),
        *("plant.y[1]", "plant.x[1]", "plant.x[2]"),
        *("controller.u[1]", "controller.step_too_long", "controller.projection_active", "controller.time_at_limit"),
    }
    assert whole.named(causality="input") == ["controller.enabled", "controller.u_manual[1]"]
    assert whole.variables["controller.adaptation_gain"].variability == "tunable"


def test_a_communication_step_is_only_a_point_to_look_at(composite) -> None:
    coarse, fine = run(composite["cosine"], 5.0, 0.1), run(composite["cosine"], 5.0, 1e-3)
    assert np.abs(coarse - fine[::100])[:, :2].max() < 1e-5


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, fmu_folder: Path) -> Path:
    """The results of the cosine loop, of separate units and as one."""
    out = tmp_path_factory.mktemp("results")
    for arguments in (["--composite"], ["--fmus", fmu_folder]):
        answer = adaptive_fmu("run", LOOPS[0], *arguments, "--json", "--out", out)
        assert (answer.returncode, answer.stderr) == (0, ""), answer
    assert sorted(folder.name for folder in out.iterdir()) == [LOOPS[0], f"{LOOPS[0]}-composite"]
    return out


def metrics_of(results: Path, loop: str) -> dict:
    return json.loads((results / loop / "metrics.json").read_text())


def test_a_loop_run_as_a_composite_is_judged_like_that_of_separate_units(results: Path) -> None:
    whole, separate = metrics_of(results, f"{LOOPS[0]}-composite"), metrics_of(results, LOOPS[0])
    assert (whole["loop"], whole["ended"]) == (f"{LOOPS[0]}-composite", "complete")
    assert [m["label"] for m in whole["metrics"]] == [m["label"] for m in separate["metrics"]]
    values, others = ([m["value"] for m in run["metrics"]] for run in (whole, separate))
    assert all(m["value"] <= m["limit"] for m in whole["metrics"])
    assert values[:2] == pytest.approx(CONVERGED["cosine"][:2], rel=2e-3)
    assert values == pytest.approx(others, rel=0.03)


def test_a_loop_run_as_a_composite_has_the_signals_of_separate_units(results: Path) -> None:
    whole, separate = (read_csv(results / loop / "result.csv") for loop in (f"{LOOPS[0]}-composite", LOOPS[0]))
    assert set(whole) == set(separate) and len(whole["time"]) == len(separate["time"])
    assert np.abs(whole["plant.y[1]"] - separate["plant.y[1]"]).max() < 0.02
    page = html.document_fromstring((results / f"{LOOPS[0]}-composite" / "index.html").read_text())
    settings = page.get_element_by_id("settings").text_content()
    assert "none (loop as a single FMU)" in settings and "gauss-seidel" not in settings
    assert all(unit in settings for unit in ["NonlinearSiso", "L1NonlinearSiso", "cosine_frequency[1] = 0.2"])
    assert len(page.find_class("diagram")) == 2


def short_run(out: Path, loop: str, *arguments: str | Path) -> dict[str, np.ndarray]:
    """What is recorded of one second of a loop as one unit."""
    answer = adaptive_fmu("run", loop, "--composite", "--until", "1", "--json", "--out", out, *arguments)
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    return read_csv(Path(json.loads(answer.stdout)["results"]) / "result.csv")


def test_a_loop_run_as_a_composite_takes_start_values_and_a_step_to_look_at(tmp_path: Path) -> None:
    (tmp_path / "square.ssv").write_text(SQUARE)
    square = short_run(tmp_path / "square", LOOPS[1])
    case = short_run(tmp_path / "case", LOOPS[0], "--case", tmp_path / "square.ssv")
    single = short_run(tmp_path / "single", LOOPS[0], "--set", "reference.signal=square")
    for name, column in square.items():
        assert np.array_equal(case[name], column) and np.array_equal(single[name], column), name
    coarse = short_run(tmp_path / "coarse", LOOPS[1], "--step", "0.1")
    assert len(coarse["time"]) == 11
    assert np.abs(coarse["plant.x[1]"] - square["plant.x[1]"][::100]).max() < 1e-5
    assert short_run(tmp_path / "start", LOOPS[0], "--set", "plant.x0[1]=0.25")["plant.x[1]"][0] == 0.25


def test_the_single_unit_takes_values_of_its_own_parameters(tmp_path: Path) -> None:
    """Whole numbers are no Reals."""
    values = ["fixed_steps=16", "integration_method=fixed", "relative_tolerance=1e-4", "work_limit=1000000000"]
    arguments = [word for value in values for word in ("--set", value)]
    answer = adaptive_fmu("run", LOOPS[0], "--composite", "--until", "0.1", *arguments, "--out", tmp_path)
    assert answer.returncode == 0, answer.stderr


def test_constant_estimates_do_not_tighten_the_tolerance_of_a_loop(tmp_path: Path) -> None:
    """It takes 2.6e7 operations; several times as many if eigenvalues that are 0 within rounding errors counted as growing."""
    arguments = ["--composite", "--until", "5", "--step", "5", "--set", "work_limit=4e7", "--out", tmp_path]
    answer = adaptive_fmu("run", "3.3.1-case1", *arguments)
    assert answer.returncode == 0, answer.stderr


def test_what_does_not_go_with_one_unit_is_refused_or_reported(fmu_folder: Path, tmp_path: Path) -> None:
    for wrong in (["--order", "jacobi"], ["--fmus", fmu_folder]):
        assert adaptive_fmu("run", LOOPS[0], "--composite", *wrong, "--out", tmp_path).returncode == 2
    wrong = ["--composite", "--set", "plant.a1=high", "--out", tmp_path]
    assert (answer := adaptive_fmu("run", LOOPS[0], *wrong)).returncode == 1 and "plant.a1" in answer.stderr
    left_out = ["--composite", "--set", "controller.relative_tolerance=1e-9", "--until", "0.1", "--json"]
    answer = adaptive_fmu("run", LOOPS[0], *left_out, "--out", tmp_path)
    (warning,) = json.loads(answer.stdout)["warnings"]
    assert "`controller.relative_tolerance` is ignored" in warning


def test_a_loop_that_does_not_exist_is_no_composite(tmp_path) -> None:
    exported = adaptive_fmu("export", "--composite", "9.9", "--out", tmp_path)
    assert exported.returncode == 1 and "no loop named `9.9`" in exported.stderr
