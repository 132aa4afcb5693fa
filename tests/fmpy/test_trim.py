"""Operating points with free inputs and wanted outputs, against formulas and solvers that know nothing of the program."""

import json
import re
from math import asin, atan, atan2, cos, pi, sin, sqrt
from pathlib import Path
from random import Random

import adaptive_fmu as package
import numpy as np
import pytest
from conftest import adaptive_fmu
from independent_plants import Robot, twin_rotor_rate
from independent_vehicles import Submarine, rotation
from master import Fmu
from scipy.optimize import root
from test_linearise import NO_DERIVATIVES, edited, fails, linearise, names, values

ALL = {"Quadrotor": 4, "MaresAuv": 6, "TwoLinkRobot": 2, "TwinRotor": 2}


def inputs(name: str) -> list[str]:
    """Options that free all inputs."""
    return ["--free", ",".join(f"u[{k + 1}]" for k in range(ALL[name]))]


def wants(**values: float) -> list[str]:
    return [word for name, value in values.items() for word in ("--want", f"{name}={float(value)!r}")]


def at(linear: dict) -> dict[str, float]:
    """Values at the operating point by name."""
    return {q["name"]: q["value"] for kind in ("states", "inputs", "outputs") for q in linear[kind]}


def applied(linear: dict) -> np.ndarray:
    return values(linear["inputs"])


HOVER = [*inputs("Quadrotor"), *wants(**{"y[3]": 1.0}), "--set", "m=0.6"]
PUSHED = [*inputs("Quadrotor"), *wants(**{"y[3]": 1.0, "y[4]": 0.2}), "--set", "m=0.6", "--set", "disturbance_force[1]=1"]
CRUISE = [*inputs("MaresAuv"), *wants(**{"der(x[1])": 1.5, "y[4]": 0.0, "y[5]": 0.0, "y[6]": 0.0})]
INCLINED = [*inputs("MaresAuv"), *wants(**{"der(x[1])": 1.0, "y[4]": 0.0, "y[5]": -0.1, "y[6]": 0.0})]
DRAG = 1.5 + 1025 / 2 * 0.2 * pi / 4 * 0.2**2 * 1.5**2
G_1 = 9.81 * ((3.2 * 0.25 + 2 * 0.5) * cos(0.5) + 2 * 0.2 * cos(-0.1))
G_2 = 9.81 * 2 * 0.2 * cos(-0.1)

TABLE = [
    ("Quadrotor", HOVER, [5.886, 0, 0, 0], (18, 18, 21)),
    ("Quadrotor", PUSHED, [sqrt(5.886**2 + 1), 0, 0, 0], (19, 19, 21)),
    ("MaresAuv", CRUISE, [DRAG, 0, 0, 0, 0, 0], (15, 15, 18)),
    ("MaresAuv", INCLINED, [4.3802595, 0, -1.7562648, 0, 2.7635342, 0], (15, 15, 18)),
    ("TwoLinkRobot", [*inputs("TwoLinkRobot"), *wants(**{"y[1]": 0.5, "y[2]": -0.6})], [G_1, G_2], (6, 6, 6)),
    ("TwinRotor", [*inputs("TwinRotor"), *wants(**{"y[1]": 0.3, "y[2]": 0.2})], [0.8218528, -0.2762517], (9, 9, 9)),
]


@pytest.mark.parametrize("by", ["derivatives", "differences"])
@pytest.mark.parametrize(("name", "options", "u", "sizes"), TABLE, ids=range(len(TABLE)))
def test_operating_points_that_were_computed_before(
    name: str, options: list[str], u: list[float], sizes: tuple[int, int, int], by: str, fmu, tmp_path: Path
) -> None:
    unit = fmu(name).path if by == "derivatives" else edited(fmu(name), tmp_path, NO_DERIVATIVES)
    linear = linearise(unit, *options)
    assert linear["method"]["by"] == by
    assert applied(linear)[: len(u)] == pytest.approx(u, abs=6e-8)
    trim = linear["trim"]
    assert (trim["rank"], trim["equations"], trim["unknowns"]) == sizes
    assert 0 < trim["steps"] <= 8 and trim["new_starts"] == 0 and trim["at_bound"] == []
    assert linear["unique"] == (sizes[0] == sizes[2]) == (trim["can_move"] == [])
    point = at(linear)
    for wanted in trim["wanted"]:
        if not wanted["name"].startswith("der("):
            assert point[wanted["name"]] == pytest.approx(wanted["value"], abs=1e-9)


