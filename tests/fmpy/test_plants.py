"""The plants of chapters 3 to 7 and their references against equations that are typed and solved without them."""

from functools import partial

import numpy as np
import pytest
from independent_plants import (
    Robot,
    actuated_rate,
    coupled_rate,
    solved,
    twin_rotor_rate,
    uncertainty,
    unmatched_rate,
)
from master import Exchange, Fmu, Unit
from scipy.signal import freqs

X = [f"x[{i}]" for i in (1, 2, 3, 4, 5, 6)]
Z = ["z[1]", "z[2]"]


def begun(fmu: Fmu, **values: float) -> Exchange:
    """An instance for model exchange in Continuous-Time Mode."""
    unit = Exchange(fmu)
    for name, value in values.items():
        unit[name] = value
    unit.start()
    unit.settle()
    return unit


def moved(fmu: Fmu, names: list[str], times: np.ndarray, inputs: dict[str, float], **values: float) -> np.ndarray:
    """Variables at the times, by communication steps between them with constant inputs."""
    with Unit(fmu) as unit:
        tolerance = {"relative_tolerance": 1e-10} if "relative_tolerance" in fmu.variables else {}
        for name, value in (tolerance | values).items():
            unit[name] = value
        unit.start(times[0], **inputs)
        rows = [[unit[name] for name in names]]
        for t, following in zip(times[:-1], times[1:], strict=True):
            unit.step(t, following - t)
            rows.append([unit[name] for name in names])
        return np.array(rows)


# Another robot than the thesis' too, so that no parameter stands for another.
OTHER = Robot((1.7, 0.9), (0.8, 0.3), (0.4, 0.15), (0.2, 0.35), 3.7)


def parameters(robot: Robot) -> dict[str, float]:
    """The robot's numbers under the names of the unit."""
    named = zip(("m", "l", "I_z", "k"), (robot.mass, robot.length, robot.inertia, robot.friction), strict=True)
    numbers = {f"{name}{i + 1}": values[i] for name, values in named for i in range(2)}
    return numbers | {"g": robot.g, "inertia_variation": robot.inertia_variation}


@pytest.mark.parametrize("robot", [Robot(), OTHER, Robot(inertia_variation=True)], ids=["thesis", "other", "varying"])
def test_the_robot_accelerates_by_its_lagrangian(fmu, robot: Robot) -> None:
    random = np.random.default_rng(5)
    with begun(fmu("TwoLinkRobot"), **parameters(robot)) as unit:
        for _ in range(200):
            t, x, u = random.uniform(0, 50), random.uniform(-4, 4, 4), random.uniform(-20, 20, 2)
            unit.slave.setTime(t)
            unit.x, unit["u[1]"], unit["u[2]"] = x, *u
            expected = robot.rate(t, x, u)
            assert np.abs(unit.rate() - expected).max() < 1e-11 * (1 + np.abs(expected).max())


@pytest.mark.parametrize("robot", [Robot(), OTHER, Robot(inertia_variation=True)], ids=["thesis", "other", "varying"])
def test_the_robot_moves_by_its_lagrangian(fmu, robot: Robot) -> None:
    times, u = np.linspace(0, 5, 101), np.array([4.0, -1.5])
    start = {"x0[1]": -0.7, "x0[2]": 1.1, "x0[3]": 0.6, "x0[4]": -2.0}
    unit = moved(fmu("TwoLinkRobot"), X[:4], times, {"u[1]": u[0], "u[2]": u[1]}, **start, **parameters(robot))
    expected = solved(lambda t, x: robot.rate(t, x, u), np.array(list(start.values())), times)
    assert np.abs(expected).max() > 1
    assert np.abs(unit - expected).max() < 1e-7


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_actuated_system_has_the_printed_uncertainty(fmu, number: int) -> None:
    random = np.random.default_rng(6)
    with begun(fmu("ActuatedSiso"), uncertainty=number) as unit:
        for _ in range(200):
            t, state = random.uniform(0, 50), random.uniform(-3, 3, 5)
            unit.slave.setTime(t)
            unit.x = state
            x1, x2, mu, z, _ = state
            f = unit.rate()[1] - mu
            expected = uncertainty(number, t, x1, x2, z)
            assert abs(f - expected) < 1e-12 * (1 + abs(expected))


@pytest.mark.parametrize("number", [1, 2, 3])
@pytest.mark.parametrize("start", [0.0, 7.0])
def test_the_actuated_system_moves_by_its_equations(fmu, number: int, start: float) -> None:
    times = start + np.linspace(0, 0.6, 61)
    names = ["x[1]", "x[2]", "mu", "y[1]"]
    initial = {"x0[1]": 0.4, "x0[2]": -0.3, "mu0": 0.2}
    unit = moved(fmu("ActuatedSiso"), names, times, {"u[1]": -1.0}, **initial, **{"uncertainty": number, "C[1,2]": 1.0})
    rate = partial(actuated_rate, number, u=-1.0)
    expected = solved(rate, np.array([*initial.values(), 0.0, 0.0]), times)
    assert np.abs(unit[:, :3] - expected[:, :3]).max() < 1e-8
    assert np.abs(unit[:, 3] - expected[:, :2].sum(axis=1)).max() < 1e-8


