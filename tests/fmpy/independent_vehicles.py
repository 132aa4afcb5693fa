"""Quadrotor and submarine without any FMU: from rotation matrices and the energy of rigid bodies."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from independent_plants import lagrange
from scipy.integrate import quad
from scipy.signal import tf2ss


def turns(angles: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Rotations about x, y and z by roll, pitch and yaw, and their derivatives by the angle."""
    (a, b, c), (p, q, r) = np.cos(angles), np.sin(angles)
    roll, d_roll = [[1, 0, 0], [0, a, -p], [0, p, a]], [[0, 0, 0], [0, -p, -a], [0, a, -p]]
    pitch, d_pitch = [[b, 0, q], [0, 1, 0], [-q, 0, b]], [[-q, 0, b], [0, 0, 0], [-b, 0, -q]]
    yaw, d_yaw = [[c, -r, 0], [r, c, 0], [0, 0, 1]], [[-r, -c, 0], [c, -r, 0], [0, 0, 0]]
    return [np.array(turn) for turn in (roll, pitch, yaw)], [np.array(slope) for slope in (d_roll, d_pitch, d_yaw)]


def rotation(angles: np.ndarray) -> np.ndarray:
    """From body to earth axes."""
    (roll, pitch, yaw), _ = turns(angles)
    return yaw @ pitch @ roll


