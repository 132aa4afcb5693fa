"""What the nominal loop of a first design has, computed from the file that `new` wrote, without the program."""

import json
import subprocess
import tomllib
from dataclasses import dataclass
from math import comb
from pathlib import Path

import control
import numpy as np
from conftest import PROGRAM
from random_plants import Plant


@dataclass
class Design:
    """The linear controller u = −K(s) y of a description, and what `new` said."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    table: dict
    stderr: str

    def at(self, omega: float) -> np.ndarray:
        inner = np.linalg.solve(1j * omega * np.eye(len(self.A)) - self.A, self.B)
        return self.C @ inner + self.D


def new(kind: str, plant: dict, bandwidth: float, folder: Path, reference: float = 1.0) -> subprocess.CompletedProcess:
    """Runs `new KIND` for a plant; the description is C.toml."""
    (folder / "plant.json").write_text(json.dumps(plant))
    options = ["--plant", "plant.json", "--bandwidth", repr(bandwidth), "--reference", repr(reference), "--out", "C.toml"]
    command = [PROGRAM, "new", kind, "--name", "C", *options, "--no-schema", "--force"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


def design(kind: str, run: subprocess.CompletedProcess, folder: Path) -> Design:
    """The controller of C.toml."""
    table = tomllib.loads((folder / "C.toml").read_text())
    start, stderr = table["start"], run.stderr
    blocks = {"pid": pid_blocks, "ladrc": ladrc_blocks}[kind](table["structure"], start)
    S = np.array(start["S"]) if kind == "pid" else np.linalg.inv(np.array(start["B_0"]))
    joined = control.append(*[control.ss(*block) for block in blocks])
    return Design(joined.A, joined.B, S @ joined.C, S @ joined.D, table, stderr)


def pid_blocks(_: dict, start: dict) -> list[tuple]:
    """K_p + K_i/s + K_d N s/(s + N) of each channel."""
    each = zip(start["K_p"], start["K_i"], start["K_d"], start["N"], strict=True)
    return [
        (np.diag([0.0, -N]), [[K_i], [N]], [[1.0, -K_d * N]], [[K_p + K_d * N]]) if K_d else ([[0.0]], [[K_i]], [[1.0]], [[K_p]])
        for K_p, K_i, K_d, N in each
    ]


def ladrc_blocks(structure: dict, start: dict) -> list[tuple]:
    """The extended observer with its control, from y to B_0 u of each channel."""
    n = structure["order"]
    blocks = []
    for omega_c, omega_o in zip(start["omega_c"], start["omega_o"], strict=True):
        gains = np.array([[comb(n + 1, i) * omega_o**i] for i in range(1, n + 2)])
        feedback = np.array([[comb(n, i) * omega_c ** (n - i) for i in range(n)] + [1.0]])
        A = np.eye(n + 1, k=1)
        A[:, [0]] -= gains
        A[n - 1] -= feedback[0]
        blocks.append((A, gains, feedback, [[0.0]]))
    return blocks


def poles(plant: Plant, design: Design) -> np.ndarray:
    """Of the closed loop, with the dead time by Padé's approximation of python-control."""
    A, B, C = plant.A, plant.B, plant.C
    if plant.delay:
        numerator, denominator = control.pade(plant.delay, 6)
        late = control.ss(control.tf(numerator, denominator))
        whole = control.series(control.append(*[late] * B.shape[1]), control.ss(A, B, C, np.zeros((len(C), B.shape[1]))))
        A, B, C = whole.A, whole.B, whole.C
    n = len(A)
    closed = np.block([[A - B @ design.D @ C, -B @ design.C], [design.B @ C, design.A]])
    assert closed.shape == (n + len(design.A),) * 2
    return np.linalg.eigvals(closed)


def modulus(plant: Plant, design: Design, points: int = 4000) -> float:
    """M_s on a grid of its own, about the poles of the loop and the plant, and about its highest points."""
    own = np.concatenate([np.linalg.eigvals(plant.A), poles(plant, design)])
    sizes = np.abs(own[np.abs(own) > 1e-6])
    near = [abs(p.imag) + k * abs(p.real) for p in own if p.imag for k in np.linspace(-2, 2, 21)]
    grid = np.sort([*np.geomspace(1e-2 * sizes.min(), 1e2 * sizes.max(), points), *[w for w in near if w > 0]])

    def at(omega: float) -> float:
        difference = np.eye(len(plant.C)) + plant.at(omega) @ design.at(omega)
        return 1 / np.linalg.svd(difference, compute_uv=False).min()

    found = np.array([at(omega) for omega in grid])
    about = [np.geomspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], 20) for k in np.argsort(found)[-20:]]
    return max(found.max(), *map(at, np.concatenate(about)))