def test_the_unmodeled_dynamics_have_the_frequency_response_of_their_transfer_function(fmu) -> None:
    """By the unit's exact derivatives; at t = 2.5 pi s, where sin 0.2 t = 1, the excitation is x1 + x2."""
    with begun(fmu("ActuatedSiso")) as unit:
        unit.slave.setTime(2.5 * np.pi)
        rates = [unit.reference(f"der(z[{i}])") for i in (1, 2)]
        by = [unit.slave.getDirectionalDerivative(rates, [unit.reference(name)], [1.0]) for name in Z + X[:2]]
    a, b = np.array(by[:2]).T, np.array(by[3])
    assert by[2] == pytest.approx(by[3], abs=1e-15)
    frequencies, expected = freqs([1.0, -1.0], [1.0, 3.0, 2.0], np.geomspace(0.01, 100, 50))
    found = [np.linalg.solve(1j * omega * np.eye(2) - a, b)[0] for omega in frequencies]
    assert np.abs(np.array(found) / expected - 1).max() < 1e-12


def test_the_robots_reference_is_that_of_the_example(fmu) -> None:
    times = np.linspace(0, 20, 201)
    names = [f"{kind}[{i}]" for i in (1, 2) for kind in ("r", "dr", "ddr")]
    values = moved(fmu("ReferenceTwoLinkRobot"), names, times, {})
    for columns, (amplitude, omega) in zip((values[:, :3], values[:, 3:]), ((0.5, 0.7), (-0.6, 0.65)), strict=True):
        r, dr, ddr = columns.T
        assert np.abs(r - amplitude * np.cos(omega * times)).max() < 1e-14
        assert np.abs(dr + amplitude * omega * np.sin(omega * times)).max() < 1e-14
        assert np.abs(ddr + omega**2 * r).max() < 1e-14


@pytest.mark.parametrize("signal", ["chapter4", "chapter7"])
def test_the_actuated_systems_reference_is_that_of_its_chapter(fmu, signal: str) -> None:
    times = np.linspace(0, 50, 101)
    r = moved(fmu("ReferenceActuatedSiso"), ["r[1]"], times, {}, signal=signal)[:, 0]
    raised = (times >= 14) & (times < 35) if signal == "chapter7" else np.zeros(101)
    assert np.abs(r - np.cos(0.5 * times) - raised).max() < 1e-14


@pytest.mark.parametrize("secant", [False, True])
def test_the_system_with_unmatched_uncertainty_moves_by_its_equations(fmu, secant: bool) -> None:
    times, u = 2.0 + np.linspace(0, 10, 101), np.array([0.4, -0.3])
    start = {"x0[1]": 0.3, "x0[2]": -0.5, "x0[3]": 0.2, "x_z0[1]": 0.7, "x_z0[2]": -1.2}
    names = [*X[:3], "x_z[1]", "x_z[2]"]
    inputs = {"u[1]": u[0], "u[2]": u[1]}
    unit = moved(fmu("UnmatchedMimo"), names, times, inputs, **start, use_secant=secant)
    rate = partial(unmatched_rate, u=u, secant=secant)
    expected = solved(rate, np.array([*start.values(), 0.0, 0.0]), times)
    assert np.abs(expected[1:, :3]).max() > 0.4
    assert np.abs(unit - expected[:, :5]).max() < 1e-7


def test_the_twin_rotor_moves_by_its_equations(fmu) -> None:
    times, u = np.linspace(0, 10, 101), np.array([1.2, -0.7])
    start = {f"x0[{i + 1}]": value for i, value in enumerate((-0.4, 0.3, 0.1, 1.5, -0.2, 0.3))}
    unit = moved(fmu("TwinRotor"), X, times, {"u[1]": u[0], "u[2]": u[1]}, **start)
    expected = solved(partial(twin_rotor_rate, u=u), np.array([*start.values(), 0.0]), times)
    assert np.abs(expected[:, :4]).max() > 1
    assert np.abs(unit - expected[:, :6]).max() < 1e-7


@pytest.mark.parametrize("nonaffine", [False, True])
def test_the_coupled_system_has_the_printed_rates(fmu, nonaffine: bool) -> None:
    random = np.random.default_rng(7)
    with begun(fmu("CoupledMimo"), nonaffine=nonaffine) as unit:
        for _ in range(200):
            t, x, u = random.uniform(0, 50), random.uniform(-3, 3, 3), random.uniform(-3, 3, 3)
            unit.slave.setTime(t)
            unit.x, unit["u[1]"], unit["u[2]"], unit["u[3]"] = x, *u
            expected = coupled_rate(t, x, u, nonaffine)
            assert np.abs(unit.rate() - expected).max() < 1e-13 * (1 + np.abs(expected).max())


def test_the_references_of_the_plants_with_several_inputs_are_those_of_their_examples(fmu) -> None:
    times = np.linspace(0, 30, 301)
    names = [f"r[{i}]" for i in (1, 2, 3)]
    unmatched = moved(fmu("ReferenceUnmatchedMimo"), names[:2], times, {})
    expected = np.where(times[:, None] < 15 - 1e-9, [1.0, -0.5], [-0.5, 1.0])
    assert np.abs(unmatched - expected).max() < 1e-14
    coupled = moved(fmu("ReferenceCoupledMimo"), names, times, {})
    assert np.abs(coupled - np.cos(np.outer(times, [0.75, 0.8, 0.7]))).max() < 1e-13
    a = 1 - np.exp(-0.5 * times) * (1 + 0.5 * times + 0.125 * times**2)
    rotor = moved(fmu("ReferenceTwinRotor"), names[:2], times, {})
    expected = np.array([a * (0.2 + 0.1 * np.sin(0.3 * times)), a * 0.3 * np.sin(0.2 * times)]).T
    assert np.abs(rotor - expected).max() < 1e-14
