"""L1 control with unmatched uncertainty without any FMU: examples 3.4.1 and 3.4.2, each as one differential equation.

What the control does about unmatched uncertainty is written for each example by hand: H_m⁻¹ H_um is (0, s + 1.8) in the
first, and (s + p_i)/(a_i b_i) on each axis of the second.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, sin

import numpy as np
from independent_plants import twin_rotor_rate, unmatched_rate
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import place_poles

Rate = Callable[[float, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Bounds:
    """Of the estimates; θ and σ within ± theirs."""

    omega_min: np.ndarray
    omega_max: np.ndarray
    theta: float
    sigma: float


def projected(v: np.ndarray, y: np.ndarray, lo: np.ndarray | float, hi: np.ndarray | float) -> np.ndarray:
    """Proj(v, y), with a tolerance of a tenth; an estimate whose bounds coincide stays."""
    c, h = (np.add(lo, hi)) / 2, (np.subtract(hi, lo)) / 2
    square = np.where(h == 0.0, 1.0, h * h)
    d = v - c
    f = (1.1 * d * d - h * h) / (0.1 * square)
    return np.where(h == 0.0, 0.0, np.where((f > 0) & (d * y > 0), y * (1 - f), y))


def adaptive(A_m: np.ndarray, B: np.ndarray, B_um: np.ndarray, gamma: float, bounds: Bounds) -> Callable:
    """Rates of (x_hat, omega_hat by rows, theta_hat, sigma_hat, theta_2, sigma_2), and what they estimate."""
    n, m, k = len(A_m), B.shape[1], B_um.shape[1]
    P = solve_continuous_lyapunov(A_m.T, -np.eye(n))
    ends = np.cumsum([n, m * m, m, m, k, k])

    def law(s: np.ndarray, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x_hat, omega, theta, sigma, theta_2, sigma_2 = np.split(s[: ends[-1]], ends[:-1])
        omega, norm = omega.reshape(m, m), np.abs(x).max()
        eta, eta_2 = omega @ v + theta * norm + sigma, theta_2 * norm + sigma_2
        error = P @ (x_hat - x)
        matched, unmatched = -B.T @ error, -B_um.T @ error
        return (
            np.concatenate(
                [
                    A_m @ x_hat + B @ eta + B_um @ eta_2,
                    gamma * projected(omega, np.outer(matched, v), bounds.omega_min, bounds.omega_max).ravel(),
                    gamma * projected(theta, matched * norm, -bounds.theta, bounds.theta),
                    gamma * projected(sigma, matched, -bounds.sigma, bounds.sigma),
                    gamma * projected(theta_2, unmatched * norm, -bounds.theta, bounds.theta),
                    gamma * projected(sigma_2, unmatched, -bounds.sigma, bounds.sigma),
                ]
            ),
            eta,
            eta_2,
        )

    return law


def unmatched_loop() -> tuple[Rate, np.ndarray, int]:
    """The loop 3.4.1: its rate, its start, and the number of the plant's states that are measured."""
    A_m = np.array([[-1.0, 0, 0], [0, 0, 1], [0, -1, -1.8]])
    B, B_um = np.array([[1.0, 0], [0, 0], [1, 1]]), np.array([[0.0], [1], [0]])
    bounds = Bounds(np.array([[0.25, -0.2], [-0.2, 0.25]]), np.array([[3, 0.2], [0.2, 3]]), 40, 5)
    law, plant = adaptive(A_m, B, B_um, 8e4, bounds), 7
    r, K_g = np.array([1, -0.5]), np.array([[1, 0], [-1, 1]])

    def rate(t: float, s: np.ndarray) -> np.ndarray:
        x, filters = s[:3], s[-10:].reshape(2, 5)
        u = -8 * filters[:, 3]
        laws, eta, eta_2 = law(s[plant:], x, u)
        w = eta - K_g @ r
        moved = []
        for channel, unmatched in enumerate((0.0, eta_2[0])):
            # D(s) as sections of unit gain; s D(s) is what the section behind the integrator takes in.
            i, p, q, w1, w2 = filters[channel]
            moved += [w[channel] + 1.8 * unmatched, 25 * (i + unmatched - p), 70 * (p - q)]
            moved += [40 * w2, 40 * (q - w1) - 72 * w2]
        return np.concatenate([unmatched_rate(t, s[:plant], u), laws, moved])

    start = np.zeros(7 + 3 + 4 + 2 + 2 + 1 + 1 + 10)
    start[3:5] = 1.0
    start[plant + 3 : plant + 7] = np.eye(2).ravel()
    return rate, start, 3


def twin_rotor_loop() -> tuple[Rate, np.ndarray, int]:
    """The loop 3.4.2, likewise."""
    A, B, B_um = np.zeros((6, 6)), np.zeros((6, 2)), np.zeros((6, 2))
    A[0, 1], A[2, 3] = 1, 1
    A[1, :5] = [-0.32 / 0.068, -0.006 / 0.068, 0, 0, 0.0924 / 0.068]
    A[3, [3, 5]] = -0.1 / 0.02, 0.09 / 0.02
    A[4, 4], A[5, 5], B[4, 0], B[5, 1], B_um[1, 0], B_um[3, 1] = -1 / 1.1, -1, 1, 0.8, 1, 1
    C = np.zeros((2, 6))
    C[0, 0], C[1, 2] = 1, 1
    K_m = np.zeros((2, 6))
    for channel, states in enumerate(([0, 1, 4], [2, 3, 5])):
        axis = A[np.ix_(states, states)]
        gain = place_poles(axis, B[states, channel : channel + 1], [-15, -17, -20]).gain_matrix
        K_m[channel, states] = gain[0]
    A_m = A - B @ K_m
    K_g = -np.linalg.inv(C @ np.linalg.solve(A_m, B))
    bounds = Bounds(np.diag([0.25, 0.25]), np.diag([5.0, 5.0]), 50, 15)
    law, plant = adaptive(A_m, B, B_um, 1e5, bounds), 7
    a_b = np.array([A[1, 4] * B[4, 0], A[3, 5] * B[5, 1]])
    p = -np.array([A_m[4, 4], A_m[5, 5]])

    def rate(t: float, s: np.ndarray) -> np.ndarray:
        x, integral = s[:6], s[-2:]
        smooth = 1 - exp(-0.5 * t) * (1 + 0.5 * t + 0.125 * t * t)
        r = smooth * np.array([0.2 + 0.1 * sin(0.3 * t), 0.3 * sin(0.2 * t)])
        # The unmatched estimates don't depend on the control.
        _, _, eta_2 = law(s[plant:], x, np.zeros(2))
        u_ad = -5 * (integral + eta_2 / a_b)
        laws, eta, _ = law(s[plant:], x, u_ad)
        moved = eta - K_g @ r + p / a_b * eta_2
        return np.concatenate([twin_rotor_rate(t, s[:plant], u_ad - K_m @ x), laws, moved])

    start = np.zeros(7 + 6 + 4 + 2 + 2 + 2 + 2 + 2)
    start[plant + 6 : plant + 10] = np.eye(2).ravel()
    return rate, start, 6


LOOPS = {"3.4.1": unmatched_loop, "3.4.2": twin_rotor_loop}


def continuous_loop(loop: str, times: np.ndarray, rtol: float) -> np.ndarray:
    """The measured state at times, a row each."""
    rate, start, measured = LOOPS[loop]()
    answer = solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=rtol, atol=rtol * 1e-2)
    assert answer.success, answer.message
    return answer.y[:measured].T
