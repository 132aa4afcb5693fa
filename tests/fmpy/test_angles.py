"""Angles that wrap, against laws that are typed and integrated without any FMU."""

from collections.abc import Callable
from math import pi, remainder, sin, tau

import numpy as np
import pytest
from conftest import adaptive_fmu
from master import Fmu, Unit
from scipy.linalg import solve_continuous_lyapunov

H = 1e-3
INERTIA = 8.81e-3
Angle = Callable[[float], float]


def wrapped(angle: float) -> float:
    """Within (-pi, pi]."""
    rest = remainder(angle, tau)
    return pi if rest == -pi else rest


def projected(estimate: float, rate: float, low: float, high: float) -> float:
    """A rate that keeps an estimate between its bounds."""
    half, away = (high - low) / 2, estimate - (low + high) / 2
    beyond = (1.1 * away**2 - half**2) / (0.1 * half**2)
    return rate * (1 - beyond) if beyond > 0 and away * rate > 0 else rate


class Yaw:
    """The L1 law of the quadrotor's yaw, roll and pitch at rest: (x_hat, rate_hat, omega, theta, sigma, u_ad) and the origin."""

    K_m = np.array([40.0**2 + 0.5**2, 80.0])
    A_m = np.array([[0.0, 1.0], -K_m])
    P_2 = solve_continuous_lyapunov(A_m.T, -np.eye(2))[:, 1]

    def __init__(self, psi: float, r: float) -> None:
        self.origin = psi + wrapped(r - psi) if max(abs(psi), abs(r)) > pi / 4 else 0.0
        self.state = np.array([psi - self.origin, 0, 1, 0, 0, self.K_m[0] * (psi - self.origin)])

    def read(self, psi: float, r: float) -> tuple[float, float]:
        """Angle and reference as the law counts them."""
        near = self.state[0]
        psi = near + wrapped(psi - self.origin - near)
        return psi, psi + wrapped(r - self.origin - psi)

    def step(self, psi: float, rate: float, r: float) -> float:
        """One communication step, by Runge and Kutta's method in substeps; the torque at its end."""
        _, r_l = self.read(psi, r)
        if abs(r_l) > pi / 4:
            self.origin += r_l
            self.state[0] -= r_l
            self.state[5] -= self.K_m[0] * r_l
        psi_l, r_l = self.read(psi, r)
        h, y = H / 50, self.state
        for _ in range(50):
            k1 = self.rates(y, psi_l, rate, r_l)
            k2 = self.rates(y + h / 2 * k1, psi_l, rate, r_l)
            k3 = self.rates(y + h / 2 * k2, psi_l, rate, r_l)
            k4 = self.rates(y + h * k3, psi_l, rate, r_l)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self.state = y
        return INERTIA * (y[5] - self.K_m[0] * psi_l - self.K_m[1] * rate)

    def rates(self, y: np.ndarray, psi: float, rate: float, r: float) -> np.ndarray:
        """The derivatives of all states."""
        x_hat, rate_hat, omega, theta, sigma, u_ad = y.tolist()
        size = max(abs(psi), abs(rate))
        eta = omega * u_ad + theta * size + sigma
        s = -(self.P_2[0] * (x_hat - psi) + self.P_2[1] * (rate_hat - rate))
        estimates = (
            projected(omega, s * u_ad, 0.5, 10.0),
            projected(theta, s * size, -100.0, 100.0),
            projected(sigma, s, -100.0, 100.0),
        )
        acceleration = eta - self.K_m[0] * x_hat - self.K_m[1] * rate_hat
        return np.array([rate_hat, acceleration, *(1e5 * rate for rate in estimates), -30 * (eta - self.K_m[0] * r)])


@pytest.mark.parametrize(
    ("start", "r"),
    [
        pytest.param(0.7, lambda t: 0.7 + 0.8 * t, id="origin"),
        pytest.param(np.radians(170), lambda t: np.radians(170 if t < 1e-9 else 190), id="seam"),
    ],
)
def test_the_quadrotor_turns_as_an_independent_law_does(fmu, start: float, r: Angle) -> None:
    law, torque = Yaw(start, r(0)), 0.0
    (psi, rate), (own, own_rate) = (start, 0.0), (start, 0.0)
    with Unit(fmu("L1Quadrotor")) as unit:
        unit["u_ad_start"] = "bumpless"
        unit.start(**{"x[9]": wrapped(psi), "r[4]": wrapped(r(0)), "u_manual[1]": 0.5 * 9.81})
        for k in range(400):
            unit["x[9]"], unit["x[12]"], unit["r[4]"] = wrapped(psi), rate, wrapped(r(k * H))
            unit.step(k * H, H)
            found = unit["u[4]"]
            torque = law.step(own, own_rate, r(k * H))
            psi, rate = psi + H * (rate + H / 2 * found / INERTIA), rate + H * found / INERTIA
            own, own_rate = own + H * (own_rate + H / 2 * torque / INERTIA), own_rate + H * torque / INERTIA
            assert abs(psi - own) < 1e-5
        assert abs(found - torque) < 1e-4
        assert abs(unit["origin[1]"] - law.origin) < 1e-9
    assert start == pytest.approx(np.radians(170)) or law.origin > 0.7, "the origin has moved"


