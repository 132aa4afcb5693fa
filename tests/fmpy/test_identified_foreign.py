"""From the FMU of another tool to a controller for it, without its equations: its answer to levels is recorded, with noise, and identified;
the controller runs in a loop with the FMU."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM, read_csv
from own_machines import levels
from sample import NUMBER
from scipy.integrate import solve_ivp
from test_foreign_plants import C_ONLY, PYTHON, in_c, needs_python

OVEN = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Oven(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.power, self.element, self.chamber, self.loss = 300.0, 130.0, 80.0, 4.0
        self.register_variable(Real("power", causality=Fmi2Causality.input))
        self.register_variable(Real("element", causality=Fmi2Causality.output))
        self.register_variable(Real("chamber", causality=Fmi2Causality.output))
        self.register_variable(Real("loss", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def rates(self, element, chamber):
        radiated = 2e-8 * ((element + 273.15) ** 4 - (chamber + 273.15) ** 4) + 0.5 * (element - chamber)
        return (self.power - radiated) / 100, (radiated - self.loss * (chamber - 25.0)) / 400

    def do_step(self, current_time, step_size):
        for _ in range(4):
            a, b = self.rates(self.element, self.chamber)
            h = step_size / 8
            a, b = self.rates(self.element + h * a, self.chamber + h * b)
            self.element += 2 * h * a
            self.chamber += 2 * h * b
        return True
"""


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [PROGRAM, *map(str, words)]
    environment = {**os.environ, **PYTHON}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def done(folder: Path, *words: str) -> str:
    answer = run(folder, *words)
    assert answer.returncode == 0, (words, answer.stdout, answer.stderr)
    return answer.stdout


def oven(folder: Path) -> Path:
    """An oven that isn't linear, in Python, as PythonFMU builds it."""
    (folder / "oven.py").write_text(OVEN)
    words = [sys.executable, "-m", "pythonfmu", "build", "-f", folder / "oven.py", "-d", folder, "--no-external-tool"]
    subprocess.run(words, check=True, capture_output=True)
    return folder / "Oven.fmu"


def record(folder: Path, fmu: Path, given: np.ndarray, step: float, signals: list[str], noise: list[float]) -> None:
    """What `simulate` records of the FMU's answer to levels, with noise, beside the levels. Signals have their units in brackets."""
    signal, *states = [name.split(" ")[0] for name in signals]
    rows = len(given)
    times = step * np.arange(rows)
    np.savetxt(folder / "levels.csv", np.column_stack([times, given]), delimiter=",", header=f"time,{signal}", comments="", fmt="%.9g")
    words = ["--input", "levels.csv", "--step", str(step), "--until", f"{times[-1]:.9g}", "--out", "simulated", "--json"]
    output = json.loads(done(folder, "simulate", fmu, *words))
    result = read_csv(folder / output["results"] / "result.csv")
    assert len(result["time"]) == rows and np.allclose(result["time"], times)
    rng = np.random.default_rng([NUMBER, 40])
    measured = np.stack([result[name] for name in states], 1) + rng.normal(size=(rows, len(states))) * noise
    header = ",".join(["time", *signals])
    np.savetxt(folder / "record.csv", np.column_stack([times, given, measured]), delimiter=",", header=header, comments="", fmt="%.9g")


def in_a_loop(folder: Path, fmu: Path, output: str, reference: float, until: float) -> dict[str, np.ndarray]:
    """A loop of the FMU with C.toml and a reference, as it is run."""
    words = ["--plant", "model.json", "--outputs", output, "--reference", str(reference), "--no-schema"]
    done(folder, "new", "reference", "--name", "R", *words)
    done(folder, "new", "loop", "--units", fmu, "C.toml", "R.toml", "--out", "loop")
    assert "TO DECIDE" not in (folder / "loop" / "SystemStructure.ssd").read_text()
    output = json.loads(done(folder, "run", "loop", "--until", str(until), "--json", "--out", "results"))
    assert output["ended"] == "complete"
    return read_csv(folder / output["results"] / "result.csv")


