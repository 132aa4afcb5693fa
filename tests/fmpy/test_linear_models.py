"""Linear models of unstable plants of other tools, in C and in Python (PythonFMU), that offer co-simulation only. The plants
are known by their equations."""

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path

import adaptive_fmu
import numpy as np
import pytest
from conftest import PROGRAM
from test_foreign_plants import C_ONLY, FOREIGN, PYTHON, needs_python

LIMIT = 20.0


@dataclass
class Plant:
    """Rates of change of x with the input u, as text that is C and Python, and a point at which they are 0."""

    states: list[str]
    rates: list[str]
    start: list[float]

    def at(self, x: np.ndarray, u: float) -> np.ndarray:
        return np.array([eval(rate, {"sin": sin, "cos": cos, "x": x, "u": u}) for rate in self.rates])  # noqa: S307

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """A and B by central differences."""
        x, columns = np.array(self.start), []
        assert np.abs(self.at(x, 0.0)).max() < 1e-9
        for k in range(len(x)):
            change = 1e-5 * max(abs(x[k]), 1e-2) * np.eye(len(x))[k]
            columns.append((self.at(x + change, 0.0) - self.at(x - change, 0.0)) / (2 * change[k]))
        return np.array(columns).T, (self.at(x, 1e-5) - self.at(x, -1e-5)) / 2e-5


def cart_pendulum() -> Plant:
    """Upright; 1 kg, and .2 kg on a rod of .5 m; friction of the cart."""
    mass = "(1.0 + 0.2 * sin(x[2]) * sin(x[2]))"
    force = "(u - 0.1 * x[1])"
    sideways = f"({force} + 0.2 * sin(x[2]) * (0.5 * x[3] * x[3] - 9.81 * cos(x[2]))) / {mass}"
    turning = (
        f"(-{force} * cos(x[2]) - 0.1 * x[3] * x[3] * cos(x[2]) * sin(x[2]) + 1.2 * 9.81 * sin(x[2])) / (0.5 * {mass})"
    )
    return Plant(["position", "velocity", "angle", "rate"], ["x[1]", sideways, "x[3]", turning], [0.0] * 4)


def maglev() -> Plant:
    """A ball of 50 g 1 cm below a magnet; its coil has 1 Ohm and 20 mH."""
    current = 0.01 * (0.05 * 9.81 / 1e-4) ** 0.5
    lift = "0.002 * (x[2] / x[0]) * (x[2] / x[0])"
    return Plant(["gap", "velocity", "current"], ["x[1]", f"9.81 - {lift}", f"({current!r} + u - x[2]) / 0.02"], [0.01, 0.0, current])


