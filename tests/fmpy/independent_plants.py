"""The plants' motion without any FMU: the robot from the energy of its links, the others from their printed formulas."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, cosh, exp, sin, tanh

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


# Unmodeled dynamics z_u of example 3.4.1, and the reaction M_R of the twin rotor, in scipy's realisation.
A_U, B_U, C_U, _ = tf2ss([-1.0, 1.0], [100.0, 8.0, 1.0])
A_R, B_R, C_R, D_R = tf2ss([-0.2 * 3.5, -0.2], [2.0, 1.0])


def unmatched_rate(t: float, s: np.ndarray, u: np.ndarray, secant: bool = False) -> np.ndarray:
    """s' for s = (x, state of the oscillator, state of z_u in scipy's realisation), example 3.4.1."""
    x, (o1, o2), filtered = s[:3], s[3:5], s[5:]
    x1, x2, x3 = x
    a_m = np.array([[-1, 0, 0], [0, 0, 1], [0, -1, -1.8]])
    a_delta = np.array([[0.2, -0.2, -0.3], [-0.2, -0.2, 0.6], [-0.1, 0, -0.9]])
    b_m, omega = np.array([[1, 0], [0, 0], [1, 1]]), np.array([[0.6, -0.2], [0.2, 1.2]])
    z = 0.1 * (o1 - o2) + (C_U @ filtered).item()
    f = [
        -(x @ x) / 3 + tanh(x1 / 2) * x1,
        x2 / (2 * (cos(x2) if secant else cosh(x2))) + 0.2 * (1 - exp(-0.3 * t)) + z / 2,
        0.6 * x3 * cos(5 * t) - 0.7 * z**2,
    ]
    moved = A_U @ filtered + B_U[:, 0] * (x1 - 2 * x2 + x3)
    return np.concatenate([(a_m + a_delta) @ x + b_m @ omega @ u + f, [o2, -o1 + 0.8 * (1 - o1**2) * o2], moved])


def twin_rotor_rate(t: float, s: np.ndarray, u: np.ndarray) -> np.ndarray:
    """s' for s = (psi, psi', phi, phi', tau1, tau2, state of M_R in scipy's realisation), example 3.4.2."""
    psi, w_psi, _, w_phi, tau1, tau2, reaction = s
    m1, m2 = 0.0135 * tau1**2 + 0.0924 * tau1, 0.02 * tau2**2 + 0.09 * tau2
    m_r = C_R.item() * reaction + D_R.item() * m1
    pitch = m1 - 0.32 * sin(psi) + 0.0163 * sin(2 * psi) * w_phi**2
    pitch -= 0.006 * w_psi + 0.001 * tanh(w_psi / 0.01) + 0.05 * m1 * w_phi * cos(psi)
    yaw = m2 - 0.1 * w_phi - 0.01 * tanh(w_phi / 0.01) - m_r
    rotors = (1.1 * u[0] - tau1) / 1.1, 0.8 * u[1] - tau2
    return np.array([w_psi, pitch / 0.068, w_phi, yaw / 0.02, *rotors, A_R.item() * reaction + B_R.item() * m1])


def coupled_rate(t: float, x: np.ndarray, u: np.ndarray, nonaffine: bool = False) -> np.ndarray:
    """x' of examples 6.5.1 and 6.5.2."""
    x1, x2, x3 = x
    a = np.array([[-36, 36, 0], [0, 20, 0], [0, 0, -3]])
    theta = [
        [3 * sin(0.5 * t), 2 * sin(0.4 * t) * cos(0.3 * t), 0.7 * sin(0.2 * t)],
        [0.9 * sin(0.2 * t), 2.5 * sin(0.3 * t) + 0.3 * cos(t), sin(0.1 * t)],
        [0.5 * sin(0.13 * t), 0.6 * cos(0.15 * t), 1.5 * cos(0.7 * t) + 1.6 * sin(0.3 * t)],
    ]
    f = np.array([x3**2 + 0.2 * sin(x1), -x1 * x3 - 0.2 * cos(x3) * x1, x1 * x2])
    if nonaffine:
        f += [-2.5 * u[2] * cos(u[0]), 0.7 * u[2] ** 2, 0]
    return (a + np.transpose(theta)) @ x + u + f + [1 + sin(t), 1.2 + cos(t), sin(t) + cos(t) - 1]


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
