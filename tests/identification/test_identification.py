"""Identification from records, against SciPy and at plants that are known.

    cargo build --release --package adaptive-fmu-identification --example identify
    python -m pytest tests/identification

The example is built by the tests unless IDENTIFY names it. With TEST_ALL=1 all cases are identified, else some of them. The figures that
must be met were found by other programs; medians may be worse by a fifth of what is missing to 100, counts by 3.
"""

import json
import os
import subprocess
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cases
import machines
import numpy as np
import pytest
from cases import Array, Case
from scipy.linalg import expm, expm_frechet
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parents[2]
ALL = os.environ.get("TEST_ALL") == "1"
Result = dict
# Findings that aren't about faults of a record.
OTHERS = {"kinematics", "coloured_residuals", "order", "unseen"}


@pytest.fixture(scope="session")
def program() -> Path:
    if "IDENTIFY" in os.environ:
        return Path(os.environ["IDENTIFY"])
    command = ["cargo", "build", "--release", "-q", "--package", "adaptive-fmu-identification", "--example", "identify"]
    subprocess.run(command, cwd=ROOT, check=True)
    return ROOT / "target" / "release" / "examples" / "identify"


@pytest.fixture(scope="session")
def ask(program: Path) -> Callable[[dict], Result]:
    def ask(request: dict) -> Result:
        answer = subprocess.run([program, json.dumps(request)], capture_output=True, text=True, check=False)
        assert answer.returncode == 0, answer.stderr
        return json.loads(answer.stdout)

    return ask


@pytest.fixture
def identified(ask: Callable[[dict], Result], tmp_path: Path) -> Callable[..., Result]:
    def identified(case: Case, measured: str = "states", **options: object) -> Result:
        letter = "x" if measured == "states" else "y"
        file = tmp_path / f"{id(case)}.csv"
        case.write(file, letter)
        names = [f"{letter}{i + 1}" for i in range(case.measured.shape[1])]
        inputs = [f"u{j + 1}" for j in range(case.inputs)]
        return ask({"files": [str(file)], "inputs": inputs, measured: names, "options": options})

    return identified


def true_entry(case: Case, matrix: str, row: int, column: int) -> float:
    return float({"A": case.A, "B": case.B, "d": case.d[:, None]}[matrix][row - 1, column - 1])


def outside(case: Case, result: Result) -> list[bool]:
    """True for each entry whose true value is outside of its 99 % interval."""
    return [abs(entry["value"] - true_entry(case, *entry["entry"])) > 2.576 * entry["error"] for entry in result["entries"]]


