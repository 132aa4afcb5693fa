"""PID and ADRC controllers that know what the actuators achieve: behind a mixer, beside equations that are typed without any FMU.
A league's mixer."""

from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from independent_rotors import INERTIA, Rotors

THRUST, UNTIL, STEP = 4.905, 1.5, 1e-3
LAWS = {"pid": ["K_p", "K_i", "K_d", "N"], "ladrc": ["omega_c", "omega_o"]}
ROWS = {"pid": 6, "ladrc": 9}

DESCRIPTION = """
name = "Turned"
model = "composite"
description = "Three angles behind the rotors of a quadrotor"
[structure]
connections = [{connections}]
[[structure.parts]]
name = "mixer"
model = "quadrotor-mixer"
[[structure.parts]]
name = "plant"
model = "state-space"
[structure.parts.structure]
A = {A}
B = {B}
C = {C}
units = {{ y = ["rad", "rad", "rad"], u = ["N.m", "N.m", "N.m"] }}
[[structure.parts]]
name = "law"
model = "{law}"
[structure.parts.structure]
channels = 3
{structure}
units = {{ y = ["rad", "rad", "rad"], u = ["N.m", "N.m", "N.m"] }}
[structure.parts.start]
{start}
[names]
"""


def drawn(law: str, seed: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Gains, a matrix from what the channels ask for to the torques, and steps of the reference that the rotors can't follow."""
    random = np.random.default_rng(seed)
    sizes = {"K_p": 60.0, "K_i": 80.0, "K_d": 14.0, "N": 90.0, "omega_c": 12.0, "omega_o": 30.0}
    gains = {name: sizes[name] * random.uniform(0.7, 1.3, 3) for name in LAWS[law]}
    torques = np.diag(INERTIA) + 0.1 * min(INERTIA) * random.uniform(-1.0, 1.0, (3, 3))
    return gains, torques, np.array([0.4, -0.3, 0.5]) * random.uniform(0.8, 1.2, 3)


def flown(law: str, seed: int, knows: bool = True) -> np.ndarray:
    """Angles and the torques that the rotors achieve, a row for each millisecond, by Runge's and Kutta's method."""
    gains, torques, r = drawn(law, seed)
    rotors, asked = Rotors(), np.linalg.inv(torques)

    def achieved(torque: np.ndarray) -> np.ndarray:
        return np.array(rotors.wrench(rotors.allocate((THRUST, *torque)))[1:])

    def pid(y: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        integral, w = state.reshape(2, 3)
        K_p, K_i, K_d, N = (gains[name] for name in LAWS["pid"])
        v = K_p * (r - y) + integral + K_d * N * ((r - y) - w)
        torque = achieved(torques @ v)
        tracked = asked @ (torque - torques @ v) / np.sqrt(K_d / K_i) if knows else 0.0
        return torque, np.concatenate([K_i * (r - y) + tracked, N * ((r - y) - w)])

    def ladrc(y: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z = state.reshape(3, 3)
        omega_c, omega_o = (gains[name] for name in LAWS["ladrc"])
        wanted = torques @ (omega_c**2 * (r - z[0]) - 2 * omega_c * z[1] - z[2])
        torque, e = achieved(wanted), y - z[0]
        driven = asked @ (torque if knows else wanted)
        return torque, np.concatenate([z[1] + 3 * omega_o * e, z[2] + 3 * omega_o**2 * e + driven, omega_o**3 * e])

    controller = {"pid": pid, "ladrc": ladrc}[law]

    def rate(x: np.ndarray) -> np.ndarray:
        torque, own = controller(x[:3], x[6:])
        return np.concatenate([x[3:6], torque / np.array(INERTIA), own])

    x = np.zeros(6 + ROWS[law])
    if law == "pid":
        x[9:] = r
    rows, span = [], STEP / 8
    for k in range(round(UNTIL / STEP) * 8 + 1):
        if k % 8 == 0:
            rows.append(np.concatenate([x[:3], controller(x[:3], x[6:])[0]]))
        k1 = rate(x)
        k2 = rate(x + span / 2 * k1)
        k3 = rate(x + span / 2 * k2)
        x = x + span / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + span * k3))
    return np.array(rows)


def as_fmu(law: str, seed: int, folder: Path) -> np.ndarray:
    """The same of a composite."""
    gains, torques, r = drawn(law, seed)
    channels = range(1, 4)
    wires = [[f"plant.y[{k}]", f"law.y[{k}]"] for k in channels] + [[f"law.u[{k}]", f"mixer.u[{k + 1}]"] for k in channels]
    wires += [[f"mixer.achieved[{k + 1}]", f"{to}[{k}]"] for k in channels for to in ("plant.u", "law.u_achieved")]
    matrix = {"pid": ("S", torques), "ladrc": ("B_0", np.linalg.inv(torques))}[law]
    start = [f"{name} = {list(map(float, values))}" for name, values in gains.items()]
    start += [f"{matrix[0]} = {[list(map(float, row)) for row in matrix[1]]}"]
    double = np.zeros((6, 6))
    double[:3, 3:] = np.eye(3)
    file = folder / "Turned.toml"
    file.write_text(
        DESCRIPTION.format(
            connections=", ".join(f'["{one}", "{other}"]' for one, other in wires),
            A=double.tolist(),
            B=np.vstack([np.zeros((3, 3)), np.diag(1 / np.array(INERTIA))]).tolist(),
            C=np.eye(3, 6).tolist(),
            law=law,
            structure="achieved = true" + ("\norder = 2" if law == "ladrc" else ""),
            start="\n".join(start),
        )
        + '"mixer.u[1]" = "thrust"\n'
        + "".join(f'"law.r[{k}]" = "r[{k}]"\n' for k in channels)
    )
    exported = adaptive_fmu("export", file, "--out", folder)
    assert exported.returncode == 0, exported.stderr
    outputs = [f"plant.y[{k}]" for k in channels] + [f"mixer.achieved[{k + 1}]" for k in channels]
    values = {"thrust": THRUST, "relative_tolerance": 1e-9} | {f"r[{k}]": r[k - 1] for k in channels}
    found = fmpy.simulate_fmu(
        str(folder / "Turned.fmu"), stop_time=UNTIL, step_size=STEP, output_interval=STEP, start_values=values, output=outputs
    )
    return np.column_stack([found[name] for name in outputs])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("law", ["pid", "ladrc"])
def test_a_law_behind_a_mixer_is_that_of_equations_that_are_typed_without_it(law: str, seed: int, tmp_path: Path) -> None:
    found, expected, unknowing = as_fmu(law, seed, tmp_path), flown(law, seed), flown(law, seed, knows=False)
    assert found.shape == expected.shape
    assert np.abs(expected[:, 5]).max() > 0.1 and np.abs(unknowing - expected)[:, :3].max() > 0.005, "the rotors' limits matter"
    assert np.abs(found - expected)[:, :3].max() < 2e-5
    # At a limit the torque of yaw jumps where the others move fast.
    assert np.quantile(np.abs(found - expected)[:, 3:], 0.99) < 1e-3


@pytest.mark.parametrize("law", ["pid", "ladrc"])
def test_the_input_is_there_where_the_description_asks_for_it(law: str, tmp_path: Path) -> None:
    order = "order = 2\n" if law == "ladrc" else ""
    file = tmp_path / "One.toml"
    text = f'name = "One"\nmodel = "{law}"\ndescription = "One"\n[structure]\nchannels = 1\n{order}'
    inputs: Callable[[], list[str]] = lambda: [
        variable.name for variable in fmpy.read_model_description(str(tmp_path / "One.fmu")).modelVariables if variable.causality == "input"
    ]
    file.write_text(text + "achieved = true\n")
    assert adaptive_fmu("export", file, "--out", tmp_path).returncode == 0
    assert "u_achieved[1]" in inputs()
    file.write_text(text)
    assert adaptive_fmu("export", file, "--out", tmp_path).returncode == 0
    assert "u_achieved[1]" not in inputs()
    file.write_text(text + "achieved = 1\n")
    refused = adaptive_fmu("export", file, "--out", tmp_path)
    assert refused.returncode == 1 and "achieved" in refused.stderr, refused.stderr


ROTORS = """
[plant.bench.mixer]
unit = "{unit}"
set = {{ {name} = 0.0, rotor_max = 3.75 }}
without = {{ rotor_min = -1e9, rotor_max = 1e9 }}
"""


@pytest.mark.parametrize(
    ("unit", "name", "message"),
    [
        ("QuadrotorMixer", "rotor_min", None),
        ("Rotors.toml", "rotor_min", None),
        ("QuadrotorMixer", "rotors_min", "no variable `mixer.rotors_min`"),
        ("QuadrotorMixers", "rotor_min", "QuadrotorMixers"),
        ("TwoLinkRobot", "rotor_min", "TwoLinkRobot has no such variable"),
    ],
)
def test_a_mixer_is_a_unit_with_these_parameters(unit: str, name: str, message: str | None, tmp_path: Path) -> None:
    text = (ROOT / "examples" / "league" / "league.toml").read_text()
    start = text.index('[[plant]]\nname = "quadrotor"')
    plant = text[start : text.index("[plant.bench.mixer]", start)]
    entry = '[[plant.controller]]\nname = "l1"\nunit = "L1Quadrotor"\n'
    file = tmp_path / "study.toml"
    file.write_text(f'title = "One"\nabout = ""\n{plant}{ROTORS.format(unit=unit, name=name)}{entry}')
    mixer = (ROOT / "modelDescription" / "QuadrotorMixer.toml").read_text()
    (tmp_path / "Rotors.toml").write_text(mixer.replace("QuadrotorMixer", "Rotors"))
    answer = adaptive_fmu("league", "--list", "--study", file, "--out", tmp_path / "out")
    assert (answer.returncode == 0) == (message is None), answer.stderr
    assert message is None or message in answer.stderr, answer.stderr
