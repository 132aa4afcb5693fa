"""Random linear plants of eight classes for first designs: poles and zeros of 0.5 … 50 rad/s, gains of either sign."""

from dataclasses import dataclass
from random import Random

import numpy as np
import scipy.linalg
import scipy.signal

CLASSES = ["minimum phase", "any bandwidth", "zero on the right", "integrators", "mode", "dead time", "unstable", "several channels"]


@dataclass
class Plant:
    """x' = A x + B u with a dead time at its inputs, y = C x, and the bandwidth that is asked for, rad/s."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    bandwidth: float
    delay: float = 0.0

    @property
    def zeros(self) -> np.ndarray:
        """Invariant zeros: finite generalised eigenvalues."""
        n, m = self.B.shape
        pencil = np.block([[self.A, self.B], [self.C, np.zeros((m, m))]])
        found = scipy.linalg.eigvals(pencil, scipy.linalg.block_diag(np.eye(n), np.zeros((m, m))))
        return found[np.isfinite(found) & (abs(found) < 1e6)]

    def json(self) -> dict:
        matrices = {"A": self.A.tolist(), "B": self.B.tolist(), "C": self.C.tolist()}
        return matrices | ({"delay": self.delay} if self.delay else {})

    def at(self, omega: float) -> np.ndarray:
        """G(j ω)."""
        inner = np.linalg.solve(1j * omega * np.eye(len(self.A)) - self.A, self.B)
        return self.C @ inner * np.exp(-1j * omega * self.delay)


def logarithmic(random: Random, least: float, most: float) -> float:
    return float(np.exp(random.uniform(np.log(least), np.log(most))))


def pair(size: float, damping: float) -> list[complex]:
    pole = size * complex(-damping, np.sqrt(1 - damping**2))
    return [pole, pole.conjugate()]


def stable(random: Random, count: int) -> list[complex]:
    """Poles, some of them in pairs."""
    poles: list[complex] = []
    while len(poles) < count:
        size = logarithmic(random, 0.5, 50)
        is_pair = count - len(poles) >= 2 and random.random() < 0.3
        poles += pair(size, random.uniform(0.3, 1)) if is_pair else [complex(-size)]
    return poles


def single(random: Random, zeros: list[complex], poles: list[complex], bandwidth: float, delay: float = 0.0) -> Plant:
    """A plant of one channel whose gain at rest, apart from integrators, is 0.01 … 100 in size."""
    gain = logarithmic(random, 0.01, 100) * random.choice([-1, 1])
    at_rest = np.prod([-z for z in zeros]) / np.prod([-p for p in poles if p != 0])
    A, B, C, _ = scipy.signal.zpk2ss(zeros, poles, gain / abs(at_rest))
    return Plant(A, B, C, bandwidth, delay)


def plant(kind: str, random: Random) -> Plant:
    """A plant of a class."""
    if kind == "several channels":
        return coupled(random)
    n = random.randint(1, 4)
    poles = stable(random, n + (kind == "zero on the right"))
    slowest = min(abs(p) for p in poles)
    some = [complex(-logarithmic(random, 0.5, 50)) for _ in range(random.randint(0, n - 1))]
    match kind:
        case "minimum phase":
            return single(random, some, poles, 3 * slowest)
        case "any bandwidth":
            return single(random, some, poles, logarithmic(random, 0.1, 20) * slowest)
        case "zero on the right":
            return single(random, [complex(logarithmic(random, 0.5, 50)), *some], poles, 3 * slowest)
        case "integrators":
            count = random.randint(1, 2)
            lags = stable(random, random.randint(0, 4 - count))
            return single(random, [], [0j] * count + lags, logarithmic(random, 0.5, 20))
        case "mode":
            poles = pair(logarithmic(random, 0.5, 50), logarithmic(random, 0.01, 0.2)) + stable(random, n - 1)
            return single(random, [], poles, 3 * min(abs(p) for p in poles))
        case "dead time":
            return single(random, [], poles, 3 * slowest, logarithmic(random, 0.1, 5) / slowest)
        case _:
            pole = logarithmic(random, 0.5, 20)
            # Lags far enough beyond the unstable pole for a margin to exist.
            lags = [complex(-pole * logarithmic(random, 10, 100)) for _ in range(random.randint(0, 2))]
            return single(random, [], [complex(pole), *lags], 3 * pole)


def coupled(random: Random) -> Plant:
    """Two or three channels with stable poles and zeros."""
    normal = np.random.default_rng(random.randrange(2**32)).normal
    m = random.choice([2, 3])
    n = m + random.randint(0, 3)
    while True:
        A = 3 * normal(size=(n, n))
        A -= np.eye(n) * (np.linalg.eigvals(A).real.max() + logarithmic(random, 0.5, 5))
        found = Plant(A, normal(size=(n, m)), normal(size=(m, n)), 3 * float(np.abs(np.linalg.eigvals(A)).min()))
        at_rest = found.C @ np.linalg.solve(A, found.B)
        if np.linalg.cond(at_rest) < 100 and (found.zeros.real < 0).all():
            return found