@C_ONLY
@pytest.mark.parametrize("kind", ["l1-limit", "pid"])
def test_a_motor_of_another_tool_is_recorded_and_controlled(kind: str, tmp_path: Path) -> None:
    fmu = in_c(tmp_path)
    rng = np.random.default_rng([NUMBER, 41])
    given = levels(rng, 2000, -10, 10, 60)
    record(tmp_path, fmu, given, 1e-3, ["voltage [V]", "speed [rad/s]", "current [A]"], [0.5, 0.05])
    done(tmp_path, "identify", "record.csv", "--inputs", "voltage", "--states", "speed,current")
    model = json.loads((tmp_path / "model.json").read_text())
    errors = dict(zip(map(tuple, model["free"]), np.sqrt(np.diag(model["covariance"])), strict=True))
    for (matrix, i, j), error in errors.items():
        if matrix != "d":
            true = {"A": [[-0.5, 250], [-25, -500]], "B": [[0], [500]]}[matrix][i - 1][j - 1]
            assert abs(model[matrix][i - 1][j - 1] - true) < 4.5 * error, (NUMBER, matrix, i, j)
    done(tmp_path, "new", kind, "--name", "C", "--plant", "model.json", "--outputs", "speed", "--reference", "50", "--no-schema")
    assert json.loads(done(tmp_path, "check", "C.toml", "--json"))["sound"]
    result = in_a_loop(tmp_path, fmu, "speed", 50.0, 4.0)
    reference = next(values for name, values in result.items() if name.endswith(".speed_reference"))
    rest = result["time"] > 3.0
    error = np.abs(result["plant.speed"] - reference)[rest].max()
    print(kind, "largest error at rest", error, "of", reference[-1], "voltage", np.abs(result["controller.voltage"]).max())
    assert reference[-1] == 50.0 and error < 0.05, NUMBER


@needs_python
def test_an_oven_in_python_is_recorded_about_its_operating_point_and_controlled(tmp_path: Path) -> None:
    """Its operating point is a constant of the record; the same temperatures in K make no other model."""
    fmu = oven(tmp_path)
    rng = np.random.default_rng([NUMBER, 42])
    record(tmp_path, fmu, levels(rng, 1500, 200, 500, 40), 5.0, ["power", "element", "chamber"], [0.5, 0.1])
    signals = ["--inputs", "power", "--states", "element,chamber"]
    done(tmp_path, "identify", "record.csv", *signals)
    model = json.loads((tmp_path / "model.json").read_text())
    print("fit", model["fit"]["held_out"], model["method"], "offset", model["offset"])
    table = np.genfromtxt(tmp_path / "record.csv", delimiter=",", skip_header=1) + [0, 0, 273.15, 273.15]
    np.savetxt(tmp_path / "kelvin.csv", table, delimiter=",", header="time,power,element,chamber", comments="", fmt="%.9g")
    run(tmp_path, "identify", "kelvin.csv", *signals, "--out", "kelvin.json")
    kelvin = json.loads((tmp_path / "kelvin.json").read_text())
    for k, (matrix, i, j) in enumerate(model["free"]):
        if matrix != "d":
            error = np.sqrt(model["covariance"][k][k])
            assert abs(kelvin[matrix][i - 1][j - 1] - model[matrix][i - 1][j - 1]) < 0.01 * error
            assert np.sqrt(kelvin["covariance"][k][k]) == pytest.approx(error, rel=0.01)
    assert min(model["fit"]["held_out"]) > 80
    done(tmp_path, "new", "pid", "--name", "C", "--plant", "model.json", "--outputs", "chamber", "--reference", "120", "--no-schema")
    assert json.loads(done(tmp_path, "check", "C.toml", "--json"))["sound"]
    # What the heater can do, which no record tells.
    text = (tmp_path / "C.toml").read_text()
    limited = re.sub(r"^u_max = .*", "u_max = [800.0]", re.sub(r"^u_min = .*", "u_min = [0.0]", text, flags=re.M), flags=re.M)
    (tmp_path / "C.toml").write_text(limited)
    result = in_a_loop(tmp_path, fmu, "chamber", 120.0, 4000.0)
    rest = result["time"] > 3000.0
    reference = next(values for name, values in result.items() if name.endswith(".chamber_reference"))
    error = np.abs(result["plant.chamber"] - reference)[rest].max()
    print("largest error at rest", error, "power", result["controller.power"].min(), result["controller.power"].max())
    assert result["controller.power"].min() == 0 and result["controller.power"].max() == 800
    assert reference[-1] == 120.0 and error < 0.5, NUMBER