def test_a_quadrotor_hovers_where_it_is_and_stays_as_it_is_turned() -> None:
    assert applied(linearise("Quadrotor", *HOVER))[0] == pytest.approx(5.886, abs=1e-12)
    point = at(found := linearise("Quadrotor", *HOVER))
    assert [point[f"x[{k}]"] for k in (3, 7, 8)] == pytest.approx([1, 0, 0], abs=1e-9)
    assert point["x[9]"] == pytest.approx(0.20012, abs=5e-6)
    assert found["trim"]["can_move"] == ["x[1]", "x[2]", "x[9]"] and found["steady_state"] is True
    linear_there = linearise("Quadrotor", *HOVER, "--hold", "x[9]")
    assert at(linear_there)["x[9]"] == 0.2 and linear_there["trim"]["held"] == ["x[9]"] and linear_there["trim"]["unknowns"] == 20
    alone = linearise("Quadrotor", "--free", "u[1]", "--set", "m=0.6")
    assert applied(alone)[:4] == pytest.approx([5.886, 0, 0, 0], abs=1e-9)
    assert [alone["trim"][key] for key in ("rank", "equations", "unknowns")] == [14, 17, 18]
    pushed = at(linearise("Quadrotor", *PUSHED))
    assert pushed["u[1]"] == pytest.approx(5.970343, abs=5e-7)
    assert pushed["x[8]"] == pytest.approx(atan(-cos(0.2) / 5.886), abs=1e-9) == pytest.approx(-0.1649944, abs=5e-8)
    assert pushed["x[7]"] == pytest.approx(asin(-sin(0.2) / sqrt(5.886**2 + 1)), abs=1e-9) == pytest.approx(-0.0332822, abs=5e-8)


def test_a_twin_rotor_has_the_commands_of_its_rotors() -> None:
    point = at(linearise(*[TABLE[5][0], *TABLE[5][1]]))
    assert [point["x[5]"], point["x[6]"]] == pytest.approx([0.9040381, -0.2210014], abs=5e-8)
    assert point["m1_lag"] == pytest.approx(0.0945665, abs=5e-8) == pytest.approx(0.32 * sin(0.3), abs=5e-8)


