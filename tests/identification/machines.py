"""Three machines with the records that a user would have of them: a motor with a flexible shaft and Coulomb friction, two coupled tanks, and
a cart that holds a pole upright. Written for these tests; no plant of the package is one of them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def levels(rng: np.random.Generator, rows: int, low: float, high: float, shortest: int, longest: int) -> Array:
    """Levels, each held for a random number of rows."""
    u, k = np.empty(rows), 0
    while k < rows:
        length = rng.integers(shortest, longest)
        u[k : k + length] = rng.uniform(low, high)
        k += length
    return u


def fourth_order(rates: Callable[..., Array], x: Array, u: object, step: float) -> Array:
    """A step by the method of Runge and Kutta."""
    a = rates(x, u)
    b = rates(x + step / 2 * a, u)
    c = rates(x + step / 2 * b, u)
    d = rates(x + step * c, u)
    return x + step / 6 * (a + 2 * b + 2 * c + d)


def midpoint(rates: Callable[..., Array], x: Array, u: object, step: float) -> Array:
    return x + step * rates(x + step / 2 * rates(x, u), u)


def motor_rates(x: Array, voltage: float, friction: float = 0.02) -> Array:
    """Current, speed of the motor, twist of the shaft, speed of the load."""
    resistance, inductance, constant = 1.2, 4e-3, 0.08
    motor_inertia, load_inertia, stiffness, loss = 2.5e-4, 9e-4, 3.0, 2e-3
    current, motor, twist, load = x
    shaft = stiffness * twist + loss * (motor - load)
    of_motor = 1e-4 * motor + friction * np.tanh(motor / 0.5)
    of_load = 4e-4 * load + 0.6 * friction * np.tanh(load / 0.5)
    return np.array(
        [
            (voltage - resistance * current - constant * motor) / inductance,
            (constant * current - of_motor - shaft) / motor_inertia,
            motor - load,
            (shaft - of_load) / load_inertia,
        ]
    )


def motor(seed: int = 1, friction: float = 0.02) -> tuple[float, Array, Array]:
    """4 s at 1 ms."""
    rng, rows, step = np.random.default_rng(seed), 4000, 1e-3
    u = levels(rng, rows, -12, 12, 20, 250)
    x, states = np.zeros(4), np.empty((rows, 4))
    for k in range(rows):
        states[k] = x
        for _ in range(4):
            x = fourth_order(lambda x, u: motor_rates(x, u, friction), x, u[k], step / 4)
    return step, u[:, None], states + rng.normal(size=states.shape) * [0.03, 0.5, 0.002, 0.5]


def tank_rates(x: Array, u: Array) -> Array:
    """Levels of two tanks, with pumps, outlets and a pipe between them."""
    gravity, area = 9.81, 154e-4
    one, two = np.maximum(x, 0)
    between = 4e-5 * np.sign(one - two) * np.sqrt(2 * gravity * abs(one - two))
    first = 1.2e-5 * u[0] - 5e-5 * np.sqrt(2 * gravity * one) - between
    second = 1.0e-5 * u[1] - 6e-5 * np.sqrt(2 * gravity * two) + between
    return np.array([first, second]) / area


def tanks(seed: int = 1) -> tuple[float, Array, Array]:
    """An hour at 1 s."""
    rng, rows = np.random.default_rng(seed), 3600
    u = np.stack([levels(rng, rows, 8, 14, 60, 400), levels(rng, rows, 8, 14, 60, 400)], 1)
    x, states = np.array([0.3, 0.2]), np.empty((rows, 2))
    for k in range(rows):
        states[k] = x
        for _ in range(4):
            x = midpoint(tank_rates, x, u[k], 0.25)
    return 1.0, u, states + rng.normal(size=states.shape) * 1e-3


def cart_rates(x: Array, force: float) -> Array:
    """Position and speed of the cart, angle and rate of the pole: a point mass at its end, friction of cart and hinge."""
    cart, pole, length, gravity, drag, hinge = 0.8, 0.25, 0.35, 9.81, 1.5, 0.004
    _, speed, angle, rate = x
    sine, cosine = np.sin(angle), np.cos(angle)
    driven = force - drag * speed + pole * sine * (length * rate**2 - gravity * cosine) + hinge * rate * cosine / length
    acceleration = driven / (cart + pole * sine**2)
    turning = (gravity * sine - acceleration * cosine - hinge * rate / (pole * length)) / length
    return np.array([speed, acceleration, rate, turning])


def cart(seed: int = 1) -> tuple[float, Array, Array]:
    """30 s at 10 ms under a bad controller of the noisy states, levels added."""
    rng, rows, step = np.random.default_rng(seed), 3000, 0.01
    gains = np.array([-4.0, -7, -42, -6])
    noise = rng.normal(size=(rows, 4)) * [1e-3, 0.01, 2e-3, 0.02]
    added = levels(rng, rows, -3, 3, 5, 40)
    x, states, u = np.array([0.0, 0, 0.05, 0]), np.empty((rows, 4)), np.empty((rows, 1))
    for k in range(rows):
        states[k] = x
        u[k] = np.clip(added[k] - gains @ (x + noise[k]), -15, 15)
        for _ in range(2):
            x = fourth_order(cart_rates, x, u[k, 0], step / 2)
    return step, u, states + noise


def linearised(rates: Callable[..., Array], x: Array) -> Array:
    """A about a point, at an input of 0."""
    delta = 1e-6
    return np.array([(rates(x + delta * v, 0.0) - rates(x - delta * v, 0.0)) / (2 * delta) for v in np.eye(len(x))]).T
