"""Plants and their records, from seeds: linear plants of random poles, disturbed or not, in closed loops, with known kinematics, or of which
outputs alone are measured; and three machines that aren't linear. The order of random draws is part of a case.

Each case is a `Case`: the true plant, and what a user would have of it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

Array = NDArray[np.float64]


@dataclass
class Case:
    """A plant x' = A x + B u + d with a record: its step in s, inputs held from row to row, and measured signals."""

    A: Array
    B: Array
    d: Array
    step: float
    u: Array
    measured: Array
    clean: Array
    decibels: float
    rng: np.random.Generator

    @property
    def order(self) -> int:
        return len(self.A)

    @property
    def inputs(self) -> int:
        return self.B.shape[1]

    def write(self, file: Path, letter: str = "x") -> None:
        """A file of comma-separated values: time, u1 …, and x1 … ."""
        write(file, self.step, self.u, self.measured, letter)


def write(file: Path, step: float, u: Array, measured: Array, letter: str = "x") -> None:
    names = ["time", *(f"u{j + 1}" for j in range(u.shape[1])), *(f"{letter}{i + 1}" for i in range(measured.shape[1]))]
    rows = np.column_stack([np.arange(len(u)) * step, u, measured])
    file.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")


def sampled(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """F and G behind a zero-order hold."""
    n, m = B.shape
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A, B
    both = expm(whole * step)
    return both[:n, :n], both[:n, n:]


def simulated(F: Array, G: Array, u: Array, start: Array, added: Array | float = 0.0) -> Array:
    """States of a sampled plant."""
    x, all_x = start, np.empty((len(u), len(F)))
    forces = np.broadcast_to(added, (len(u), len(F)))
    for k in range(len(u)):
        all_x[k] = x
        x = F @ x + G @ u[k] + forces[k]
        if np.abs(x).max() > 1e8:
            all_x[k:] = 1e8
            break
    return all_x


def random_plant(rng: np.random.Generator, n: int, m: int) -> tuple[Array, Array]:
    """Poles between .3 and 3 rad/s, six of ten in pairs with damping between .1 and .95, in coordinates with units that differ by 100."""
    blocks: list[Array] = []
    left = n
    while left:
        frequency = 10 ** rng.uniform(-0.5, 0.5)
        if left >= 2 and rng.random() < 0.6:
            damping = rng.uniform(0.1, 0.95)
            a, b = -frequency * damping, frequency * np.sqrt(1 - damping**2)
            blocks.append(np.array([[a, b], [-b, a]]))
        else:
            blocks.append(np.array([[-frequency]]))
        left -= len(blocks[-1])
    modal, at = np.zeros((n, n)), 0
    for block in blocks:
        modal[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    turned = np.linalg.qr(rng.normal(size=(n, n)))[0] @ np.diag(10 ** rng.uniform(-0.3, 0.3, n))
    B = rng.normal(size=(n, m))
    units = np.diag(10 ** rng.uniform(-1, 1, n))
    A = units @ turned @ modal @ np.linalg.inv(turned) @ np.linalg.inv(units)
    return A, units @ turned @ B


def recorded(
    rng: np.random.Generator, A: Array, B: Array, step: float, rows: int, decibels: float, disturbance: float = 0.0
) -> tuple[Array, Array, Array, Array]:
    """Inputs at random levels, states with white noise, states without, and the constant d. A disturbance is white, in parts of what half
    of the full inputs do in a step."""
    n, m = B.shape
    longest = max(1, int(0.8 / step))
    u = np.empty((rows, m))
    for j in range(m):
        k = 0
        while k < rows:
            length = 1 + rng.integers(1, 2 * longest)
            u[k : k + length, j] = rng.uniform(-1, 1)
            k += length
    F, G = sampled(A, B, step)
    d = 0.3 * rng.uniform(-1, 1) * B @ np.ones(m) / 2
    constant = sampled(A, d[:, None], step)[1][:, 0]
    start = rng.normal(size=n) * 0.1 * np.abs(np.linalg.solve(A, B)).sum(1)
    forces = rng.normal(size=(rows, n)) * disturbance * np.abs(G).sum(1) * 0.5
    x = simulated(F, G, u, start, constant + forces)
    noise = x.std(axis=0) * 10 ** (-decibels / 20)
    return u, x + rng.normal(size=x.shape) * noise, x, d


def linear(number: int, disturbance: float = 0.0) -> Case:
    """One to six states, one or two inputs, 10 to 60 dB."""
    rng = np.random.default_rng(1000 + number)
    n = 1 + number % 6
    m = 1 if n < 3 else 1 + (number // 6) % 2
    decibels = 10.0 * (1 + (number // 12) % 6)
    A, B = random_plant(rng, n, m)
    step = 10 ** rng.uniform(-1.6, -0.8)
    u, measured, clean, d = recorded(rng, A, B, step, 800, decibels, disturbance)
    return Case(A, B, d, step, u, measured, clean, decibels, rng)


def mechanical(number: int) -> Case:
    """One or two coupled masses, each with its force; the kinematics are known. Half of them are disturbed."""
    rng = np.random.default_rng(7000 + number)
    masses = 1 + number % 2
    n = 2 * masses
    decibels = [20.0, 30.0, 40.0][(number // 2) % 3]
    A, B = np.zeros((n, n)), np.zeros((n, masses))
    frequency, damping = 10 ** rng.uniform(-0.3, 0.3, masses), rng.uniform(0.05, 0.6, masses)
    for k in range(masses):
        position, speed = 2 * k, 2 * k + 1
        A[position, speed] = 1
        A[speed, position], A[speed, speed] = -(frequency[k] ** 2), -2 * damping[k] * frequency[k]
        B[speed, k] = rng.uniform(0.5, 2)
    if masses == 2:
        springs = rng.uniform(0.1, 0.6, 2)
        A[1, [0, 2]] += [-springs[0], springs[0]]
        A[3, [2, 0]] += [-springs[1], springs[1]]
        B[1, 1], B[3, 0] = 0.1, -0.1
    step = 10 ** rng.uniform(-1.4, -1.0)
    u, measured, clean, d = recorded(rng, A, B, step, 800, decibels, 0.1 if number % 4 > 1 else 0.0)
    return Case(A, B, d, step, u, measured, clean, decibels, rng)


def closed_loop(number: int) -> Case:
    """An unstable plant under a linear-quadratic regulator of its noisy states, levels added."""
    rng = np.random.default_rng(9000 + number)
    n, rows = 2 + number % 4, 800
    A, B = random_plant(rng, n, 1)
    step = 10 ** rng.uniform(-1.4, -1.0)
    A = A + np.eye(n) * (rng.uniform(0.1, 1.0) - np.linalg.eigvals(A).real.max())
    F, G = sampled(A, B, step)
    weights = np.diag(1 / np.maximum(np.abs(B).ravel(), 1e-3 * np.abs(B).max()) ** 2)
    P = solve_discrete_are(F, G, weights, np.eye(1))
    K = np.linalg.solve(np.eye(1) + G.T @ P @ G, G.T @ P @ F)

    def run(noise: Array) -> tuple[Array, Array, Array]:
        draws = np.random.default_rng(1)
        x, clean, measured, u = np.zeros(n), np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, 1))
        level, until = 0.0, 0
        for k in range(rows):
            if k == until:
                level = draws.uniform(-1, 1)
                until += 1 + draws.integers(1, max(2, int(1.2 / step)))
            y = x + draws.normal(size=n) * noise
            clean[k], measured[k], u[k] = x, y, level - K @ y
            x = F @ x + G @ u[k]
        return clean, u, measured

    decibels = [20.0, 30.0, 40.0][(number // 4) % 3]
    clean, *_ = run(np.zeros(n))
    clean, u, measured = run(clean.std(0) * 10 ** (-decibels / 20))
    return Case(A, B, np.zeros(n), step, u, measured, clean, decibels, rng)


def outputs(number: int) -> Case:
    """One to five states, of which one or two outputs are measured: 840 rows to identify, 360 held out."""
    rng = np.random.default_rng(3000 + number)
    n, m, p = 1 + number % 5, 1 + (number // 5) % 2, 1 + (number // 10) % 2
    decibels = [20.0, 30.0, 40.0, 50.0][number % 4]
    A, B = random_plant(rng, n, m)
    step = 10 ** rng.uniform(-1.6, -0.8)
    u, _, x, d = recorded(rng, A, B, step, 1200, decibels)
    C = rng.normal(size=(p, n)) / x.std(0)
    clean = x @ C.T
    measured = clean + rng.normal(size=clean.shape) * clean.std(0) * 10 ** (-decibels / 20)
    return Case(A, B, d, step, u, measured, clean, decibels, rng)


def fit(case: Case, A: Array, B: Array) -> float:
    """The fit of a model's answer to another input, without noise, %: the mean over the states of 100 (1 − ‖x − x̂‖/‖x − x̄‖)."""
    rows, longest = 600, max(1, int(0.8 / case.step))
    u = np.repeat(case.rng.uniform(-1, 1, (rows // longest + 1, case.inputs)), longest, 0)[:rows]
    true, found = (simulated(*sampled(*plant, case.step), u, np.zeros(case.order)) for plant in ((case.A, case.B), (A, B)))
    error = np.linalg.norm(true - found, axis=0) / np.linalg.norm(true - true.mean(0), axis=0)
    return float(np.mean(100 * (1 - error)))
