"""Controllers for plants that were identified: bounds and the region of `check` follow from what the records leave uncertain."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from recorded import SIGNALS, motor, program, record, written
from sample import NUMBER
from scipy.stats import chi2, norm

REFERENCE = 50.0
FOR_SPEED = ["--outputs", "speed", "--reference", str(REFERENCE), "--no-schema", "--force"]


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A folder with a record and the model of a random motor."""
    folder = tmp_path_factory.mktemp("records")
    rng = np.random.default_rng(NUMBER + 20)
    written(folder, record(rng, *motor(rng), noise=0.02, rows=600))
    ran = program(folder, "identify", "record.csv", *SIGNALS)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return folder, json.loads((folder / "model.json").read_text())


def of_plant(model: dict) -> tuple[list, np.ndarray]:
    """The entries of A and B, and their covariance."""
    used = [k for k, (matrix, *_) in enumerate(model["free"]) if matrix in "AB"]
    return [model["free"][k] for k in used], np.array(model["covariance"])[np.ix_(used, used)]


def begun(folder: Path, kind: str, *options: str) -> dict:
    ran = program(folder, "new", kind, "--name", "C", "--plant", "model.json", *FOR_SPEED, *options)
    assert ran.returncode in (0, 3), ran.stderr
    return tomllib.loads((folder / "C.toml").read_text())


def checked(folder: Path, *options: str) -> dict:
    return json.loads(program(folder, "check", "C.toml", "--json", *options).stdout)


def test_a_description_keeps_the_covariance_of_its_plant(identified: tuple[Path, dict]) -> None:
    folder, model = identified
    nominal = begun(folder, "pid", "--margin", "1.5", "--level", "0.95")["nominal"]
    free, covariance = of_plant(model)
    rows = [row + [0.0] * (len(free) - len(row)) for row in nominal["covariance"]]
    joined = np.tril(rows) + np.tril(rows, -1).T
    assert nominal["free"] == free and np.allclose(joined, covariance, rtol=1e-12)
    assert (nominal["margin"], nominal["level"], nominal["model"]) == (1.5, 0.95, "model.json")
    assert "uncertainty" not in nominal
    # Without the options: the level of the model, and a margin.
    nominal = begun(folder, "pid")["nominal"]
    assert (nominal["margin"], nominal["level"]) == (3.0, model["level"])
    # A part of each number in their place.
    nominal = begun(folder, "pid", "--uncertainty", "10%")["nominal"]
    assert nominal["uncertainty"] == 0.1 and "covariance" not in nominal


def test_bounds_of_an_l1_controller_are_those_of_the_covariance(identified: tuple[Path, dict]) -> None:
    folder, model = identified
    margin, level = 2.0, 0.95
    design = begun(folder, "l1", f"--margin={margin}", f"--level={level}")
    free, covariance = of_plant(model)
    A, B = np.array(model["A"]), np.array(model["B"])
    n, m = B.shape
    # Gain that puts the poles of A where the description says (Ackermann's formula).
    start = design["start"]
    poles = np.array(start["pole_real"]) + 1j * np.array(start["pole_imag"])
    a_1, a_0 = np.poly(poles).real[1:]
    K_m = np.array([[0, 1]]) @ np.linalg.inv(np.hstack([B, A @ B])) @ (A @ A + a_1 * A + a_0 * np.eye(2))
    L = np.linalg.pinv(B)
    z = norm.ppf(1 - (1 - level) / (2 * (n * n + n * m + m)))

    def bound(weight) -> float:
        weights = np.array([weight(matrix, i - 1, j - 1) for matrix, i, j in free])
        return z * margin * np.sqrt(weights @ covariance @ weights)

    for j in range(n):
        # L (ΔA − ΔB K_m)
        theta = bound(lambda matrix, r, c, j=j: (L[0, r] if c == j else 0) if matrix == "A" else -L[0, r] * K_m[0, j])
        written_there = start["theta_bound"][0][j] / design["structure"]["state_scale"][j]
        assert theta <= written_there * (1 + 1e-9) and written_there <= 1.011 * theta, (NUMBER, j, theta, written_there)
    omega = bound(lambda matrix, r, c: L[0, r] if matrix == "B" else 0)
    assert start["omega_max"][0] - 1 == pytest.approx(omega, rel=1e-6)
    # The constant of the record, with its error, and what the plant did beyond the model.
    constant = abs(L @ np.array(model["offset"][0]))[0]
    of_d = [k for k, (matrix, *_) in enumerate(model["free"]) if matrix == "d"]
    error = np.sqrt((L @ np.array(model["covariance"])[np.ix_(of_d, of_d)] @ L.T)[0, 0])
    assert start["sigma_bound"][0] >= 1.2 * max(constant + z * error, model["disturbance"][0])


