"""`simulate --compare`: a record through a controller, against the control that was recorded."""

import json
from pathlib import Path

import numpy as np
import pytest
from master import Fmu, Unit
from recorded import motor, program
from sample import NUMBER
from scipy.linalg import expm

ROWS, STEP = 800, 0.005
HEAD = "time,speed_reference,speed,current,voltage,temperature"
REPLAY = ["simulate", "fmus/C.fmu", "--input", "record.csv", "--compare", "voltage", "--step", str(STEP), "--json", "--out", "results"]


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    """A folder with an L1 controller as an FMU, for a random motor."""
    folder = tmp_path_factory.mktemp("replay")
    A, B = motor(np.random.default_rng(NUMBER + 30))
    # Too little for the reference: the limits act.
    limit = 0.8 * 40 / (-np.array([1, 0]) @ np.linalg.solve(A, B))[0]
    plant = {
        **{"A": A.tolist(), "B": B.tolist(), "C": [[1, 0]], "states": ["speed", "current"], "inputs": ["voltage"], "outputs": ["speed"]},
        **{"units": {"x": ["rad/s", "A"], "u": ["V"], "y": ["rad/s"]}, "u_min": [-limit], "u_max": [limit]},
    }
    (folder / "plant.json").write_text(json.dumps(plant))
    made = program(folder, "new", "l1", "--name", "C", "--plant", "plant.json", "--reference", "50", "--bandwidth", "20", "--no-schema")
    assert made.returncode in (0, 3), made.stderr
    exported = program(folder, "export", "C.toml", "--out", "fmus")
    assert exported.returncode == 0, exported.stderr
    return folder, A, B


def experiment(folder: Path, A: np.ndarray, B: np.ndarray, *, late: bool) -> np.ndarray:
    """A closed loop in steps: the record's voltage is the one that was computed of its row, or the one that acts there."""
    rng = np.random.default_rng(NUMBER + 31)
    whole = expm(np.block([[1.1 * A, B], [np.zeros((1, 3))]]) * STEP)
    x, acting, rows = np.zeros(2), 0.0, []
    with Unit(Fmu(folder / "fmus" / "C.fmu", folder)) as unit:
        reference = 0.0
        unit.start(speed_reference=0.0, speed=0.0, current=0.0)
        for k in range(ROWS):
            reference = 40 * np.sign(np.sin(2 * np.pi * k / 300)) if k > 20 else 0.0
            measured = x + 0.01 * rng.standard_normal(2)
            unit["speed_reference"], unit["speed"], unit["current"] = reference, measured[0], measured[1]
            unit.step(k * STEP, STEP)
            computed = unit["voltage"]
            rows.append([k * STEP, reference, *measured, acting if late else computed, 20 + k / ROWS])
            x = whole[:2, :2] @ x + whole[:2, 2] * acting
            acting = computed
    table = np.array(rows)
    np.savetxt(folder / "record.csv", table, delimiter=",", header=HEAD, comments="", fmt="%.17g")
    return table


