"""The loops of chapter 7, through an observer: as one unit, and through separate units."""

import numpy as np
import pytest
from independent_plants import solved
from scipy import signal
from test_plants import moved

# As one unit; the metrics are those of points at every millisecond, whatever the loop's own step is.
WHOLE = ("--composite", "--step", 1e-3)
# The continuous loops, converged: rms errors from 5 s on (of 7.5.1, the largest deviation from the ideal model).
TRACKING = {
    "7.5.1": (0.104,),
    "7.5.2": (0.05604, 0.04294),
    "7.5.3-case1": (3.54e-3, 1.10e-3, 5.08e-3, 2.12e-3, 8.84e-3),
    "7.5.3-case2": (4.23e-3, 9.52e-3, 5.75e-3),
}
# How many of their decimals are known.
KNOWN_TO = {"7.5.1": 3, "7.5.2": 5, "7.5.3-case1": 5, "7.5.3-case2": 5}
PEAKS = {"7.5.1": (6.914,), "7.5.2": (49.15, 44.10)}
QUADROTOR = [
    ("controller.angle_reference[1]", "plant.x[7]"),
    ("controller.angle_reference[2]", "plant.x[8]"),
    ("reference.r[4]", "plant.y[4]"),
    ("reference.r[1]", "plant.y[1]"),
    ("reference.r[2]", "plant.y[2]"),
]
ERRORS = {
    "7.5.2": [("reference.r[1]", "plant.x[1]"), ("reference.r[2]", "plant.x[2]")],
    "7.5.3-case1": QUADROTOR,
    "7.5.3-case2": QUADROTOR[:3],
}


def late(table: dict[str, np.ndarray]) -> np.ndarray:
    return table["time"] >= 5 - 1e-9


def ideal(t: np.ndarray) -> np.ndarray:
    """What example 7.5.1 follows: the desired dynamics with unit gain at rest, C = (1 1)."""
    product = 1.4**2 + 0.743**2
    model = signal.lti([product, product], [1, 2.8, product])
    cosine = signal.lsim(model, np.cos(0.5 * t), t)[1]
    _, step = signal.step(model, T=t)
    return cosine + sum(sign * np.interp(t - at, t, step, left=0) for sign, at in ((1, 14), (-1, 35)))


def tracking(loop: str, table: dict[str, np.ndarray]) -> list[float]:
    after = late(table)
    if loop == "7.5.1":
        return [np.abs(table["plant.y[1]"] - ideal(table["time"]))[after].max()]
    return [np.sqrt(np.mean((table[wanted] - table[true])[after] ** 2)) for wanted, true in ERRORS[loop]]


def estimation(table: dict[str, np.ndarray], states: range, first: int = 1) -> list[float]:
    """Largest errors of these estimated states, the first of which is this state of the plant."""
    pairs = [(f"observer.x_obs[{i}]", f"plant.x[{i + first - 1}]") for i in states]
    return [np.abs(table[estimate] - table[true])[late(table)].max() for estimate, true in pairs]


def peaks(loop: str, table: dict[str, np.ndarray]) -> list[float]:
    return [np.abs(table[f"controller.u[{i + 1}]"]).max() for i in range(len(PEAKS[loop]))]


@pytest.mark.parametrize("loop", TRACKING)
def test_the_loop_as_a_composite_tracks_like_the_continuous_one(ran, loop: str) -> None:
    _, table = ran(loop, *WHOLE)
    # In the digits that are printed.
    digits = KNOWN_TO[loop]
    found = [round(value, digits) for value in tracking(loop, table)]
    assert found == pytest.approx(TRACKING[loop], abs=1.001 * 10**-digits)


@pytest.mark.parametrize("loop", PEAKS)
def test_the_loop_as_a_composite_has_the_controls_of_the_continuous_one(ran, loop: str) -> None:
    _, table = ran(loop, *WHOLE)
    # Finer points of the start too: those of a whole run may miss a peak.
    _, start = ran(loop, "--composite", "--until", 0.3, "--step", 1e-5)
    highest = np.maximum(peaks(loop, table), peaks(loop, start))
    assert [float(f"{value:.4g}") for value in highest] == list(PEAKS[loop])


