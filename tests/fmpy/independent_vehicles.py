"""The quadrotor without any FMU: from rotation matrices and the energy of a rigid body."""

from dataclasses import dataclass

import numpy as np
from independent_plants import lagrange
from scipy.signal import tf2ss


def turns(angles: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Rotations about x, y and z by roll, pitch and yaw, and their derivatives by the angle."""
    rotations, slopes = [], []
    for axis, angle in enumerate(angles):
        across = [(axis + 1) % 3, (axis + 2) % 3]
        rotation, slope = np.eye(3, dtype=complex), np.zeros((3, 3), dtype=complex)
        c, s = np.cos(angle), np.sin(angle)
        rotation[np.ix_(across, across)] = [[c, -s], [s, c]]
        slope[np.ix_(across, across)] = [[-s, -c], [c, -s]]
        rotations.append(rotation)
        slopes.append(slope)
    return rotations, slopes


def rotation(angles: np.ndarray) -> np.ndarray:
    """From body to earth axes."""
    (roll, pitch, yaw), _ = turns(angles)
    return yaw @ pitch @ roll


def body_rates(angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """From the spin R^T R', which is skew-symmetric."""
    (roll, pitch, yaw), (d_roll, d_pitch, d_yaw) = turns(angles)
    change = rates[0] * yaw @ pitch @ d_roll + rates[1] * yaw @ d_pitch @ roll + rates[2] * d_yaw @ pitch @ roll
    spin = rotation(angles).T @ change
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
