"""The quadrotor and its reference against equations that are typed and solved without them."""

import numpy as np
import pytest
from independent_plants import solved
from independent_vehicles import Quadrotor, disturbance_rate, disturbances
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
def test_the_quadrotor_accelerates_as_its_equations_say(fmu, quadrotor: Quadrotor) -> None:
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
def test_the_quadrotor_moves_as_its_equations_say(fmu, quadrotor: Quadrotor) -> None:
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


def test_the_quadrotors_reference_climbs_in_circles(fmu) -> None:
    t = np.linspace(0, 20, 201)
    names = [f"{kind}[{i}]" for kind in ("r", "dr", "ddr") for i in (1, 2, 3, 4)]
    values = moved(fmu("ReferenceQuadrotor"), names, t, {})
    decay = np.exp(-0.5 * t)
    r = np.sin(0.4 * t), 1 - np.cos(0.4 * t), 2 * (1 - decay * (1 + 0.5 * t)), 0.3 * np.sin(0.3 * t)
    dr = 0.4 * np.cos(0.4 * t), 0.4 * np.sin(0.4 * t), 0.5 * t * decay, 0.09 * np.cos(0.3 * t)
    ddr = -0.16 * np.sin(0.4 * t), 0.16 * np.cos(0.4 * t), 0.5 * (1 - 0.5 * t) * decay, -0.027 * np.sin(0.3 * t)
    assert np.abs(values - np.array([*r, *dr, *ddr]).T).max() < 1e-14
