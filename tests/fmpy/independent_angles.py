"""Laws of one angle with a reference model or a funnel, typed from their pages and integrated without any FMU.

Each has `states`, `rates(t, y, x, r)` and `control(t, y, x, r)`, with x = (psi, rate) and r = (r, r', r'') as it counts them: from
`origin`, which `moved(by)` takes along.
"""

from math import atanh, cos, exp, pi, remainder, sin, tau

import numpy as np
from scipy.linalg import solve_continuous_lyapunov


def wrapped(angle: float) -> float:
    """Within (-pi, pi]."""
    rest = remainder(angle, tau)
    return pi if rest == -pi else rest


def projected(estimate: float, rate: float, low: float, high: float) -> float:
    """A rate that keeps an estimate between its bounds, in a layer of a tenth."""
    half, away = (high - low) / 2, estimate - (low + high) / 2
    beyond = (1.1 * away**2 - half**2) / (0.1 * half**2)
    return rate * (1 - beyond) if beyond > 0 and away * rate > 0 else rate


class Funnel:
    """A symmetric funnel."""

    def __init__(self, rho_0: float, rho_inf: float, decay: float) -> None:
        self.rho_0, self.rho_inf, self.decay = rho_0, rho_inf, decay

    def at(self, t: float) -> tuple[float, float, float]:
        """rho and its derivatives."""
        part = (self.rho_0 - self.rho_inf) * exp(-self.decay * t)
        return part + self.rho_inf, -self.decay * part, self.decay**2 * part

    def inside(self, t: float, e: float) -> tuple[float, float, float]:
        """z, epsilon and R."""
        z = e / self.at(t)[0]
        return z, atanh(z), 1 / (self.at(t)[0] * (1 - z * z))


def feedback(pole: complex) -> np.ndarray:
    """K_m of a double integrator with this pair of poles."""
    return np.array([abs(pole) ** 2, -2 * pole.real])


