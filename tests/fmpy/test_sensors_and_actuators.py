"""Sensor and actuator against the statistics and equations of scipy, through FMPy in both interfaces."""

import fmpy
import numpy as np
import pytest
from master import Fmu, Unit
from scipy.integrate import solve_ivp
from scipy.signal import welch
from scipy.stats import kstest

SAMPLES = 100_000
H = 1e-3


def noise(fmu: Fmu, seed: int, deviation: float = 1.0, count: int = SAMPLES) -> np.ndarray:
    """What a sensor of noise alone gives at its samples."""
    with Unit(fmu) as unit:
        unit["noise_deviation[1]"], unit["seed"] = deviation, seed
        unit.start()
        values = np.empty(count)
        for k in range(count):
            unit.step(k * H, H)
            values[k] = unit["y[1]"]
        return values


def test_the_noise_is_gaussian_and_white_with_the_density_of_its_documentation(fmu) -> None:
    deviation = 0.2
    values = noise(fmu("Sensor"), 12, deviation)
    assert kstest(values / deviation, "norm").pvalue > 1e-3
    frequencies, density = welch(values, fs=1 / H, nperseg=1000)
    inner = density[1:-1]
    # 199 segments that overlap by half: each of the 499 values scatters by about 8 %.
    assert np.abs(inner / (2 * deviation**2 * H) - 1).max() < 0.4
    assert abs(inner.mean() / (2 * deviation**2 * H) - 1) < 0.02
    assert frequencies[-1] == pytest.approx(1 / (2 * H))


def test_two_seeds_give_independent_noise(fmu) -> None:
    first, second = noise(fmu("Sensor"), 1, count=20_000), noise(fmu("Sensor"), 2, count=20_000)
    assert abs(np.corrcoef(first, second)[0, 1]) < 4.5 / np.sqrt(20_000)


@pytest.mark.parametrize("solver", ["CVode", "Euler"])
def test_model_exchange_has_the_noise_of_co_simulation(fmu, solver: str) -> None:
    """In the middle between samples, for at a sample FMPy gives both sides of its jump."""
    path = str(fmu("SensorTwoLinkRobot").path)
    names = [f"y[{i}]" for i in (1, 2, 3, 4)]
    start = {"u[1]": 0.30004, "u[2]": -1.0, "u[3]": 0.5, "u[4]": -0.2}
    options = dict(stop_time=0.3, output_interval=H / 2, output=names, start_values=start)
    slave = fmpy.simulate_fmu(path, fmi_type="CoSimulation", **options)
    exchange = fmpy.simulate_fmu(path, fmi_type="ModelExchange", solver=solver, step_size=H / 10, **options)
    between = (np.arange(300) + 0.5) * H
    for name in names:
        here, there = (r[name][np.searchsorted(r["time"], between - H / 10)] for r in (slave, exchange))
        assert np.abs(here - there).max() < 1e-9
    assert np.all(slave["y[1]"] == pytest.approx(0.3, abs=1e-12)), "the nearest step of the encoder"
    assert np.std(slave["y[3]"]) == pytest.approx(1e-3, rel=0.2)


def test_an_actuator_answers_a_wild_command_by_its_equation(fmu) -> None:
    """Limits, rate limit and lag together, with a command that changes within the steps as its slopes say."""
    low, high, rate, lag, dead = -0.6, 0.9, 15.0, 0.03, 0.1
    knots = np.linspace(0, 2, 41)
    command = np.random.default_rng(9).uniform(-1.5, 1.5, len(knots))

    def equation(t: float, x: np.ndarray) -> np.ndarray:
        u = np.interp(t, knots, command)
        wanted = np.clip(np.sign(u) * max(abs(u) - dead, 0.0), low, high)
        return np.clip((wanted - x) / lag, -rate, rate)

    parameters = {"u_min": low, "u_max": high, "rate_limit": rate, "time_constant": lag, "dead_zone": dead}
    with Unit(fmu("Actuator")) as unit:
        for name, value in parameters.items():
            unit[f"{name}[1]"] = value
        unit["relative_tolerance"] = 1e-10
        unit.start(**{"u[1]": command[0]})
        x = np.array([unit["y[1]"]])
        for k, (t, end) in enumerate(zip(knots[:-1], knots[1:], strict=True)):
            unit["u[1]"] = command[k]
            unit.set_slope("u[1]", (command[k + 1] - command[k]) / (end - t))
            unit.step(t, end - t)
            x = solve_ivp(equation, (t, end), x, rtol=1e-10, atol=1e-12, max_step=1e-3).y[:, -1]
            assert unit["y[1]"] == pytest.approx(x[0], abs=1e-7)


def test_a_delayed_sine_is_the_sine_of_before(fmu) -> None:
    """Within h^2/8 of its curvature, in a loop's communication steps with the sine's own slopes."""
    delay, omega = 0.02, 20.0
    with Unit(fmu("Actuator")) as unit:
        unit["delay[1]"] = delay
        unit.start()
        for k in range(2000):
            t = k * 0.3 * H
            unit["u[1]"] = np.sin(omega * t)
            unit.set_slope("u[1]", omega * np.cos(omega * t))
            unit.step(t, 0.3 * H)
            expected = np.sin(omega * max(t + 0.3 * H - delay, 0.0))
            # The master's own lines between its points are as far off, at most.
            assert abs(unit["y[1]"] - expected) < omega**2 * (H**2 / 8 + (0.3 * H) ** 2 / 2)