def random_plant(seed: int) -> Plant:
    """Two to four states, one of which grows; the fastest rate is within 3 … 15 rad/s, and what isn't linear is as large
    for values of 1."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    a = random.normal(size=(n, n))
    a += (random.uniform(0.1, 1.0) - max(np.linalg.eigvals(a).real)) * np.eye(n)
    a *= random.uniform(3.0, 15.0) / max(np.abs(np.linalg.eigvals(a)))
    b, bend = random.normal(size=n), random.uniform(0.5, 2.0) * np.abs(a).max(axis=1)

    def rate(i: int) -> str:
        linear = " + ".join(f"{a[i, j]!r} * x[{j}]".replace("np.float64", "") for j in range(n))
        k = (i + 1) % n
        return f"{linear} + {b[i]!r} * u * cos(x[{k}]) - {bend[i]!r} * (x[{k}] - sin(x[{k}]) + 0.3 * (1.0 - cos(x[{k}])))"

    rates = [rate(i).replace("np.float64", "") for i in range(n)]
    return Plant([f"z{k}" for k in range(n)], rates, [0.0] * n)


PLANTS = {"cart-pendulum": cart_pendulum(), "maglev": maglev(), "random 1": random_plant(1), "random 2": random_plant(2)}


def in_c(plant: Plant, folder: Path, sets_starts: bool) -> Path:
    rates = "".join(f"dx[{k}] = {rate};\n" for k, rate in enumerate(plant.rates))
    values = ", ".join(map(repr, plant.start))
    (folder / "rates.h").write_text(
        f"#define STATES {len(plant.states)}\n#define START_VALUES {values}\n#define LIMIT {LIMIT}\n"
        f"static void rates(const double *x, double u, double *dx) {{\n{rates}}}\n"
    )
    library = folder / "Plant.so"
    compile_it = ["cc", "-shared", "-fPIC", "-O1", "-w", "-fvisibility=hidden", f"-I{folder}", f"-I{FOREIGN}"]
    subprocess.run([*compile_it, "-o", library, FOREIGN / "plant.c", "-lm"], check=True)

    def variable(k: int, name: str, start: float) -> str:
        exact = f'initial="exact"><Real start="{start!r}"/>' if sets_starts else "><Real/>"
        head = f'<ScalarVariable name="{name}" valueReference="{k + 2}" causality="output" variability="continuous" '
        return f"{head}{exact}</ScalarVariable>"

    states = "".join(variable(k, *state) for k, state in enumerate(zip(plant.states, plant.start, strict=True)))
    outputs = "".join(f'<Unknown index="{k + 3}"/>' for k in range(len(plant.states)))
    with zipfile.ZipFile(folder / "Plant.fmu", "w") as archive:
        archive.write(library, "binaries/linux64/Plant.so")
        archive.writestr(
            "modelDescription.xml",
            f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Plant" guid="plant" generationTool="by hand">
  <CoSimulation modelIdentifier="Plant" canHandleVariableCommunicationStepSize="true"/>
  <DefaultExperiment startTime="0" stopTime="2" stepSize="0.001"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input" variability="continuous">
      <Real min="-{LIMIT}" max="{LIMIT}" start="0"/></ScalarVariable>
    <ScalarVariable name="gain" valueReference="1" causality="parameter" variability="fixed"><Real start="1"/></ScalarVariable>
    {states}
  </ModelVariables>
  <ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns/></ModelStructure>
</fmiModelDescription>
""",
        )
    return folder / "Plant.fmu"