@pytest.mark.parametrize("seed", range(12))
def test_sampled_models_and_their_derivatives_are_those_of_scipy(ask: Callable[[dict], Result], seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m = 1 + seed % 6, 1 + seed % 2
    A, B = cases.random_plant(rng, n, m)
    step = 10 ** rng.uniform(-2, 1)
    found = ask({"A": A.tolist(), "B": B.tolist(), "step": step})

    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n], whole[:n, n:] = A * step, np.eye(n) * step
    value = expm(whole)
    F, phi = value[:n, :n], value[:n, n:]
    np.testing.assert_allclose(found["F"], F, atol=1e-12 * np.abs(F).max(), rtol=0)
    np.testing.assert_allclose(found["G"], phi @ B, atol=1e-12 * np.abs(phi @ B).max(), rtol=0)
    for k in range(n * n):
        direction = np.zeros((2 * n, 2 * n))
        direction[k // n, k % n] = step
        derivative = expm_frechet(whole, direction, compute_expm=False)
        for found_part, part in [(found["dF"][k], derivative[:n, :n]), (found["dG"][k], derivative[:n, n:] @ B)]:
            np.testing.assert_allclose(found_part, part, atol=1e-12 * max(1e-3, np.abs(part).max()), rtol=0)


class OutputError:
    """Output error of a whole record by other means: unknowns are A, B, d and the initial state, residuals those of SciPy's exponential."""

    def __init__(self, case: Case) -> None:
        self.case, self.n, self.m = case, case.order, case.inputs
        self.rows = len(case.u)

    def residuals(self, unknowns: Array) -> Array:
        n, m = self.n, self.m
        A, rest = unknowns[: n * n].reshape(n, n), unknowns[n * n :]
        B, d, start = rest[: n * m].reshape(n, m), rest[n * m : n * m + n], rest[n * m + n :]
        F, G = cases.sampled(A, np.column_stack([B, d]), self.case.step)
        u = np.column_stack([self.case.u, np.ones(self.rows)])
        return self.case.measured - cases.simulated(F, G, u, start)

    def weighted(self, unknowns: Array, weights: Array) -> Array:
        return (self.residuals(unknowns) * weights).ravel()

    def solved(self) -> tuple[Array, Array]:
        """Unknowns and rms of the residuals, from the true plant on, until the weights agree with the residuals."""
        case = self.case
        start = np.concatenate([case.A.ravel(), case.B.ravel(), case.d, case.clean[0]])
        rms = np.sqrt((self.residuals(start) ** 2).mean(0))
        for _ in range(30):
            scale, exact = np.maximum(np.abs(start), 1e-3), dict.fromkeys(["xtol", "ftol", "gtol"], 1e-15)
            found = least_squares(self.weighted, start, "3-point", x_scale=scale, args=(1 / rms,), **exact)
            start, before = found.x, rms
            rms = np.sqrt((self.residuals(start) ** 2).mean(0))
            if np.abs(rms / before - 1).max() < 1e-13:
                break
        return start, rms

    def covariance(self, unknowns: Array, rms: Array) -> Array:
        """With the residuals' correlation, and standard errors not below those of 24 blocks of rows."""
        n, weights = self.n, 1 / rms
        step = np.maximum(np.abs(unknowns), 1e-2) * 1e-5
        moved = [(self.residuals(unknowns + e) - self.residuals(unknowns - e)) * weights for e in np.diag(step)]
        jacobian = np.stack([m.ravel() / (2 * h) for m, h in zip(moved, step, strict=True)], 1)
        residuals = self.residuals(unknowns) * weights
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        noise = residuals.T @ residuals / (self.rows - len(unknowns) / n)
        by_row = jacobian.reshape(self.rows, n, -1)
        middle = np.einsum("kip,ij,kjq->pq", by_row, noise, by_row)
        plain = inverse @ middle @ inverse
        block = np.arange(self.rows) * 24 // self.rows
        sums = np.stack([np.einsum("kip,ki->p", by_row[block == b], residuals[block == b]) for b in range(24)], 1)
        robust = inverse @ (sums @ sums.T) @ inverse * 24 / 23
        kappa = np.sqrt(np.maximum(1, np.diag(robust) / np.diag(plain)))
        return (plain * kappa * kappa[:, None])[: -self.n, : -self.n]


@pytest.mark.parametrize("number", [25, 26, 37])
def test_objective_estimate_and_covariance_are_those_of_scipy_from_the_true_plant(identified: Callable[..., Result], number: int) -> None:
    case = cases.linear(number)
    rows = slice(0, 300)
    case = replace(case, u=case.u[rows], measured=case.measured[rows], clean=case.clean[rows])
    result = identified(case, hold_out=0)
    assert result["model"]["method"] == "output error"
    problem = OutputError(case)
    unknowns, rms = problem.solved()
    loss = len(case.u) * np.log((rms / case.measured.std(0)) ** 2).sum()
    assert result["losses"][0] == pytest.approx(loss, abs=1e-9 * abs(loss))
    covariance = problem.covariance(unknowns, rms)
    error = np.sqrt(np.diag(covariance))
    values = [entry["value"] for entry in result["entries"]]
    assert (np.abs(values - unknowns[: len(values)]) < 3e-4 * error).all()
    correlation = np.array(result["model"]["covariance"]) / np.outer(error, error)
    np.testing.assert_allclose(correlation, covariance / np.outer(error, error), atol=1e-4, rtol=0)


def test_standard_errors_grow_where_the_objective_is_flatter_than_its_quadratic_form(identified: Callable[..., Result]) -> None:
    """Two poles that are almost the same, from one input: along the least certain direction the objective grows by half of 2.5² at least."""
    case = cases.linear(31)
    result = identified(case, hold_out=0)
    problem = OutputError(case)
    x, u, h, n = case.measured.std(0), case.u.std(0), case.step, case.order
    units = np.concatenate([np.outer(x, 1 / x).ravel(), np.outer(x, 1 / u).ravel(), x]) / h
    variance, directions = np.linalg.eigh(np.array(result["model"]["covariance"]) / np.outer(units, units))
    weights = 1 / np.array(result["model"]["noise"])

    def objective(entries: Array) -> float:
        """At the best initial state, in which residuals are linear."""
        rest = problem.residuals(np.concatenate([entries, np.zeros(n)]))
        slopes = [(problem.residuals(np.concatenate([entries, e])) - rest) * weights for e in np.eye(n)]
        start = np.linalg.lstsq(np.stack(slopes, -1).reshape(-1, n), -(rest * weights).ravel(), rcond=None)[0]
        residuals = problem.residuals(np.concatenate([entries, start]))
        return float(len(case.u) * np.log((residuals**2).mean(0)).sum())

    values = np.array([entry["value"] for entry in result["entries"]])
    moved = 2.5 * np.sqrt(variance[-1]) * directions[:, -1] * units
    growth = [objective(values + sign * moved) - objective(values) for sign in (1, -1)]
    assert 3.1 < min(growth) < 3.4


def chosen(count: int, some: int) -> list[int]:
    """All cases, or some of them: each so manieth."""
    return list(range(count)) if ALL else list(range(0, count, count // some))[:some]


def in_parallel(identified: Callable[..., Result], of: Iterable[Case], **options: object) -> Iterator[tuple[Case, Result]]:
    """Cases with their results, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        listed = list(of)
        yield from zip(listed, pool.map(lambda case: identified(case, **options), listed), strict=True)


def test_plants_with_noise_alone(identified: Callable[..., Result]) -> None:
    numbers = list(range(48)) if ALL else list(range(0, 48, 2))
    fits, by_output_error, entries = [], 0, []
    for case, result in in_parallel(identified, map(cases.linear, numbers), hold_out=0):
        by_output_error += result["model"]["method"] == "output error"
        entries += outside(case, result)
        fits.append(cases.fit(case, np.array(result["model"]["A"]), np.array(result["model"]["B"])))
    print(f"median {np.median(fits):.2f}, worst {min(fits):.1f}, outside {np.mean(entries):.2%}, output error {by_output_error}")
    assert by_output_error >= len(numbers) - 2
    assert np.median(fits) > 99.5 and min(fits) > 93
    assert np.mean(entries) < 0.03


def test_plants_with_a_disturbance(identified: Callable[..., Result]) -> None:
    numbers = chosen(42, 21)
    fits, by_innovation, entries = [], 0, []
    for case, result in in_parallel(identified, (cases.linear(number, 0.3) for number in numbers), hold_out=0):
        by_innovation += result["model"]["method"] == "innovation form"
        entries += outside(case, result)
        fits.append(cases.fit(case, np.array(result["model"]["A"]), np.array(result["model"]["B"])))
    print(f"median {np.median(fits):.2f}, worst {min(fits):.1f}, outside {np.mean(entries):.2%}, innovation form {by_innovation}")
    assert by_innovation >= 0.76 * len(numbers)
    assert np.median(fits) > 96.9 and min(fits) > 80
    assert np.mean(entries) < 0.04


def test_unstable_plants_in_closed_loops(identified: Callable[..., Result]) -> None:
    """An unstable pole that is far off is said not to be sure; no other is."""
    errors = []
    for case, result in in_parallel(identified, map(cases.closed_loop, chosen(20, 10)), hold_out=0):
        true = np.linalg.eigvals(case.A).real.max()
        if "refusal" in result:
            errors.append(1.0)
            continue
        errors.append(abs(np.linalg.eigvals(np.array(result["model"]["A"])).real.max() / true - 1))
        flagged = any(finding["kind"] == "unstable_pole" for finding in result["findings"])
        assert flagged == (errors[-1] > 0.05), errors[-1]
    print(f"median error of the pole {np.median(errors):.2%}, within 2 %: {np.sum(np.array(errors) < 0.02)} of {len(errors)}")
    assert np.median(errors) < 0.004
    assert np.sum(np.array(errors) < 0.02) >= 0.7 * len(errors)


def test_plants_with_known_kinematics(identified: Callable[..., Result]) -> None:
    entries = []
    for number in range(36):
        case = cases.mechanical(number)
        rows = [f"x{2 * k + 1}' = x{2 * k + 2}" for k in range(case.inputs)]
        result = identified(case, hold_out=0, structure={"rows": rows})
        A, B = np.array(result["model"]["A"]), np.array(result["model"]["B"])
        assert (A[0] == np.eye(case.order)[1]).all() and (B[0] == 0).all()
        entries += outside(case, result)
        assert cases.fit(case, A, B) > 97
        assert {finding["kind"] for finding in result["findings"]} <= OTHERS | {"short_record"}
    print(f"outside {np.mean(entries):.2%}")
    assert np.mean(entries) < 0.05


@pytest.mark.parametrize("number", range(24) if ALL else range(1, 24, 4))
def test_outputs_alone(identified: Callable[..., Result], number: int) -> None:
    """The held-out part is followed up to its noise, by an order that isn't above the true one."""
    case = cases.outputs(number)
    result = identified(case, "outputs")
    held_out, clean = case.measured[840:], case.clean[840:]
    ceiling = np.mean(100 * (1 - np.linalg.norm(held_out - clean, axis=0) / np.linalg.norm(held_out - held_out.mean(0), axis=0)))
    assert np.mean(result["model"]["fit"]["held_out"]) > ceiling - 0.1
    A, B, C = (np.array(result["model"][name]) for name in "ABC")
    assert len(A) <= case.order
    # The response to another input, without noise: the gain in coordinates of the states is free.
    found = cases.simulated(*cases.sampled(A, B, case.step), case.u, np.zeros(len(A))) @ C.T
    true = cases.simulated(*cases.sampled(case.A, case.B, case.step), case.u, np.zeros(case.order))
    seen = np.linalg.lstsq(np.column_stack([true, np.ones(len(true))]), case.clean, rcond=None)[0]
    true = true @ seen[:-1]
    error = np.linalg.norm((found - true)[100:] - (found - true)[100:].mean(0), axis=0) / np.linalg.norm(true - true.mean(0), axis=0)
    assert (error < 3 * (1 - ceiling / 100) / np.sqrt(len(true) / 100) + 0.1).all()


def machine(name: str, ask: Callable[[dict], Result], folder: Path, **options: object) -> Result:
    step, u, measured = getattr(machines, name)()
    cases.write(folder / "record.csv", step, u, measured)
    states = [f"x{i + 1}" for i in range(measured.shape[1])]
    inputs = [f"u{j + 1}" for j in range(u.shape[1])]
    result = ask({"files": [str(folder / "record.csv")], "inputs": inputs, "states": states, "options": options})
    assert {finding["kind"] for finding in result["findings"]} <= OTHERS - {"unseen"}, result["findings"]
    return result


def test_the_motor_with_friction(ask: Callable[[dict], Result], tmp_path: Path) -> None:
    structure = {
        "A": [["?", "?", 0, 0], ["?", "?", "?", "?"], "x3' = x2 - x4", [0, "?", "?", "?"]],
        "B": [["?"], [0], [0], [0]],
    }
    result = machine("motor", ask, tmp_path, structure=structure)
    assert len(result["entries"]) == 13
    assert (np.array(result["model"]["fit"]["held_out"]) > [97, 95, 95, 95]).all()
    # Friction adds damping to the slow pole.
    found = sorted((pole["real"], pole["imaginary"]) for pole in result["poles"])
    np.testing.assert_allclose(found[0], [-278, 0], atol=3)
    np.testing.assert_allclose(found[1:3], [[-13.9, -126.2], [-13.9, 126.2]], atol=0.6)
    np.testing.assert_allclose(found[3], [-6, 0], atol=0.1)
    without = machine("motor", ask, tmp_path)
    proposals = [finding["text"] for finding in without["findings"] if finding["kind"] == "kinematics"]
    assert len(proposals) == 1 and proposals[0].startswith("row 3 is x3' = x2 - x4 within 0.0")


def test_the_tanks(ask: Callable[[dict], Result], tmp_path: Path) -> None:
    result = machine("tanks", ask, tmp_path)
    assert len(result["entries"]) == 10 and result["model"]["method"] == "innovation form"
    assert (np.array(result["model"]["fit"]["held_out"]) > [93, 92]).all()
    assert 2 < max(result["model"]["kappa"]) < 4


def test_the_cart_with_a_pole(ask: Callable[[dict], Result], tmp_path: Path) -> None:
    structure = {"A": ["x1' = x2", [0, "?", "?", "?"], "x3' = x4", [0, "?", "?", "?"]]}
    result = machine("cart", ask, tmp_path, structure=structure)
    assert len(result["entries"]) == 10
    assert (np.array(result["model"]["fit"]["windows"]) > [98, 95, 95, 93]).all()
    true = np.sort(np.linalg.eigvals(machines.linearised(machines.cart_rates, np.zeros(4))).real)
    found = np.sort([pole["real"] for pole in result["poles"]])
    np.testing.assert_allclose(found, true, atol=0.06)
