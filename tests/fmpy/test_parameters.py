"""Parameters set while a loop runs."""

import numpy as np
import pytest
from independent import Design, Experiment, changed, continuous_loop
from master import CONTROLLER, PLANT, REFERENCE, ClosedLoop, Unit, example, refused

STEP = 1e-3
VARIABLES = {
    "feedback_gain": "feedback_gain[1,1]",
    "adaptation_gain": "adaptation_gain",
    "theta_bound": "theta_bound[1]",
}


@pytest.fixture
def loop(unit) -> ClosedLoop:
    """The example with its cosine, started."""
    return example(unit(REFERENCE), unit(PLANT), unit(CONTROLLER)).start()


def controller_of(loop: ClosedLoop) -> Unit:
    return loop.units["controller"]


@pytest.mark.parametrize(
    ("number", "value"), [("feedback_gain", 60.0), ("feedback_gain", 5.0), ("adaptation_gain", 2e4)]
)
def test_a_gain_changed_while_running_acts_as_in_the_continuous_loop(
    loop: ClosedLoop, number: str, value: float
) -> None:
    until, stop = 2000, 4000
    first = loop.run(until * STEP, STEP)
    controller_of(loop)[VARIABLES[number]] = value
    run = first.followed_by(loop.run(stop * STEP, STEP, first=until))
    solution = continuous_loop(Experiment(4.0, changes=((2.0, changed(**{number: value})),)))
    unchanged = continuous_loop(Experiment(4.0))
    error = np.abs(run.x[::10] - solution.x).max()
    assert error < 2e-3 and np.abs(run.u[::10] - solution.u)[250:].max() < 0.02
    # The change is seen, and not by a margin.
    assert np.abs(solution.u - unchanged.u).max() > 1e-3
    assert controller_of(loop)[VARIABLES[number]] == value


def test_a_change_of_the_feedback_gain_never_makes_the_control_jump(loop: ClosedLoop) -> None:
    loop.run(2.0, STEP)
    before = controller_of(loop)["u[1]"]
    controller_of(loop)["feedback_gain[1,1]"] = 100.0
    controller_of(loop).step(2.0, 1e-7)
    # u' = -K (eta - r), of which eta - r is below 10.
    assert 0 < abs(controller_of(loop)["u[1]"] - before) < 100 * 10 * 1e-7


def test_estimates_outside_tightened_bounds_are_brought_to_them_and_it_is_logged(loop: ClosedLoop) -> None:
    loop.run(4.0, STEP)
    controller, estimates = controller_of(loop), ["theta_hat[1,1]", "theta_hat[1,2]"]
    largest = max(abs(controller[name]) for name in estimates)
    assert largest > 0.05
    bound = largest / 2
    controller["theta_bound[1]"] = bound
    loop.run(4.001, STEP, first=4000)
    assert max(abs(controller[name]) for name in estimates) <= bound * (1 + 1e-6)
    logged = [message for message in controller.messages if message.category == "logProjection"]
    assert len(logged) == 2 and "moved to" in logged[0].text and "at a bound" in logged[1].text
    # It stays inside from then on, and the loop goes on.
    later = loop.run(6.0, STEP, first=4001)
    assert max(abs(controller[name]) for name in estimates) <= bound * (1 + 1e-6)
    assert np.isfinite(later.u).all() and len(controller.messages) == 2


def test_parameters_that_are_valid_only_together_may_be_set_one_by_one(loop: ClosedLoop) -> None:
    loop.run(1.0, STEP)
    controller = controller_of(loop)
    # An upper bound under the lower one, then the lower bound, then an upper bound that fits.
    for name, value in [("omega_max[1,1]", 0.2), ("omega_min[1,1]", 0.1), ("omega_max[1,1]", 6.0)]:
        controller[name] = value
    # A_m is unstable after the first of these, and stable after the second.
    controller["A_m[2,1]"] = 1.0
    controller["A_m[1,1]"] = -2.0
    loop.run(1.001, STEP, first=1000)
    assert controller.messages == []
    assert (controller["omega_min[1,1]"], controller["omega_max[1,1]"]) == (0.1, 6.0)
    # K_g = -1/(C A_m^-1 B) and A_m' P + P A_m = -I, with the new A_m.
    a_m = np.array([[-2.0, 1.0], [1.0, -1.4]])
    p = np.array([[controller[f"P[{i},{j}]"] for j in (1, 2)] for i in (1, 2)])
    assert np.allclose(a_m.T @ p + p @ a_m, -np.eye(2), atol=1e-12)
    assert controller["K_g[1,1]"] == pytest.approx(-1 / np.linalg.inv(a_m)[0, 1], rel=1e-12)


