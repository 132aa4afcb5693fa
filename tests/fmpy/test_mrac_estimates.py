"""The estimates of the robust MRAC are bounded: loop 6.5.1 as one unit against an integration of its equations by scipy."""

from pathlib import Path

import numpy as np
import pytest
from conftest import adaptive_fmu
from independent_plants import coupled_rate
from master import Fmu, Unit
from scipy.integrate import solve_ivp

CHANNELS = (1, 2, 3)
A = np.array([[-36.0, 36, 0], [0, 20, 0], [0, 0, -3]])
A_M = np.array([[-70.0, 0, 0], [0, -60, 1], [0, -1, -60]])
UNTIL = 2.0
# Most happens in the first milliseconds.
TIMES = np.concatenate([[0], np.geomspace(1e-5, 0.01, 60), np.linspace(0.02, UNTIL, 199)])
# Bound, leakage.
CASES = [(1000.0, 0.0), (20.0, 0.0), (1000.0, 0.05), (3.0, 0.0), (2.0, 0.3)]


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("loop")
    assert adaptive_fmu("export", "--composite", "6.5.1-mrac", "--out", folder).returncode == 0
    return Fmu(folder / "Loop_6_5_1_mrac.fmu", folder / "unpacked")


def of_unit(loop: Fmu, bound: float, leakage: float) -> tuple[np.ndarray, int, list[str]]:
    """theta_hat and e at these times, how often an estimate was at its bound, and warnings of that."""
    names = [f"controller.theta_hat[{j},{i}]" for i in CHANNELS for j in CHANNELS]
    names += [f"controller.e[{i}]" for i in CHANNELS]
    with Unit(loop, logging=True) as unit:
        for i in CHANNELS:
            unit[f"controller.theta_bound[{i}]"] = bound
            unit[f"controller.theta_leakage[{i}]"] = leakage
        unit.start()
        rows, active = [[unit[name] for name in names]], 0
        for start, end in zip(TIMES[:-1], TIMES[1:], strict=True):
            unit.step(start, end - start)
            rows.append([unit[name] for name in names])
            active += unit["controller.projection_active"] > 0
        messages = [message.text for message in unit.messages if message.category == "logProjection"]
    return np.array(rows), active, messages


def by_scipy(bound: float, leakage: float) -> np.ndarray:
    """The same of the equations: e, x_m, theta_hat and the integral part of sigma_hat, a row a channel."""

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        e, x_m = state[:3], state[3:6]
        theta, integral = state[6:].reshape(2, 3, 3)
        x = e + x_m
        above = 1.95 * np.exp(-1.5 * t)
        rho, rho_rate = above + 0.05, -1.5 * above
        z = e / rho
        epsilon, r = np.arctanh(z), 1 / (rho * (1 - z * z))
        size = np.abs(epsilon)[:, None]
        sigma = (integral + 2e5 * epsilon[:, None]) / (1 + 5e3 * size)
        model = A_M @ (x_m - np.cos(np.array([0.75, 0.8, 0.7]) * t))
        estimated = theta @ x + 2 * sigma.sum(1)
        u = -A @ x + model + z * rho_rate - estimated - 10 * np.tanh(epsilon / 0.01) - 0.1 * epsilon
        free = r[:, None] * (epsilon[:, None] * x - leakage * size * theta)
        f = (1.1 * theta**2 - bound**2) / (0.1 * bound**2)
        projected = np.where((f > 0) & (free * theta > 0), free * (1 - f), free)
        integral_rate = 5e4 * r[:, None] * (2 * epsilon[:, None] - 0.05 * size * sigma)
        return np.concatenate([coupled_rate(t, x, u) - model, model, 5e4 * projected.ravel(), integral_rate.ravel()])

    start = np.concatenate([[0.6, -0.8, 0.4], np.zeros(21)])
    tolerance = np.concatenate([np.full(3, 1e-13), np.full(3, 1e-9), np.full(18, 1e-7)])
    answer = solve_ivp(rate, (0, UNTIL), start, "LSODA", TIMES, rtol=1e-7, atol=tolerance)
    assert answer.success, answer.message
    return np.concatenate([answer.y[6:15], answer.y[:3]]).T


@pytest.mark.parametrize(("bound", "leakage"), CASES)
def test_the_estimates_are_those_that_scipy_finds(loop: Fmu, bound: float, leakage: float) -> None:
    found, active, messages = of_unit(loop, bound, leakage)
    expected = by_scipy(bound, leakage)
    largest = np.abs(expected[:, :9]).max()
    assert np.abs(found[:, :9] - expected[:, :9]).max() < 1e-3 * largest
    assert np.abs(found[:, :9]).max() <= bound * (1 + 1e-6)
    is_bounded = largest > bound / np.sqrt(1.1)
    assert (active > 0) == is_bounded and len(messages) == is_bounded
    assert all("theta_bound" in text and "theta_leakage" in text for text in messages)
    # At the start, of all of the run.
    parts = np.abs(found[:, 9:]) / (1.95 * np.exp(-1.5 * TIMES) + 0.05)[:, None]
    assert parts.max() == pytest.approx(0.4, abs=1e-9)


def test_a_bound_far_off_changes_no_digit_and_leakage_makes_the_estimates_smaller(loop: Fmu) -> None:
    usual, _, _ = of_unit(loop, 1000.0, 0.0)
    assert np.array_equal(of_unit(loop, 20.0, 0.0)[0], usual)
    leaking, _, _ = of_unit(loop, 1000.0, 0.05)
    # 9.571 after 10 s.
    assert np.abs(usual[:, :9]).max() > 8 and np.abs(leaking[:, :9]).max() == pytest.approx(5.543, abs=0.01)
