"""The plants' motion without any FMU: the robot from the energy of its links, the actuated system from its formulas."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import tf2ss

# f(q + i h) has the imaginary part h f'(q), with no cancellation however small h is.
H = 1e-30


def lagrange(
    kinetic: Callable[[np.ndarray, np.ndarray], complex],
    potential: Callable[[np.ndarray], complex],
    q: np.ndarray,
    w: np.ndarray,
    force: np.ndarray,
    more_inertia: np.ndarray | float = 0.0,
) -> np.ndarray:
    """q'' from d/dt (dL/dq') - dL/dq = force, for a kinetic energy that is quadratic in the rates w."""
    axes = np.eye(len(q))

    def momentum(q: np.ndarray, w: np.ndarray) -> np.ndarray:
        # Exact differences, for the energy is quadratic.
        return np.array([(kinetic(q, w + e) - kinetic(q, w - e)) / 2 for e in axes])

    inertia = np.column_stack([momentum(q, e).real for e in axes])
    drift = momentum(q + 1j * H * w, w).imag / H
    slope = np.imag([kinetic(p, w) - potential(p) for p in q + 1j * H * axes]) / H
    return np.linalg.solve(inertia + more_inertia, force + slope - drift)


@dataclass(frozen=True)
class Robot:
    """Two bodies in a plane; `inertia_variation` as in example 7.5.2."""

    mass: tuple[float, float] = (3.2, 2.0)
    length: tuple[float, float] = (0.5, 0.4)
    inertia: tuple[float, float] = (0.96, 0.841)
    friction: tuple[float, float] = (1.0, 1.0)
    g: float = 9.81
    inertia_variation: bool = False

    def kinetic_energy(self, q: np.ndarray, w: np.ndarray) -> complex:
        """From the velocities of the mass centres, which lie in the middle of the links."""
        (l1, l2), turns = self.length, (w[0], w[0] + w[1])
        a, b = q[0], q[0] + q[1]
        v1 = l1 / 2 * turns[0] * np.array([-np.sin(a), np.cos(a)])
        v2 = 2 * v1 + l2 / 2 * turns[1] * np.array([-np.sin(b), np.cos(b)])
        bodies = zip(self.mass, (v1, v2), self.inertia, turns, strict=True)
        # A plain product, no norm: velocities may be complex.
        return sum(m * (v @ v) + i * turn * turn for m, v, i, turn in bodies) / 2

    def potential_energy(self, q: np.ndarray) -> complex:
        """From the heights of the mass centres."""
        l1, l2 = self.length
        heights = l1 / 2 * np.sin(q[0]), l1 * np.sin(q[0]) + l2 / 2 * np.sin(q[0] + q[1])
        return self.g * sum(m * height for m, height in zip(self.mass, heights, strict=True))

    def acceleration(self, t: float, q: np.ndarray, w: np.ndarray, u: np.ndarray) -> np.ndarray:
        """q'' under torques u and friction."""
        variation = np.zeros((2, 2))
        if self.inertia_variation:
            d1, d2, d3 = 0.6 * sin(0.3 * t), 0.7 * sin(0.25 * t), abs(0.5 * sin(0.35 * t))
            variation = np.array([[d1, d2], [d2, d3]])
        force = u - np.multiply(self.friction, w)
        return lagrange(self.kinetic_energy, self.potential_energy, q, w, force, variation)

    def rate(self, t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """x' for x = (q, q')."""
        return np.concatenate([x[2:], self.acceleration(t, x[:2], x[2:], u)])


def uncertainty(number: int, t: float, x1: float, x2: float, z: float) -> float:
    """The unknown part f of the actuated system, as printed."""
    if number == 2:
        varying = (sin(0.4 * t) + 1) * x1**2 + (2 * cos(0.35 * t) + 0.5) * x2**2
        varying += (sin(0.3 * t) + 0.3) * x1 * sin(x1**2) + sin(0.35 * t) * cos(0.4 * t)
        return varying + 0.5 * x2 * cos(x2**2 + 0.5 * cos(0.3 * t)) + sin(0.3 * t) * cos(0.4 * t) * z**2
    constant = 2 * x1**2 + 2 * x2**2 + x1 * sin(x1**2) + x2 * cos(x2**2)
    return constant + z**2 if number == 3 else constant


# scipy's own realisation of the unmodeled dynamics.
A_Z, B_Z, C_Z, _ = tf2ss([1.0, -1.0], [1.0, 3.0, 2.0])


def actuated_rate(number: int, t: float, s: np.ndarray, u: float) -> np.ndarray:
    """s' for s = (x1, x2, mu, state of the unmodeled dynamics in scipy's realisation)."""
    x1, x2, mu, state = s[0], s[1], s[2], s[3:]
    z = (C_Z @ state).item()
    excitation = x1 * sin(0.2 * t) + x2
    return np.array(
        [x2, mu + uncertainty(number, t, x1, x2, z), 75 * (u - mu), *(A_Z @ state + B_Z[:, 0] * excitation)]
    )


def solved(
    rate: Callable[[float, np.ndarray], np.ndarray],
    start: np.ndarray,
    times: np.ndarray,
    max_step: float = 5e-3,
    rtol: float = 1e-11,
) -> np.ndarray:
    """The solution at times, a row each. Between long steps scipy's interpolation is not as good as they are."""
    options = {"rtol": rtol, "atol": rtol / 100, "max_step": max_step}
    answer = solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, **options)
    assert answer.success, answer.message
    return answer.y.T