class Mrac:
    """x_m, kappa, theta, sigma of a double integrator."""

    def __init__(self, gain: float, pole: complex, bounds: tuple[float, float, float, float]) -> None:
        self.gain, self.K_m = gain, feedback(pole)
        self.omega_min, self.omega_max, self.theta_bound, self.sigma_bound = bounds
        self.A_m = np.array([[0, 1], -self.K_m])
        self.P_2 = solve_continuous_lyapunov(self.A_m.T, -np.eye(2))[:, 1]
        self.states = np.zeros(6)

    def start(self, x: np.ndarray) -> None:
        """The model where the plant is."""
        self.states[:2] = x

    def moved(self, by: float) -> None:
        """Along with the origin."""
        self.states[0] -= by
        self.states[5] = min(max(self.states[5] + self.states[3] * by, -self.sigma_bound), self.sigma_bound)

    def control(self, _t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """u"""
        u_b = self.K_m[0] * r[0] - self.K_m @ x
        return np.array([u_b * (1 - y[2]) - y[3:5] @ x - y[5]])

    def rates(self, _t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """y'"""
        s, u_b = self.P_2 @ (x - y[:2]), self.K_m[0] * r[0] - self.K_m @ x
        of_model = self.A_m @ y[:2] + np.array([0, self.K_m[0] * r[0]])
        adapted = [
            projected(y[2], s * u_b, 1 - 1 / self.omega_min, 1 - 1 / self.omega_max),
            *(projected(y[3 + j], s * x[j], -self.theta_bound, self.theta_bound) for j in range(2)),
            projected(y[5], s, -self.sigma_bound, self.sigma_bound),
        ]
        return np.array([*of_model, *(self.gain * rate for rate in adapted)])


class Unmatched:
    """x_m, theta by rows and sigma for rows (0, 1), (0, -1), of which the control reaches the second."""

    A = np.array([[0.0, 1.0], [0.0, -1.0]])

    def __init__(self, poles: np.ndarray, funnels: list[Funnel], gamma: list[float], K: list[float]) -> None:
        self.A_m, self.funnels, self.gamma, self.K = np.array([[0, 1], -poles]), funnels, gamma, K
        self.states = np.zeros(8)

    def start(self, x: np.ndarray) -> None:
        """The model where the plant is."""
        self.states[:2] = x

    def moved(self, by: float) -> None:
        """Along with the origin."""
        self.states[0] -= by
        for i in range(2):
            self.states[6 + i] = min(max(self.states[6 + i] + self.states[2 + 2 * i] * by, -5.0), 5.0)

    def parts(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> tuple[list, np.ndarray]:
        """(epsilon, R) of both rows, and what they are to be: alpha, w."""
        x_m, wanted, inside = y[:2], [], []
        of_model = self.A_m @ x_m + np.array([0, -self.A_m[1, 0] * r[0]])
        errors = [x[0] - x_m[0]]
        for i, own in enumerate((0.0, -x[1])):
            z, epsilon, R = self.funnels[i].inside(t, errors[i])
            barrier = z * self.funnels[i].at(t)[1] - self.K[i] * R * epsilon
            wanted.append(of_model[i] - own - y[2 + 2 * i : 4 + 2 * i] @ x - y[6 + i] + barrier)
            inside.append((epsilon, R))
            errors.append(x[1] - wanted[0])
        return inside, np.array([*wanted, *of_model])

    def control(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """u"""
        return self.parts(t, y, x, r)[1][1:2]

    def rates(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """y'"""
        inside, wanted = self.parts(t, y, x, r)
        dy = np.zeros(8)
        dy[:2] = wanted[2:]
        for i, (epsilon, R) in enumerate(inside):
            for j in range(2):
                dy[2 + 2 * i + j] = projected(y[2 + 2 * i + j], self.gamma[i] * R * epsilon * x[j], -3.0, 3.0)
            rate = self.gamma[i] * R * (epsilon - 0.05 * abs(epsilon) * y[6 + i])
            dy[6 + i] = projected(y[6 + i], rate, -5.0, 5.0)
        return dy


class RobustMrac:
    """x_m, theta by channels and I by channels, for rows (0, 0.5), (0, -1) and a control each; the model counts turns itself."""

    A = np.array([[0.0, 0.5], [0.0, -1.0]])

    def __init__(self, A_m: np.ndarray, funnel: Funnel, numbers: dict[str, float]) -> None:
        self.A_m, self.funnel, self.numbers = A_m, funnel, numbers
        self.states = np.zeros(10)

    def start(self, x: np.ndarray) -> None:
        """The model where the plant is."""
        self.states[:2] = x

    def moved(self, by: float) -> None:
        """Along with the origin."""
        self.states[0] -= by
        for i in range(2):
            # psi = (2, 2), its square 8.
            self.states[6 + 2 * i : 8 + 2 * i] += 2 * self.states[2 + 2 * i] * by / 8

    def channel(self, i: int, t: float, y: np.ndarray, x: np.ndarray) -> tuple[float, float, float, np.ndarray]:
        """z, epsilon, R and sigma_hat."""
        z, epsilon, R = self.funnel.inside(t, x[i] - y[i])
        gain = self.numbers["beta"] * self.numbers["gamma_2"]
        sigma = (y[6 + 2 * i : 8 + 2 * i] + gain * epsilon * 2) / (1 + gain * 0.05 * abs(epsilon))
        return z, epsilon, R, sigma

    def control(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """u"""
        u = -self.A @ x + self.A_m @ (y[:2] - np.array([r[0], 0]))
        for i in range(2):
            z, epsilon, _, sigma = self.channel(i, t, y, x)
            switched = self.numbers["alpha_bar"] * np.tanh(epsilon / 0.5) + self.numbers["K_epsilon"] * epsilon
            u[i] += z * self.funnel.at(t)[1] - y[2 + 2 * i : 4 + 2 * i] @ x - 2 * sigma.sum() - switched
        return u

    def rates(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """y'"""
        dy = np.zeros(10)
        dy[:2] = self.A_m @ (y[:2] - np.array([r[0], 0]))
        for i in range(2):
            _, epsilon, R, sigma = self.channel(i, t, y, x)
            for j in range(2):
                rate = epsilon * R * x[j]
                dy[2 + 2 * i + j] = self.numbers["gamma_1"] * projected(y[2 + 2 * i + j], rate, -0.5, 0.5)
            dy[6 + 2 * i : 8 + 2 * i] = self.numbers["gamma_2"] * R * (epsilon * 2 - abs(epsilon) * 0.05 * sigma)
        return dy


class Neuro:
    """The weights of a network over (sin psi, cos psi, rate), relative degree 2."""

    def __init__(self, weights: np.ndarray, biases: np.ndarray, funnel: Funnel, numbers: dict[str, float]) -> None:
        self.weights, self.biases, self.funnel, self.numbers = weights, biases, funnel, numbers
        self.states = np.zeros(len(biases))

    def start(self, x: np.ndarray) -> None:
        """Nothing of the plant."""

    def moved(self, by: float) -> None:
        """Nothing grows with an angle."""

    def parts(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> tuple[float, np.ndarray, float]:
        """u, the neurons, and R E."""
        Z = 1 / (1 + np.exp(-self.weights @ np.array([sin(x[0]), cos(x[0]), x[1]]) - self.biases))
        (rho, rate, second), (k, weight) = self.funnel.at(t), (self.numbers["k"], self.numbers["lambda"])
        z, epsilon, R = self.funnel.inside(t, wrapped(x[0] - r[0]))
        w = x[1] - r[1] - z * rate
        dz = w / rho
        dR = (0.5 / (1 - z) ** 2 - 0.5 / (1 + z) ** 2) * dz / rho - R * rate / rho
        E = R * w + weight * epsilon
        V = dR * w - R * (dz * rate + z * second + r[2]) + weight * R * w
        nu_b = Z @ y + (V + k * E) / R + self.numbers["n_f"] * R * E
        return -self.numbers["eta_Gb"] * nu_b**2 * R * E, Z, R * E

    def control(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """u"""
        return np.array([self.parts(t, y, x, r)[0]])

    def rates(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """y'"""
        _, Z, RE = self.parts(t, y, x, r)
        return self.numbers["network_gain"] * (Z * RE - self.numbers["sigma"] * y)


class L1Ppf:
    """x_hat, omega, theta, sigma and u_ad of a double integrator, baseline outside, with its barrier."""

    def __init__(self, pole: complex, funnel: Funnel, numbers: dict[str, float]) -> None:
        self.K_m, self.funnel, self.numbers = feedback(pole), funnel, numbers
        self.A_m = np.array([[0, 1], -self.K_m])
        self.P_2 = solve_continuous_lyapunov(self.A_m.T, -np.eye(2))[:, 1]
        self.states = np.array([0, 0, 1.0, 0, 0, 0])

    def start(self, x: np.ndarray) -> None:
        """The predictor where the plant is."""
        self.states[:2] = x

    def moved(self, by: float) -> None:
        """Along with the origin."""
        self.states[0] -= by
        self.states[5] -= self.K_m[0] * by

    def barrier(self, t: float, x: np.ndarray, r: np.ndarray) -> float:
        """u_epsilon"""
        z, epsilon, R = self.funnel.inside(t, wrapped(x[0] - r[0]))
        E = R * (x[1] - r[1] - z * self.funnel.at(t)[1]) + self.numbers["error_weight"] * epsilon
        return -self.numbers["barrier_gain"] * R * E

    def control(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """u"""
        return np.array([y[5] - self.K_m @ x + self.barrier(t, x, r)])

    def rates(self, t: float, y: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """y'"""
        size, s, gain = np.abs(x).max(), -self.P_2 @ (y[:2] - x), self.numbers["adaptation_gain"]
        eta = y[2] * y[5] + y[3] * size + y[4]
        predicted = self.A_m @ y[:2] + np.array([0, eta + self.barrier(t, x, r)])
        adapted = [
            projected(y[2], s * y[5], 0.5, 2.0),
            projected(y[3], s * size, -10.0, 10.0),
            projected(y[4], s, -10.0, 10.0),
        ]
        command = r[2] + self.K_m @ r[:2]
        return np.array([*predicted, *(gain * rate for rate in adapted), -15 * (eta - command)])
