"""Five machines with random parameters, no plant of the package among them, and their records: a buck converter, a heat exchanger, a belt drive,
a satellite with a wheel, and a mixing vessel, which isn't linear."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm

Array = np.ndarray


@dataclass(frozen=True)
class Plant:
    """A machine with drawn parameters: x' = A x + B u + d, or x' = rates(x, u)."""

    inputs: tuple[str, ...]
    states: tuple[str, ...]
    step: float
    """Step of a record, s."""
    low: tuple[float, ...]
    high: tuple[float, ...]
    """Least and largest level of each input."""
    longest: int
    """Rows for which a level lasts at most."""
    A: Array | None = None
    B: Array | None = None
    rates: Callable[[Array, Array], Array] | None = None
    start: tuple[float, ...] | None = None
    gain: Array | None = None
    """u = levels − gain (x + noise), where the machine would drift away else."""

    @property
    def signals(self) -> list[str]:
        plain = lambda names: ",".join(name.split(" ")[0] for name in names)  # noqa: E731
        return ["--inputs", plain(self.inputs), "--states", plain(self.states)]


def converter(rng: np.random.Generator) -> Plant:
    """Buck converter, averaged: current of the coil and voltage of the capacitor, driven by the duty cycle."""
    supply, coil, capacitor = rng.uniform(12, 48), rng.uniform(20e-6, 80e-6), rng.uniform(50e-6, 300e-6)
    loss, load = rng.uniform(0.02, 0.2), rng.uniform(1, 5)
    A = np.array([[-loss / coil, -1 / coil], [1 / capacitor, -1 / (load * capacitor)]])
    B = np.array([[supply / coil], [0.0]])
    step = 0.3 / np.sqrt(abs(np.linalg.det(A)))
    return Plant(("duty",), ("current [A]", "output_voltage [V]"), step, (0.3,), (0.6,), 12, A, B)


def exchanger(rng: np.random.Generator) -> Plant:
    """Counterflow heat exchanger of two mixed volumes, driven by the temperatures at its inlets."""
    hot, cold, shared_hot, shared_cold = rng.uniform(0.5, 2, 4) * [0.02, 0.03, 0.01, 0.015]
    A = np.array([[-hot - shared_hot, shared_hot], [shared_cold, -cold - shared_cold]])
    B = np.diag([hot, cold])
    return Plant(("hot_inlet [degC]", "cold_inlet [degC]"), ("hot [degC]", "cold [degC]"), 4.0, (60, 10), (90, 30), 40, A, B)


def belt(rng: np.random.Generator) -> Plant:
    """Belt drive: speed of the motor's pulley, stretch of the belt, and speed of the carriage, driven by a torque."""
    radius, stiffness, loss = 0.02, rng.uniform(1e4, 4e4), rng.uniform(10, 40)
    inertia, mass, drag = rng.uniform(1e-4, 4e-4), rng.uniform(0.5, 2), rng.uniform(2, 8)
    A = np.array(
        [
            [-(loss * radius**2 + 1e-3) / inertia, -radius * stiffness / inertia, radius * loss / inertia],
            [radius, 0, -1],
            [radius * loss / mass, stiffness / mass, -(loss + drag) / mass],
        ]
    )
    B = np.array([[1 / inertia], [0], [0]])
    step = 0.3 / np.abs(np.linalg.eigvals(A)).max()
    return Plant(("torque [N.m]",), ("pulley [rad/s]", "stretch [m]", "carriage [m/s]"), step, (-1,), (1,), 60, A, B)


def satellite(rng: np.random.Generator) -> Plant:
    """Satellite with a reaction wheel, held by a controller to which levels are added. Its momentum stays, so one direction of the states never
    moves."""
    body, wheel, drag = rng.uniform(5, 20), rng.uniform(0.02, 0.08), rng.uniform(1e-4, 1e-3)
    A = np.array([[0, 1, 0], [0, -drag / body, drag / body], [0, drag / wheel, -drag / wheel]])
    B = np.array([[0], [1 / body], [-1 / wheel]])
    gain = np.array([[0.04 * body, 0.4 * body, 0]])
    names = ("angle [rad]", "rate [rad/s]", "wheel_speed [rad/s]")
    return Plant(("torque [N.m]",), names, 0.5, (-0.05,), (0.05,), 30, A, B, gain=gain)


