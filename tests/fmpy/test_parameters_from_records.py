"""`identify --fmu`: parameters of plants as FMUs, from records, against other simulations and SciPy's least squares."""

import json
from pathlib import Path

import numpy as np
import pytest
from independent_plants import Robot, solved
from recorded import program
from sample import NUMBER
from scipy.optimize import least_squares

ROBOT = ["--fmu", "TwoLinkRobot", "--inputs", "u[1],u[2]", "--outputs", "x[1],x[2]", "--set", "x0[1]=-1.5"]


def robot_record(folder: Path, rng: np.random.Generator, robot: Robot, *, rows: int = 250, step: float = 0.04) -> None:
    """Angles with noise of a robot that hangs, under torques that are constant from row to row, and too small to turn it over."""
    levels = np.repeat(rng.uniform(-3, 3, (rows, 2)), rng.integers(2, 20, rows), axis=0)[:rows]
    times = step * np.arange(rows)
    x = np.zeros((rows, 4))
    x[0, 0] = -1.5
    for k in range(rows - 1):
        x[k + 1] = solved(lambda t, x, k=k: robot.rate(t, x, levels[k]), x[k], times[k : k + 2], max_step=step, rtol=1e-9)[-1]
    measured = x[:, :2] + 0.003 * rng.standard_normal((rows, 2))
    table = np.column_stack([times, levels, measured])
    np.savetxt(folder / "record.csv", table, delimiter=",", header='time,"u[1]","u[2]","x[1] [rad]","x[2] [rad]"', comments="", fmt="%.12g")


def test_masses_and_friction_of_a_robot_are_found_with_their_errors(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 40)
    robot = Robot(mass=(3.2, 2.0 * rng.uniform(0.6, 1.5)), friction=(rng.uniform(0.5, 2), rng.uniform(0.5, 2)))
    robot_record(tmp_path, rng, robot)
    ran = program(tmp_path, "identify", "record.csv", *ROBOT, "--free", "m2=0.1:10,k1,k2=0.01:20", "--offset", "none", "--json")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    output = json.loads(ran.stdout)
    true = {"m2": robot.mass[1], "k1": robot.friction[0], "k2": robot.friction[1]}
    assert [of["name"] for of in output["parameters"]] == list(true)
    for of in output["parameters"]:
        assert abs(of["value"] - true[of["name"]]) < 5 * of["error"], (NUMBER, of, true)
        assert of["error"] < 0.05 * true[of["name"]], (NUMBER, of)
    # The fit is that of the last 30 %, of which noise is a part.
    noise, measured = 0.003, np.loadtxt(tmp_path / "record.csv", delimiter=",", skiprows=1)[-75:, 3:]
    assert output["parameters"][0]["unit"] == "kg"
    assert np.all(np.array(output["fit"]) > 100 * (1 - 1.2 * noise / measured.std(axis=0))), output["fit"]
    assert output["noise"] == pytest.approx([0.003, 0.003], rel=0.2)
    # The linear model about the start depends on three parameters: its covariance has that rank.
    model = json.loads((tmp_path / "model.json").read_text())
    covariance = np.array(model["covariance"])
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert np.linalg.matrix_rank(correlation, tol=1e-4) <= 3
    at = np.array([-1.5, 0, 0, 0])
    of_state = [(robot.rate(0, at + e, np.zeros(2)) - robot.rate(0, at - e, np.zeros(2))) / 2e-5 for e in 1e-5 * np.eye(4)]
    for (matrix, i, j), variance in zip(model["free"], np.diag(covariance), strict=True):
        if matrix == "A":
            assert abs(model["A"][i - 1][j - 1] - of_state[j - 1][i - 1]) < 5 * np.sqrt(variance) + 1e-6, (NUMBER, i, j)
    # The values are a parameter set for runs.
    assert "m2" in (tmp_path / "model.ssv").read_text()