def test_the_estimate_is_as_good_as_reported(ran) -> None:
    _, table = ran("7.5.1", *WHOLE)
    assert [round(error, 4) for error in estimation(table, range(1, 3))] == [0.0242, 0.0298]
    assert round(table["observer.beta"].max(), 1) == 7.0
    _, proof = ran("7.5.1", *WHOLE, "--set", "observer.beta_error_power=2")
    assert [round(error, 4) for error in estimation(proof, range(1, 3))] == [0.0328, 0.0404]
    assert proof["observer.beta"].max() <= 1.02 and round(peaks("7.5.1", proof)[0], 3) == 6.910


def test_known_torques_leave_an_error_only_where_the_vehicle_differs_from_its_model(ran) -> None:
    # With equal inertias about roll and pitch, nothing but the torque turns the vehicle in yaw.
    known, differs = (estimation(ran(f"7.5.3-{case}", *WHOLE)[1], range(1, 7), 7) for case in ("case1", "case2"))
    assert max(known[2], known[5]) < 1e-12 and max(known) < 1e-4 < max(differs)


@pytest.mark.parametrize("loop", TRACKING)
def test_at_its_own_step_a_loop_of_separate_units_tracks_like_the_whole_and_keeps_its_limits(ran, loop: str) -> None:
    output, table = ran(loop)
    assert output["ended"] == "complete"
    limits = [metric for metric in output["metrics"] if metric["limit"] is not None]
    assert limits and all(metric["value"] <= metric["limit"] for metric in limits)
    _, whole = ran(loop, *WHOLE)
    for value, expected in zip(tracking(loop, table), tracking(loop, whole), strict=True):
        assert abs(value - expected) <= max(0.02 * expected, 2e-4)


@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("loop", ["7.5.1", "7.5.2"])
def test_smaller_steps_come_nearer_to_the_loop_as_a_composite_in_proportion(ran, loop: str, order: str) -> None:
    _, whole = ran(loop, "--composite", "--until", 2, "--step", 0.002)
    steps, errors = [1e-3, 5e-4, 2.5e-4, 1e-4], []
    for step in steps:
        _, table = ran(loop, "--order", order, "--step", step, "--until", 2)
        every = round(0.002 / step)
        names = [name for name in whole if name.startswith("plant.y")]
        errors.append([np.abs(table[name][::every] - whole[name]).max() for name in names])
    for error in np.array(errors).T:
        assert (np.diff(error) < 0).all(), error
        assert np.polyfit(np.log(steps), np.log(error), 1)[0] >= 0.8, error


def test_the_robots_loop_may_run_longer(ran) -> None:
    output, _ = ran("7.5.2", "--until", 20)
    assert output["ended"] == "complete"
    errors = [metric["value"] for metric in output["metrics"] if metric["label"].startswith("rms")]
    assert len(errors) == 2 and max(errors) < 0.06


def test_an_observer_moves_by_its_equations(fmu) -> None:
    times, y = np.linspace(0, 1, 51), np.array([0.4, -0.7])
    C, chains, B = np.hstack([np.eye(2), np.eye(2) / 60]), np.eye(4, k=2), np.vstack([np.zeros((2, 2)), np.eye(2)])
    # The poles of each joint: s² + (k1 + k2/60) s + k2.
    rate_gain = np.diag([60**2 + 0.5**2, 50**2 + 0.5**2])
    gain = np.vstack([np.diag([120.0, 100.0]) - rate_gain / 60, rate_gain])

    def rate(_: float, s: np.ndarray) -> np.ndarray:
        x, beta, delta = s[:4], s[4], s[5]
        error, norm = C @ x - y, y @ y
        growth = 1 + norm**2 + x @ x * norm**2 + 2 * delta
        moved = chains @ x - gain @ error - beta * growth * B @ error
        beta_rate = 100 * np.sqrt(error @ error) * growth - 100 * 1e-4 * beta
        return np.array([*moved, beta_rate, -2.5 * delta + norm**2 + 0.625])

    names = [*(f"x_obs[{i + 1}]" for i in range(4)), "beta", "delta"]
    unit = moved(fmu("ObserverTwoLinkRobot"), names, times, {"y[1]": y[0], "y[2]": y[1]})
    expected = solved(rate, np.array([0, 0, 0, 0, 1.0, 1.0]), times)
    assert np.abs(expected[-1, :2] - y).max() < 0.1
    assert np.abs(unit - expected).max() < 1e-6 * np.abs(expected).max()