@needs_python
def test_a_parameter_of_an_oven_in_python_is_found(tmp_path: Path) -> None:
    """With the uncertainty that it leaves in the linear model, of which one entry depends on it."""
    fmu = oven(tmp_path)
    rng = np.random.default_rng([NUMBER, 43])
    record(tmp_path, fmu, levels(rng, 150, 200, 500, 20), 10.0, ["power", "element", "chamber"], [0.5, 0.1])
    words = ["--inputs", "power", "--outputs", "element,chamber", "--free", "loss=0.5:20", "--set", "loss=6", "--offset", "none", "--json"]
    output = json.loads(done(tmp_path, "identify", "record.csv", "--fmu", fmu, "--in-process", *words))
    [loss] = output["parameters"]
    assert abs(loss["value"] - 4.0) < 5 * loss["error"] and loss["error"] < 0.05, (NUMBER, loss)
    model = json.loads((tmp_path / "model.json").read_text())
    errors = dict(zip(map(tuple, model["free"]), np.sqrt(np.diag(model["covariance"])), strict=True))
    assert errors.pop(("A", 2, 2)) == pytest.approx(loss["error"] / 400, rel=0.2)
    # Found by experiments, others depend on it by rounding at most.
    assert all(error < 1e-4 * abs(model[matrix][i - 1][j - 1]) for (matrix, i, j), error in errors.items()), errors
    done(tmp_path, "new", "pid", "--name", "C", "--plant", "model.json", "--outputs", "chamber", "--reference", "120", "--no-schema")
    assert json.loads(done(tmp_path, "check", "C.toml", "--json"))["sound"]


@needs_python
def test_an_event_of_an_oven_in_python_changes_its_loss(tmp_path: Path) -> None:
    """Against its equations; alone, and in a loop, in which it is connected to nothing."""
    fmu = oven(tmp_path)
    rng = np.random.default_rng([NUMBER, 44])
    when, loss = int(rng.integers(50, 400)), rng.uniform(0.5, 20)

    def rates(time: float, x: np.ndarray) -> list[float]:
        radiated = 2e-8 * ((x[0] + 273.15) ** 4 - (x[1] + 273.15) ** 4) + 0.5 * (x[0] - x[1])
        return [(300.0 - radiated) / 100, (radiated - (loss if time >= when else 4.0) * (x[1] - 25.0)) / 400]

    times = np.arange(0.0, 601.0)
    before = solve_ivp(rates, (0.0, when), [130.0, 80.0], t_eval=times[times <= when], rtol=1e-9)
    after = solve_ivp(rates, (when, 600.0), before.y[:, -1], t_eval=times[times >= when], rtol=1e-9)
    expected = np.concatenate([before.y[1], after.y[1, 1:]])
    event, rows = ["--step", "1", "--until", "600", "--out", "results", "--json"], {}
    output = json.loads(done(tmp_path, "simulate", fmu, "--event", f"{when}: loss={loss}", *event))
    rows["alone"] = read_csv(tmp_path / output["results"] / "result.csv")["chamber"]
    done(tmp_path, "new", "loop", "--units", f"oven={fmu}", "--out", "loop")
    output = json.loads(done(tmp_path, "run", "loop", "--event", f"{when}: oven.loss={loss}", *event))
    rows["loop"] = read_csv(tmp_path / output["results"] / "result.csv")["oven.chamber"]
    for where, chamber in rows.items():
        np.testing.assert_allclose(chamber, expected, atol=0.01, err_msg=f"{where} {NUMBER}")
