"""L1 controllers in their loops while they run: warnings, limits of the control, taking over from a person."""

import re

import numpy as np
import pytest
from independent_l1 import DESIGNS
from separate import Separate
from test_l1_design import poles

CASE_1, CASE_2 = poles(DESIGNS["3.3.1-case1"]), poles(DESIGNS["3.3.1-case2"])
ESTIMATES = [*(f"omega_hat[{i},{j}]" for i in (1, 2) for j in (1, 2)), "theta_hat[1,1]", "theta_hat[2,1]"]
ESTIMATES += ["sigma_hat[1]", "sigma_hat[2]"]


def rms(r: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean((r - x[:, : r.shape[1]]) ** 2, axis=0))


def messages_of(loop: Separate, category: str) -> list[str]:
    return [message.text for message in loop.controller.messages if message.category == category]


def test_a_step_too_long_for_the_control_is_shown_and_reported_once_with_one_to_try(unit) -> None:
    loop, shown, parts, controls = Separate(unit, "robot", {}, CASE_1), [], [], []

    def look() -> None:
        frequency(loop)
        controls.append(loop.u.values.copy())
        shown.append(loop.controller["step_too_long"])
        parts.append(max(moved(u) for u in np.array(controls).T))

    loop.run(100, 1e-3, after=look)
    limit = loop.controller["step_move_limit"]
    assert any(shown) and not all(shown) and shown == [part > limit for part in parts]
    (text,) = messages_of(loop, "logStepTooLong")
    first = next(part for part in parts if part > limit)
    part, step, of_limit, better = map(float, re.findall(r"\d+\.\d+(?:e-?\d+)?", text))
    assert (part, step, of_limit) == (pytest.approx(first, abs=0.005), 1e-3, limit)
    named = 0.65 * limit / first * 1e-3
    assert 0.9 * named < better <= named


def moved(u: np.ndarray) -> float:
    """The farthest move of a control in a step, in parts of its largest magnitude; 0 while it hasn't its size."""
    size, since = 0.0, 0
    for magnitude in np.abs(u):
        size, since = (magnitude, 0) if magnitude > 1.1 * size else (size, since + 1)
    if since < min(max(len(u) - since, 20), 1000):
        return 0.0
    return np.abs(np.diff(u)).max() / np.abs(u).max()


def frequency(loop: Separate) -> float:
    """The frequency that a controller shows is that of its equations."""
    design = DESIGNS["3.3.1-case1"]
    x, u = loop.x.values, loop.u.values
    stiffness = np.linalg.eigvalsh(design.B.T @ design.P() @ design.B).max()
    expected = np.sqrt(design.adaptation_gain * stiffness * (u @ u + np.abs(x).max() ** 2 + 1))
    assert loop.controller["adaptation_frequency"] == pytest.approx(expected, rel=1e-6)
    return expected


def test_estimates_at_their_bounds_are_counted_and_reported_once(unit) -> None:
    loop, counts, expected = Separate(unit, "robot", {}, CASE_2), [], []
    low = np.array([0.5, -2.0, -2.0, 0.5, -100.0, -100.0, -10.0, -10.0])
    high = np.array([10.0, 2.0, 2.0, 10.0, 100.0, 100.0, 10.0, 10.0])

    def count() -> None:
        values = np.array([loop.controller[name] for name in ESTIMATES])
        # A general method keeps to the bounds within its tolerance.
        slack = 1e-6 * (high - low)
        assert (low - slack <= values).all() and (values <= high + slack).all()
        # Projection acts where an estimate is further from the centre than this.
        outer = np.abs(values - (low + high) / 2) > (high - low) / 2 / np.sqrt(1.1)
        counts.append(loop.controller["projection_active"])
        expected.append(outer.sum())

    loop.run(1000, 1e-3, after=count)
    assert counts == expected and max(counts) > 0 and min(counts) == 0
    assert len(messages_of(loop, "logProjection")) == 1


LIMITS = np.array([80.0, 60.0])


