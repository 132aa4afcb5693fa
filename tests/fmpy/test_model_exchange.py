"""Model exchange: FMPy's and scipy's solvers integrate, and get the motion that co-simulation gives."""

import fmpy
import numpy as np
import pytest
from independent import HALF_PERIOD, Experiment, continuous_loop
from master import CONTROLLER, PLANT, REFERENCE, Exchange, Fmu, Unit, at_ease, duration
from scipy.integrate import solve_ivp


def nominal(fmu: Fmu, name: str) -> float:
    """Nominal value of a variable."""
    return float(fmu.variables[name].nominal or 1.0)


@pytest.fixture
def exchange(fmu):
    """Makes instances for model exchange; they are freed after the test."""
    made: list[Exchange] = []

    def make(name: str) -> Exchange:
        made.append(Exchange(fmu(name), f"{name} {len(made)}"))
        return made[-1]

    yield make
    for instance in made:
        instance.free()


def test_fmpys_cvode_gets_the_motion_of_co_simulation(each_fmu: Fmu) -> None:
    """Within 1e-5 of each variable's nominal or largest value, whichever is larger.

    CVode's relative tolerance is 1e-10, that of the unit 1e-9; CVode takes 500 steps at most from one output to the next.
    """
    inputs = {name: 0.3 - 0.2 * k for k, name in enumerate(each_fmu.named(causality="input", type="Real"))}
    start = at_ease(each_fmu) | inputs
    stop = duration(each_fmu, start)
    moving = [v.name for v in each_fmu.variables.values() if v.variability == "continuous" and v.causality != "input"]
    names = [name for name in moving if not name.startswith("der(")]
    # By a general method, whose tolerance that is.
    general = {"relative_tolerance": 1e-9, "integration_method": 2}
    tolerance = general if "relative_tolerance" in each_fmu.variables else {}

    def run(**options: object) -> np.ndarray:
        return fmpy.simulate_fmu(
            str(each_fmu.path), stop_time=stop, output_interval=stop / 1000, output=names, **options
        )

    co_simulation = run(fmi_type="CoSimulation", start_values=start | tolerance)
    exchange = run(fmi_type="ModelExchange", solver="CVode", relative_tolerance=1e-10, start_values=start)
    # At an event FMPy gives the values before it and behind it; a unit of co-simulation stands behind it.
    times = co_simulation["time"]
    exchange = exchange[np.searchsorted(exchange["time"], times + 1e-9, side="right") - 1]
    assert len(times) == 1001 and np.abs(exchange["time"] - times).max() < 1e-9
    for name in names:
        difference = np.abs(exchange[name] - co_simulation[name]).max()
        scale = max(nominal(each_fmu, name), np.abs(co_simulation[name]).max())
        assert difference < 1e-5 * scale, name


@pytest.mark.parametrize("solver", ["CVode", "Euler"])
def test_the_square_wave_jumps_at_its_edges(fmu, solver: str) -> None:
    result = fmpy.simulate_fmu(
        str(fmu(REFERENCE).path),
        fmi_type="ModelExchange",
        solver=solver,
        stop_time=60.0,
        output_interval=0.05,
        step_size=0.05,
        start_values={"signal": 2},
    )
    half_periods = result["time"] / HALF_PERIOD
    # At an edge itself both sides are right.
    clear = np.abs(half_periods - np.round(half_periods)) > 1e-6
    assert clear.sum() > 1000
    assert (result["r[1]"][clear] == np.where(np.floor(half_periods[clear]) % 2 == 0, 1.0, -1.0)).all()


def test_the_closed_loop_of_three_units_is_the_continuous_loop(exchange) -> None:
    """Plant and controller solved by scipy as one system; within 1e-6 of the loop that knows no FMU, over 2 s."""
    reference, plant, controller = exchange(REFERENCE), exchange(PLANT), exchange(CONTROLLER)
    for unit in (reference, plant, controller):
        unit.start()
        unit.settle()

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        for unit in (reference, plant, controller):
            unit.slave.setTime(t)
        plant.x, controller.x = z[: plant.states], z[plant.states :]
        plant["u[1]"] = controller["u[1]"]
        controller["r[1]"], controller["x[1]"], controller["x[2]"] = reference["r[1]"], plant["x[1]"], plant["x[2]"]
        return np.concatenate([plant.rate(), controller.rate()])

    start = np.concatenate([plant.x, controller.x])
    solved = solve_ivp(rate, (0.0, 2.0), start, "DOP853", np.linspace(0, 2, 201), rtol=1e-8, atol=1e-10)
    expected = continuous_loop(Experiment(2.0))
    assert solved.success
    assert np.abs(solved.y[:2].T - expected.x).max() < 1e-6


def test_an_implicit_solver_uses_the_directional_derivatives(exchange) -> None:
    """Radau with the exact Jacobian, column by column, through fmi2GetDirectionalDerivative."""
    plant = exchange(PLANT).start()
    plant.settle()
    plant["u[1]"] = -0.2
    x, dx = ([plant.reference(name) for name in names] for names in (["x[1]", "x[2]"], ["der(x[1])", "der(x[2])"]))

    def at(t: float, z: np.ndarray) -> None:
        plant.slave.setTime(t)
        plant.x = z

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        at(t, z)
        return plant.rate()

    def jacobian(t: float, z: np.ndarray) -> np.ndarray:
        at(t, z)
        return np.array([plant.slave.getDirectionalDerivative(dx, [known], [1.0]) for known in x]).T

    assert jacobian(0.7, np.array([0.3, 0.5]))[0].tolist() == [0.0, 1.0]
    with_jacobian = solve_ivp(rate, (0.0, 1.5), np.zeros(2), "Radau", jac=jacobian, rtol=1e-9, atol=1e-12)
    without = solve_ivp(rate, (0.0, 1.5), np.zeros(2), "DOP853", rtol=1e-11, atol=1e-13)
    assert with_jacobian.y[:, -1] == pytest.approx(without.y[:, -1], abs=1e-7)


def test_a_restored_unit_continues_bit_for_bit(exchange) -> None:
    plant = exchange(PLANT).start()
    plant.settle()
    plant["u[1]"] = -0.3

    def go_on() -> tuple[np.ndarray, bytes]:
        for k in range(100):
            plant.slave.setTime(0.01 * (k + 1))
            plant.x = plant.x + 0.01 * plant.rate()
            assert plant.slave.completedIntegratorStep() == (0, 0)
        return plant.x, plant.slave.serializeFMUstate(plant.slave.getFMUstate())

    state = plant.slave.getFMUstate()
    first, bytes_of_first = go_on()
    plant.slave.setFMUstate(state)
    second, bytes_of_second = go_on()
    assert (first == second).all() and bytes_of_first == bytes_of_second
