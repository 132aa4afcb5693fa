"""Records of random motors, for tests of models that are identified from them."""

import subprocess
from pathlib import Path

import numpy as np
from conftest import PROGRAM
from scipy.linalg import expm

STEP = 0.002
"""Step of the records, s."""
SIGNALS = ["--inputs", "voltage", "--states", "speed,current"]


def program(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=120)


def motor(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A random DC motor: speed in rad/s and current in A, driven by a voltage."""
    k, R, L, J, b = 0.05 * rng.uniform(0.5, 2), rng.uniform(0.5, 2), 0.02 * rng.uniform(0.5, 2), 1e-3 * rng.uniform(0.5, 2), 1e-3
    return np.array([[-b / J, k / J], [-k / L, -R / L]]), np.array([[0.0], [1 / L]])


def record(rng: np.random.Generator, A: np.ndarray, B: np.ndarray, *, noise: float = 0.005, rows: int = 1500) -> np.ndarray:
    """Time, voltage, speed and current: levels of random heights and lengths, and sensors' noise in parts of each signal."""
    whole = expm(np.block([[A, B], [np.zeros((1, 3))]]) * STEP)
    F, G = whole[:2, :2], whole[:2, 2:]
    u = np.repeat(rng.uniform(-10, 10, rows), rng.integers(5, 60, rows))[:rows]
    x = np.zeros((rows, 2))
    for k in range(rows - 1):
        x[k + 1] = F @ x[k] + G[:, 0] * u[k]
    x += noise * x.std(axis=0) * rng.standard_normal(x.shape)
    return np.column_stack([STEP * np.arange(rows), u, x])


def written(folder: Path, table: np.ndarray, name: str = "record.csv", header: str = "time,voltage,speed [rad/s],current [A]") -> Path:
    np.savetxt(folder / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return folder / name
