"""First designs of the laws that keep errors in funnels: `check` runs their loops, and they do the same in any unit and at any speed."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from sample import ALL, NUMBER
from zoo import FOLDER, PLANTS, program

# Which plants of the zoo these laws take: an input for each state, or at most one integrator between.
TAKEN = {
    "mrac-ppf": ["first_order", "pmsm_currents", "reactor"],
    "mrac-ppf-unmatched": ["cruise_control", "cstr", "dc_motor", "first_order", "pmsm_currents", "reactor"],
    "neuro-ppf": ["first_order", "satellite"],
}
PAIRS = [(kind, plant) for kind, plants in TAKEN.items() for plant in plants]


def made(folder: Path, kind: str, plant: dict, *options: str) -> dict:
    """The report of `check` on the design of a kind for a plant."""
    (folder / "plant.json").write_text(json.dumps(plant))
    arguments = ["new", kind, "--name=C", "--plant=plant.json", "--no-schema", "--force", *options]
    ran = program(folder, *arguments)
    assert ran.returncode == 0, ran.stderr
    checked = program(folder, "check", "C.toml", "--json")
    assert checked.returncode in (0, 3), checked.stderr
    return json.loads(checked.stdout)


def skip_without_figures(*reports: dict) -> None:
    """Skips where `check` had no time for the loop, and says so."""
    if any("takes too long for `check`" in json.dumps(report) for report in reports):
        pytest.skip("`check` leaves out figures of runs that take too long, as on a machine with much else to do")


def number(report: dict, name: str) -> float:
    return next(finding["value"] for finding in report["findings"] if finding["name"] == name and "FMUs" in finding["section"])


@pytest.mark.parametrize(("kind", "plant"), PAIRS if ALL else [pair for k, pair in enumerate(PAIRS) if (k + NUMBER) % 3 == 0])
def test_the_loop_of_a_new_design_follows_its_reference(kind: str, plant: str, tmp_path: Path):
    known = PLANTS[plant]
    matrices = json.loads((FOLDER / f"{plant}.json").read_text())
    options = [f"--bandwidth={known['bandwidth']}", f"--reference={known['reference']}"]
    report = made(tmp_path, kind, matrices, *options)
    assert report["sound"], report["text"]
    skip_without_figures(report)
    # A first-order model of that bandwidth has settled after 3.9/W; what is bounded and not driven to 0 stays within a few per cent.
    assert number(report, "settling time") < 8 / known["bandwidth"], report["text"]
    assert number(report, "at rest") < 5, report["text"]


# Numbers of three digits; what the neurons see isn't scaled.
@pytest.mark.parametrize(("kind", "tolerance"), [("mrac-ppf", 0.03), ("neuro-ppf", 0.1)])
def test_a_design_does_the_same_in_other_units_and_at_another_speed(kind: str, tolerance: float, tmp_path: Path):
    rng = np.random.default_rng(NUMBER)
    A = np.array([[-1.0, 0.3], [0.2, -0.5]]) + rng.uniform(-0.2, 0.2, (2, 2))
    B = np.array([[2.0, 0.3], [0.1, 1.0]])
    first = made(tmp_path, kind, {"A": A.tolist(), "B": B.tolist(), "C": np.eye(2).tolist()}, "--bandwidth=2")
    speed, size = 10 ** rng.uniform(-4, 3), 10 ** rng.uniform(-5, 6)
    # Another unit of x and of time, where x and its reference are so large.
    other = {"A": (speed * A).tolist(), "B": (size * speed * B).tolist(), "C": np.eye(2).tolist()}
    scaled = made(tmp_path, kind, other, f"--bandwidth={2 * speed!r}", f"--reference={size!r}")
    skip_without_figures(first, scaled)
    times = [number(report, "settling time") for report in (first, scaled)]
    assert times[1] * speed == pytest.approx(times[0], rel=tolerance)
    for name in ("peak of u[1]", "peak of u[2]"):
        assert number(scaled, name) == pytest.approx(number(first, name), rel=tolerance)


def test_a_reference_may_have_a_size_of_its_own_in_each_channel(tmp_path: Path):
    plant = json.loads((FOLDER / "reactor.json").read_text())
    (tmp_path / "plant.json").write_text(json.dumps(plant))
    sizes = [0.5, 40.0]
    for kind, bounds in [
        ("funnel", "psi_0"),
        ("mrac-ppf", "rho_0"),
        ("l1-ppf", "rho_0"),
        ("l1", None),
        ("pid", None),
        ("ladrc", None),
    ]:
        given = ["--name=C", "--plant=plant.json", "--no-schema", "--force", "--bandwidth=0.02"]
        ran = program(tmp_path, "new", kind, *given, "--reference=0.5,40")
        assert ran.returncode in (0, 3), ran.stderr
        text = tomllib.loads((tmp_path / "C.toml").read_text())
        assert text["nominal"]["reference"] == sizes
        if bounds:
            assert text["start"][bounds] == [2 * size for size in sizes]
        if kind == "funnel":
            assert text["start"]["on_funnel_exit"] == "reopen"
            assert text["start"]["g"][1] == pytest.approx(80 * text["start"]["g"][0], rel=1e-3)
        refused = program(tmp_path, "new", kind, *given, "--reference=1,2,3")
        assert refused.returncode == 1 and "--reference = 1.0, 2.0, 3.0: must be one number, or 2" in refused.stderr
    ran = program(tmp_path, "new", "reference", "--name=R", "--plant=plant.json", "--no-schema", "--reference=0.5,40")
    assert ran.returncode == 0, ran.stderr
    start = tomllib.loads((tmp_path / "R.toml").read_text())["start"]
    assert [start["step_height[1,1]"], start["step_height[2,1]"]] == sizes


@pytest.mark.parametrize("kind", ["mrac-ppf", "mrac-ppf-unmatched", "neuro-ppf"])
def test_a_dead_time_and_an_input_gain_of_the_other_sign_are_refused_with_the_reason(kind: str, tmp_path: Path):
    plant = {"A": [[-1.0]], "B": [[2.0]], "C": [[1.0]]}
    for change, reason in [({"delay": 0.1}, "takes no dead time"), ({"B": [[-2.0]]}, "upwards" if kind == "neuro-ppf" else None)]:
        (tmp_path / "plant.json").write_text(json.dumps(plant | change))
        ran = program(tmp_path, "new", kind, "--name=C", "--plant=plant.json", "--no-schema", "--force")
        assert (ran.returncode == 0) if reason is None else (ran.returncode == 1 and reason in ran.stderr), ran.stderr


def test_an_observer_reports_what_uncertain_plants_leave_of_its_error_at_rest(tmp_path: Path):
    rng = np.random.default_rng(NUMBER + 1)
    A, B, C = np.array([[-1.0, 2.0], [-3.0, -rng.uniform(2, 6)]]), np.array([[0.0], [rng.uniform(1, 3)]]), np.array([[1.0, 0.0]])
    plant = {"A": A.tolist(), "B": B.tolist(), "C": C.tolist()}
    report = made(tmp_path, "observer", plant, "--bandwidth=2", "--reference=4", "--uncertainty=10%")
    text = tomllib.loads((tmp_path / "C.toml").read_text())["start"]
    poles = np.array(text["observer_pole_real"]) + 1j * np.array(text["observer_pole_imag"])
    values = {finding["name"]: finding["value"] for finding in report["findings"]}
    assert values["decay of the estimate's error"] == pytest.approx(np.log(50) / min(-poles.real), rel=0.01)
    # Written anew: the gain by pole placement of two states, and the errors at all corners.
    trace, determinant = -poles.sum().real, poles.prod().real
    k = np.linalg.solve(np.array([[1.0, 0.0], [-A[1, 1], A[0, 1]]]), [trace + np.trace(A), determinant - np.linalg.det(A)])[
        :, None
    ]
    largest = np.zeros(2)
    for corner in np.ndindex(*[2] * 5):
        signs = 0.1 * (2 * np.array(corner) - 1)
        A_t, B_t = A * (1 + signs[:4].reshape(2, 2)), B * (1 + np.array([[0.0], [signs[4]]]))
        rest = np.linalg.solve(np.block([[A_t, B_t], [C, np.zeros((1, 1))]]), [0, 0, 4])
        x, u = rest[:2], rest[2:]
        estimate = np.linalg.solve(A - k @ C, -(k @ C @ x + B @ u))
        largest = np.maximum(largest, abs(estimate - x))
    found = np.array(values["error of the estimate at rest"]).ravel()
    # Random corners and points within: near the worst, never beyond.
    assert (found <= 1.005 * largest).all() and (found >= 0.9 * largest).all(), (found, largest)