@pytest.mark.parametrize("seed", range(8))
def test_a_quadrotor_leans_into_the_wind(seed: int) -> None:
    random = Random(seed)
    m, height, yaw = random.uniform(0.3, 1.2), random.uniform(-5, 5), random.uniform(-3, 3)
    force = np.array([random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-1, 1)])
    options = [*inputs("Quadrotor"), *wants(**{"y[3]": height, "y[4]": yaw})]
    start = {f"x0[{k}]": random.uniform(-1, 1) for k in range(1, 13)}
    start |= {"m": m, "u[1]": random.uniform(1, 14)} | {f"disturbance_force[{k + 1}]": float(force[k]) for k in range(3)}
    point = at(linearise("Quadrotor", *options, **start))
    needed = np.array([0, 0, m * 9.81]) - force
    thrust = np.linalg.norm(needed)
    x, y, z = needed / thrust
    roll, pitch = asin(x * sin(yaw) - y * cos(yaw)), atan2(x * cos(yaw) + y * sin(yaw), z)
    np.testing.assert_allclose(rotation(np.array([roll, pitch, yaw]))[:, 2] * thrust, needed, atol=1e-12)
    assert [point[name] for name in ("u[1]", "x[7]", "x[8]", "x[9]", "x[3]")] == pytest.approx(
        [thrust, roll, pitch, yaw, height], abs=1e-8
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_submarine_is_carried_by_the_forces_that_its_energy_and_drag_ask_for(seed: int) -> None:
    random = Random(seed)
    speed, sink, pitch, yaw = random.uniform(0.3, 2), random.uniform(-0.3, 0.3), random.uniform(-0.5, 0.5), random.uniform(-2, 2)
    own = Submarine(m=random.uniform(20, 50), z_g=random.uniform(0.002, 0.01), axial_drag=random.uniform(0.1, 0.4))
    wanted = {"der(eta[1])": speed, "der(eta[3])": sink, "y[4]": 0.0, "y[5]": pitch, "y[6]": yaw}
    linear = linearise("MaresAuv", *inputs("MaresAuv"), *wants(**wanted), m=own.m, z_g=own.z_g, axial_drag=own.axial_drag)
    x = np.array([0, 0, 0, 0, pitch, yaw, speed, 0, sink, 0, 0, 0], dtype=float)
    found = root(lambda u: own.rate(x, u)[6:], np.zeros(6), tol=1e-12)
    assert found.success and linear["steady_state"] is False
    assert applied(linear)[:6] == pytest.approx(found.x, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_the_torques_of_its_weight_balance_a_robot(seed: int) -> None:
    random = Random(seed)
    q = np.array([random.uniform(-3, 3), random.uniform(-3, 3)])
    own = Robot(mass=(random.uniform(1, 5), random.uniform(1, 5)), length=(random.uniform(0.3, 0.8), random.uniform(0.3, 0.8)))
    set_ = {f"{name}{k + 1}": value for name, pair in (("m", own.mass), ("l", own.length)) for k, value in enumerate(pair)}
    linear = linearise("TwoLinkRobot", *inputs("TwoLinkRobot"), *wants(**{"y[1]": q[0], "y[2]": q[1]}), **set_)
    weight = [(own.potential_energy(q + e * 1e-6) - own.potential_energy(q - e * 1e-6)) / 2e-6 for e in np.eye(2)]
    assert applied(linear)[:2] == pytest.approx(weight, abs=1e-7) and linear["unique"] is True


@pytest.mark.parametrize("seed", range(6))
def test_a_twin_rotor_is_where_another_solver_finds_it(seed: int) -> None:
    random = Random(seed)
    psi, phi = random.uniform(-0.2, 1.2), random.uniform(-2, 2)
    linear = linearise("TwinRotor", *inputs("TwinRotor"), *wants(**{"y[1]": psi, "y[2]": phi}))

    def rates(z: np.ndarray) -> np.ndarray:
        s, u = np.array([psi, 0, phi, 0, *z[:3]]), z[3:]
        return twin_rotor_rate(0.0, s, u)[[1, 3, 4, 5, 6]]

    point = at(linear)
    found = root(rates, [point["x[5]"] + 0.1, point["x[6]"] + 0.1, 0, 0, 0], tol=1e-13)
    assert found.success and applied(linear)[:2] == pytest.approx(found.x[3:], abs=1e-7)


def bounded(fmu: Fmu, folder: Path, least: float, most: float) -> Path:
    """The quadrotor with limits of its thrust in its description."""
    limits = (
        r'(name="u\[1\]".*?<Real unit="N") nominal="5.0" start="4.905"',
        rf'\1 nominal="5.0" min="{least}" max="{most}" start="4.905"',
    )
    return edited(fmu, folder, limits)


@pytest.mark.parametrize("number", range(3))
def test_random_starts_lead_to_the_nearest_hover_within_bounds(number: int, fmu, tmp_path: Path) -> None:
    limited, random = bounded(fmu("Quadrotor"), tmp_path, 0.0, 15.0), Random(f"hover {number}")
    for _ in range(12):
        size = [5, 5, 5, 2, 2, 2, 1.4, 1.4, 3, 3, 3, 3]
        start = {f"x0[{k + 1}]": random.uniform(-s, s) for k, s in enumerate(size)}
        start |= {"u[1]": random.uniform(0, 15), "m": 0.6}
        start |= {f"u[{k}]": random.uniform(-0.1, 0.1) for k in (2, 3, 4)}
        linear = linearise(limited, *inputs("Quadrotor"), "--want", "y[3]=1", **start)
        point, trim = at(linear), linear["trim"]
        # Upright, not inverted with negative thrust, and no turn further.
        assert [point[f"u[{k}]"] for k in (1, 2, 3, 4)] == pytest.approx([5.886, 0, 0, 0], abs=1e-8), start
        assert [point["x[7]"], point["x[8]"]] == pytest.approx([0, 0], abs=1e-8), start
        assert trim["steps"] <= 14 and trim["new_starts"] == 0, start


def test_an_input_at_its_bound_is_named(fmu, tmp_path: Path) -> None:
    weak = bounded(fmu("Quadrotor"), tmp_path, 0.0, 5.0)
    error = fails(weak, *HOVER)
    assert "der(x[6]) = -1.476667 m/s2 remains" in error and "u[1] is at its largest value, 5 N" in error
    # The climb that is wanted is the one of the largest thrust.
    options = ["--set", "m=0.5", "--free", "u[1]", "--want", f"der(x[6])={5 / 0.5 - 9.81!r}"]
    linear = linearise(weak, *options)
    bound = {"name": "u[1]", "value": 5.0, "unit": "N", "is_largest": True}
    assert linear["trim"]["at_bound"] == [bound] and applied(linear)[0] == 5.0
    answer = adaptive_fmu("linearise", weak, *options)
    assert "u[1] is at its largest value, 5 N\n" in answer.stdout and ", operating point at t = 0 s" in answer.stdout


def test_where_nothing_is_free_the_message_proposes_inputs() -> None:
    error = fails("Quadrotor", "--want", "y[3]=1", "--set", "m=0.6")
    assert "no operating point was found from the start values, nor from 5 others near them" in error
    assert "der(x[6]) = -1.635 m/s2 remains" in error and "18 equations in 17 unknowns" in error
    assert re.search(r"An input that would help if it were free: --free u\[1\]$", error.strip())
    # The balance of yaw asks for the other voltage, which acts by the state of its rotor.
    assert "An input that would help if it were free: --free u[2]" in fails("TwinRotor", "--free", "u[1]", "--want", "y[1]=0.3")
    # No input acts on a height that can't be both.
    error = fails("Quadrotor", *inputs("Quadrotor"), "--want", "y[3]=1", "--want", "x[3]=2")
    assert "y[3] = 1.5 m instead of 1 m" in error and "x[3] = 1.5 m instead of 2 m" in error and "--free" not in error


def test_an_input_without_effect_is_named() -> None:
    # The plant's own limit of the thrust is at 15 N.
    error = fails("Quadrotor", *HOVER, "--set", "u[1]=20")
    assert "u[1] has no effect there" in error and "--set u[1]=VALUE" in error and "der(x[6])" in error


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--free", "v[1]"], ["there is no continuous Real input named `v[1]`", "u[1]"]),
        (["--free", "u[5]"], ["`u[5]`", "within 1 … 4 in `u`"]),
        (["--hold", "y[1]"], ["there is no continuous state named `y[1]`", "x[1]"]),
        (["--want", "m=1"], ["there is no Real output, local variable or derivative of a state named `m`"]),
        (["--want", "u[1]=1"], ["named `u[1]`"]),
        (["--want", "der(y[9])=1"], ["named `der(y[9])`"]),
        (["--want", "y[3]=1", "--want", "y[3]=2"], ["y[3]", "already has a wanted value"]),
        (["--want", "x[3]=1", "--hold", "x[3]"], ["--hold x[3] is not allowed with --want x[3]"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_names_that_are_wrong_are_refused(options: list[str], words: list[str]) -> None:
    error = fails("Quadrotor", *options)
    assert all(word in error for word in words), error


@pytest.mark.parametrize("option", ["--want=y[3]", "--want=y[3]=high", "--want=y[3]=nan", "--free=", "--hold=,"])
def test_options_that_cant_be_read_are_refused(option: str) -> None:
    assert adaptive_fmu("linearise", "Quadrotor", option).returncode == 2


def test_local_variables_and_outputs_that_equal_states_may_be_wanted(fmu, tmp_path: Path) -> None:
    options = [*inputs("TwinRotor"), *wants(**{"m[1]": 0.1, "y[2]": 0.2})]
    for unit in (fmu("TwinRotor").path, edited(fmu("TwinRotor"), tmp_path, NO_DERIVATIVES)):
        point = at(linearise(unit, *options))
        assert point["x[1]"] == pytest.approx(asin(0.1 / 0.32), abs=1e-8) and point["x[3]"] == pytest.approx(0.2, abs=1e-9)
    by_output, by_state = (linearise("MaresAuv", "--free", "u[1]", "--want", f"der({of}[1])=1.5") for of in ("x", "eta"))
    assert by_output == by_state and by_output["trim"]["wanted"][0] == {"name": "der(eta[1])", "value": 1.5, "unit": "m/s"}
    # The seventh output is a rate, which equals no state.
    assert "der(x[7])" in fails("MaresAuv", "--free", "u[1]", "--want", "der(x[7])=1")


def test_the_text_states_how_many_operating_points_there_are() -> None:
    lines = adaptive_fmu("linearise", "Quadrotor", *HOVER).stdout.splitlines()
    assert lines[0] == "Quadrotor, steady state at t = 0 s, by its exact derivatives"
    assert re.fullmatch(r"18 equations in 21 unknowns, of rank 18, solved in [4-7] Newton steps", lines[1])
    assert lines[2].endswith("is one of many; these can move: x[1], x[2], x[9]")
    unique = adaptive_fmu("linearise", *[TABLE[4][0], *TABLE[4][1]]).stdout
    assert "6 equations in 6 unknowns, of rank 6" in unique and "one of many" not in unique


def test_without_model_exchange_there_is_no_search(fmu, tmp_path: Path) -> None:
    other = edited(fmu("TwinRotor"), tmp_path, (r"<ModelExchange.*?(/>|</ModelExchange>)", ""))
    assert "does not support model exchange, which --steady-state, --free, --want and --hold need" in fails(
        other, "--free", "u[1]"
    )


def test_inputs_of_a_loop_have_their_names_there() -> None:
    error = fails("3.2.1-cosine", "--free", "u_manual[1]")
    assert "no continuous Real input named `u_manual[1]`" in error and "controller.u_manual[1]" in error


def test_new_and_design_take_the_operating_point_of_an_fmu(fmu, tmp_path: Path) -> None:
    words = ["--free", "u[1],u[2]", *wants(**{"y[1]": 0.3, "y[2]": 0.2})]
    linear = linearise(fmu("TwinRotor").path, *words)
    file = tmp_path / "Trimmed.toml"
    made = adaptive_fmu("new", "state-space", "--name", "Trimmed", "--plant", fmu("TwinRotor").path, *words, "--out", file)
    assert made.returncode == 0 and "t = 0 s and u[1] = 0.8218528 V, u[2] = -0.2762517 V" in made.stderr
    found = package.linearise(file)
    np.testing.assert_allclose(found.A, linear["A"], atol=1e-12)
    np.testing.assert_allclose(found.B[:, :2], linear["B"], atol=1e-12)
    answer = adaptive_fmu(
        "design",
        fmu("TwinRotor").path,
        *words,
        "--output",
        "y[1],y[2]",
        "--bandwidth",
        "2",
        "--kinds",
        "pid",
        "--out",
        tmp_path / "d",
    )
    assert answer.returncode in (0, 3) and "u[1] = 0.8218528 V" in answer.stderr, answer


@pytest.mark.parametrize("command", [["new", "pid", "--name", "P"], ["new", "pid", "--name", "P", "--plant"], ["design"]])
def test_matrices_have_no_operating_point(command: list[str], tmp_path: Path) -> None:
    (tmp_path / "plant.json").write_text(json.dumps({"A": [[-1]], "B": [[1]], "C": [[1]]}))
    is_alone = command[-1] == "P"
    more = [] if is_alone else ["plant.json"]
    settle = ["--bandwidth", "2"] if command[0] == "design" else []
    answer = adaptive_fmu(*command, *more, *settle, "--free", "u", folder=tmp_path)
    assert answer.returncode == 1 and "--free, --want and --hold are for an FMU as the plant" in answer.stderr
    assert ("--plant FILE.fmu" if is_alone else "linear already") in answer.stderr


def test_python_takes_the_operating_point_and_hands_it_over() -> None:
    linear = package.linearise(
        "Quadrotor", free=[f"u[{k}]" for k in range(1, 5)], want={"y[3]": 1}, hold=["x[9]"], values={"m": 0.6}
    )
    assert linear.operating_point.loc["u[1]", "value"] == pytest.approx(5.886, abs=1e-9)
    assert linear.trim is not None and linear.trim["can_move"] == ["x[1]", "x[2]"] and linear.trim["held"] == ["x[9]"]
    assert package.linearise("Quadrotor").trim is None
    with pytest.raises(package.Error, match=r"An input that would help if it were free: free u\[1\]"):
        package.linearise("Quadrotor", want={"y[3]": 1}, values={"m": 0.6})
    with pytest.raises(package.ArgumentError, match="list of names"):
        package.linearise("Quadrotor", free="u[1]")
    both = package.linearise("TwinRotor", free=["u[1]", "u[2]"], want={"y": [0.3, 0.2]})
    assert both.operating_point.loc["u[1]", "value"] == pytest.approx(0.8218528, abs=6e-8)
    assert names([{"name": name} for name in both.inputs]) == ["u[1]", "u[2]"]


def test_the_json_of_an_operating_point_is_a_plant_for_new(tmp_path: Path) -> None:
    linear = linearise("TwoLinkRobot", *inputs("TwoLinkRobot"), *wants(**{"y[1]": 0.5, "y[2]": -0.6}))
    (tmp_path / "plant.json").write_text(json.dumps(linear))
    made = adaptive_fmu("new", "state-space", "--name", "Robot", "--plant", "plant.json", folder=tmp_path)
    assert made.returncode == 0, made
    np.testing.assert_allclose(package.linearise(tmp_path / "Robot.toml").A, linear["A"], atol=1e-12)
