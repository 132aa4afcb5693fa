"""Inputs within a step, derivatives of outputs, any start time, any step; against scipy and mathematics."""

import math
from collections.abc import Callable

import fmpy
import numpy as np
import pytest
import sample

from independent import HALF_PERIOD, plant_rate, square
from master import CONTROLLER, PLANT, REFERENCE, Fmu, FMICallException, Unit, at_ease, refused
from scipy.integrate import solve_ivp

Signal = Callable[[float], float]


def exact(control: Signal, stop: float, start: float = 0.0, x0: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """State of the plant at the end, under a control given as a function of time."""
    rate = lambda t, x: plant_rate(t, *x, control(t))  # noqa: E731
    return solve_ivp(rate, (start, stop), x0, "DOP853", rtol=1e-11, atol=1e-12, max_step=0.05).y[:, -1]


def state(plant: Unit) -> np.ndarray:
    return np.array([plant["x[1]"], plant["x[2]"]])


def driven(
    unit,
    control: Signal,
    step: float,
    stop: float,
    handling: str = "hold",
    slope: Signal | None = None,
    ahead: float = 0.0,
):
    """State of the plant at the end, under a control set at each communication point."""
    plant = unit(PLANT, input_handling=handling).start()
    for k in range(round(stop / step)):
        plant["u[1]"] = control((k + ahead) * step)
        if slope:
            plant.set_slope("u[1]", slope(k * step))
        plant.step(k * step, step)
    return state(plant)


def ramp(t: float) -> float:
    """Nothing for the first tenth of a second, then down."""
    return -0.8 * max(0.0, t - 0.1)


@pytest.mark.parametrize("start", [0.0, 0.7, 100.0, -20.0, 1e5])
def test_the_plant_starts_at_any_time(unit, start: float) -> None:
    plant = unit(PLANT, **{"x0[1]": 0.2, "x0[2]": -0.1}).start(time=start, **{"u[1]": 0.1})
    assert state(plant).tolist() == [0.2, -0.1]
    for k in range(10):
        plant.step(start + k * 0.1, 0.1)
    assert state(plant) == pytest.approx(exact(lambda _: 0.1, start + 1.0, start, (0.2, -0.1)), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("step", [1.0, 0.3, 0.05, 1e-3])
def test_how_long_a_step_is_makes_no_difference_to_a_plant_whose_control_is_constant(unit, step: float) -> None:
    plant, time = unit(PLANT).start(**{"u[1]": -0.3}), 0.0
    while time < 1.0 - 1e-9:
        now = min(step, 1.0 - time)
        plant.step(time, now)
        time += now
    assert state(plant) == pytest.approx(exact(lambda _: -0.3, 1.0), abs=3e-6)


def test_a_tolerance_tightens_the_integration_and_never_loosens_it(unit) -> None:
    right, errors = exact(lambda _: -0.3, 1.5), {}
    for tolerance in [None, 1e-1, 1e-10]:
        plant = unit(PLANT).start(tolerance=tolerance, **{"u[1]": -0.3})
        plant.step(0.0, 1.5)
        errors[tolerance] = np.abs(state(plant) - right).max()
    assert errors[1e-1] == errors[None] < 1e-5
    assert errors[1e-10] < 1e-9


def test_inputs_are_sampled_unless_set_otherwise(unit) -> None:
    sampled = exact(lambda t: ramp(0.1 * math.floor(t / 0.1 + 1e-9)), 1.0)
    plain = driven(unit, ramp, 0.1, 1.0)
    # scipy steps over the jumps of the held control, hence the tolerance.
    assert plain == pytest.approx(sampled, abs=1e-3)
    assert np.abs(plain - exact(ramp, 1.0)).max() > 0.02


def test_input_derivatives_make_a_ramp_exact(unit) -> None:
    slope = lambda t: -0.8 if t > 0.1 - 1e-9 else 0.0  # noqa: E731
    assert driven(unit, ramp, 0.1, 1.0, slope=slope) == pytest.approx(exact(ramp, 1.0), abs=3e-6)


def test_interpolation_makes_a_ramp_exact_for_masters_that_step_the_plant_first(unit) -> None:
    control = driven(unit, ramp, 0.1, 1.0, "interpolate", ahead=1.0)
    assert control == pytest.approx(exact(ramp, 1.0), abs=3e-6)


def test_extrapolation_makes_a_ramp_exact_but_for_its_first_step(unit) -> None:
    late = lambda t: ramp(t) if t < 0.1 or t > 0.2 else ramp(0.1)  # noqa: E731
    # In its first step the ramp can't be foreseen: the control is held there.
    right = exact(late, 1.0)
    assert driven(unit, ramp, 0.1, 1.0, "extrapolate") == pytest.approx(right, abs=1e-4)
    plain = np.abs(driven(unit, ramp, 0.1, 1.0) - exact(ramp, 1.0)).max()
    assert np.abs(driven(unit, ramp, 0.1, 1.0, "extrapolate") - exact(ramp, 1.0)).max() < 0.25 * plain


@pytest.mark.parametrize("way", ["extrapolate", "derivatives"])
def test_a_curved_input_is_met_to_second_order(unit, way: str) -> None:
    control, slope = lambda t: -0.5 * math.sin(2 * t), lambda t: -math.cos(2 * t)
    errors = []
    for step in [0.1, 0.05, 0.025]:
        given = {"handling": way} if way == "extrapolate" else {"slope": slope}
        errors.append(np.abs(driven(unit, control, step, 1.0, **given) - exact(control, 1.0)).max())
    assert np.polyfit(np.log([0.1, 0.05, 0.025]), np.log(errors), 1)[0] > 1.7
    assert errors[0] < np.abs(driven(unit, control, 0.1, 1.0) - exact(control, 1.0)).max() / 3


def test_an_input_derivative_holds_for_one_step_and_the_input_reads_back_what_was_set(unit) -> None:
    plant = unit(PLANT).start(**{"u[1]": 0.1})
    plant.set_slope("u[1]", -1.0)
    plant.step(0.0, 0.5)
    assert plant["u[1]"] == 0.1
    plant.step(0.5, 0.5)
    control = lambda t: 0.1 - t if t < 0.5 else 0.1  # noqa: E731
    middle = exact(control, 0.5 - 1e-12)
    assert state(plant) == pytest.approx(exact(lambda _: 0.1, 1.0, 0.5, tuple(middle)), abs=3e-6)


def test_derivatives_of_the_plants_outputs_are_its_equations(unit) -> None:
    plant = unit(PLANT, **{"x0[1]": 0.4, "x0[2]": 0.3}).start(**{"u[1]": 0.2})
    for k in range(5):
        plant.step(0.2 * k, 0.2)
        rates = plant_rate(0.2 * (k + 1), plant["x[1]"], plant["x[2]"], 0.2)
        assert (plant.slope("x[1]"), plant.slope("x[2]")) == pytest.approx(rates, rel=1e-12)
        assert plant.slope("y[1]") == plant["x[2]"]
        assert (plant["der(x[1])"], plant["der(x[2])"]) == pytest.approx(rates, rel=1e-12)


def test_the_derivative_of_the_control_is_the_control_law(unit) -> None:
    controller = unit(CONTROLLER).start(**{"r[1]": 1.0, "x[1]": 0.1, "x[2]": -0.2})
    for k in range(5):
        controller.step(0.01 * k, 0.01)
        # u' = -K (eta - K_g r), eta = omega u + theta x + sigma.
        eta = controller["omega_hat[1,1]"] * controller["u[1]"] + controller["sigma_hat[1]"]
        eta += controller["theta_hat[1,1]"] * 0.1 - controller["theta_hat[1,2]"] * 0.2
        assert controller["eta_hat[1]"] == pytest.approx(eta, rel=1e-12)
        assert controller.slope("u[1]") == pytest.approx(-20 * (eta - 1.0), rel=1e-12)


def test_directional_derivatives_are_those_of_the_equations(unit) -> None:
    plant = unit(PLANT, **{"x0[1]": 0.4, "x0[2]": 0.3}).start(**{"u[1]": 0.2})
    assert plant.fmu.description.coSimulation.providesDirectionalDerivative
    plant.step(0.0, 0.3)
    x1, x2 = state(plant)
    rates = [plant.reference(name) for name in ("der(x[1])", "der(x[2])")]
    for known, wanted in [
        ("u[1]", (0.0, 2 + 0.2 * math.sin(0.3) + math.cos(0.2) * math.sin(x1))),
        ("x[1]", (0.0, math.sin(0.2) * math.cos(x1) + 2 * x1)),
        ("x[2]", (1.0, 2 * x2)),
    ]:
        answer = plant.slave.getDirectionalDerivative(rates, [plant.reference(known)], [3.0])
        assert answer == pytest.approx([3 * slope for slope in wanted], abs=1e-12), known


def test_derivatives_of_outputs_match_finite_differences(unit) -> None:
    plant, controller = unit(PLANT).start(**{"u[1]": 0.4}), unit(CONTROLLER)
    # Differences of so short steps tell derivatives of what is integrated accurately.
    controller.start(**{"r[1]": 1.0, "integration_method": "explicit"})
    for instance, outputs in [(plant, ["x[1]", "x[2]", "y[1]"]), (controller, ["u[1]"])]:
        instance.step(0.0, 0.3)
        h = 1e-5
        values = [[instance[name] for name in outputs]]
        instance.step(0.3, h)
        slopes = [instance.slope(name) for name in outputs]
        instance.step(0.3 + h, h)
        values = (np.array([instance[name] for name in outputs]) - values[0]) / (2 * h)
        assert values == pytest.approx(slopes, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("start", [0.0, 33.3, -7.0])
def test_the_cosine_and_its_derivatives_are_exact_at_every_time(unit, start: float) -> None:
    reference, time = unit(REFERENCE).start(time=start), start
    for step in [0.1, 1e-3, 2.7, 10.0]:
        reference.step(time, step)
        time += step
        angle = 0.2 * time
        wanted = [2 * math.cos(angle), -0.4 * math.sin(angle), -0.08 * math.cos(angle), 0.016 * math.sin(angle)]
        read = [reference["r[1]"], reference["dr[1]"], reference["ddr[1]"], reference.slope("ddr[1]")]
        assert read == pytest.approx(wanted, abs=1e-14)
        assert (reference.slope("r[1]"), reference.slope("dr[1]")) == pytest.approx(wanted[1:3], abs=1e-14)


@pytest.mark.parametrize("start", [0.0, 1.0, 3.0, 50.0])
@pytest.mark.parametrize("step", [0.01, 0.37, 5.0])
def test_the_square_wave_has_the_right_sign_whatever_the_start_and_the_step(unit, start: float, step: float) -> None:
    reference = unit(REFERENCE, signal="square").start(time=start)
    assert reference["r[1]"] == square(start)
    for k in range(60):
        time = start + k * step
        reference.step(time, step)
        if abs((time + step) / HALF_PERIOD - round((time + step) / HALF_PERIOD)) > 1e-6:
            assert reference["r[1]"] == square(time + step), time + step
        assert reference["dr[1]"] == reference["ddr[1]"] == 0.0


def test_a_step_of_the_general_reference_is_taken_at_its_time(unit) -> None:
    reference = unit(
        "Reference", **{"step_time[1,1]": 0.35, "step_height[1,1]": 3.0, "offset[1]": 1.0, "slope[1]": 2.0}
    )
    reference.start()
    seen = [reference["r[1]"]]
    for k in range(5):
        reference.step(0.1 * k, 0.1)
        seen.append(reference["r[1]"])
    assert seen == pytest.approx([1.0, 1.2, 1.4, 1.6, 4.8, 5.0], abs=1e-12)


STEPS_AND_STOPS = [(1e-3, 1e-3), (0.3, 1.0), (1.0, 1e-2), (0.25, 2.0), (1e-4, 0.02), (0.1, 0.05), (0.07, 1.3)]


@pytest.mark.parametrize(("step", "stop"), STEPS_AND_STOPS)
def test_fmpy_simulates_every_unit_with_any_step_and_stop_time(each_fmu: Fmu, step: float, stop: float) -> None:
    start = at_ease(each_fmu) | dict.fromkeys(each_fmu.named(causality="input"), 0.1)
    # Without its controller a plant may diverge soon after its experiment.
    stop = min(stop, float(each_fmu.description.defaultExperiment.stopTime))
    result = fmpy.simulate_fmu(
        str(each_fmu.path), fmi_type="CoSimulation", output_interval=step, stop_time=stop, start_values=start
    )
    assert result["time"][0] == 0.0 and result["time"][-1] == pytest.approx(stop, abs=step)
    assert all(np.isfinite(result[name]).all() for name in result.dtype.names)
    assert set(each_fmu.named(causality="output")) <= set(result.dtype.names)


# The plant diverges without its controller: the next test.
@pytest.mark.parametrize("name", [name for name in sample.FMUS if name != PLANT])
def test_fmpy_runs_the_default_experiment_of_every_standalone_fmu(fmu, name: str) -> None:
    result = fmpy.simulate_fmu(str(fmu(name).path), start_values=at_ease(fmu(name)))
    assert result["time"][-1] == float(fmu(name).description.defaultExperiment.stopTime)
    if name == REFERENCE:
        assert result["r[1]"] == pytest.approx(2 * np.cos(0.2 * result["time"]), abs=1e-12)


def test_the_plant_without_its_controller_ends_with_an_error_where_its_equations_do(fmu, unit) -> None:
    """x'' = ... + x² has a pole in finite time; numbers beyond it would be wrong."""
    reached = solve_ivp(lambda t, x: plant_rate(t, *x, 0.0), (0, 3), (0.0, 0.0), "DOP853", rtol=1e-10, atol=1e-12)
    pole = reached.t[-1]
    assert not reached.success and 2.0 < pole < 3.0
    with pytest.raises(FMICallException, match="fmi2DoStep.*error"):
        fmpy.simulate_fmu(str(fmu(PLANT).path), stop_time=60.0)
    plant, time = unit(PLANT).start(), 0.0
    while time < 2.0 - 1e-9:
        plant.step(time, 0.1)
        time += 0.1
    assert state(plant) == pytest.approx(exact(lambda _: 0.0, 2.0), rel=1e-4)
    refused(plant.step, time, 1.0)
    numbers = [float(word) for word in plant.messages[-1].text.replace(":", " ").split() if word[:3] == f"{pole:.1f}"]
    assert numbers and numbers[0] == pytest.approx(pole, abs=1e-4)


def test_a_discarded_step_reports_up_to_when_it_is_right(unit) -> None:
    plant = unit(PLANT, on_step_failure="discard").start()
    plant.step(0.0, 1.0)
    assert refused(plant.step, 1.0, 5.0).status == 2
    assert plant.slave.getRealStatus(2) == 1.0
    assert plant.messages[-1].category == "logStatusDiscard"
