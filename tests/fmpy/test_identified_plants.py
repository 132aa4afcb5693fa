"""Plants with random parameters and noise: `identify` follows the part that is held out, or says why not; and what it says of its uncertainty
holds for the true plant, in the model and in the bounds of a controller for it."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import sample
from machine_loops import Machine, loop, program
from master import Fmu
from own_machines import LINEAR, MACHINES, Plant, recorded, sampled, written
from sample import NUMBER
from scipy.optimize import fsolve
from scipy.signal import place_poles
from scipy.stats import norm

Array = np.ndarray
ROWS = 1200
DRAWS = 6 if sample.ALL else 1
# Records of linear plants for what is said of uncertainty, 20 or 4 of each plant.
RECORDS = 20 if sample.ALL else 4
OUTPUTS = {"converter": "output_voltage", "exchanger": "hot,cold", "belt": "carriage", "vessel": "level,concentration"}


def drawn(name: str, seed: int, folder: Path) -> tuple[Plant, Array, Array, Array, float]:
    """A plant with a record in the folder: inputs, measured states, noise."""
    rng = np.random.default_rng([NUMBER, seed, len(name)])
    plant, decibels = MACHINES[name](rng), rng.uniform(20, 60)
    u, measured, noise = recorded(plant, rng, ROWS, decibels)
    written(folder, plant, u, measured)
    return plant, u, measured, noise, decibels


def held_out(model: dict, step: float, u: Array, measured: Array) -> Array:
    """Fit in % of each state over the last 30 %: A and B as they are, the initial state and a constant by least squares."""
    A, B = np.array(model["A"]), np.array(model["B"])
    n, first = len(A), round(0.7 * len(u))
    u, y = u[first:], measured[first:]
    F, G = sampled(A, np.column_stack([B, np.eye(n)]), step)
    G, of_d = G[:, : B.shape[1]], G[:, B.shape[1] :]
    x, from_start, from_d = np.zeros(n), np.eye(n), np.zeros((n, n))
    forced, slopes = np.empty_like(y), np.empty((*y.shape, 2 * n))
    for k in range(len(u)):
        forced[k], slopes[k] = x, np.hstack([from_start, from_d])
        x, from_start, from_d = F @ x + G @ u[k], F @ from_start, F @ from_d + of_d
    weights = 1 / np.array(model["noise"])
    free, *_ = np.linalg.lstsq((slopes * weights[:, None]).reshape(-1, 2 * n), ((y - forced) * weights).ravel(), rcond=None)
    error = y - forced - slopes @ free
    return 100 * (1 - np.linalg.norm(error, axis=0) / np.linalg.norm(y - y.mean(0), axis=0))


@pytest.mark.parametrize("draw", range(DRAWS))
@pytest.mark.parametrize("name", MACHINES)
def test_a_model_follows_what_was_held_out_or_the_reason_is_reported(name: str, draw: int, tmp_path: Path) -> None:
    plant, u, measured, noise, decibels = drawn(name, draw, tmp_path)
    done = program(tmp_path, "identify", "record.csv", *plant.signals)
    print(f"{name} {decibels:.0f} dB: {done.returncode}", *[line for line in done.stdout.splitlines() if line.startswith("not sound")])
    assert done.returncode in (0, 1, 3), done.stderr
    if done.returncode == 1:
        # Never for plants that a record can show.
        assert name not in LINEAR and done.stderr.startswith("error: "), (NUMBER, done.stderr)
        return
    if done.returncode == 3:
        reasons = [line for line in done.stdout.splitlines() if line.startswith("not sound: ")]
        assert reasons, (NUMBER, done.stdout)
        # Noise may hide an entry of those, and nothing else.
        assert name not in LINEAR or all("this record doesn't show it" in reason for reason in reasons), (NUMBER, reasons)
    model = json.loads((tmp_path / "model.json").read_text())
    reported = np.array(model["fit"]["held_out"])
    if not len(reported):
        # An estimate that isn't stable is simulated through short windows only.
        assert done.returncode == 3 and np.linalg.eigvals(np.array(model["A"])).real.max() > 0, NUMBER
        return
    for signal, fit in zip(model["states"], reported, strict=True):
        line = next(line for line in done.stdout.splitlines() if line.startswith(f"{signal} "))
        assert abs(float(line.split()[1]) - fit) < 0.06
    # As computed anew, and at least half of what noise leaves.
    rest = measured[round(0.7 * ROWS) :]
    ceiling = 100 * (1 - noise / rest.std(0))
    again = held_out(model, plant.step, u, measured)
    print("fit", reported.round(2), "again", again.round(2), "of", ceiling.round(2))
    assert np.abs(reported - again).max() < 0.2, (NUMBER, reported, again)
    if done.returncode == 0:
        assert (reported > 0.5 * ceiling).all(), (NUMBER, reported, ceiling)
    if name in LINEAR:
        assert (reported > ceiling - 0.15 * (100 - ceiling) - 0.2).all(), (NUMBER, reported, ceiling)


def test_a_satellite_keeps_its_momentum_and_the_record_shows_nothing_across_it(tmp_path: Path) -> None:
    """Rate and wheel speed move together, so their columns can't be told apart."""
    plant, *_ = drawn("satellite", 100, tmp_path)
    done = program(tmp_path, "identify", "record.csv", *plant.signals, "--json")
    findings = json.loads(done.stdout)["findings"]
    print([finding["text"] for finding in findings])
    assert done.returncode == 3, done.stdout
    unseen = [finding["text"] for finding in findings if "this record doesn't show" in finding["text"]]
    assert unseen or any("condition number" in finding["text"] for finding in findings), (NUMBER, findings)


