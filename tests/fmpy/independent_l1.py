"""L1 adaptive control without any FMU: the design by scipy, and loops as one differential equation."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from independent_plants import Robot, actuated_rate
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov


# Rows and columns from very large to zero, as the thesis prints them.
RULES = ("VL VL VL VL L", "VL VL VL L S", "VL VL L S VS", "VL L S VS VS", "L S VS VS Z")
# In the middle of the bounds of their corners.
SETS = {"Z": (0.25, 0.25, 0.9), "VS": (0.25, 1, 2.25), "S": (0.9, 2.75, 6), "L": (2.25, 4.5, 8), "VL": (6, 10, 10)}


# Rows and columns of each set, from zero to very large.
PLACES = {
    name: [(4 - i, 4 - j) for i, row in enumerate(RULES) for j, other in enumerate(row.split()) if other == name]
    for name in SETS
}


def fuzzy_gain(a: float, b: float) -> float:
    """The centre of sums, by Simpson's rule over each piece of the sets that are cut off: exact."""
    positions = [min(max((value - 0.08) / 0.23, 0.0), 4.0) for value in (a, b)]
    first, second = ([max(0.0, 1 - abs(position - k)) for k in range(5)] for position in positions)
    moment = area = 0.0
    for name, (low, centre, high) in SETS.items():
        height = max(min(second[i], first[j]) for i, j in PLACES[name])
        left, right = low + height * (centre - low), high - height * (high - centre)
        # Both slopes and the top: where each begins and ends, and how high it is there.
        for x0, x1, h0, h1 in ((low, left, 0, height), (left, right, height, height), (right, high, height, 0)):
            middle = 4 * (h0 + h1) / 2
            area += (x1 - x0) / 6 * (h0 + middle + h1)
            moment += (x1 - x0) / 6 * (h0 * x0 + middle * (x0 + x1) / 2 + h1 * x1)
    return moment / area


