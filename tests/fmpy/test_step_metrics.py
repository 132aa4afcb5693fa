"""Metrics of steps: rise, settling, overshoot, steady-state error, IAE, total variation, peak, time at a limit, wherever a loop runs."""

import json
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
from conftest import adaptive_fmu as command
from sample import NUMBER


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> adaptive_fmu.Loop:
    """A second-order plant by chance, whose PID is limited, and a reference that steps twice."""
    random = np.random.default_rng(NUMBER)
    w, d = random.uniform(0.5, 3.0), random.uniform(0.2, 1.5)
    folder = tmp_path_factory.mktemp("steps")
    plant = [[0.0, 1.0], [-(w**2), -2 * d * w]], [[0.0], [w**2]], [[1.0, 0.0]], [[0.0]]
    parts = {"plant": "state-space", "controller": "pid"}
    files = [
        (name, adaptive_fmu.new(kind, folder / f"{name.title()}.toml", plant=plant, **({"bandwidth": 3} if kind == "pid" else {})))
        for name, kind in parts.items()
    ]
    (folder / "Wanted.toml").write_text('name = "Wanted"\nmodel = "reference"\ndescription = "steps"\n[structure]\nchannels = 1\n')
    loop = adaptive_fmu.Loop.connect(*files, ("reference", folder / "Wanted.toml"), step=0.005, until=60)
    loop.save(folder / "loop")
    return adaptive_fmu.Loop(folder / "loop")


def reference(first: float, second: float, at: float) -> dict[str, object]:
    heights = {"reference.step_time[1,1]": 0.0, "reference.step_time[1,2]": at}
    return heights | {"reference.step_height[1,1]": first, "reference.step_height[1,2]": second}


def crossing(t: np.ndarray, z: np.ndarray, k: int, level: float) -> float:
    """When the line from a point to the next one is at a level."""
    return t[k] + (t[k + 1] - t[k]) * (level - z[k]) / (z[k + 1] - z[k])


def figures(t: np.ndarray, y: np.ndarray, start: float, end: float) -> dict[str, float]:
    """Of one step: from a value to another one, of points from its time on."""
    z, t = (y - start) / (end - start), t - t[0]
    first = [crossing(t, z, int(np.argmax(z >= part * z[-1])) - 1, part * z[-1]) for part in (0.1, 0.9)]
    outside = np.flatnonzero(abs(z - z[-1]) > 0.02)
    last = outside[-1]
    band = z[-1] + np.copysign(0.02, z[last] - z[-1])
    return {
        "rise time": first[1] - first[0],
        "settling time": crossing(t, z, last, band),
        "overshoot": 100 * max(0.0, z.max() - 1.0),
        "steady-state error": abs(y[-1] - end),
    }


def test_metrics_are_those_of_the_recorded_signals(loop: adaptive_fmu.Loop, tmp_path: Path) -> None:
    values = reference(2.0, -3.0, 30.0) | {"controller.u_min[1]": -2.5, "controller.u_max[1]": 2.1}
    result = loop.run(values=values, out=tmp_path)
    found = result.metrics["value"]
    data = result.data
    t, y, r, u = (data.index.to_numpy(), *(data[name].to_numpy() for name in ("plant.y[1]", "reference.r[1]", "controller.u[1]")))
    assert set(r) == {2.0, -1.0}
    k = int(np.argmax(r < 0))
    steps = [figures(t[:k], y[:k], 0.0, 2.0), figures(t[k:], y[k:], 2.0, -1.0)]
    for name, unit in [("rise time", ", s"), ("settling time", ", s"), ("overshoot", ", %"), ("steady-state error", "")]:
        expected = max(step[name] for step in steps)
        assert found[f"{name} of plant.y[1]{unit}"] == pytest.approx(expected, rel=1e-9, abs=1e-9), name
    error = (abs(r[:-1] - y[:-1]) + abs(r[:-1] - y[1:])) / 2
    assert found["IAE of plant.y[1], s"] == pytest.approx(np.sum(error * np.diff(t)), rel=1e-9)
    assert found["total variation of controller.u[1]"] == pytest.approx(np.sum(abs(np.diff(u))), rel=1e-9)
    at_limit = (u <= -2.5) | (u >= 2.1)
    assert at_limit.any()
    # Each stay is counted from its first point on, or from the next one.
    stays = np.sum(np.diff(at_limit.astype(int)) > 0) + at_limit[0]
    assert found["time at a limit of controller, s"] == pytest.approx(np.sum(at_limit) * 0.005, abs=0.0051 * (stays + 1))
    # What is written and printed is the same.
    metrics = json.loads((tmp_path / "loop" / "metrics.json").read_text())["metrics"]
    assert {each["label"]: each["value"] for each in metrics} == {label: float(value) for label, value in found.items()}
    page = (tmp_path / "loop" / "index.html").read_text()
    assert "settling time of plant.y[1], s" in page
    printed = command("run", loop.name, "--until", "20", *(f"--set={name}={value}" for name, value in values.items()), "--out", tmp_path)
    assert printed.returncode == 0 and "overshoot of plant.y[1], %" in printed.stdout


