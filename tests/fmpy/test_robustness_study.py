"""The study of the robot's robustness: its loops are those that FMPy runs, its samples and intervals are right, and it continues."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from dask.distributed import Client, LocalCluster
from scipy.stats import binomtest

STUDY = ROOT / "examples" / "robustness_dask"
sys.path.insert(0, str(STUDY))
# Cargo watches that folder: compiled Python in it would have it build the program again.
sys.dont_write_bytecode = True

import study  # noqa: E402

SEED = 1
#: In the order of stepping: each FMU, and what it is given before a step: source, outputs, inputs.
UNITS = {
    "reference": ("ReferenceTwoLinkRobot", []),
    "plant": ("TwoLinkRobot", [("actuator", "y[1] y[2]", "u[1] u[2]")]),
    "sensor": ("SensorTwoLinkRobot", [("plant", "x[1] x[2] x[3] x[4]", "u[1] u[2] u[3] u[4]")]),
    "controller": (
        "L1TwoLinkRobot",
        [("reference", "r[1] r[2]", "r[1] r[2]"), ("sensor", "y[1] y[2] y[3] y[4]", "x[1] x[2] x[3] x[4]")],
    ),
    "actuator": ("ActuatorTwoLinkRobot", [("controller", "u[1] u[2]", "u[1] u[2]")]),
}
POLES = ((-30.0, 0.5), (-30.0, -0.5), (-40.0, 0.5), (-40.0, -0.5))


def errors_by_fmpy(unit: Callable, values: dict[str, float], step: float) -> np.ndarray:
    """Rms errors of both joints from 5 s on."""
    units = {name: unit(fmu) for name, (fmu, _) in UNITS.items()}
    for i, (real, imaginary) in enumerate(POLES, 1):
        units["controller"][f"pole_real[{i}]"], units["controller"][f"pole_imag[{i}]"] = real, imaginary
    for name, value in values.items():
        of, variable = name.split(".")
        units[of][variable] = value
    for one in units.values():
        one.start(stop=study.STOP)
    errors = []
    for k in range(round(study.STOP / step)):
        for name, (_, wires) in UNITS.items():
            for source, outputs, inputs in wires:
                values_there = units[source].slave.getReal([units[source].reference(output) for output in outputs.split()])
                units[name].slave.setReal([units[name].reference(input) for input in inputs.split()], values_there)
            units[name].step(k * step, step)
        errors.append([units["reference"][f"r[{i}]"] - units["plant"][f"y[{i}]"] for i in study.JOINTS])
    later = np.array(errors)[round(5.0 / step) - 1 :]
    return np.sqrt((later**2).mean(axis=0))


@pytest.mark.parametrize("k", [10, 19])
def test_a_loop_of_the_study_is_the_one_that_fmpy_runs(unit: Callable, k: int) -> None:
    """The one passes, the other fails; both have the longest step."""
    table = study.study(k + 1, SEED, None)
    sample = study.sample(SEED, k)
    assert sample["step (s)"] == 0.005 and bool(table["failed"][k]) is (k == 19)
    values = {name: of.item() for name, of in study.points(pd.DataFrame([sample])).items()}
    found = errors_by_fmpy(unit, values, sample["step (s)"])
    assert table.loc[k, [f"rms e_{i}, t >= 5 s" for i in study.JOINTS]].to_numpy(float) == pytest.approx(found, rel=1e-3)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster.scheduler_address


def test_the_study_runs_on_dask_and_continues(scheduler: str, tmp_path: Path) -> None:
    """By its command, the same to the bit as in this process; with more loops, and without what a crash cut off."""
    for loops in (4, 8):
        words = ["--loops", str(loops), "--scheduler", scheduler, "--out", str(tmp_path / "out")]
        command = [sys.executable, STUDY / "study.py", *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        expected = study.study(loops, SEED, None)
        found = pd.read_csv(tmp_path / "out" / "results.csv", index_col="loop", keep_default_na=False)
        pd.testing.assert_frame_equal(found, expected, check_exact=True, check_names=False, check_dtype=False)
        assert f"failed: {expected['failed'].sum()} of {loops}" in (tmp_path / "out" / "summary.txt").read_text()
        stored = sorted((tmp_path / "out").glob("step_*/runs.jsonl"))
        assert sum(len(file.read_text().splitlines()) for file in stored) == loops
        stored[-1].write_bytes(stored[-1].read_bytes()[:-20])
    assert "failure rate of 8 loops" in (tmp_path / "out" / "failure_rate.svg").read_text()
    assert not list(STUDY.glob("**/*.pyc"))


def test_the_first_loops_end_as_those_of_the_figure() -> None:
    table = study.study(40, SEED, None)
    assert table.index[table["failed"]].tolist() == [6, 19, 26, 30]


@pytest.mark.slow
def test_the_readme_and_the_figure_are_those_of_the_study(tmp_path: Path) -> None:
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=":0") as client:
        table = study.study(1000, SEED, client)
    page = " ".join((STUDY / "README.md").read_text().split())
    failed = int(table["failed"].sum())
    low, high = study.interval(failed, 1000)
    assert f"{failed} fail, {failed / 10:.1f} % ({100 * low:.1f} to {100 * high:.1f} %, with 95 % confidence)" in page
    errors = table[[f"rms e_{i}, t >= 5 s" for i in study.JOINTS]].max(axis=1)
    assert f"rms error of a joint is {errors.max():.3f} rad, the limit 0.05 rad, the median {errors.median():.3f} rad" in page
    parts = study.rates(table)
    study.picture(parts, failed / 1000, 1000, tmp_path / "figure.svg")
    drawn, shown = ((folder / name).read_text() for folder, name in ((tmp_path, "figure.svg"), (STUDY, "failure_rate.svg")))
    paths = [re.findall(r' d="([^"]*)"', text) for text in (drawn, shown)]
    assert paths[0] == paths[1]
    for name, sentence in {
        "rate_noise (rad/s)": "{:.0f} % ({:.0f} to {:.0f}) fail in the highest fifth of its range",
        "drive_lag (s)": "{:.0f} % ({:.0f} to {:.0f}) fail with time constants above 6.3 ms",
        "adaptation_gain (1)": "{:.0f} % ({:.0f} to {:.0f}) fail in the highest fifth",
        "step (s)": "{:.0f} % ({:.0f} to {:.0f}) fail at 5 ms",
    }.items():
        last = parts[parts["quantity"] == name].iloc[-1]
        assert sentence.format(100 * last["failed"] / last["loops"], 100 * last["low"], 100 * last["high"]) in page, name


def test_samples_depend_on_seed_and_number_only_and_fill_their_ranges() -> None:
    assert study.sample(SEED, 5) == study.sample(SEED, 5) != study.sample(SEED + 1, 5)
    samples = pd.DataFrame([study.sample(SEED, k) for k in range(1000)])
    for name, low, high, how, _ in study.QUANTITIES:
        assert low <= samples[name].min() and samples[name].max() <= high
        # Each tenth of the samples up to where a tenth should be, within five standard deviations.
        for tenth in () if isinstance(how, list) else range(1, 10):
            part = (samples[name] < study.value(tenth / 10, low, high, how)).mean()
            assert abs(part - tenth / 10) < 5 * np.sqrt(0.25 / len(samples))
        for choice in how if isinstance(how, list) else ():
            assert abs((samples[name] == choice).mean() - 1 / len(how)) < 5 * np.sqrt(0.25 / len(samples))


def test_limits_of_the_drives_and_of_their_model_are_symmetric() -> None:
    values = study.points(pd.DataFrame([study.sample(SEED, k) for k in range(5)]))
    limits = [f"{unit}.u_max[{i}]" for unit in ("controller", "actuator") for i in study.JOINTS]
    for name in limits:
        assert values[name].equals(values[limits[0]]) and values[name.replace("max", "min")].equals(-values[name])


@pytest.mark.parametrize(("failed", "count"), [(0, 10), (3, 10), (10, 10), (147, 1000)])
def test_intervals_are_those_of_wilson(failed: int, count: int) -> None:
    expected = binomtest(failed, count).proportion_ci(0.95, method="wilson")
    assert study.interval(failed, count) == pytest.approx((expected.low, expected.high), abs=1e-4)


def test_rates_are_those_of_each_part() -> None:
    """Of a table in which a quantity decides."""
    table = pd.DataFrame([study.sample(SEED, k) for k in range(200)])
    table["failed"] = table["rate_noise (rad/s)"] > study.value(0.8, 1e-3, 1e-1, True)
    rates = study.rates(table)
    assert rates.groupby("quantity")["loops"].sum().eq(200).all() and rates.groupby("quantity")["failed"].sum().nunique() == 1
    noise = rates[rates["quantity"] == "rate_noise (rad/s)"]
    assert (noise["failed"].to_numpy()[:4] == 0).all() and noise["failed"].iloc[4] == noise["loops"].iloc[4] > 0