@pytest.fixture(scope="module")
def unwrap(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    """Two channels."""
    folder = tmp_path_factory.mktemp("unwrap")
    text = 'name = "Two"\nmodel = "unwrap"\ndescription = "Two angles"\n\n[structure]\nchannels = 2\n'
    (folder / "two.toml").write_text(text)
    made = adaptive_fmu("export", folder / "two.toml", "--out", folder)
    assert made.returncode == 0, made.stderr
    return Fmu(folder / "Two.fmu", folder / "unpacked")


def test_unwrapped_angles_are_those_of_numpy(unwrap: Fmu) -> None:
    random = np.random.default_rng(4)
    angles = np.cumsum(random.uniform(-3, 3, (500, 2)), axis=0)
    given = angles + tau * random.integers(-3, 4, angles.shape)
    found = []
    with Unit(unwrap) as unit:
        unit.start(**{"u[1]": given[0, 0], "u[2]": given[0, 1]})
        for k, values in enumerate(given):
            for i in range(2):
                unit[f"u[{i + 1}]"] = values[i]
            unit.step(k * H, H)
            found.append([unit["y[1]"], unit["y[2]"]])
    expected = np.unwrap(given, axis=0)
    assert np.abs(np.diff(given, axis=0)).max() > 5
    assert np.abs(np.array(found) - expected).max() < 1e-9


def pid_rates(y: np.ndarray, v: tuple[float, float], c: float) -> np.ndarray:
    """I' and w' of a PID controller of an angle, K_i = 1 and N = 100."""
    psi, r = v
    return np.array([wrapped(r - psi), 100 * wrapped(c * r - psi - y[1])])


@pytest.mark.parametrize("c", [0.0, 1.0])
def test_a_pid_controller_answers_angles_by_its_equations(tmp_path, c: float) -> None:
    text = 'name = "Turn"\nmodel = "pid"\ndescription = "An angle"\n\n[structure]\nchannels = 1\nangles = [1]\nunits = { y = ["rad"] }\n\n'
    gains = f"[start]\nK_p = [64.0]\nK_i = [1.0]\nK_d = [15.0]\nN = [100.0]\nc = [{c}]\nrelative_tolerance = 1e-10\n"
    (tmp_path / "turn.toml").write_text(text + gains)
    made = adaptive_fmu("export", tmp_path / "turn.toml", "--out", tmp_path)
    assert made.returncode == 0, made.stderr
    psi = rate = np.radians(179)
    rate = 0.0
    own = None
    with Unit(Fmu(tmp_path / "Turn.fmu", tmp_path / "unpacked")) as unit:
        for k in range(1500):
            t = k * H
            r = np.radians(179 + 60 * t) + (0.4 if t > 0.7 else 0.0) + 0.1 * sin(9 * t)
            inputs = {"y[1]": wrapped(psi), "r[1]": wrapped(r)}
            if own is None:
                own = np.array([0.0, c * inputs["r[1]"] - inputs["y[1]"]])
                unit.start(**inputs)
            for name, value in inputs.items():
                unit[name] = value
            unit.step(t, H)
            sampled, h = (psi, r), H / 10
            for _ in range(10):
                k1 = pid_rates(own, sampled, c)
                k2 = pid_rates(own + h / 2 * k1, sampled, c)
                k3 = pid_rates(own + h / 2 * k2, sampled, c)
                own = own + h / 6 * (k1 + 2 * k2 + 2 * k3 + pid_rates(own + h * k3, sampled, c))
            u = 64 * wrapped(r - psi) + own[0] + 1500 * wrapped(c * r - psi - own[1])
            assert abs(unit["u[1]"] - u) < 1e-6 * (1 + abs(u)), t
            psi, rate = psi + H * (rate + H / 2 * u), rate + H * u
    assert abs(wrapped(r - psi)) < 0.5
    assert psi > pi + 0.5