def in_python(plant: Plant, folder: Path, sets_starts: bool) -> Path:
    exact = "initial=Fmi2Initial.exact, start=value" if sets_starts else ""
    (folder / "plant.py").write_text(
        f"""
from math import cos, sin

from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real

STATES = {plant.states!r}


class Plant(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.gain = 0.0, 1.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(
            Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable, start=1.0)
        )
        for name, value in zip(STATES, {plant.start!r}):
            setattr(self, name, value)
            self.register_variable(Real(name, causality=Fmi2Causality.output, {exact}))

    def rates(self, x):
        u = self.gain * min(max(self.u, -{LIMIT}), {LIMIT})
        return [{", ".join(plant.rates)}]

    def do_step(self, current_time, step_size):
        x, h = [getattr(self, name) for name in STATES], step_size / 2
        moved = lambda k, h: [a + h * b for a, b in zip(x, k)]
        for _ in range(2):
            k1 = self.rates(x)
            k2 = self.rates(moved(k1, h / 2))
            k3 = self.rates(moved(k2, h / 2))
            k4 = self.rates(moved(k3, h))
            x = [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]
        for name, value in zip(STATES, x):
            setattr(self, name, value)
        return True
"""
    )
    words = [sys.executable, "-m", "pythonfmu", "build", "-f", folder / "plant.py", "-d", folder, "--no-external-tool"]
    built = subprocess.run(words, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "Plant.fmu"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The unit of a plant, built once."""
    units: dict[tuple, Path] = {}

    def get(build: Callable, name: str, sets_starts: bool) -> Path:
        key = build, name, sets_starts
        if key not in units:
            units[key] = build(PLANTS[name], tmp_path_factory.mktemp("plant"), sets_starts)
        return units[key]

    return get


def asked(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [PROGRAM, *words], env={**os.environ, **PYTHON}, capture_output=True, text=True, check=False, timeout=120
    )


def linear(unit: Path, *options: str) -> dict:
    answer = asked("linearise", unit, "--json", *options)
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout)


def error(plant: Plant, found: dict) -> float:
    """The largest distance of eigenvalues, relative to the largest one."""
    wanted = np.linalg.eigvals(plant.matrices()[0])
    there = np.linalg.eigvals(np.array(found["A"]))
    apart = np.abs(wanted[:, None] - there)
    return max(apart.min(axis=0).max(), apart.min(axis=1).max()) / np.abs(wanted).max()


def cases() -> Iterator[object]:
    """Each plant in both languages, with both steps and three gains; in Python, where a unit takes long to start, with one."""
    for k, name in enumerate(PLANTS):
        for step in ["0.001", "0.005"]:
            for sets_starts, way in [(False, "inputs"), (True, "start values")]:
                gains = [1e-3, 1.0, 1e3]
                yield pytest.param(in_c, sets_starts, name, step, gains, id=f"{name}-{step}-C-{way}", marks=C_ONLY)
        step, gain = [("0.001", 1e3), ("0.005", 1.0), ("0.005", 1e3), ("0.001", 1e-3)][k]
        yield pytest.param(in_python, True, name, step, [gain], id=f"{name}-{step}-PythonFMU", marks=needs_python)


@pytest.mark.parametrize(("build", "sets_starts", "name", "step", "gains"), [*cases()])
def test_an_unstable_plant_is_linearised(
    build: Callable, sets_starts: bool, name: str, step: str, gains: list[float], built: Callable
) -> None:
    plant, unit = PLANTS[name], built(build, name, sets_starts)
    b = plant.matrices()[1]
    for gain in gains:
        found = linear(unit, "--step", step, "--set", f"gain={gain!r}")
        assert error(plant, found) < 1e-3, found
        np.testing.assert_allclose(np.ravel(found["B"]), b * gain, atol=1e-3 * gain * np.abs(b).max())
        method = found["method"]
        assert (method["by"], method["step"]) == ("responses", float(step)) and method["difference"] < 0.01
        assert sets_starts or method["starts"] == 0


@C_ONLY
def test_new_designs_for_the_unstable_plant_that_was_given(built: Callable, tmp_path: Path) -> None:
    plant, unit = PLANTS["cart-pendulum"], built(in_c, "cart-pendulum", False)
    made = asked(*["new", "state-space", "--name", "P", "--plant", unit, "--step", "0.005", "--out", tmp_path / "P.toml"])
    assert made.returncode == 0 and "sampled every 0.005 s" in made.stderr and "two extrapolations" in made.stderr, made
    described = tomllib.loads((tmp_path / "P.toml").read_text())
    assert error(plant, {"A": described["structure"]["A"]}) < 1e-3


@C_ONLY
def test_python_sets_the_communication_step(built: Callable) -> None:
    found = adaptive_fmu.linearise(built(in_c, "cart-pendulum", False), step=0.005)
    assert found.method["step"] == 0.005
    assert error(PLANTS["cart-pendulum"], {"A": found.A}) < 1e-3


@C_ONLY
def test_it_is_linearised_where_a_simulation_has_brought_it(built: Callable) -> None:
    """It moves there: its start values set it there too, and one step tells more than many."""
    plant, options = PLANTS["cart-pendulum"], ["--at", "0.2", "--set", "u=0.001"]
    by_starts = linear(built(in_c, "cart-pendulum", True), *options)
    by_inputs = linear(built(in_c, "cart-pendulum", False), *options)
    assert [state["value"] for state in by_starts["states"]] == [state["value"] for state in by_inputs["states"]]
    assert max(error(plant, by_starts), error(plant, by_inputs)) < 1e-3


@C_ONLY
def test_an_input_at_its_bound_is_moved_to_the_side_that_acts(built: Callable) -> None:
    """The unit limits it: the mean of both sides would be half of the gain."""
    found = linear(built(in_c, "cart-pendulum", True), "--set", f"u={LIMIT}")
    assert found["B"][1] == pytest.approx([1.0], rel=1e-2) and found["B"][3] == pytest.approx([-2.0], rel=1e-2)


@C_ONLY
def test_what_is_not_certain_is_refused_with_what_helps(built: Callable) -> None:
    unit = built(in_c, "cart-pendulum", False)
    hides = asked("linearise", unit, "--states", "position,velocity")
    assert hides.returncode == 1 and "condition number of the fit is" in hides.stderr, hides
    assert all(word in hides.stderr for word in ["--states", "grows by a factor of 1.0", "0.001 s"]), hides.stderr
    # It grows by a factor of 11 in a step, and its stable modes are gone.
    too_long = asked("linearise", unit, "--step", "0.5")
    assert too_long.returncode == 1 and "0.5 s" in too_long.stderr and "shorter" in too_long.stderr, too_long
    assert asked("linearise", unit, "--step", "0").returncode == 2
