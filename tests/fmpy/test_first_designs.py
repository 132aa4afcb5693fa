"""First designs of `new pid`, `new ladrc` and `new funnel`: margins of random plants by python-control, loops of the plants' FMUs,
and what is refused and said."""

import csv
import json
import subprocess
from pathlib import Path
from random import Random

import control
import fmpy
import numpy as np
import pytest
import scipy.integrate
from conftest import PROGRAM
from first_designs import design, modulus, new, poles
from random_plants import CLASSES, Plant, plant
from sample import ALL, NUMBER

# M_s at most, of the second pass; and of several channels in parts of it.
MODULUS = {"pid": 2.0, "ladrc": 2.5}
# Without a note that margins are small.
USUAL = {"pid": 1.7, "ladrc": 2.0}
SEVERAL = 1.1
# Half of the last of three digits, and what lines between points of a grid leave.
PRINTED = 0.006
EACH = 20 if ALL else 3
# Classes in which a plant may have no design; elsewhere all have one.
MAY_REFUSE = ["zero on the right", "unstable", "several channels", "any bandwidth"]


@pytest.mark.parametrize("kind", MODULUS)
@pytest.mark.parametrize("of", CLASSES)
def test_designs_of_random_plants_have_margins(of: str, kind: str, tmp_path: Path):
    random, refused = Random(f"{NUMBER} {of}"), 0
    for number in range(EACH):
        tried = plant(of, random)
        run = new(kind, tried.json(), tried.bandwidth, tmp_path)
        assert run.returncode in (0, 1), run.stderr
        if run.returncode:
            refused += 1
            continue
        found = design(kind, run, tmp_path)
        usual = USUAL[kind] if "The margins are small" not in run.stderr else MODULUS[kind]
        most = usual * (SEVERAL if of == "several channels" else 1)
        closed, worst = poles(tried, found), modulus(tried, found, 1500)
        text = f"TEST_SAMPLE={NUMBER} {of} {number} {kind}: M_s {worst}, poles {closed}"
        assert (closed.real < 0).all(), text
        # A grid of frequencies misses up to 1 % of a peak.
        assert worst <= 1.01 * most, text
        # The file says what its loop has.
        documented = (tmp_path / "C.toml").read_text().replace("\n# ", " ").split("maximum sensitivity M_s ")[1].split()[0].rstrip(".")
        assert worst == pytest.approx(float(documented), rel=0.02), text
    assert refused <= (0 if of not in MAY_REFUSE else max(1, EACH // 5)), f"TEST_SAMPLE={NUMBER} {of}: {refused} of {EACH} refused"


@pytest.mark.parametrize("kind", MODULUS)
@pytest.mark.parametrize("of", [of for of in CLASSES if of not in ("dead time", "several channels")])
def test_margins_that_check_reports_are_those_of_another_program(of: str, kind: str, tmp_path: Path):
    random = Random(f"{NUMBER} margins {of}")
    for _ in range(EACH):
        tried = plant(of, random)
        run = new(kind, tried.json(), tried.bandwidth, tmp_path)
        if run.returncode:
            continue
        found = design(kind, run, tmp_path)
        opened = control.series(control.ss(found.A, found.B, found.C, found.D), control.ss(tried.A, tried.B, tried.C, 0))
        gains, phases, _, _, crossings, _ = control.stability_margins(opened, returnall=True)
        checked = subprocess.run([PROGRAM, "check", "C.toml", "--json"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        report = {item["name"]: item["value"] for item in json.loads(checked.stdout)["findings"] if item["section"] == "Margins"}
        delays = np.radians(phases % 360) / crossings
        expected = {
            "gain margin": min((gain for gain in gains if 1.001 < gain < 1e9), default="unlimited"),
            "least gain": max((gain for gain in gains if 1e-6 < gain < 0.999), default=None),
            "phase margin": min(abs((phases + 180) % 360 - 180), default="unlimited"),
            "delay margin": min(delays, default="unlimited"),
        }
        for name, value in expected.items():
            text = f"TEST_SAMPLE={NUMBER} {of} {kind}: {name} {report.get(name)}, {expected}"
            assert report.get(name) == (value if value is None or value == "unlimited" else pytest.approx(value, rel=PRINTED)), text


def loop(folder: Path, kind: str, model: dict, bandwidth: float, reference: float, until: float) -> dict[str, np.ndarray]:
    """Runs the loop that `new` makes for a plant, and returns its result's columns."""

    def program(*arguments: str) -> subprocess.CompletedProcess:
        return subprocess.run([PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=120)

    made = new(kind, model, bandwidth, folder, reference)
    assert made.returncode == 0, made.stderr
    for other, name in [("state-space", "P"), ("reference", "R")]:
        options = ["--plant", "plant.json", "--reference", repr(reference), "--out", f"{name}.toml", "--no-schema", "--force"]
        made = program("new", other, "--name", name, *options)
        assert made.returncode == 0, made.stderr
    made = program("new", "loop", "--units", "P.toml", "C.toml", "R.toml", "--until", repr(until), "--out", ".", "--force")
    assert made.returncode == 0 and "to decide" not in made.stderr, made.stderr
    ran = program("run", ".", "--out", "results", "-q", "--every", repr(until / 2000))
    assert ran.returncode == 0, ran.stderr
    with next((folder / "results").rglob("result.csv")).open() as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))


MOTOR = {
    "A": [[-0.5, 250], [-25, -500]], "B": [[0], [500]], "C": [[1, 0]],
    "states": ["speed", "current"], "inputs": ["voltage"], "outputs": ["speed"],
    "units": {"x": ["rad/s", "A"], "u": ["V"], "y": ["rad/s"]}, "u_min": [-12], "u_max": [12],
}  # fmt: skip
ROOM = {
    "A": [[-2.92e-3, 2.5e-3], [3.75e-5, -5.25e-5]], "B": [[1 / 1.2e5], [0]], "C": [[1, 0]],
    "states": ["air", "wall"], "inputs": ["power"], "outputs": ["air"],
    "units": {"x": ["K", "K"], "u": ["W"], "y": ["K"]}, "u_min": [-4000], "u_max": [4000],
}  # fmt: skip
AXIS = {"A": [[0, 1], [0, 0]], "B": [[0], [0.5]], "C": [[1, 0]], "states": ["angle", "rate"], "inputs": ["torque"], "outputs": ["angle"]}


@pytest.mark.parametrize("kind", ["pid", "ladrc", "funnel"])
@pytest.mark.parametrize(
    ("model", "bandwidth", "reference", "until"),
    [(MOTOR, 20.0, 100.0, 2.0), (ROOM, 3e-3, 5.0, 5000.0), (AXIS, 2.0, 0.5, 12.0), (MOTOR | {"delay": 0.01}, 20.0, 100.0, 4.0)],
    ids=["motor", "room", "axis", "late motor"],
)
def test_the_loop_of_a_first_design_settles(kind, model, bandwidth, reference, until, tmp_path: Path):
    if kind == "funnel" and "delay" in model:
        refused = new(kind, model, bandwidth, tmp_path)
        assert refused.returncode == 1 and "takes no dead time" in refused.stderr, refused.stderr
        return
    columns = loop(tmp_path, kind, model, bandwidth, reference, until)
    y = columns[f"plant.{model['outputs'][0]}" if f"plant.{model['outputs'][0]}" in columns else f"plant.{model['outputs'][0]}_output"]
    assert abs(y[-1] / reference - 1) < 0.05 and y.max() < 1.3 * reference, (y[-1], y.max())
    table = (tmp_path / "SystemStructure.ssd").read_text()
    assert ("smooth_start_rate" in table) == (kind == "funnel")


def test_the_step_that_limits_allow_is_reported(tmp_path: Path):
    """The largest control of a loop without limits is the limit, for the step that `new` allows."""
    run = new("pid", MOTOR | {"u_max": [5], "u_min": [-5]}, 20.0, tmp_path, 100.0)
    assert run.returncode == 0 and "A step of the reference to 100 needs controls from" in run.stderr, run.stderr
    largest = float(run.stderr.split("A step to ")[1].split()[0])
    free = MOTOR | {"u_max": [1000], "u_min": [-1000]}
    voltage = loop(tmp_path, "pid", free, 20.0, 100.0, 2.0)["controller.voltage"]
    assert np.abs(voltage).max() * largest / 100 == pytest.approx(5, rel=0.01)


@pytest.mark.parametrize("limits", [(-10, 0), (-10, -2), (-0.1, 10), (0, 10)])
@pytest.mark.parametrize("kind", ["pid", "ladrc", "funnel"])
def test_limits_that_lie_on_one_side_are_respected(kind: str, limits: tuple[float, float], tmp_path: Path):
    lag = {"A": [[-1]], "B": [1], "C": [1], "u_min": [limits[0]], "u_max": [limits[1]]}
    run = new(kind, lag, 5.0, tmp_path)
    assert run.returncode == 0, run.stderr
    noted = "beyond u_min and u_max" in run.stderr
    # Up needs a positive control; PID's falls below 0 on the way, the others' don't.
    assert noted == (limits[1] <= 0 or kind == "pid"), run.stderr
    if kind != "funnel" and limits[1] <= 0:
        assert "No step stays within them" in run.stderr


@pytest.mark.parametrize("kind", ["pid", "ladrc"])
def test_units_of_measurement_and_short_dead_times_are_no_reason(kind: str, tmp_path: Path):
    pair = {"A": [[-1, 1], [1, -2]], "B": [[1, 0], [0, 1e-11]], "C": [[1, 0], [0, 1]]}
    for model, bandwidth in [(pair, 3.0), ({"A": [[0]], "B": [1], "C": [1], "delay": 1e-6}, 1.0), ({"A": [[1]], "B": [1], "C": [1e-20], "delay": 1e-6}, 3.0)]:
        run = new(kind, model, bandwidth, tmp_path)
        assert run.returncode == 0, run.stderr


def test_the_input_gain_that_is_written_is_the_one_that_was_tested(tmp_path: Path):
    """Inputs that do nearly the same: four digits of their gain would be another loop."""
    for much in (3.7e-4, 1.37e-4):
        tried = Plant(np.array([[-1, 0.2], [0.1, -2]]), np.array([[1, 1.234], [1, 1.234 * (1 + much)]]), np.eye(2), 5.0)
        run = new("ladrc", tried.json(), 5.0, tmp_path)
        assert run.returncode == 0, run.stderr
        documented = (tmp_path / "C.toml").read_text().replace("\n# ", " ").split("maximum sensitivity M_s ")[1].split()[0].rstrip(".")
        assert modulus(tried, design("ladrc", run, tmp_path), 1000) == pytest.approx(float(documented), rel=0.02)


@pytest.mark.parametrize(
    ("kind", "model", "reason"),
    [
        ("pid", {"A": [[-1, 0], [0, -1]], "B": [[1, 0], [0, 1]], "C": [[1, 0], [0, 1]], "delay": [1, 1e-3]}, "at least 1/100 of the longest"),
        ("ladrc", {"A": [[0, 1e150], [-1e-150, -1]], "B": [0, 1e150], "C": [1, 0]}, "too many powers of ten"),
        ("funnel", {"A": [[-1, 0, 0], [0, -1, 1], [0, 0, -1]], "B": [[1, 0], [1, 0], [0, 1]], "C": [[1, 0, 0], [0, 1, 0]]}, "independently"),
        ("pid", {"A": [[0, 1], [5, 4]], "B": [0, 1], "C": [-6, 1]}, "M_s of at least 11"),
        ("ladrc", {"A": [[0, 1], [5, 4]], "B": [0, 1], "C": [-6, 1]}, "M_s of at least 11"),
        ("funnel", {"A": [[0, 1], [-2, -3]], "B": [0, 1], "C": [6, -1]}, "zero at 6 rad/s"),
        ("funnel", {"A": np.eye(5, k=1).tolist(), "B": [0, 0, 0, 0, 1], "C": [1, 0, 0, 0, 0]}, "relative degree 5"),
        ("pid", {"A": [[-1]], "B": [1], "C": [1], "delay": -1}, "delay = -1: must be at least 0 s"),
        ("pid", {"A": [[-1]], "B": [1], "C": [1], "delay": [1, 2]}, "a list of 1 numbers"),
    ],
)
def test_what_has_no_design_is_refused_with_the_reason(kind, model, reason, tmp_path: Path):
    refused = new(kind, model, 10.0, tmp_path)
    assert refused.returncode == 1 and reason in refused.stderr and not (tmp_path / "C.toml").exists(), refused.stderr


LATE = """
name = "Late"
model = "state-space"
description = "A plant with dead times"
[structure]
A = [[-2.0, 0.5], [0.0, -3.0]]
B = [[1.0, 0.0], [0.0, 2.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
delay = [0.3, 0.07]
[start]
u_max = [0.8, 1e15]
"""


@pytest.mark.parametrize("form", [[], ["--compile"]], ids=["generic", "compiled"])
def test_a_plant_has_its_dead_times(form: list[str], tmp_path: Path):
    """In both interfaces, against an integration with the inputs that were."""
    (tmp_path / "Late.toml").write_text(LATE)
    made = subprocess.run([PROGRAM, "export", "Late.toml", "--out", "out", *form], cwd=tmp_path, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr

    def inputs(t: float) -> np.ndarray:
        return np.array([0.5 + 0.5 * np.sin(4 * max(t, 0)), 1.5 - np.cos(5 * max(t, 0))])

    def rates(t: float, x: np.ndarray, sampled: float) -> np.ndarray:
        late = np.array([min(inputs(t - 0.3 - sampled)[0], 0.8), inputs(t - 0.07 - sampled)[1]])
        return np.array([[-2.0, 0.5], [0.0, -3.0]]) @ x + np.array([[1.0, 0.0], [0.0, 2.0]]) @ late

    times = np.arange(0, 3.0005, 0.001)
    given = np.array([(t, *inputs(t)) for t in times], [("time", float), ("u[1]", float), ("u[2]", float)])
    looked_at = np.arange(0, 3.001, 0.01)
    # In co-simulation the value that is stored at a communication point is that of the step which ends there.
    for interface, sample_time in [("ModelExchange", 0.0), ("CoSimulation", 0.001)]:
        solved = scipy.integrate.solve_ivp(rates, (0, 3), [0, 0], rtol=1e-9, atol=1e-12, max_step=0.01, t_eval=looked_at, args=[sample_time])
        ran = fmpy.simulate_fmu(
            str(tmp_path / "out/Late.fmu"), stop_time=3, fmi_type=interface, relative_tolerance=1e-8, output_interval=0.001,
            input=given, output=["y[1]", "y[2]"],
        )  # fmt: skip
        found = np.array([np.interp(looked_at, ran["time"], ran[name]) for name in ("y[1]", "y[2]")])
        assert np.abs(found - solved.y).max() < 2e-4, (interface, np.abs(found - solved.y).max())


def test_dead_times_and_derivatives_that_are_none_are_refused(tmp_path: Path):
    for old, new_text, message in [
        ("delay = [0.3, 0.07]", "delay = [0.3]", "number of delays = 1: must be 2"),
        ("delay = [0.3, 0.07]", "delay = [0.3, 0.002]", "delay[2] = 0.002: must be 0, or at least 1/100 of the longest"),
        ("delay = [0.3, 0.07]", "delay = [0.3, -1.0]", "delay[2] = -1"),
        ("delay = [0.3, 0.07]", "output_derivatives = 1", "must be 0: this derivative has feedthrough from an input"),
        ("delay = [0.3, 0.07]", "output_derivatives = 3", "output_derivatives = 3: must be within 0 … 2"),
    ]:
        (tmp_path / "Late.toml").write_text(LATE.replace(old, new_text))
        made = subprocess.run([PROGRAM, "check", "Late.toml"], cwd=tmp_path, capture_output=True, text=True)
        assert made.returncode == 1 and message in made.stderr, made.stderr


def test_without_a_speed_of_its_own_a_plant_needs_one(tmp_path: Path):
    (tmp_path / "plant.json").write_text(json.dumps(AXIS))
    command = [PROGRAM, "new", "pid", "--name", "C", "--plant", "plant.json"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 1 and "give --bandwidth" in run.stderr, run.stderr


def test_a_control_that_moves_to_one_side_is_not_at_its_other_limit(tmp_path: Path):
    """A plant that answers the other way round needs a negative control: an upper limit of 0 is none to it."""
    lag = {"A": [[-1]], "B": [-1], "C": [1], "u_min": [-100], "u_max": [0]}
    for kind in ("ladrc", "funnel"):
        run = new(kind, lag, 5.0, tmp_path)
        assert run.returncode == 0 and "beyond u_min and u_max" not in run.stderr, run.stderr
