"""Quadrotor and submarine, with their references, against equations that are typed and solved without them."""

from dataclasses import asdict

import numpy as np
import pytest
from independent_plants import H, solved
from independent_vehicles import Quadrotor, Submarine, disturbance_rate, disturbances
from master import Unit
from test_plants import begun, moved

X = [f"x[{i + 1}]" for i in range(12)]

QUADROTORS = {
    "thesis": Quadrotor(),
    "exact": Quadrotor(exact=True),
    "uncertain": Quadrotor(uncertain=True),
    "other": Quadrotor(1.3, (0.02, 0.05, 0.04), 3.7, exact=True, uncertain=True),
}


def quadrotor_parameters(quadrotor: Quadrotor) -> dict[str, float]:
    """Its numbers under the names of the unit."""
    inertia = {f"inertia[{i + 1}]": value for i, value in enumerate(quadrotor.inertia)}
    switches = {"exact_kinematics": quadrotor.exact, "uncertain": quadrotor.uncertain}
    return {"m": quadrotor.m, "g": quadrotor.g} | inertia | switches


@pytest.mark.parametrize("quadrotor", QUADROTORS.values(), ids=QUADROTORS)
def test_the_quadrotor_accelerates_by_its_equations(fmu, quadrotor: Quadrotor) -> None:
    random = np.random.default_rng(7)
    with begun(fmu("Quadrotor"), **quadrotor_parameters(quadrotor)) as unit:
        for _ in range(100):
            x, u, s = random.uniform(-1.2, 1.2, 12), random.uniform(-0.5, 0.5, 4), random.uniform(-1, 1, 5)
            u[0] = random.uniform(-5, 20)
            unit.x = np.concatenate([s, x])
            for i in range(4):
                unit[f"u[{i + 1}]"] = u[i]
            expected = quadrotor.rate(x, u, s[[0, 1, 3]])
            assert np.abs(unit.rate()[5:] - expected).max() < 1e-11 * (1 + np.abs(expected).max())


@pytest.mark.parametrize("quadrotor", QUADROTORS.values(), ids=QUADROTORS)
def test_the_quadrotor_moves_by_its_equations(fmu, quadrotor: Quadrotor) -> None:
    times, u = np.linspace(0, 1.5, 31), np.array([6.0, 4e-3, -6e-3, 5e-3])
    inputs = {f"u[{i + 1}]": value for i, value in enumerate(u)}
    unit = moved(fmu("Quadrotor"), X, times, inputs, **quadrotor_parameters(quadrotor))
    start = np.concatenate([np.zeros(6), [0.1, -0.1, 0.2], np.zeros(3 + 5)])

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([quadrotor.rate(x[:12], u, disturbances(x[12:])), disturbance_rate(t, x[12:])])

    expected = solved(rate, start, times, max_step=0.05)[:, :12]
    assert np.abs(expected).max() > 1
    assert np.abs(unit - expected).max() < 1e-7


def test_the_quadrotors_disturbances_are_filtered_sines(fmu) -> None:
    times = np.linspace(0, 20, 201)
    names = [f"disturbance[{i}]" for i in (1, 2, 4)]
    inputs = {"u[1]": 0.5 * 9.81}
    level = {"x0[7]": 0.0, "x0[8]": 0.0, "x0[9]": 0.0}
    unit = moved(fmu("Quadrotor"), names, times, inputs, **level)
    states = solved(disturbance_rate, np.zeros(5), times)
    expected = np.array([disturbances(s) for s in states])
    assert (np.abs(expected).max(axis=0) > 0.05).all()
    assert np.abs(unit - expected).max() < 1e-9


def test_the_quadrotors_reference_is_a_helix(fmu) -> None:
    t = np.linspace(0, 20, 201)
    names = [f"{kind}[{i}]" for kind in ("r", "dr", "ddr") for i in (1, 2, 3, 4)]
    values = moved(fmu("ReferenceQuadrotor"), names, t, {})
    decay = np.exp(-0.5 * t)
    r = np.sin(0.4 * t), 1 - np.cos(0.4 * t), 2 * (1 - decay * (1 + 0.5 * t)), 0.3 * np.sin(0.3 * t)
    dr = 0.4 * np.cos(0.4 * t), 0.4 * np.sin(0.4 * t), 0.5 * t * decay, 0.09 * np.cos(0.3 * t)
    ddr = -0.16 * np.sin(0.4 * t), 0.16 * np.cos(0.4 * t), 0.5 * (1 - 0.5 * t) * decay, -0.027 * np.sin(0.3 * t)
    assert np.abs(values - np.array([*r, *dr, *ddr]).T).max() < 1e-14