def test_estimates_and_errors_are_those_of_least_squares(tmp_path: Path) -> None:
    """Two records with initial states of their own, and a sensor with a constant error."""
    rng = np.random.default_rng(NUMBER + 41)
    a, b, step, rows = -rng.uniform(0.5, 3), rng.uniform(1, 4), 0.05, 200
    plant = {"A": [[-1]], "B": [[1]], "C": [[1]], "states": ["x"], "inputs": ["u"], "outputs": ["y"]}
    (tmp_path / "plant.json").write_text(json.dumps(plant))
    made = program(tmp_path, "new", "state-space", "--name", "P", "--plant", "plant.json", "--no-schema")
    assert made.returncode == 0, made.stderr
    inputs = [np.repeat(rng.uniform(-1, 1, rows), rng.integers(1, 20, rows))[:rows] for _ in range(2)]

    def course(a: float, b: float, start: float, u: np.ndarray) -> np.ndarray:
        y = np.empty(rows)
        y[0] = start
        for k in range(rows - 1):
            y[k + 1] = np.exp(a * step) * y[k] + np.expm1(a * step) / a * b * u[k]
        return y

    # One of them near 0, which no record can show to a part of itself.
    starts = np.array([rng.uniform(-1, 1), 1e-3])
    measured = [course(a, b, start, u) + 0.4 + 0.02 * rng.standard_normal(rows) for start, u in zip(starts, inputs, strict=True)]
    for k in range(2):
        table = np.column_stack([step * np.arange(rows), inputs[k], measured[k]])
        np.savetxt(tmp_path / f"r{k}.csv", table, delimiter=",", header="time,u,y", comments="", fmt="%.17g")
    names = ["--fmu", "P.toml", "--inputs", "u", "--outputs", "y", "--free", "A[1,1],B[1,1]", "--initial", "x0[1]"]
    ran = program(tmp_path, "identify", "r0.csv", "r1.csv", *names, "--hold-out", "0", "--json")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    output = json.loads(ran.stdout)

    def residuals(p: np.ndarray) -> np.ndarray:
        return np.concatenate([course(p[0], p[1], p[2 + k], inputs[k]) + p[4 + k] - measured[k] for k in range(2)])

    best = least_squares(residuals, [-1, 1, 0, 0, 0, 0], x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    covariance = np.linalg.inv(best.jac.T @ best.jac) * 2 * best.cost / (2 * rows - 6)
    errors = np.sqrt(np.diag(covariance))
    assert [(of["name"], of["record"]) for of in output["parameters"]] == [("A[1,1]", None), ("B[1,1]", None), ("x0[1]", 1), ("x0[1]", 2)]
    for of, value, error in zip(output["parameters"], best.x, errors, strict=False):
        assert abs(of["value"] - value) < 0.02 * error, (NUMBER, of, value, error)
        assert 0.9 * error < of["error"] < 2.5 * error, (NUMBER, of, error)
    # The model is that of the parameters, with their covariance: a controller can be designed for it.
    model = json.loads((tmp_path / "model.json").read_text())
    assert model["free"] == [["A", 1, 1], ["B", 1, 1]]
    np.testing.assert_allclose(model["covariance"], np.array(output["covariance"])[:2, :2], rtol=1e-3)
    new = program(tmp_path, "new", "pid", "--name", "C", "--plant", "model.json", "--margin", "2", "--no-schema")
    assert new.returncode == 0 and "covariance" in (tmp_path / "C.toml").read_text(), new.stderr


def test_what_records_do_not_show_is_not_sound_and_faults_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 42)
    robot_record(tmp_path, rng, Robot(), rows=60)
    ran = program(tmp_path, "identify", "record.csv", *ROBOT, "--free", "m2,rate_weight")
    assert ran.returncode == 3 and "rate_weight has no effect on these outputs" in ran.stdout, ran.stdout + ran.stderr
    # The true friction is beyond the range.
    ran = program(tmp_path, "identify", "record.csv", *ROBOT, "--free", "k1=2:5", "--set", "k1=3", "--force")
    assert ran.returncode == 3 and "k1 = " in ran.stdout and "at the end of its range" in ran.stdout, ran.stdout + ran.stderr
    (tmp_path / "gap.csv").write_text((tmp_path / "record.csv").read_text().replace("\n0.04,", "\n0.04,nan,0,0,0\n0.041,", 1))
    for arguments, reason in [
        (["record.csv", *ROBOT, "--free", "m3"], "--free = m3: is not a Real parameter or start value"),
        (["record.csv", *ROBOT, "--free", "m2", "--initial", "x9"], "--initial = x9: is not a Real parameter or start value"),
        (["record.csv", *ROBOT, "--free", "m2=5:1"], "--free = m2=5:1: must be NAME, or NAME=LOW:HIGH"),
        (["record.csv", *ROBOT, "--free", "m2=5:8"], "m2 = 2: must begin between 5 and 8: give a start value with --set"),
        (["record.csv", *ROBOT, "--free", "m2,m2"], "--free = m2: is given twice"),
        (["record.csv", *ROBOT, "--free", "m2", "--hold-out", "record.csv"], "with --fmu the last part of each record is held out"),
        (["gap.csv", *ROBOT, "--free", "m2"], "u[1] = NaN: must be a finite number, at 0.04 s"),
        (["record.csv", *ROBOT[:4], "--outputs", "x[9]", "--free", "m2"], "x[9]"),
        (["record.csv", *ROBOT[:4], "--states", "x[1]", "--free", "m2"], "cannot be used with"),
    ]:
        ran = program(tmp_path, "identify", *arguments, "--out", "none.json")
        assert ran.returncode != 0 and reason in ran.stderr, (arguments, ran.stdout, ran.stderr)
        assert not list(tmp_path.glob("none.*"))


def test_a_held_out_part_that_rests_is_not_judged(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 43)
    robot_record(tmp_path, rng, Robot(), rows=120)
    lines = (tmp_path / "record.csv").read_text().splitlines()
    # It hangs for the last third.
    hanging = [f"{0.04 * k:.12g},0,0,{-np.pi / 2 + 0.003 * rng.standard_normal():.9g},{0.003 * rng.standard_normal():.9g}" for k in range(120, 180)]
    (tmp_path / "record.csv").write_text("\n".join([*lines, *hanging]) + "\n")
    ran = program(tmp_path, "identify", "record.csv", *ROBOT, "--free", "m2=0.1:10", "--offset", "none", "--hold-out", "20%", "--json")
    output = json.loads(ran.stdout)
    assert output["fit"] == [None, None] and not any("held-out" in finding for finding in output["findings"]), output


def test_parameters_of_a_loop_without_inputs(tmp_path: Path) -> None:
    """A record of a loop of this package: a gain of its controller and a start value of its plant are found again."""
    values = {"controller.feedback_gain[1,1]": 30.0, "plant.x0[1]": 0.3}
    sets = [part for name, value in values.items() for part in ("--set", f"{name}={value}")]
    ran = program(tmp_path, "run", "3.2.1-cosine", *sets, "--until", "3", "--out", "results")
    assert ran.returncode == 0, ran.stderr
    [table] = tmp_path.glob("results/**/result.csv")
    names = ["--fmu", "3.2.1-cosine", "--outputs", "plant.x[1],controller.u[1]", "--offset", "none", "--json", "--hold-out", "0"]
    ran = program(tmp_path, "identify", str(table), *names, "--free", ",".join(values))
    assert ran.returncode == 0, ran.stdout + ran.stderr
    for of in json.loads(ran.stdout)["parameters"]:
        assert of["value"] == pytest.approx(values[of["name"]], rel=0.01), of
