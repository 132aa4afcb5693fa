"""Rotors of the quadrotor: the mixer against linear programmes, and the loops of 3.3.2 whose controller knows the rotors."""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import Ran
from fmpy.fmi1 import FMICallException
from independent_rotors import INERTIA, PRIORITIES, Rotors, flown
from master import Exchange, Fmu, Unit

SMALL = Rotors()
U, F, ACHIEVED = ([f"{name}[{i}]" for i in (1, 2, 3, 4)] for name in ("u", "f", "achieved"))
DEMANDS = [(4.905, 0, 0, 2.82), (4.905, 0.3, -0.2, 0.05), (1, 0.4, 0, 0), (14, 0.4, 0.2, 0.1), (4.905, 2, 1, 0.1), (-1, 0, 0, 0)]
CASES = {"3.3.2-case1": False, "3.3.2-case2": True}
# The largest error of the position in the first 3 s, when the yaw error falls below 0.02 rad for good, the largest torque of yaw,
# rms of five errors after 5 s.
FIGURES = {
    "3.3.2-case1": (0.0974, 0.163, 0.1959, [6e-4, 4.5e-4, 5.1e-3, 1.13e-3, 1.32e-3]),
    "3.3.2-case2": (0.0983, 0.171, 0.1967, [1.07e-3, 5.0e-4, 5.1e-3, 1.37e-3, 2.39e-3]),
}
HALF_A_DIGIT = [0.5e-4, 0.5e-5, 0.5e-4, 0.5e-5, 0.5e-5]


def drawn(random: np.random.Generator) -> tuple[Rotors, list[tuple[float, ...]]]:
    """Rotors, and demands on them, more often than not beyond their limits."""
    low = random.uniform(-0.5, 0.5)
    rotors = Rotors(random.uniform(0.1, 0.5), random.uniform(0.01, 0.09), low, low + random.uniform(1, 5))
    room = rotors.high - rotors.low
    largest = np.array([4 * rotors.high, 2.5 * rotors.arm * room, 2.5 * rotors.arm * room, 4 * rotors.drag * room])
    return rotors, [tuple(largest * random.uniform([-0.3, -1, -1, -1], [1.3, 1, 1, 1])) for _ in range(5)]


def mixer(fmu: Fmu, rotors: Rotors, priority: str) -> Exchange:
    """One that takes inputs at any time."""
    unit = Exchange(fmu)
    names = ("arm_length", "drag_to_thrust", "rotor_min", "rotor_max")
    for name, value in zip(names, (rotors.arm, rotors.drag, rotors.low, rotors.high), strict=True):
        unit[name] = value
    unit["priority"] = priority
    unit.start()
    unit.settle()
    return unit


def mixed(unit: Exchange, demand: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The rotors' thrusts, and what they give."""
    for name, value in zip(U, demand, strict=True):
        unit[name] = value
    return np.array([unit[name] for name in F]), np.array([unit[name] for name in ACHIEVED])


@pytest.mark.parametrize("priority", PRIORITIES)
def test_the_mixer_solves_three_linear_programmes_in_a_row(fmu: Callable[[str], Fmu], priority: str) -> None:
    random, cut = np.random.default_rng(PRIORITIES.index(priority)), 0
    for rotors, demands in [(SMALL, DEMANDS), *(drawn(random) for _ in range(60))]:
        with mixer(fmu("QuadrotorMixer"), rotors, priority) as unit:
            for demand in demands:
                forces, achieved = mixed(unit, demand)
                assert np.abs(forces - rotors.programmes(demand, priority)).max() < 1e-9, (rotors, demand)
                assert np.abs(forces - rotors.allocate(demand, priority)).max() < 1e-11
                assert np.abs(achieved - rotors.wrench(list(forces))).max() < 1e-12
                assert rotors.low <= forces.min() and forces.max() <= rotors.high
                cut += np.abs(achieved - demand).max() > 1e-6
    assert 150 < cut < 306, "demands beyond the limits, and within them"


def test_the_mixer_reports_when_the_rotors_give_something_else(fmu: Callable[[str], Fmu]) -> None:
    hover = (4.905, 0.0, 0.0, 0.0)
    cases = [((4.905, 0.3, -0.2, 0.05), False), ((4.905, 0.0, 0.0, 2.82), True), (hover, False), ((-1, 0, 0, 0), True)]
    with Unit(fmu("QuadrotorMixer")) as unit:
        unit.start(**dict(zip(U, hover, strict=True)))
        assert not unit["saturated"]
        for k, (demand, saturated) in enumerate(cases):
            for name, value in zip(U, demand, strict=True):
                unit[name] = value
            unit.step(k, 1.0)
            given = [unit[name] for name in ACHIEVED]
            assert unit["saturated"] == saturated == (given != list(demand)), demand
    with mixer(fmu("QuadrotorMixer"), SMALL, "attitude") as unit:
        mixed(unit, (4.905, 0.0, 0.0, 2.82))
        assert not unit["saturated"], "it changes at an event"
        unit.slave.enterEventMode()
        unit.settle()
        assert unit["saturated"]


@pytest.mark.parametrize("name", ["QuadrotorMixer", "L1Quadrotor"])
@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"rotor_min": 3.75}, "rotor_min = 3.75: must be below rotor_max = 3.75"),
        ({"rotor_min": 1.0, "rotor_max": 0.5}, "rotor_min"),
        ({"arm_length": 0.0}, "arm_length"),
        ({"arm_length": -0.1}, "arm_length"),
        ({"drag_to_thrust": 0.0}, "drag_to_thrust"),
    ],
)
def test_rotors_that_are_none_are_refused(fmu: Callable[[str], Fmu], name: str, values: dict[str, float], reason: str) -> None:
    with Unit(fmu(name), logging=True) as unit:
        with pytest.raises(FMICallException):
            for variable, value in values.items():
                unit[variable] = value
            unit.start()
        assert reason in unit.messages[-1].text