def test_a_controller_without_anything_added_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER)
    plant = MACHINES["satellite"](rng)
    noise, rows = np.array([1e-3, 1e-4, 1e-1]), 600
    F, G = sampled(plant.A, plant.B, plant.step)
    x, u, measured = np.array([0.2, 0.0, 0.0]), np.empty((rows, 1)), np.empty((rows, 3))
    for k in range(rows):
        measured[k] = x + noise * rng.normal(size=3)
        u[k] = -plant.gain @ measured[k]
        x = F @ x + G @ u[k]
    written(tmp_path, plant, u, measured)
    done = program(tmp_path, "identify", "record.csv", *plant.signals)
    assert done.returncode == 1 and "torque = -" in done.stderr, done.stderr
    assert "a feedback without anything added" in done.stderr and not (tmp_path / "model.json").exists(), done.stderr


def within_bounds(plant: Plant, design: dict) -> float:
    """The largest share of the bounds of an L1 controller that the true plant takes."""
    structure, start = design["structure"], design["start"]
    A, B = np.array(structure["A"]), np.array(structure["B"])
    L = np.linalg.pinv(B)
    if "A_m" in start:
        K_m = L @ (A - np.array(start["A_m"]))
    elif "pole_real" in start:
        K_m = place_poles(A, B, np.array(start["pole_real"]) + 1j * np.array(start["pole_imag"])).gain_matrix
    else:
        K_m = np.zeros(B.shape[::-1])
    theta = np.abs(L @ (plant.A - A - (plant.B - B) @ K_m))
    theta_bound = np.array(start["theta_bound"]) / np.array(structure["state_scale"])
    omega, omega_max = np.abs(L @ (plant.B - B)), np.array(start["omega_max"])
    # Where only the diagonal is known, 0.05 beside it is what it leaves out.
    diagonal = omega_max.ndim == 1
    omega_bound = np.diag(omega_max - 1.05) + 0.05 if diagonal else omega_max - np.eye(len(omega_max))
    return max((theta / theta_bound).max(), (omega / omega_bound).max())


@pytest.fixture(scope="module")
def shares(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Array]:
    """For each record of a linear plant: the largest error of an entry in parts of its bound, and the largest share of a bound of L1."""
    entries, bounds = [], []
    for name in LINEAR:
        folder = tmp_path_factory.mktemp(name)
        for k in range(RECORDS):
            plant, *_ = drawn(name, 200 + k, folder)
            done = program(folder, "identify", "record.csv", *plant.signals, "--force")
            unseen = done.returncode == 3 and "this record doesn't show it" in done.stdout
            assert done.returncode == 0 or unseen, (NUMBER, name, k, done.stdout, done.stderr)
            model = json.loads((folder / "model.json").read_text())
            n, m = plant.B.shape
            z = norm.ppf(1 - 0.01 / (2 * (n * n + n * m + m)))
            true, errors = {"A": plant.A, "B": plant.B}, np.sqrt(np.diag(model["covariance"]))
            of_plant = [(entry, error) for entry, error in zip(model["free"], errors, strict=True) if entry[0] in true]
            assert len(of_plant) == n * (n + m)
            off = [abs(model[M][i - 1][j - 1] - true[M][i - 1, j - 1]) / error for (M, i, j), error in of_plant]
            entries.append(max(off) / z)
            words = ["--plant", "model.json", "--margin", "1", "--outputs", OUTPUTS[name], "--no-schema", "--force"]
            done = program(folder, "new", "l1", "--name", "C", *words)
            if unseen and "Give a smaller --margin" in done.stderr:
                continue
            assert done.returncode in (0, 3), (NUMBER, name, k, done.stderr)
            bounds.append(within_bounds(plant, tomllib.loads((folder / "C.toml").read_text())))
    return {"entries": np.array(entries), "bounds": np.array(bounds)}


