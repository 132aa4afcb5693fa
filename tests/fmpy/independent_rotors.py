"""Rotors of a quadrotor without any FMU: their allocation, by linear programmes too, and the loops of 3.3.2 behind them."""

from dataclasses import dataclass
from math import atan, cos, exp, sin

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import linprog

PRIORITIES = ("attitude", "attitude_down", "thrust")
Four = tuple[float, float, float, float]


@dataclass(frozen=True)
class Rotors:
    """Arm, torque by thrust, and the limits of a rotor."""

    arm: float = 0.225
    drag: float = 0.038
    low: float = 0.0
    high: float = 3.75

    def directions(self, demand: Four) -> tuple[list[float], list[float]]:
        """What roll and pitch, and what yaw, ask of each rotor."""
        _, p, q, r = demand
        d = [share / (2 * self.arm) for share in (-q, p, q, -p)]
        return d, [sign * r / (4 * self.drag) for sign in (1, -1, 1, -1)]

    def wrench(self, f: list[float]) -> list[float]:
        """Thrust and torques of the rotors' thrusts."""
        return [sum(f), self.arm * (f[1] - f[3]), self.arm * (f[2] - f[0]), self.drag * (f[0] - f[1] + f[2] - f[3])]

    def part(self, base: list[float], more: list[float]) -> float:
        """The largest part, 1 at most, of something that can be added."""
        room = [((self.high if m > 0 else self.low) - b) / m for b, m in zip(base, more, strict=True) if m != 0]
        return max(0.0, min([1.0, *room]))

    def allocate(self, demand: Four, priority: str = "attitude") -> list[float]:
        """The rotors' thrusts."""
        d, g = self.directions(demand)
        wanted = demand[0] / 4
        s = min(1.0, (self.high - self.low) / max(max(d) - min(d), 1e-300))
        lowest, highest = self.low - s * min(d), self.high - s * max(d)
        t = min(max(wanted, lowest), max(highest, lowest))
        if priority == "thrust" or priority == "attitude_down" and wanted < lowest:
            t = min(max(wanted, self.low), self.high)
            s = self.part([t] * 4, d)
        base = [t + s * share for share in d]
        s_y = self.part(base, g)
        return [b + s_y * share for b, share in zip(base, g, strict=True)]

    def programmes(self, demand: Four, priority: str) -> list[float]:
        """The same by three linear programmes, one after another: the largest part s of roll and pitch, then the thrust
        nearest to what is asked, then the largest part of yaw."""
        d, g = (np.array(share) for share in self.directions(demand))
        wanted, one = demand[0] / 4, np.ones(4)
        nearest = min(max(wanted, self.low), self.high)
        thrust = {"attitude": (self.low, self.high), "attitude_down": (self.low, nearest), "thrust": (nearest, nearest)}
        within = np.vstack([np.column_stack([one, d]), -np.column_stack([one, d])])
        bounds = np.concatenate([one * self.high, -one * self.low])
        _, s = solved([0, -1], within, bounds, [thrust[priority], (0, 1)])
        away = np.vstack([np.column_stack([within[:, 0], np.zeros(8)]), [[1, -1], [-1, -1]]])
        left = np.concatenate([bounds - within[:, 1] * s, [wanted, -wanted]])
        t, _ = solved([0, 1], away, left, [thrust[priority], (0, None)])
        turned = np.concatenate([g, -g])[:, None]
        (s_y,) = solved([-1], turned, bounds - within @ [t, s], [(0, 1)])
        return list(t + s * d + s_y * g)


def solved(cost: list[float], rows: np.ndarray, bounds: np.ndarray, ranges: list) -> np.ndarray:
    """The solution of a linear programme."""
    # What is at its limit may be beyond it by rounding.
    answer = linprog(cost, rows, bounds + 1e-12, bounds=ranges, method="highs-ds")
    assert answer.success, answer.message
    return answer.x


POLES = (30.0, 35.0, 40.0)
INERTIA = (4.85e-3, 4.85e-3, 8.81e-3)
MASS, G, GAIN, K = 0.5, 9.81, 1e5, 30.0
STIFFNESS = [pole**2 + 0.25 for pole in POLES]
DAMPING = [2 * pole for pole in POLES]
# Of P of each axis, as Q = I and A_m has a block for each.
P = [solve_continuous_lyapunov(np.array([[0, 1], [-k, -c]]).T, -np.eye(2))[1] for k, c in zip(STIFFNESS, DAMPING, strict=True)]


def reference(t: float) -> tuple[list[float], list[float], list[float]]:
    """Position with its derivatives, and yaw behind the position."""
    decay = exp(-0.5 * t)
    r = [sin(0.4 * t), 1 - cos(0.4 * t), 2 * (1 - decay * (1 + 0.5 * t)), 0.3 * sin(0.3 * t)]
    dr = [0.4 * cos(0.4 * t), 0.4 * sin(0.4 * t), 0.5 * t * decay]
    ddr = [-0.16 * sin(0.4 * t), 0.16 * cos(0.4 * t), 0.5 * (1 - 0.5 * t) * decay]
    return r, dr, ddr


def clipped(value: float, most: float) -> float:
    return min(max(value, -most), most)