def test_a_demand_that_has_diverged_is_an_error_though_the_rotors_keep_their_limits(fmu: Callable[[str], Fmu]) -> None:
    with Unit(fmu("QuadrotorMixer"), logging=True) as unit:
        unit.start(**{"u[3]": 1e12})
        unit.step(0.0, 1.0)
        assert unit["f[3]"] <= 3.75
        unit["u[3]"] = -1.1e12
        with pytest.raises(FMICallException):
            unit.step(1.0, 1.0)
        assert "u[3] = -1.1" in unit.messages[-1].text and "1e12" in unit.messages[-1].text
    with Unit(fmu("L1Quadrotor"), logging=True) as unit:
        unit["rotor_limits"], unit["enabled"] = True, False
        unit.start(**{"u_manual[2]": 1e3})
        unit.step(0.0, 1e-3)
        assert unit["u[2]"] < 1
        unit["u_manual[2]"] = 1e13
        with pytest.raises(FMICallException):
            unit.step(1e-3, 1e-3)
        assert "u[2] = 1" in unit.messages[-1].text


def test_the_controller_gives_what_the_mixer_makes_of_its_demand(fmu: Callable[[str], Fmu]) -> None:
    random = np.random.default_rng(9)
    with Unit(fmu("L1Quadrotor")) as unit:
        unit["rotor_limits"], unit["enabled"] = True, False
        unit.start()
        for k in range(50):
            rotors, demands = drawn(random)
            demand = (*np.clip(demands[0][:1], 0, 15), *demands[0][1:])
            priority = PRIORITIES[k % 3]
            # The limits stay in order on the way.
            unit["rotor_min"], unit["rotor_max"] = -10.0, 10.0
            for name, value in [("arm_length", rotors.arm), ("drag_to_thrust", rotors.drag), ("priority", priority)]:
                unit[name] = value
            unit["rotor_max"], unit["rotor_min"] = rotors.high, rotors.low
            for i, value in enumerate(demand):
                unit[f"u_manual[{i + 1}]"] = value
            unit.step(k * 1e-3, 1e-3)
            forces = [unit[f"rotor_force[{i + 1}]"] for i in range(4)]
            assert np.abs(np.array(forces) - rotors.allocate(demand, priority)).max() < 1e-11
            assert np.abs(np.array([unit[name] for name in U]) - rotors.wrench(forces)).max() < 1e-12


def test_it_takes_over_from_torques_that_the_rotors_do_not_give_without_a_jump(fmu: Callable[[str], Fmu]) -> None:
    with Unit(fmu("L1Quadrotor")) as unit:
        unit["rotor_limits"], unit["enabled"] = True, False
        hover = {"u_manual[1]": 4.905, "u_manual[4]": 1.0, "x[9]": 0.05}
        unit.start(**hover)
        unit.step(0.0, 1e-3)
        by_hand = [unit[name] for name in U]
        assert by_hand[3] == pytest.approx(0.18639)
        unit["enabled"] = True
        unit.step(1e-3, 1e-9)
        assert [unit[name] for name in U] == pytest.approx(by_hand, abs=1e-4)
        feedback = 0.05 * (40**2 + 0.25)
        assert unit["u_ad[3]"] == pytest.approx(by_hand[3] / INERTIA[2] + feedback, abs=1e-2)