@pytest.mark.parametrize("of", ["entries", "bounds"])
def test_the_true_plant_is_within_what_the_record_leaves_open(of: str, shares: dict[str, Array]) -> None:
    """At 99 % for all of them at once, in at least 95 % of the records; and always within the usual margin of 3."""
    found = shares[of]
    inside = np.mean(found <= 1)
    print(f"{of}: {inside:.1%} of {len(found)} records inside, largest share {found.max():.2f}, median {np.median(found):.2f}")
    # Of 12 records one may be outside: with 99 % each that is so in 99.4 of 100 runs.
    assert np.sum(found > 1) <= max(1, 0.05 * len(found)), (NUMBER, found)
    assert found.max() <= 3, (NUMBER, found)
    # Bounds that nothing ever comes near would say nothing.
    assert found.max() > 0.3, (NUMBER, found)


def equilibrium(plant: Plant, u: Array) -> Array:
    """State at rest with constant inputs."""
    if plant.rates is None:
        return np.linalg.solve(plant.A, -plant.B @ u)
    return fsolve(lambda x: plant.rates(x, u), plant.start)


@pytest.mark.parametrize("kind", ["l1", "pid"])
@pytest.mark.parametrize("name", OUTPUTS)
def test_a_controller_for_a_record_moves_the_plant_from_one_point_to_another(name: str, kind: str, tmp_path: Path) -> None:
    """From rest at the middle of what was recorded, by half of the way to its end, through sensors with noise."""
    plant, _, _, noise, _ = drawn(name, 300, tmp_path)
    done = program(tmp_path, "identify", "record.csv", *plant.signals)
    assert done.returncode == 0, done.stdout + done.stderr
    low, high = np.array(plant.low), np.array(plant.high)
    shares = np.array([0.25, 0.1])[: len(low)]
    points = [equilibrium(plant, (low + high) / 2 + part * shares * (high - low)) for part in (0, 1)]
    names = [state.split(" ")[0] for state in plant.states]
    outputs = tuple(OUTPUTS[name].split(","))
    places = [names.index(output) for output in outputs]
    change = np.abs(points[1] - points[0])[places]
    words = ["--outputs", OUTPUTS[name], "--reference", ",".join(map(str, change)), "--no-schema"]
    done = program(tmp_path, "new", kind, "--name", "C", "--plant", "model.json", "--margin", "1", *words)
    assert done.returncode == 0, (NUMBER, done.stderr)
    assert program(tmp_path, "check", "C.toml").returncode == 0, NUMBER
    assert program(tmp_path, "export", "C.toml", "--out", "fmus").returncode == 0
    design = tomllib.loads((tmp_path / "C.toml").read_text())
    step, pause = design["experiment"]["step"], 12 / design["nominal"]["bandwidth"]
    rates = plant.rates or (lambda x, u: plant.A @ x + plant.B @ np.atleast_1d(u))
    steps = [(k * pause, *point[places]) for k, point in enumerate(points)]
    given = (plant.inputs, plant.states, outputs, "", 0, rates, tuple(points[0]), tuple(noise), (-1e9, 1e9), ())
    machine = Machine(name, *given, tuple(steps), 2 * pause, 0.7 * pause, ())
    substeps = max(2, round(10 * step * np.abs(np.linalg.eigvals(np.array(design["nominal"]["A"]))).max()))
    motion = loop(Fmu(tmp_path / "fmus" / "C.fmu", tmp_path / "unpacked"), machine, step, NUMBER, substeps)
    for error, target in zip(motion.error(machine), steps, strict=True):
        print(name, kind, "steps", len(motion.time), "error", error, "of", change, "noise", noise[places], target)
        assert (error < 0.01 * change + 3 * noise[places]).all(), (NUMBER, error)