def vessel(rng: np.random.Generator) -> Plant:
    """Mixing vessel with free outflow: level and concentration, driven by two flows of different concentration."""
    area, outlet, strong, weak = rng.uniform(0.5, 2), rng.uniform(0.01, 0.03), rng.uniform(5, 10), rng.uniform(0, 1)

    def rates(x: Array, u: Array) -> Array:
        level, concentration = max(x[0], 1e-3), x[1]
        mixed = (strong - concentration) * u[0] + (weak - concentration) * u[1]
        return np.array([(u.sum() - outlet * np.sqrt(level)) / area, mixed / (area * level)])

    flow = outlet / 2
    names = ("strong_flow [m3/s]", "weak_flow [m3/s]"), ("level [m]", "concentration")
    low, high = (0.85 * flow,) * 2, (1.15 * flow,) * 2
    return Plant(*names, 4.0, low, high, 30, rates=rates, start=(1.0, (strong + weak) / 2))


MACHINES = {machine.__name__: machine for machine in (converter, exchanger, belt, satellite, vessel)}
LINEAR = ["converter", "exchanger", "belt"]


def levels(rng: np.random.Generator, rows: int, low: float, high: float, longest: int) -> Array:
    u, k = np.empty(rows), 0
    while k < rows:
        length = rng.integers(2, longest + 1)
        u[k : k + length] = rng.uniform(low, high)
        k += length
    return u


def sampled(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """F and G behind a zero-order hold."""
    n, m = B.shape
    whole = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * step)
    return whole[:n, :n], whole[:n, n:]


def advanced(plant: Plant, x: Array, u: Array) -> Array:
    """The state after a row of a machine that isn't linear: 4 steps of the method of Runge and Kutta."""
    h = plant.step / 4
    for _ in range(4):
        a = plant.rates(x, u)
        b = plant.rates(x + h / 2 * a, u)
        c = plant.rates(x + h / 2 * b, u)
        x = x + h / 6 * (a + 2 * b + 2 * c + plant.rates(x + h * c, u))
    return x


def simulated(plant: Plant, rng: np.random.Generator, u: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Inputs, true and measured states of a record."""
    rows, n = len(u), len(plant.states)
    if plant.rates is None:
        F, G = sampled(plant.A, plant.B, plant.step)
        free = plant.gain is None
        x = np.linalg.solve(plant.A, -plant.B @ u.mean(0)) if free else np.zeros(n)
    else:
        x = np.array(plant.start)
    true, u = np.empty((rows, n)), u.copy()
    disturbed = noise * rng.normal(size=(rows, n))
    for k in range(rows):
        true[k] = x
        if plant.gain is not None:
            u[k] -= plant.gain @ (x + disturbed[k])
        x = F @ x + G @ u[k] if plant.rates is None else advanced(plant, x, u[k])
    return u, true, true + disturbed


def recorded(plant: Plant, rng: np.random.Generator, rows: int, decibels: float) -> tuple[Array, Array, Array]:
    """A record with noise so far below each state's motion: inputs, measured states, and the noise's standard deviations."""
    limits = zip(plant.low, plant.high, strict=True)
    u = np.stack([levels(rng, rows, low, high, plant.longest) for low, high in limits], 1)
    _, clean, _ = simulated(plant, rng, u, np.zeros(len(plant.states)))
    noise = clean.std(0) * 10 ** (-decibels / 20)
    given, _, measured = simulated(plant, rng, u, noise)
    return given, measured, noise


def written(folder: Path, plant: Plant, u: Array, measured: Array) -> None:
    table = np.column_stack([plant.step * np.arange(len(u)), u, measured])
    header = ",".join(["time", *plant.inputs, *plant.states])
    np.savetxt(folder / "record.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