def position_loop(t: float, x: list[float]) -> tuple[float, float, float, float]:
    """The thrust and the angles that are asked for."""
    r, dr, ddr = reference(t)
    a_x, a_y, a_z = (ddr[i] + 4 * (dr[i] - x[3 + i]) + 4 * (r[i] - x[i]) for i in range(3))
    g_z, (c, s) = max(G + a_z, 0.3 * G), (cos(x[8]), sin(x[8]))
    theta = clipped(atan((a_x * c + a_y * s) / g_z), 0.6)
    phi = clipped(atan(cos(theta) * (a_x * s - a_y * c) / g_z), 0.6)
    thrust = MASS * g_z / max(cos(x[6]) * cos(x[7]), 0.3)
    return min(max(thrust, 0.0), 15.0), phi, theta, r[3]


def projected(value: float, rate: float, low: float, high: float) -> float:
    d, half = value - (low + high) / 2, (high - low) / 2
    f = (1.1 * d * d - half * half) / (0.1 * half * half)
    return rate * (1 - f) if f > 0 and d * rate > 0 else rate


def asked_and_given(t: float, z: list[float], rotors: Rotors | None) -> tuple[list[float], list[float]]:
    """Thrust and torques that the law asks for, and those that act."""
    thrust = position_loop(t, z)[0]
    wanted = [z[32 + i] - STIFFNESS[i] * z[6 + i] - DAMPING[i] * z[9 + i] for i in range(3)]
    asked = [thrust, *(inertia * v for inertia, v in zip(INERTIA, wanted, strict=True))]
    return asked, asked if rotors is None else rotors.wrench(rotors.allocate(tuple(asked)))


def rate(t: float, z: list[float], rotors: Rotors | None, uncertain: bool) -> list[float]:
    """Plant (12), disturbances (5), x_hat (6), omega_hat, theta_hat, sigma_hat and u_ad (3 each)."""
    x, (phi, theta, psi), (p, q, r) = z[:12], z[6:9], z[9:12]
    _, *goal = position_loop(t, z)
    asked, u = asked_and_given(t, z, rotors)
    lift = u[0] / MASS
    up = [cos(phi) * sin(theta) * cos(psi) + sin(phi) * sin(psi), cos(phi) * sin(theta) * sin(psi) - sin(phi) * cos(psi)]
    acceleration = [up[0] * lift, up[1] * lift, cos(phi) * cos(theta) * lift - G]
    i_x, i_y, i_z = INERTIA
    turning = [(i_y - i_z) / i_x * q * r, (i_z - i_x) / i_y * p * r, (i_x - i_y) / i_z * p * q]
    d = z[12:17]
    if uncertain:
        unknown = [
            0.2 * cos(phi) * sin(theta) + 0.2 * phi * psi + d[0],
            0.2 * cos(phi) * sin(psi) + 0.2 * phi * psi**2 + d[1],
            0.2 * cos(theta) * sin(phi) + 0.2 * phi * theta * psi + d[3],
        ]
        gains = (1.6, 0.7, 1.23)
    else:
        unknown, gains = [0.0] * 3, (1.0, 1.0, 1.0)
    turning = [turning[i] + unknown[i] + gains[i] * u[1 + i] / INERTIA[i] for i in range(3)]
    # The filters by their phase variables.
    filters = [0.2 * sin(0.4 * t) - d[0], d[2], 0.24 * sin(0.6 * t) - 3 * d[1] - 2 * d[2], d[4]]
    filters.append(0.15 * sin(0.5 * t) - 2 * d[3] - 3 * d[4])
    norm = max(map(abs, z[6:12]))
    law = [[0.0] * 3 for _ in range(6)]
    for i in range(3):
        omega, of_norm, sigma, u_ad = (z[23 + 3 * k + i] for k in range(4))
        lost = (u[1 + i] - asked[1 + i]) / INERTIA[i]
        v = u_ad + lost
        eta = omega * v + of_norm * norm + sigma
        angle, speed = z[17 + i], z[20 + i]
        s = -(P[i][0] * (angle - x[6 + i]) + P[i][1] * (speed - x[9 + i]))
        law[0][i], law[1][i] = speed, -STIFFNESS[i] * angle - DAMPING[i] * speed + eta
        law[2][i] = GAIN * projected(omega, s * v, 0.5, 10)
        law[3][i] = GAIN * projected(of_norm, s * norm, -100, 100)
        law[4][i] = GAIN * projected(sigma, s, -100, 100)
        law[5][i] = -K * (eta - STIFFNESS[i] * goal[i]) + lost * K
    return [*z[3:6], *acceleration, *z[9:12], *turning, *filters, *(value for row in law for value in row)]


def flown(rotors: Rotors | None, uncertain: bool, until: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states, and what is asked for, by classical Runge-Kutta steps."""
    z = [0.0] * 6 + [0.1, -0.1, 0.2] + [0.0] * 8 + [0.1, -0.1, 0.2, 0.0, 0.0, 0.0] + [1.0] * 3 + [0.0] * 9
    rows, asked = [z], [asked_and_given(0.0, z, rotors)[0]]
    steps = round(until / step)
    ahead = lambda k, h: [a + h * b for a, b in zip(z, k, strict=True)]  # noqa: E731
    for n in range(steps):
        t = n * step
        k1 = rate(t, z, rotors, uncertain)
        k2 = rate(t + step / 2, ahead(k1, step / 2), rotors, uncertain)
        k3 = rate(t + step / 2, ahead(k2, step / 2), rotors, uncertain)
        k4 = rate(t + step, ahead(k3, step), rotors, uncertain)
        slope = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
        z = ahead(slope, step)
        rows.append(z)
        asked.append(asked_and_given(t + step, z, rotors)[0])
    return np.arange(steps + 1) * step, np.array(rows), np.array(asked)