@pytest.mark.parametrize("late", [False, True])
def test_the_same_controller_gives_the_recorded_control(late: bool, controller: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, A, B = controller
    table = experiment(folder, A, B, late=late)
    ran = program(folder, *REPLAY)
    assert ran.returncode == 0, ran.stderr
    assert "not used: temperature" in ran.stderr
    output = json.loads(ran.stdout)["compared"]
    of = output["outputs"]["voltage"]
    assert of["delay"] == int(late) and of["unit"] == "V"
    # Steps of other lengths by rounding, integrated to the relative tolerance of 1e-6.
    assert of["rms"] < 5e-5 and of["largest"] < 5e-4 and of["fit"] == pytest.approx(100, abs=1e-3), (NUMBER, of)
    # The limits act: each computed voltage that is at one counts.
    results = np.genfromtxt(folder / "results" / "C" / "result.csv", delimiter=",", names=True, deletechars="")
    at_limit = results["time_at_limit"] > 0
    assert output["shares"]["time_at_limit"]["part"] == pytest.approx(100 * at_limit.mean())
    assert at_limit.any() and "projection_active" in output["shares"]
    np.testing.assert_allclose(results["voltage_recorded"], table[:, 4], rtol=0, atol=1e-12)


def test_another_controller_is_reported_with_how_much_and_when(controller: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, A, B = controller
    table = experiment(folder, A, B, late=False)
    table[500, 4] += 3.0
    table[700:710, 4] = np.nan
    np.savetxt(folder / "record.csv", table, delimiter=",", header=HEAD.replace("voltage", "voltage [V]"), comments="", fmt="%.17g")
    of = json.loads(program(folder, *REPLAY).stdout)["compared"]["outputs"]["voltage"]
    assert of["largest"] == pytest.approx(3.0, abs=5e-4) and of["time"] == pytest.approx(501 * STEP)
    known = np.isfinite(table[:-1, 4])
    assert of["rms"] == pytest.approx(3.0 / np.sqrt(known.sum()), rel=1e-4)
    output = program(folder, *(option for option in REPLAY if option != "--json")).stdout
    assert "against the record" in output and "a control is at its limit (time_at_limit) for" in output


def test_names_that_do_not_fit_are_refused(controller: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, A, B = controller
    experiment(folder, A, B, late=False)
    without = [option for option in REPLAY if option not in ("--input", "record.csv")]
    for arguments, reason in [
        ([*REPLAY, "--compare", "voltag"], "cannot be used multiple times"),
        ([option.replace("voltage", "voltag") for option in REPLAY], "--compare = voltag: is not an output of the FMU; did you mean `voltage`?"),
        ([option.replace("voltage", "temperature") for option in REPLAY], "--compare = temperature: is not an output of the FMU; there are: voltage"),
        (without, "--input"),
    ]:
        ran = program(folder, *arguments)
        assert ran.returncode != 0 and reason in ran.stderr, ran.stderr
    (folder / "record.csv").write_text((folder / "record.csv").read_text().replace("voltage,", "volts,"))
    assert "--compare = voltage: is not a column of the record" in program(folder, *REPLAY).stderr
    (folder / "record.csv").write_text((folder / "record.csv").read_text().replace("volts,", "voltage [A],"))
    assert "voltage is in A: must be in V, or a unit of that quantity" in program(folder, *REPLAY).stderr


def test_columns_are_converted_to_the_units_of_the_fmu(controller: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, A, B = controller
    table = experiment(folder, A, B, late=False) * np.array([1, 30 / np.pi, 30 / np.pi, 1e3, 1e3, 1])
    head = "time,speed_reference [rpm],speed [rpm],current [mA],voltage [mV],temperature [degC]"
    np.savetxt(folder / "record.csv", table, delimiter=",", header=head, comments="", fmt="%.17g")
    of = json.loads(program(folder, *REPLAY).stdout)["compared"]["outputs"]["voltage"]
    assert of["fit"] == pytest.approx(100, abs=1e-3) and of["rms"] < 5e-5 and of["unit"] == "V", (NUMBER, of)


def test_a_controller_that_is_another_has_no_delay(controller: tuple[Path, np.ndarray, np.ndarray]) -> None:
    """Where the difference isn't much less with a delay, none is reported."""
    folder, A, B = controller
    experiment(folder, A, B, late=False)
    of = json.loads(program(folder, *REPLAY, "--set", "feedback_gain[1,1]=5").stdout)["compared"]["outputs"]["voltage"]
    assert of["delay"] == 0 and of["fit"] < 99.9, (NUMBER, of)


def test_columns_that_set_parameters_are_reported(tmp_path: Path) -> None:
    """A column of a record may have the name of one by chance."""
    (tmp_path / "record.csv").write_text('time,"u[1]","A[2,2]","y[1]",other\n0,1,-2,0,0\n1,1,-3,0.5,0\n')
    ran = program(tmp_path, "simulate", "StateSpace", "--input", "record.csv", "--compare", "y[1]", "--json")
    assert ran.returncode == 0, ran.stderr
    assert "columns of record.csv that set parameters: A[2,2]" in ran.stderr and "not used: other" in ran.stderr
