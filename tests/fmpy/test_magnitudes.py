"""Plants whose units make signals very small or large: what is computed doesn't depend on units."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM, ROOT
from scipy.linalg import expm


def run(*arguments: str, folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=120)


def written(matrix: np.ndarray) -> str:
    return str(matrix.tolist())


def plant(rng: np.random.Generator, of_x: np.ndarray, of_u: float, of_t: float) -> tuple[np.ndarray, ...]:
    """A random stable plant of three lags in a row, in units in which states, input and time are so large."""
    A = np.diag(-rng.uniform(0.5, 3.0, 3)) + np.diag(rng.uniform(0.5, 2.0, 2), 1)
    B, C = np.array([[0.0], [0.0], [rng.uniform(0.5, 2.0)]]), np.array([[1.0, 0.0, 0.0]])
    S = np.diag(of_x)
    return S @ A @ np.linalg.inv(S) / of_t, S @ B / of_u / of_t, C @ np.linalg.inv(S)


@pytest.mark.parametrize("seed", range(6))
def test_a_plant_in_any_units_moves_as_its_exponential(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    of_x, of_u, of_t = 10.0 ** rng.uniform(-9, 6, 3), 10.0 ** rng.uniform(-12, 6), 10.0 ** rng.uniform(-4, 4)
    A, B, C = plant(rng, of_x, of_u, of_t)
    (tmp_path / "plant.json").write_text(f'{{"A": {written(A)}, "B": {written(B)}, "C": {written(C)}}}')
    made = run("new", "state-space", "--name", "P", "--plant", "plant.json", folder=tmp_path)
    assert made.returncode == 0, made.stderr
    # A constant input to which the output answers by about 1.
    u = float(1.0 / (-C @ np.linalg.inv(A) @ B)[0, 0])
    until = 3.0 * of_t
    ran = run(
        "simulate", "P.toml", "--set", f"u[1]={u!r}", "--until", repr(until), "--step", repr(until / 10), "--out", "results", "--quiet",
        folder=tmp_path,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    found = np.genfromtxt(next((tmp_path / "results").rglob("result.csv")), delimiter=",", names=True, deletechars="")
    states = np.array([found[f"x[{i}]"] for i in (1, 2, 3)]).T
    at_rest = np.abs(np.linalg.solve(A, B * u))[:, 0]
    for time, state in zip(found["time"], states, strict=True):
        x = np.linalg.solve(A, (expm(A * time) - np.eye(3)) @ B * u)[:, 0]
        assert np.all(np.abs(state - x) <= 1e-4 * at_rest), (time, state, x)


def test_a_loop_in_units_of_a_physiologist_is_that_in_other_units(tmp_path: Path) -> None:
    # Bergman's model with infusions of 1e-11 mol/s: its L1 loop, and the same in units in which all signals are about 1.
    glucose = json.loads((ROOT / "examples" / "zoo" / "glucose.json").read_text())
    A, B = np.array(glucose["A"]), np.array(glucose["B"])
    S, of_u = np.diag([1.0, 6e-5, 5e-8]), 1e-12
    scaled = {"A": np.linalg.solve(S, A @ S), "B": np.linalg.solve(S, B * of_u), "C": np.array(glucose["C"]) @ S}
    courses = {}
    for name, plant in [("own", {"A": A, "B": B, "C": np.array(glucose["C"])}), ("scaled", scaled)]:
        folder = tmp_path / name
        folder.mkdir()
        (folder / "plant.json").write_text(json.dumps({key: value.tolist() for key, value in plant.items()}))
        for kind, unit in [("state-space", "P"), ("l1", "C"), ("reference", "R")]:
            speed = [] if kind == "reference" else ["--bandwidth", "3e-4"]
            made = run("new", kind, "--name", unit, "--plant", "plant.json", "--out", f"{unit}.toml", *speed, folder=folder)
            assert made.returncode == 0, made.stderr
        made = run("new", "loop", "--units", "P.toml", "C.toml", "R.toml", "--until", "30000", "--out", ".", folder=folder)
        assert made.returncode == 0, made.stderr
        ran = run("run", ".", "--out", "results", "-q", "--every", "50", folder=folder)
        assert ran.returncode == 0, ran.stderr
        table = np.genfromtxt(next((folder / "results").rglob("result.csv")), delimiter=",", names=True, deletechars="")
        courses[name] = table["plant.y[1]"], table["controller.u[1]"]
    (y, u), (of_y, of_v) = courses["own"], courses["scaled"]
    assert y[-1] == pytest.approx(1.0, abs=0.01)
    assert y == pytest.approx(of_y, abs=2e-3)
    assert u / of_u == pytest.approx(of_v, abs=5e-3 * np.abs(of_v).max())