def test_a_signal_that_does_not_settle_has_no_settling_time_and_one_that_follows_a_cosine_no_step(loop: adaptive_fmu.Loop) -> None:
    rising = loop.run(values=reference(1.0, 0.0, 30.0), until=5).data["plant.y[1]"]
    # Half-way up: a fixed time may be that of the first peak, where the signal stays within 2 % for a while.
    half_way = float((rising > 0.5).idxmax())
    metrics = loop.run(values=reference(1.0, 0.0, 30.0), until=half_way).metrics["value"]
    assert np.isnan(metrics["settling time of plant.y[1], s"]) and metrics["steady-state error of plant.y[1]"] > 0
    cosine = {"reference.cosine_amplitude[1]": 1.0, "reference.cosine_frequency[1]": 0.7}
    moving = loop.run(values=reference(0.0, 0.0, 30.0) | cosine).metrics
    assert not any("settling" in label or "overshoot" in label for label in moving.index)
    # At rest at its reference from the start, nothing steps.
    assert not any("settling" in label for label in loop.run(values=reference(0.0, 0.0, 30.0), until=2).metrics.index)


def test_sweep_compare_and_tune_have_them(loop: adaptive_fmu.Loop, tmp_path: Path) -> None:
    label, gain = "settling time of plant.y[1], s", "controller.K_p[1]"
    fixed = reference(1.0, 0.0, 30.0)
    present = float(adaptive_fmu.simulate(Path(loop.name) / "../Controller.toml", until=0.01, record=[gain.removeprefix("controller.")]).data.iloc[0, -1])
    gains = [present * factor for factor in (0.8, 1.0, 1.3)]
    swept = loop.sweep({gain: gains}, values=fixed)
    each = [loop.run(values=fixed | {gain: value}).metrics["value"] for value in gains]
    assert swept.data[label].tolist() == [one[label] for one in each]
    answer = command("sweep", loop.name, f"--over={gain}={','.join(map(repr, gains))}", "--json", "--out", tmp_path,
                     *(f"--set={name}={value}" for name, value in fixed.items()))  # fmt: skip
    points = json.loads(answer.stdout)["points"]
    assert [point["metrics"][label] for point in points] == swept.data[label].tolist()
    table = adaptive_fmu.compare((loop, fixed), (loop, fixed | {gain: gains[2]}))
    assert table.loc[label].iloc[1:].tolist() == [each[1][label], each[2][label]]
    tuned = loop.tune({gain: (0.5 * present, 2 * present)}, metric=label, values=fixed, particles=6, generations=4, seed=NUMBER, separate=True)
    assert tuned.objective <= each[1][label]
    again = loop.run(values=fixed | tuned.values).metrics["value"]
    assert again[label] == pytest.approx(tuned.objective, rel=1e-12)
    with pytest.raises(adaptive_fmu.Error, match=r"(?s)no metric `settling`.*settling time of plant\.y\[1\], s"):
        loop.tune({gain: (0.5 * present, 2 * present)}, metric="settling", values=fixed)


def test_a_step_of_200_has_no_largest_error_of_200(tmp_path: Path) -> None:
    motor = [[-0.5, 250], [-25, -500]], [[0], [500]], [[1, 0]], [[0]]
    adaptive_fmu.design(motor, settling_time=0.2, reference=200, kinds=["pid"], out=tmp_path, force=True)
    result = adaptive_fmu.Loop(tmp_path / "loop").run()
    values = result.metrics["value"]
    assert 200.0 not in values.round(6).tolist()
    assert values.filter(like="settling time").iloc[0] < 0.2
    assert isinstance(result.metrics, pd.DataFrame)