def pid_loop(A: np.ndarray, B: np.ndarray, start: dict) -> np.ndarray:
    """The loop of a PID controller of one channel: states of the plant, of the integral and of the derivative's filter."""
    C = np.array([[1.0, 0.0]])
    K_p, K_i, K_d, N, S = (np.ravel(start[name])[0] for name in ("K_p", "K_i", "K_d", "N", "S"))
    # u = S (−K_p y + I + K_d N (w − y)), I' = −K_i y, w' = N (y − w)
    of_x = -S * (K_p + K_d * N) * C
    return np.block(
        [
            [A + B @ of_x, S * B, S * K_d * N * B],
            [-K_i * C, np.zeros((1, 2))],
            [N * C, np.array([[0.0, -N]])],
        ]
    )


def test_check_tries_plants_of_the_region_and_reports_how_much_of_it_is_stable(identified: tuple[Path, dict]) -> None:
    folder, model = identified
    free, covariance = of_plant(model)
    nominal = {name: np.array(model[name]) for name in "AB"}
    radius = chi2.ppf(model["level"], len(free))

    def distance(plant: dict) -> float:
        change = np.array([plant[matrix][i - 1][j - 1] - nominal[matrix][i - 1, j - 1] for matrix, i, j in free])
        return change @ np.linalg.solve(covariance, change)

    def at(point: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """A plant of the region `size` times as large: `point` has length 1 on the surface."""
        plant = {name: matrix.copy() for name, matrix in nominal.items()}
        for (matrix, i, j), change in zip(free, size * np.sqrt(radius) * np.linalg.cholesky(covariance) @ point, strict=True):
            plant[matrix][i - 1, j - 1] += change
        return plant["A"], plant["B"]

    start = begun(folder, "pid")["start"]
    report = checked(folder)
    assert report["sound"] and report["worst"], report["text"]
    distances = [distance(plant) for plant in report["worst"]]
    assert max(distances) == pytest.approx(9 * radius, rel=1e-6) and "At most 4.5 % of the plants" in report["text"]
    for plant in report["worst"]:
        assert np.linalg.eigvals(pid_loop(np.array(plant["A"]), np.array(plant["B"]), start)).real.max() < 0
    # So large that some are unstable: within what is called stable none of others is.
    begun(folder, "pid", "--margin", "1000")
    report = checked(folder)
    [stable] = [finding for finding in report["findings"] if finding["name"] == "stable up to"]
    assert stable["verdict"] != "ok" and not report["sound"], report["text"]
    share = float(str(stable["value"]).split()[0])
    rng = np.random.default_rng(NUMBER + 21)
    for _ in range(400):
        point = rng.standard_normal(len(free))
        A, B = at(point / np.linalg.norm(point), 0.8 * share)
        assert np.linalg.eigvals(pid_loop(A, B, start)).real.max() < 0, (NUMBER, share)


def test_records_give_model_and_controller_in_one_command(identified: tuple[Path, dict]) -> None:
    folder, _ = identified
    ran = program(folder, "new", "l1", "--name", "OneStep", "--data", "record.csv", *SIGNALS, *FOR_SPEED)
    assert ran.returncode == 0, ran.stderr
    assert (folder / "OneStep.json").read_bytes() == (folder / "model.json").read_bytes()
    two = begun(folder, "l1")
    one = tomllib.loads((folder / "OneStep.toml").read_text())
    one["name"], one["nominal"]["model"] = two["name"], two["nominal"]["model"]
    assert one == two


def test_a_finding_of_the_record_ends_with_code_3_and_both_files(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 22)
    A, B = motor(rng)
    table = record(rng, A, B)
    # Another plant in the part that is held out.
    other = record(rng, *motor(np.random.default_rng(NUMBER + 23)))
    table[1050:, 1:] = other[1050:, 1:]
    table[1050:, 2] *= -1
    written(tmp_path, table)
    ran = program(tmp_path, "new", "pid", "--name", "C", "--data", "record.csv", *SIGNALS, *FOR_SPEED)
    assert ran.returncode == 3 and "not sound" in ran.stdout, ran.stdout + ran.stderr
    assert (tmp_path / "C.toml").exists() and (tmp_path / "C.json").exists()


def test_states_that_nobody_measured_are_reported(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 24)
    written(tmp_path, record(rng, *motor(rng), noise=0.002))
    ran = program(tmp_path, "identify", "record.csv", "--inputs", "voltage", "--outputs", "speed")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    model = json.loads((tmp_path / "model.json").read_text())
    assert model["units"] == {"y": ["rad/s"], "u": [""]} and len(model["states"]) == 2
    ran = program(tmp_path, "new", "l1", "--name", "C", "--plant", "model.json", "--reference", "50", "--no-schema")
    assert ran.returncode == 0 and "no sensor has" in ran.stderr, ran.stderr
    ran = program(tmp_path, "new", "pid", "--name", "D", "--plant", "model.json", "--reference", "50", "--no-schema")
    assert ran.returncode == 0 and "no sensor has" not in ran.stderr, ran.stderr


def test_options_without_a_use_are_refused(identified: tuple[Path, dict]) -> None:
    folder, model = identified
    (folder / "plain.json").write_text(json.dumps({key: model[key] for key in "ABC"}))
    broken = {**model, "covariance": model["covariance"][:-1]}
    (folder / "broken.json").write_text(json.dumps(broken))
    for kind, plant, options, reason in [
        ("reference", "model.json", ["--margin", "2"], "--margin = 2: reference doesn't use it; the kinds that do are"),
        ("pid", "plain.json", ["--margin", "2"], "--margin = 2: needs a plant with the covariance"),
        ("pid", "plain.json", ["--level", "0.9"], "--level = 0.9: needs a plant with the covariance"),
        ("pid", "model.json", ["--margin", "0"], "must be a finite number above 0"),
        ("pid", "model.json", ["--level", "99"], "must be above 0 and below 1"),
        ("pid", "model.json", ["--margin", "2", "--uncertainty", "0.1"], "cannot be used with"),
        ("pid", "broken.json", [], "broken.json: covariance"),
    ]:
        ran = program(folder, "new", kind, "--name", "No", "--plant", plant, *options, "--no-schema")
        assert ran.returncode != 0 and reason in ran.stderr, (options, ran.stderr)
        assert not (folder / "No.toml").exists()
    for options, reason in [
        (["--data", "record.csv", "--inputs", "voltage"], "--data needs --states NAME,…"),
        (["--data", "record.csv", "--inputs", "voltage", "--states", "sped,current"], "did you mean `speed`?"),
        (["--data", "record.csv", "--inputs", "1", "--states", "speed"], "--inputs = 1: must be names of columns"),
    ]:
        ran = program(folder, "new", "l1", "--name", "No", *options, "--no-schema")
        assert ran.returncode != 0 and reason in ran.stderr, (options, ran.stderr)
        assert not list(folder.glob("No.*"))


@pytest.mark.parametrize(("inputs", "key"), [(["u"], "u = 0"), (["flow", "u"], "flow = ")])
def test_an_input_may_be_called_as_the_vector_of_inputs(inputs: list[str], key: str, tmp_path: Path) -> None:
    """Magnitudes of the controls stand for each signal by its name then."""
    n = len(inputs)
    rng = np.random.default_rng(NUMBER + 25)
    A, B = -np.diag(rng.uniform(0.5, 2, n)), np.diag(rng.uniform(1, 2, n)) * 1e4
    plant = {"A": A.tolist(), "B": B.tolist(), "C": np.eye(n).tolist(), "inputs": inputs, "states": [f"s{k}" for k in range(n)]}
    (tmp_path / "plant.json").write_text(json.dumps(plant))
    for kind in ("l1", "pid", "mrac", "ladrc", "l1-limit"):
        ran = program(tmp_path, "new", kind, "--name", "C", "--plant", "plant.json", "--no-schema", "--force")
        assert ran.returncode == 0, (kind, ran.stderr)
        assert key in (tmp_path / "C.toml").read_text().split("[magnitudes]")[1].split("[nominal]")[0], kind
        assert program(tmp_path, "check", "C.toml").returncode in (0, 3), kind