def body_rates(angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """From the spin R^T R', which is skew-symmetric."""
    (roll, pitch, yaw), (d_roll, d_pitch, d_yaw) = turns(angles)
    change = rates[0] * yaw @ pitch @ d_roll + rates[1] * yaw @ d_pitch @ roll + rates[2] * d_yaw @ pitch @ roll
    spin = (yaw @ pitch @ roll).T @ change
    return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


@dataclass(frozen=True)
class Quadrotor:
    """The printed equations, or a rigid body; `uncertain` as in the second case."""

    m: float = 0.5
    inertia: tuple[float, float, float] = (4.85e-3, 4.85e-3, 8.81e-3)
    g: float = 9.81
    exact: bool = False
    uncertain: bool = False

    def angular_acceleration(self, angles: np.ndarray, rates: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """The angles' second derivatives without uncertainty."""
        if not self.exact:
            ix, iy, iz = self.inertia
            dphi, dtheta, dpsi = rates
            f = (iy - iz) / ix * dtheta * dpsi, (iz - ix) / iy * dphi * dpsi, (ix - iy) / iz * dphi * dtheta
            return np.array(f) + torque / self.inertia
        # Torques about the body's axes do the work torque . omega: their forces along the angles.
        force = np.column_stack([body_rates(angles, e).real for e in np.eye(3)]).T @ torque
        return lagrange(self.kinetic_energy, lambda _: 0.0, angles, rates, force)

    def kinetic_energy(self, angles: np.ndarray, rates: np.ndarray) -> complex:
        """Of turning."""
        omega = body_rates(angles, rates)
        return omega @ (self.inertia * omega) / 2

    def rate(self, x: np.ndarray, u: np.ndarray, d: np.ndarray) -> np.ndarray:
        """x' under disturbances d."""
        angles, rates, torque = x[6:9], x[9:], u[1:]
        acceleration = rotation(angles).real @ [0, 0, np.clip(u[0], 0, 15)] / self.m - [0, 0, self.g]
        turning = self.angular_acceleration(angles, rates, torque)
        if self.uncertain:
            still = self.angular_acceleration(angles, rates, np.zeros(3))
            phi, theta, psi = angles
            f = np.array(
                [
                    0.2 * np.cos(phi) * np.sin(theta) + 0.2 * phi * psi,
                    0.2 * np.cos(phi) * np.sin(psi) + 0.2 * phi * psi**2,
                    0.2 * np.cos(theta) * np.sin(phi) + 0.2 * phi * theta * psi,
                ]
            )
            turning = still + f + np.diag([1.6, 0.7, 1.23]) @ (turning - still) + d
        return np.concatenate([x[3:6], acceleration, rates, turning])


# Numerator, denominator and frequency of each disturbance, and scipy's own realisations.
DISTURBANCES = [([0.2], [1, 1], 0.4), ([0.24], [1, 2, 3], 0.6), ([0.15], [1, 3, 2], 0.5)]
FILTERS = [(*tf2ss(numerator, denominator)[:3], omega) for numerator, denominator, omega in DISTURBANCES]


def disturbances(s: np.ndarray) -> np.ndarray:
    """The outputs of the filters with states s, one after another."""
    return np.array([(c @ part).item() for (_, _, c, _), part in zip(FILTERS, np.split(s, [1, 3]), strict=True)])


def disturbance_rate(t: float, s: np.ndarray) -> np.ndarray:
    """s' of the filters."""
    parts = zip(FILTERS, np.split(s, [1, 3]), strict=True)
    return np.concatenate([a @ part + b[:, 0] * np.sin(omega * t) for (a, b, _, omega), part in parts])


def lamb(a: float, b: float) -> tuple[float, float]:
    """The integrals alpha and beta of a prolate spheroid with semi-axes a > b, numerically."""
    alpha, _ = quad(lambda s: a * b**2 / ((a**2 + s) ** 1.5 * (b**2 + s)), 0, np.inf, epsabs=0, epsrel=1e-12)
    beta, _ = quad(lambda s: a * b**2 / ((a**2 + s) ** 0.5 * (b**2 + s) ** 2), 0, np.inf, epsabs=0, epsrel=1e-12)
    return alpha, beta


@dataclass(frozen=True)
class Submarine:
    """A spheroid in water whose mass centre hangs below its centre."""

    length: float = 1.5
    diameter: float = 0.2
    m: float = 32.0
    z_g: float = 0.0044
    rho: float = 1025.0
    g: float = 9.81
    linear: tuple[float, ...] = (1.0, 5.0, 5.0, 0.2, 1.0, 1.0)
    axial_drag: float = 0.2
    cross_flow_drag: float = 1.1
    roll_damping: float = 0.1

    @cached_property
    def inertia(self) -> np.ndarray:
        """Moments of inertia of the spheroid about its centre."""
        a, b = self.length / 2, self.diameter / 2
        return self.m / 5 * np.array([2 * b**2, a**2 + b**2, a**2 + b**2])

    @cached_property
    def added_mass(self) -> np.ndarray:
        """From the integrals, as Lamb has it; 5 % of the body's own in roll."""
        a, b = self.length / 2, self.diameter / 2
        (alpha, beta), water = lamb(a, b), 4 / 3 * np.pi * self.rho * a * b**2
        turning = (b**2 - a**2) ** 2 * (alpha - beta) / (2 * (b**2 - a**2) + (b**2 + a**2) * (beta - alpha))
        along, across, pitch = water * alpha / (2 - alpha), water * beta / (2 - beta), water / 5 * turning
        return np.array([along, across, across, 0.05 * self.inertia[0], pitch, pitch])

    def velocities(self, eta: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """In body axes."""
        return np.concatenate([rotation(eta[3:]).T @ rates[:3], body_rates(eta[3:], rates[3:])])

    def kinetic_energy(self, eta: np.ndarray, rates: np.ndarray) -> complex:
        """Of the mass centre, of turning about it, and of the water. Plain products: velocities may be complex."""
        nu = self.velocities(eta, rates)
        v, omega = nu[:3], nu[3:]
        centre = v + self.z_g * np.array([omega[1], -omega[0], 0])
        about_centre = self.inertia - self.m * self.z_g**2 * np.array([1, 1, 0])
        return (self.m * (centre @ centre) + omega @ (about_centre * omega) + nu @ (self.added_mass * nu)) / 2

    def potential_energy(self, eta: np.ndarray) -> complex:
        """Buoyancy carries the weight; what remains is how deep the mass centre hangs."""
        return -self.m * self.g * self.z_g * rotation(eta[3:])[2, 2]

    @cached_property
    def quadratic_damping(self) -> np.ndarray:
        """By areas; in pitch and yaw what every strip of the hull resists."""
        frontal, side = np.pi * self.diameter**2 / 4, self.length * self.diameter
        along, across = self.rho / 2 * self.axial_drag * frontal, self.rho / 2 * self.cross_flow_drag * side
        turning, _ = quad(lambda s: self.rho * self.cross_flow_drag * self.diameter * s**3, 0, self.length / 2)
        return np.array([along, across, across, self.roll_damping, turning, turning])

    def drag(self, nu: np.ndarray) -> np.ndarray:
        """Forces and moments in body axes."""
        return (self.linear + self.quadratic_damping * np.abs(nu)) * nu

    def rate(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """x' for x = (eta, eta')."""
        eta, rates = x[:6], x[6:]
        inverse = np.column_stack([self.velocities(eta, e).real for e in np.eye(6)])
        force = u - inverse.T @ self.drag(inverse @ rates)
        return np.concatenate([rates, lagrange(self.kinetic_energy, self.potential_energy, eta, rates, force)])