SUBMARINES = {
    "thesis": Submarine(),
    "other": Submarine(2.1, 0.5, 200.0, 0.03, 998.0, 3.7, (3.0, 7.0, 11.0, 2.0, 5.0, 13.0), 0.4, 0.9, 0.6),
}


def submarine_parameters(submarine: Submarine) -> dict[str, float]:
    """Its numbers under the names of the unit."""
    linear = {f"linear_damping[{i + 1}]": value for i, value in enumerate(submarine.linear)}
    return {name: value for name, value in asdict(submarine).items() if name != "linear"} | linear


@pytest.mark.parametrize("submarine", SUBMARINES.values(), ids=SUBMARINES)
def test_the_submarines_added_mass_is_that_of_lambs_integrals(fmu, submarine: Submarine) -> None:
    with Unit(fmu("MaresAuv")) as unit:
        for name, value in submarine_parameters(submarine).items():
            unit[name] = value
        unit.start()
        added = [unit[f"added_mass[{i + 1}]"] for i in range(6)]
    assert added == pytest.approx(submarine.added_mass, rel=1e-10)


@pytest.mark.parametrize("submarine", SUBMARINES.values(), ids=SUBMARINES)
def test_the_submarine_accelerates_by_its_lagrangian(fmu, submarine: Submarine) -> None:
    random = np.random.default_rng(8)
    with begun(fmu("MaresAuv"), **submarine_parameters(submarine)) as unit:
        for _ in range(50):
            x, u = random.uniform(-1.2, 1.2, 12), random.uniform(-30, 30, 6)
            unit.x = np.concatenate([x[:6], submarine.velocities(x[:6], x[6:]).real])
            for i in range(6):
                unit[f"u[{i + 1}]"] = u[i]
            change = submarine.rate(x, u)
            # The velocities in body axes change with the rates and with the attitude.
            moved_x = x + 1j * H * change
            nu_rate = submarine.velocities(moved_x[:6], moved_x[6:]).imag / H
            expected = np.concatenate([x[6:], nu_rate])
            assert np.abs(unit.rate() - expected).max() < 1e-10 * (1 + np.abs(expected).max())


def test_the_submarine_moves_by_its_lagrangian(fmu) -> None:
    submarine, times = Submarine(), np.linspace(0, 1, 11)
    u = np.array([35.0, -28.0, 22.0, 0.3, -5.9, 7.2])
    start = np.array([1, 2, 3, 0.2, -0.3, 0.7, 0.4, -0.2, 0.1, 0.2, -0.1, 0.3])
    inputs = {f"u[{i + 1}]": value for i, value in enumerate(u)}
    initial = {f"x0[{i + 1}]": value for i, value in enumerate(start)}
    unit = moved(fmu("MaresAuv"), X, times, inputs, **initial)
    expected = solved(lambda _, x: submarine.rate(x, u), start, times, max_step=0.1, rtol=1e-9)
    assert np.abs(expected - start).max() > 0.3
    assert np.abs(unit - expected).max() < 1e-7


def test_the_submarines_reference_begins_smoothly(fmu) -> None:
    t = np.linspace(0, 30, 301)
    names = [f"{kind}[{i + 1}]" for kind in ("r", "dr", "ddr") for i in range(6)]
    values = moved(fmu("ReferenceMaresAuv"), names, t, {})
    decay = np.exp(-0.4 * t)
    s = 1 - decay * (1 + 0.4 * t + 0.08 * t**2), 0.032 * t**2 * decay, (0.064 * t - 0.0128 * t**2) * decay
    waves = [(2.0, 0.1), (0.1, 0.2), (-0.15, 0.15), (0.5, 0.1)]
    east, phi, theta, psi = (
        (a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)) for a, w in waves
    )
    shapes = [(0.25 * t, 0.25, 0), east, (3, 0, 0), phi, theta, psi]
    r = [s[0] * g for g, _, _ in shapes]
    dr = [s[1] * g + s[0] * dg for g, dg, _ in shapes]
    ddr = [s[2] * g + 2 * s[1] * dg + s[0] * ddg for g, dg, ddg in shapes]
    assert np.abs(values - np.array([*r, *dr, *ddr]).T).max() < 1e-13