@dataclass(frozen=True)
class L1:
    """A controller for m double integrators with x = (q, q'); a pole of each conjugate pair, one pair a channel."""

    poles: tuple[complex, ...]
    adaptation_gain: float
    feedback_gain: float
    omega_min: tuple[tuple[float, ...], ...]
    omega_max: tuple[tuple[float, ...], ...]
    theta_bound: float
    sigma_bound: float
    inside: bool
    projection_tolerance: float = 0.1
    # k_p, k_d and k_e, where the gain is a fuzzy one of e and e'.
    fuzzy: tuple[float, float, float] | None = None

    @property
    def m(self) -> int:
        """Number of channels."""
        return len(self.poles)

    @property
    def B(self) -> np.ndarray:
        """Input matrix."""
        return np.vstack([np.zeros((self.m, self.m)), np.eye(self.m)])

    @property
    def K_m(self) -> np.ndarray:
        """From s² - 2 re s + re² + im² of each channel."""
        stiffness = [pole.real**2 + pole.imag**2 for pole in self.poles]
        return np.hstack([np.diag(stiffness), np.diag([-2 * pole.real for pole in self.poles])])

    @property
    def A_m(self) -> np.ndarray:
        """Desired dynamics."""
        chains = np.eye(2 * self.m, k=self.m)
        return chains - self.B @ self.K_m

    def P(self, Q: np.ndarray | None = None) -> np.ndarray:
        """Solution of the Lyapunov equation."""
        return solve_continuous_lyapunov(self.A_m.T, -(np.eye(2 * self.m) if Q is None else Q))

    @property
    def K_g(self) -> np.ndarray:
        """Feedforward gain, for C = (1 0)."""
        C = np.eye(self.m, 2 * self.m)
        return -np.linalg.inv(C @ np.linalg.solve(self.A_m, self.B))

    def gain(self, e: float, rate: float) -> float:
        """The feedback gain in force."""
        if self.fuzzy is None or abs(e) <= self.fuzzy[2]:
            return self.feedback_gain
        return fuzzy_gain(self.fuzzy[0] * abs(e), self.fuzzy[1] * abs(rate))

    def law(self) -> Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """u and the rate of the states (x_hat, omega_hat by rows, theta_hat, sigma_hat, u_ad) of (r, r'), x, them."""
        m, A_m, B, K_m, K_g = self.m, self.A_m, self.B, self.K_m, self.K_g
        BP, gain = B.T @ self.P(), self.adaptation_gain
        bound = np.repeat([self.theta_bound, self.sigma_bound], m)
        low = np.concatenate([np.ravel(self.omega_min), -bound])
        high = np.concatenate([np.ravel(self.omega_max), bound])
        centre, half, layer = (low + high) / 2, (high - low) / 2, self.projection_tolerance
        ends = np.cumsum([2 * m, m * m, m, m])

        def projected(estimates: np.ndarray, rate: np.ndarray) -> np.ndarray:
            d = estimates - centre
            f = ((1 + layer) * d * d - half * half) / (layer * half * half)
            return np.where((f > 0) & (d * rate > 0), rate * (1 - f), rate)

        def u_and_rate(r: np.ndarray, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (r, dr), (y, dy) = r, x.reshape(2, m)
            K = np.array([self.gain(*of_channel) for of_channel in zip(r - y, dr - dy, strict=True)])
            x_hat, omega, theta, sigma, u_ad = np.split(z, ends)
            baseline, phi = K_m @ x, np.abs(x).max()
            u = u_ad - baseline
            v = u if self.inside else u_ad
            eta = omega.reshape(m, m) @ v + theta * phi + sigma + (baseline if self.inside else 0.0)
            s = BP @ (x - x_hat)
            rates = gain * projected(z[ends[0] : ends[3]], np.concatenate([np.outer(s, v).ravel(), s * phi, s]))
            return u, np.concatenate([A_m @ x_hat + B @ eta, rates, -K * (eta - K_g @ r)])

        return u_and_rate

    def start(self, x: np.ndarray) -> np.ndarray:
        """The predictor at the measured state, omega_hat at the identity, the rest at zero."""
        return np.concatenate([x, np.eye(self.m).ravel(), np.zeros(3 * self.m)])


ROBOT_BOUNDS = {"omega_min": ((0.5, -2.0), (-2.0, 0.5)), "omega_max": ((10.0, 2.0), (2.0, 10.0))}
ROBOT = {"adaptation_gain": 1e5, "feedback_gain": 30.0, "theta_bound": 100.0, "sigma_bound": 10.0, "inside": True}
ACTUATED = {"adaptation_gain": 1e6, "feedback_gain": 20.0, "theta_bound": 10.0, "sigma_bound": 100.0, "inside": False}
DESIGNS = {
    "3.3.1-case1": L1((-300 + 5j, -400 + 5j), **ROBOT, **ROBOT_BOUNDS),
    "3.3.1-case2": L1((-30 + 0.5j, -40 + 0.5j), **ROBOT, **ROBOT_BOUNDS),
    "4-case1": L1((-21 + 0.743j,), **ACTUATED, omega_min=((0.0,),), omega_max=((10.0,),)),
    "4-case1-fuzzy": L1((-21 + 0.743j,), **ACTUATED, omega_min=((0.0,),), omega_max=((10.0,),), fuzzy=(0.8, 0.4, 0.1)),
    "4-case3": L1((-84 + 0.743j,), **ACTUATED, omega_min=((0.0,),), omega_max=((10.0,),)),
}


def robot_loop(t: float, x: np.ndarray, u: np.ndarray | None) -> np.ndarray:
    """The robot's reference and its rate where u is None, else the rate of its state."""
    if u is None:
        return np.array([[0.5 * cos(0.7 * t), -0.6 * cos(0.65 * t)], [-0.35 * sin(0.7 * t), 0.39 * sin(0.65 * t)]])
    return ROBOT_ARM.rate(t, x, u)


def actuated_loop(t: float, x: np.ndarray, u: np.ndarray | None) -> np.ndarray:
    """The reference of chapter 4 and its rate where u is None, else the rate of the plant of its case 1."""
    return np.array([[cos(0.5 * t)], [-0.5 * sin(0.5 * t)]]) if u is None else actuated_rate(1, t, x, u[0])


ROBOT_ARM = Robot()
# Number of the plant's states, how many of them are measured, and its equations.
PLANTS = {"3": (4, 4, robot_loop), "4": (5, 2, actuated_loop)}


def continuous_loop(name: str, times: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """The measured state and the control at times, from rest."""
    (states, measured, plant), law = PLANTS[name[0]], DESIGNS[name].law()

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        u, of_law = law(plant(t, z, None), z[:measured], z[states:])
        return np.concatenate([plant(t, z[:states], u), of_law])

    start = np.concatenate([np.zeros(states), DESIGNS[name].start(np.zeros(measured))])
    # Between long steps scipy's interpolation is not as good as they are: each time is the end of a step. The first
    # one is told, for at rest nothing hints at how fast the adaptation will be.
    # A fuzzy gain has kinks, of which scipy's estimate of its error knows nothing: short steps lead across them.
    longest = 1e-3 if DESIGNS[name].fuzzy is None else 2e-5
    rows, options = [start], {"rtol": tolerance, "atol": tolerance * 1e-2, "first_step": 1e-6, "max_step": longest}
    for t, following in zip(times[:-1], times[1:], strict=True):
        answer = solve_ivp(rate, (t, following), rows[-1], "DOP853", **options)
        assert answer.success, answer.message
        rows.append(answer.y[:, -1])
    rows = np.array(rows)
    u = np.array([law(plant(t, z, None), z[:measured], z[states:])[0] for t, z in zip(times, rows, strict=True)])
    return rows[:, :measured], u