def errors(loop: dict[str, np.ndarray]) -> np.ndarray:
    """Of position and yaw."""
    return np.column_stack([loop[f"reference.r[{i}]"] - loop[f"plant.y[{i}]"] for i in (1, 2, 3, 4)])


@pytest.mark.parametrize("case", CASES)
def test_the_loop_within_the_rotors_limits_has_the_figures_of_the_continuous_one(ran: Callable[..., Ran], case: str) -> None:
    largest, settled, yaw, rms = FIGURES[case]
    output, loop = ran(f"{case}-rotors", "--composite", "--step", 1e-3)
    assert output["ended"] == "complete"
    time, error = loop["time"], np.abs(errors(loop))
    start = time <= 3.0
    assert error[start, :3].max() == pytest.approx(largest, abs=0.5e-4)
    outside = time[error[:, 3] >= 0.02][-1]
    assert outside == pytest.approx(settled, abs=0.6e-3)
    found = {metric["label"]: metric["value"] for metric in output["metrics"]}
    for name, value, half in zip(("phi", "theta", "psi", "x", "y"), rms, HALF_A_DIGIT, strict=True):
        assert found[f"rms e_{name}, t >= 5 s"] == pytest.approx(value, abs=1.01 * half), name
    assert found["max |torque of yaw|"] == pytest.approx(yaw, abs=0.5e-4)
    forces = np.column_stack([loop[f"controller.rotor_force[{i}]"] for i in (1, 2, 3, 4)])
    assert forces.min() == 0.0 and forces.max() <= 3.75


def test_with_the_predictor_alone_the_control_winds_up_and_the_vehicle_is_lost(ran: Callable[..., Ran]) -> None:
    off = [word for i in (1, 2, 3) for word in ("--set", f"controller.tracking_time[{i}]=0")]
    _, loop = ran("3.3.2-case1-rotors", "--until", 2.0, *off)
    assert np.abs(errors(loop)[:, 3]).max() > 3.0


@pytest.mark.parametrize("case", CASES)
def test_at_its_own_step_the_loop_keeps_its_limits(ran: Callable[..., Ran], case: str) -> None:
    output, _ = ran(f"{case}-rotors")
    limits = [metric for metric in output["metrics"] if metric["limit"] is not None]
    assert len(limits) == 10 and all(metric["value"] <= metric["limit"] for metric in limits), limits


@pytest.mark.parametrize(("until", "step"), [(0.4, 1e-4), pytest.param(3.0, 1e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", CASES)
def test_the_loop_flies_as_equations_that_are_typed_without_it(ran: Callable[..., Ran], case: str, until: float, step: float) -> None:
    _, loop = ran(f"{case}-rotors", "--composite", "--step", 1e-3)
    time, states, asked = flown(SMALL, CASES[case], until, step)
    every = round(1e-3 / step)
    time, states = time[::every], states[::every]
    assert np.abs(loop["time"][: len(time)] - time).max() < 1e-9
    for i in range(12):
        assert np.abs(loop[f"plant.x[{i + 1}]"][: len(time)] - states[:, i]).max() < (1e-5 if i not in (9, 10, 11) else 1e-3), i
    torques = np.abs(asked[:, 1:]).max(axis=0)
    assert torques == pytest.approx([0.437, 0.594, 2.820], abs=0.5e-3)


def test_without_limits_the_thrusts_show_that_no_rotor_gives(fmu: Callable[[str], Fmu]) -> None:
    with Unit(fmu("L1Quadrotor")) as unit:
        unit.start(**{"x[7]": 0.1, "x[8]": -0.1, "x[9]": 0.2})
        unit.step(0.0, 1e-6)
        asked = [unit[name] for name in U]
        assert np.abs(asked[1:]) == pytest.approx([0.437, 0.594, 2.820], abs=1e-3)
        forces = [unit[f"rotor_force[{i}]"] for i in (1, 2, 3, 4)]
        assert min(forces) < -10
        assert SMALL.wrench(forces) == pytest.approx(asked, abs=1e-12)


def test_limits_that_no_rotor_reaches_change_no_bit(ran: Callable[..., Ran]) -> None:
    wide = ["controller.rotor_limits=true", "controller.rotor_min=-1e6", "controller.rotor_max=1e6"]
    options = ["--until", 2, "--composite", "--step", 1e-3]
    _, without = ran("3.3.2-case2", *options)
    _, within = ran("3.3.2-case2", *options, *(word for value in wide for word in ("--set", value)))
    for name in without:
        if name.startswith(("plant.", "controller.u[", "controller.x_hat")):
            assert without[name].tobytes() == within[name].tobytes(), name