INVALID = [
    ({"A_m[2,1]": 1.0}, "A_m"),
    ({"omega_max[1,1]": 0.2}, "omega_max[1,1]"),
    ({"omega_min[1,1]": 3.5}, "omega_min[1,1]"),
    ({"Q[1,1]": -1.0}, "Q"),
    ({"theta_bound[1]": -1.0}, "theta_bound[1]"),
    ({"projection_tolerance": 0.0}, "projection_tolerance"),
    ({"adaptation_gain": -1e5}, "adaptation_gain"),
]


@pytest.mark.parametrize(("values", "named"), INVALID, ids=[named for _, named in INVALID])
def test_an_invalid_set_is_refused_and_the_loop_goes_on_as_if_it_had_never_been_set(
    unit, loop: ClosedLoop, values: dict[str, float], named: str
) -> None:
    other = example(unit(REFERENCE), unit(PLANT), unit(CONTROLLER)).start()
    loop.run(0.5, STEP), other.run(0.5, STEP)
    controller = controller_of(loop)
    before = controller.everything()
    for name, value in values.items():
        controller[name] = value
    assert refused(controller.step, 0.5, STEP).status == 3
    assert controller.messages[-1].category == "logStatusError" and named in controller.messages[-1].text
    assert controller.everything() == before
    assert loop.run(1.0, STEP, first=500).same_as(other.run(1.0, STEP, first=500))


def test_of_several_reasons_every_one_is_reported(loop: ClosedLoop) -> None:
    controller = controller_of(loop)
    controller["A_m[2,1]"] = 1.0
    controller["omega_max[1,1]"] = 0.2
    refused(controller.step, 0.0, STEP)
    assert all(name in controller.messages[-1].text for name in ["A_m", "omega_max[1,1]"])


@pytest.mark.parametrize(
    ("name", "variable", "value"),
    [
        (PLANT, "x0[1]", 1.0),
        (PLANT, "relative_tolerance", 1e-3),
        (PLANT, "input_handling", "extrapolate"),
        (CONTROLLER, "relative_tolerance", 1e-3),
        (CONTROLLER, "input_handling", "interpolate"),
        (REFERENCE, "on_step_failure", "discard"),
    ],
)
def test_a_fixed_parameter_is_refused_once_the_simulation_has_started(unit, name: str, variable: str, value) -> None:
    instance = unit(name)
    instance[variable] = value
    set_before = instance.start()[variable]
    refused(instance.__setitem__, variable, value)
    assert f"`{variable}`" in instance.messages[-1].text and "fixed" in instance.messages[-1].text
    instance.step(0.0, STEP)
    assert instance[variable] == set_before


def test_what_is_wrong_at_the_start_is_reported_there(unit) -> None:
    controller = unit(CONTROLLER, **{"A_m[2,2]": 1.4})
    controller.slave.setupExperiment()
    controller.slave.enterInitializationMode()
    assert refused(controller.slave.exitInitializationMode).status == 3
    assert "A_m" in controller.messages[-1].text
    controller["A_m[2,2]"] = -1.4
    controller.slave.exitInitializationMode()
    controller.step(0.0, STEP)


def test_the_tests_design_is_the_units(unit) -> None:
    controller, design = unit(CONTROLLER).start(), Design()
    read = {number: controller[variable] for number, variable in VARIABLES.items()}
    assert read == {number: getattr(design, number) for number in VARIABLES}
    assert (controller["omega_min[1,1]"], controller["omega_max[1,1]"]) == design.omega