def test_a_controller_that_knows_its_limits_keeps_them_and_the_loop_tracks(unit) -> None:
    known = {f"u_{end}[{i + 1}]": sign * LIMITS[i] for i in (0, 1) for end, sign in (("min", -1), ("max", 1))}
    free = Separate(unit, "robot", {}, CASE_2).run(10_000, 1e-3)
    limited = Separate(unit, "robot", {}, CASE_2 | known).run(10_000, 1e-3)
    outside = Separate(unit, "robot", {}, CASE_2).run(10_000, 1e-3, applied=lambda u: np.clip(u, -LIMITS, LIMITS))
    peak = {name: np.abs(run[3]).max(axis=0) for name, run in (("free", free), ("outside", outside))}
    assert (peak["free"] > LIMITS).all() and (np.abs(limited[3]) <= LIMITS).all()
    assert (np.abs(limited[3]).max(axis=0) == LIMITS).all()
    without = rms(free[1][5000:], free[2][5000:])
    for run in (limited, outside):
        assert rms(run[1][5000:], run[2][5000:]) == pytest.approx(without, rel=0.02)
    # What is cut off without its knowledge it demands all the more; so little is cut that tracking hardly suffers.
    assert (peak["outside"] > 1.2 * peak["free"]).all()


def handed_over(unit, step: float, seconds: float) -> tuple[Separate, np.ndarray, tuple]:
    """The robot held by hand near its reference for 1 s, then by the controller: the last control by hand, the rest."""
    loop = Separate(unit, "robot", {}, CASE_2)
    loop.controller["enabled"] = False

    def by_hand() -> None:
        error, rate = loop.r.values - loop.x.values[:2], loop.x.values[2:]
        weight, stiffness, damping = np.array([[15.0, 0.0], [200.0, 100.0], [30.0, 15.0]])
        loop.by_hand.values[:] = weight + stiffness * error - damping * rate
        loop.by_hand.set()

    *_, u = loop.run(round(1.0 / step), step, before=by_hand)
    assert np.array_equal(u[-1], loop.by_hand.values)
    loop.controller["enabled"] = True
    return loop, u[-1], loop.run(round(seconds / step), step)


def test_a_controller_takes_over_from_a_person_without_a_jump_and_tracks(unit) -> None:
    loop, by_hand, (_, r, x, u) = handed_over(unit, 1e-3, 9.0)
    # Without u_ad in its place the control would be -K_m x.
    assert np.abs(DESIGNS["3.3.1-case2"].K_m @ x[0]).max() > 300.0
    coarse = np.abs(u[0] - by_hand).max()
    _, by_hand, (*_, u_fine) = handed_over(unit, 1e-4, 1e-3)
    # The control is continuous: what it changes by in the first step goes with that step.
    assert coarse < 3.0 and np.abs(u_fine[0] - by_hand).max() < 0.12 * coarse
    assert not loop.controller["step_too_long"] and np.abs(u).max() < 45.0
    free = Separate(unit, "robot", {}, CASE_2).run(10_000, 1e-3)
    assert (rms(r[4000:], x[4000:]) <= 1.05 * rms(free[1][5000:], free[2][5000:])).all()


def test_started_on_its_trajectory_a_controller_begins_with_the_control_that_is_given(unit) -> None:
    on_it = {"x0[1]": 0.5, "x0[2]": -0.6}
    hold = {"u_manual[1]": 20.0, "u_manual[2]": 3.9}
    bumpless = Separate(unit, "robot", on_it, CASE_1 | hold | {"u_ad_start": "bumpless"})
    assert bumpless.u.values == pytest.approx([20.0, 3.9], rel=1e-9)
    _, r, x, u = bumpless.run(2000, 1e-4)
    assert np.abs(u).max() < 40.0 and np.abs(r - x[:, :2]).max() < 5e-3
    zero = Separate(unit, "robot", on_it, CASE_1)
    assert zero.u.values[0] < -45_000.0
