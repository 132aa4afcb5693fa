"""Linear systems about operating points, against differences and formulas that know nothing of the program."""

import json
import re
import zipfile
from ctypes import c_double
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
import sample
from conftest import ROOT, adaptive_fmu
from fmpy.fmi2 import FMU2Model
from master import CONTROLLER, PLANT, Fmu, tried
from scipy.optimize import brentq
from test_command_line import LOOPS

EXCITED = {"r[1]": 1.0, "x[1]": 0.3, "x[2]": -0.2}


def linearise(name: str | Path, *options: str, **values: float) -> dict:
    settings = [part for variable, value in values.items() for part in ("--set", f"{variable}={value!r}")]
    answer = adaptive_fmu("linearise", name, "--json", *options, *settings)
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    return json.loads(answer.stdout)


def fails(*arguments: str | Path) -> str:
    answer = adaptive_fmu("linearise", *arguments)
    assert (answer.returncode, answer.stdout) == (1, "") and answer.stderr.startswith("error: "), answer
    assert len(answer.stderr.splitlines()) == 1
    return answer.stderr


def edited(fmu: Fmu, folder: Path, *edits: tuple[str, str]) -> Path:
    """The FMU with another description: as a tool would write it that gives less."""
    file = folder / f"{fmu.path.stem}.fmu"
    with zipfile.ZipFile(fmu.path) as archive, zipfile.ZipFile(file, "w") as less:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "modelDescription.xml":
                for pattern, replacement in edits:
                    content, count = re.subn(pattern.encode(), replacement.encode(), content, flags=re.DOTALL)
                    assert count, pattern
            less.writestr(name, content)
    return file


def names(quantities: list[dict]) -> list[str]:
    return [quantity["name"] for quantity in quantities]


def values(quantities: list[dict]) -> np.ndarray:
    return np.array([quantity["value"] for quantity in quantities])


class Exchange:
    """An instance for model exchange in FMPy: derivatives and outputs at any time, states and inputs."""

    def __init__(self, fmu: Fmu, linear: dict) -> None:
        self.linear, self.time = linear, linear["time"]
        self.references = {name: v.valueReference for name, v in fmu.variables.items()}
        identifier = fmu.description.modelExchange.modelIdentifier
        guid, folder = fmu.description.guid, str(fmu.folder)
        self.model = FMU2Model(guid=guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="exchange")
        self.model.instantiate()
        self.model.setupExperiment(startTime=self.time)
        self.model.enterInitializationMode()
        self.set_inputs(values(linear["inputs"]))
        self.model.exitInitializationMode()
        while self.model.newDiscreteStates()[0]:
            pass
        self.model.enterContinuousTimeMode()

    def set_inputs(self, u: np.ndarray) -> None:
        self.model.setReal([self.references[name] for name in names(self.linear["inputs"])], list(u))

    def __call__(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Derivatives, then outputs."""
        self.set_inputs(u)
        self.model.setContinuousStates((c_double * len(x))(*x), len(x))
        derivatives = (c_double * len(x))()
        self.model.getDerivatives(derivatives, len(x))
        outputs = self.model.getReal([self.references[name] for name in names(self.linear["outputs"])])
        return np.array([*derivatives, *outputs])

    def free(self) -> None:
        self.model.terminate()
        self.model.freeInstance()


def differences(exchange: Exchange, linear: dict) -> np.ndarray:
    """[A B; C D] by central differences."""
    x, u = values(linear["states"]), values(linear["inputs"])
    point, columns = np.concatenate([x, u]), []
    for k in range(len(point)):
        step = np.zeros(len(point))
        step[k] = 1e-4 * max(1.0, abs(point[k]))
        ahead, behind = point + step, point - step
        difference = exchange(ahead[: len(x)], ahead[len(x) :]) - exchange(behind[: len(x)], behind[len(x) :])
        columns.append(difference / (2.0 * step[k]))
    return np.array(columns).T


@pytest.mark.parametrize(
    ("name", "time", "start"),
    [
        (PLANT, "0", {}),
        (PLANT, "0", {"x0[1]": 0.4, "x0[2]": -0.3, "u[1]": 0.7}),
        (PLANT, "0.75", {"u[1]": -0.4}),
        (CONTROLLER, "0", EXCITED),
        (CONTROLLER, "0.0125", EXCITED),
    ],
)
def test_the_matrices_are_those_of_central_differences(name: str, time: str, start: dict, fmu, fmu_folder) -> None:
    linear = linearise(fmu_folder / f"{name}.fmu", "--at", time, **start)
    exchange = Exchange(fmu(name), linear)
    expected = differences(exchange, linear)
    exchange.free()
    exact = np.block([[np.array(linear["A"]), np.array(linear["B"])], [np.array(linear["C"]), np.array(linear["D"])]])
    assert exact.shape == expected.shape
    # The error of the differences: rounding of the largest terms, and curvature.
    assert np.abs(exact - expected).max() <= 1e-6 * np.abs(exact).max()
    # Small entries too, each by the size of its row.
    assert (np.abs(exact - expected) <= 1e-6 * (1.0 + np.abs(exact).max(axis=1, keepdims=True))).all()


def test_the_plant_has_the_jacobian_of_its_equations() -> None:
    x1, x2, u = 0.4, -0.3, 0.7
    linear = linearise(PLANT, **{"x0[1]": x1, "x0[2]": x2, "u[1]": u})
    # x2' = ω u + sin u sin x1 + x1² + x2² + sin(t/2), with ω = 2 at t = 0
    assert np.allclose(linear["A"], [[0.0, 1.0], [2 * x1 + sin(u) * cos(x1), 2 * x2]], rtol=1e-14, atol=0)
    assert np.allclose(linear["B"], [[0.0], [2.0 + cos(u) * sin(x1)]], rtol=1e-14, atol=0)
    assert (linear["C"], linear["D"]) == ([[1, 0], [0, 1], [1, 0]], [[0], [0], [0]])


def test_the_operating_point_is_that_of_a_simulation_with_constant_inputs(unit, fmu_folder) -> None:
    plant = unit(PLANT).start(**{"u[1]": -0.4})
    for k in range(75):
        plant.step(k * 0.01, 0.01)
    linear = linearise(fmu_folder / f"{PLANT}.fmu", "--at", "0.75", **{"u[1]": -0.4})
    assert (linear["time"], linear["steady_state"]) == (0.75, False)
    assert values(linear["states"]) == pytest.approx([plant["x[1]"], plant["x[2]"]], rel=1e-5)


def test_a_steady_state_is_one() -> None:
    # 2 u + sin u sin x1 + x1² = 0 at t = 0
    u = -0.5
    root = brentq(lambda x: 2 * u + sin(u) * sin(x) + x * x, 0.5, 2.0, xtol=1e-14)
    linear = linearise(PLANT, "--steady-state", **{"u[1]": u, "x0[1]": 1.0})
    assert (linear["steady_state"], linear["unique"]) == (True, True)
    assert values(linear["states"]) == pytest.approx([root, 0.0], abs=1e-9)
    # A saddle: two real eigenvalues, of which one is unstable.
    rate = np.sqrt(2 * root + sin(u) * cos(root))
    assert sorted(e["real"] for e in linear["eigenvalues"]) == pytest.approx([-rate, rate], rel=1e-8)
    assert sorted(e["damping"] for e in linear["eigenvalues"]) == [-1.0, 1.0]


def test_the_steady_state_at_another_time_is_that_of_the_equations_then() -> None:
    time, u = 2.0, -0.5
    gain = 2.0 + 0.2 * sin(time)
    root = brentq(lambda x: gain * u + sin(u) * sin(x) + x * x + sin(time / 2), 0.3, 2.0, xtol=1e-14)
    linear = linearise(PLANT, "--steady-state", "--at", str(time), **{"u[1]": u, "x0[1]": 1.0})
    assert values(linear["states"]) == pytest.approx([root, 0.0], abs=1e-9)


def test_of_many_steady_states_one_is_found_and_it_is_reported(fmu, fmu_folder) -> None:
    start = {"r[1]": 1.0, "x[1]": 1.0}
    linear = linearise(fmu_folder / f"{CONTROLLER}.fmu", "--steady-state", **start)
    assert (linear["unique"], np.linalg.matrix_rank(linear["A"]) < len(linear["states"])) == (False, True)
    exchange = Exchange(fmu(CONTROLLER), linear)
    derivatives = exchange(values(linear["states"]), values(linear["inputs"]))[: len(linear["states"])]
    exchange.free()
    # The adaptation gain is 1e5: that is what a derivative is made of.
    assert np.abs(derivatives).max() < 1e-4
    answer = adaptive_fmu("linearise", CONTROLLER, "--steady-state", "--set", "r[1]=1", "--set", "x[1]=1")
    assert answer.returncode == 0 and "A is singular" in answer.stdout


def test_where_there_is_no_steady_state_what_remains_is_reported() -> None:
    # 2 u + sin u sin x1 + x1² > 0 for u = 1.
    assert "der(x[2])" in (error := fails(PLANT, "--steady-state", "--set", "u[1]=1")) and "steady state" in error
    # The controller's reference asks for another output than the one that its inputs hold.
    error = fails(CONTROLLER, "--steady-state", "--set", "r[1]=1", "--set", "x[1]=0.5")
    assert "remain" in error and "A is singular" in error and "of 7" in error


@pytest.mark.parametrize("name", sample.FMUS)
def test_every_fmu_is_linearised_as_json_of_one_shape(name: str, fmu, fmu_folder) -> None:
    for option in ([], ["--steady-state"]):
        linear = linearise(fmu_folder / f"{name}.fmu", *option, **tried(fmu(name), "steady"))
        n, m, p = len(linear["states"]), len(linear["inputs"]), len(linear["outputs"])
        shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        for matrix, (rows, columns) in shapes.items():
            assert [len(row) for row in linear[matrix]] == [columns] * rows, matrix
        assert (linear["fmu"], linear["time"], linear["steady_state"]) == (name, 0.0, bool(option))
        variables = fmu(name).variables
        assert names(linear["inputs"]) == fmu(name).named(causality="input", type="Real")
        assert names(linear["outputs"]) == fmu(name).named(causality="output", type="Real")
        assert all(f"der({state})" in variables for state in names(linear["states"]))
        for quantity in linear["states"] + linear["inputs"] + linear["outputs"]:
            assert quantity["unit"] == variables[quantity["name"]].unit
        assert len(linear["eigenvalues"]) == n
        for eigenvalue in linear["eigenvalues"]:
            assert eigenvalue["frequency"] == pytest.approx(np.hypot(eigenvalue["real"], eigenvalue["imaginary"]))


def test_eigenvalues_are_those_of_the_matrix() -> None:
    linear = linearise(CONTROLLER, "--at", "0.0125", **EXCITED)
    expected = np.linalg.eigvals(np.array(linear["A"]))
    reported = np.array([complex(e["real"], e["imaginary"]) for e in linear["eigenvalues"]])
    assert len(reported) == len(expected) == 7 and (np.diff(np.abs(reported)) >= 0.0).all()
    assert np.abs(reported[:, None] - expected).min(axis=1).max() <= 1e-9 * np.abs(expected).max()


def test_the_table_names_everything() -> None:
    answer = adaptive_fmu("linearise", PLANT)
    assert (answer.returncode, answer.stderr) == (0, "")
    words = ["t = 0 s", "x[1]", "u[1]", "y[1]", "1/s", "der(x[2])", "eigenvalue", "damping", "frequency"]
    assert [word for word in words if word not in answer.stdout] == []


def part_of(loop: dict, name: str, inputs: dict[str, str], outputs: list[str]) -> dict:
    """A unit of a linearised loop at the same point, as one that was linearised alone; each input with its source."""
    quantities = {quantity["name"]: quantity["value"] for quantity in loop["states"] + loop["outputs"]}
    states = [state["name"] for state in loop["states"] if state["name"].startswith(f"{name}.")]
    return {
        "time": loop["time"],
        "states": [{"name": state.removeprefix(f"{name}."), "value": quantities[state]} for state in states],
        "inputs": [{"name": variable, "value": quantities[source]} for variable, source in inputs.items()],
        "outputs": [{"name": variable} for variable in outputs],
    }


def blocks(fmu: Fmu, part: dict) -> list[np.ndarray]:
    """A, B, C and D of a unit alone, by differences."""
    exchange, n = Exchange(fmu, part), len(part["states"])
    whole = differences(exchange, part)
    exchange.free()
    return [whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]]


@pytest.mark.parametrize("time", ["0", "0.5"])
def test_a_composite_is_linearised_as_its_units_closed(time: str, fmu) -> None:
    loop = linearise(LOOPS[0], "--at", time, **{"plant.x0[1]": 0.4, "plant.x0[2]": -0.3})
    assert (names(loop["inputs"]), loop["time"]) == (["controller.u_manual[1]"], float(time))
    assert (loop["unique"], loop["steady_state"]) == (None, False)
    plant = part_of(loop, "plant", {"u[1]": "controller.u[1]"}, ["x[1]", "x[2]"])
    sources = {"r[1]": "reference.r[1]", "x[1]": "plant.x[1]", "x[2]": "plant.x[2]"}
    controller = part_of(loop, "controller", sources, ["u[1]"])
    a_p, b_p, c_p, d_p = blocks(fmu(PLANT), plant)
    a_c, b_c, c_c, d_c = blocks(fmu(CONTROLLER), controller)
    # Only one of the two feeds through; the reference is no state's.
    assert not d_p.any()
    b_c, d_c = b_c[:, 1:], d_c[:, 1:]
    expected = np.block([[a_p + b_p @ d_c @ c_p, b_p @ c_c], [b_c @ c_p, a_c]])
    states = [f"plant.{name}" for name in names(plant["states"])]
    states += [f"controller.{name}" for name in names(controller["states"])]
    order = [names(loop["states"]).index(name) for name in states]
    assert sorted(order) == list(range(len(loop["states"]))) and len(order) > 7
    exact = np.array(loop["A"])[np.ix_(order, order)]
    assert (np.abs(exact - expected) <= 1e-6 * (1.0 + np.abs(exact).max(axis=1, keepdims=True))).all()
    eigenvalues = np.array([complex(e["real"], e["imaginary"]) for e in loop["eigenvalues"]])
    there = np.linalg.eigvals(expected)
    assert np.abs(eigenvalues[:, None] - there).min(axis=1).max() <= 1e-6 * np.abs(there).max()


def test_a_loop_of_ones_own_is_linearised_too(tmp_path: Path) -> None:
    expected = linearise(LOOPS[0])
    folder = ROOT / "examples" / LOOPS[0]
    assert linearise(folder) == expected == linearise(folder / "SystemStructure.ssd")
    assert adaptive_fmu("export", "--ssp", LOOPS[0], "--out", tmp_path).returncode == 0
    assert linearise(tmp_path / f"{LOOPS[0]}.ssp") == expected
    error = fails(LOOPS[0], "--set", "x0[1]=1")
    assert "x0[1]" in error and "plant.x0[1]" in error


def changed(file: Path, target: Path, old: str, new: str) -> Path:
    """A copy of an FMU with another modelDescription.xml."""
    with zipfile.ZipFile(file) as archive, zipfile.ZipFile(target, "w") as copy:
        for entry in archive.namelist():
            content = archive.read(entry)
            if entry == "modelDescription.xml":
                assert old in content.decode()
                content = content.decode().replace(old, new).encode()
            copy.writestr(entry, content)
    return target


@pytest.mark.parametrize("flag", ["", 'providesDirectionalDerivative="0"'])
def test_a_steady_state_is_found_without_directional_derivatives(fmu, tmp_path: Path, flag: str) -> None:
    plain = edited(fmu(PLANT), tmp_path, ('providesDirectionalDerivative="true"', flag))
    options = ["--steady-state", "--set", "u[1]=-0.5", "--set", "x0[1]=1"]
    exact, near = linearise(fmu(PLANT).path, *options), linearise(plain, *options)
    assert near["method"]["by"] == "differences" and near["unique"]
    np.testing.assert_allclose(values(near["states"]), values(exact["states"]), atol=1e-8)
    np.testing.assert_allclose(near["A"], exact["A"], atol=1e-6)


def test_an_fmu_without_model_exchange_has_no_steady_state(fmu_folder: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(fmu_folder / f"{PLANT}.fmu") as archive:
        xml = archive.read("modelDescription.xml").decode()
    element = xml[xml.index("<ModelExchange") : xml.index("<CoSimulation")]
    other = changed(fmu_folder / f"{PLANT}.fmu", tmp_path / "other.fmu", element, "")
    assert linearise(other)["A"] == linearise(fmu_folder / f"{PLANT}.fmu")["A"]
    assert "model exchange" in fails(other, "--steady-state")


def test_what_cant_be_linearised_is_reported(tmp_path: Path) -> None:
    error = fails("NonlinearSisso")
    assert all(word in error for word in ["FMU or loop", "NonlinearSisso", "did you mean `NonlinearSiso`?"])
    assert "gone.fmu" in fails(tmp_path / "gone.fmu")
    assert "gone.toml" in fails(tmp_path / "gone.toml")
    assert "omgea" in (error := fails(PLANT, "--set", "omgea=1")) and "omega" in error
    assert "x[1]" in fails(PLANT, "--set", "x[1]=1")
    error = fails(PLANT, "--set", "omega=two")
    assert all(word in error for word in ["omega", "two", "must be a finite number"])
    assert "start time" in fails(PLANT, "--at=-1")
    for wrong in (["--set", "omega"], ["--at", "soon"], ["--at=nan"]):
        assert adaptive_fmu("linearise", PLANT, *wrong).returncode == 2


NO_DERIVATIVES = ('providesDirectionalDerivative="true"', "")
CO_SIMULATION_ONLY = (r"<ModelExchange.*?(/>|</ModelExchange>)", "")
NO_STATES = (r"<Derivatives>.*?</Derivatives>", "")


@pytest.mark.parametrize("name", ["NonlinearSiso", "TwoLinkRobot", "TwinRotor", "MaresAuv", "Quadrotor", "L1NonlinearSiso"])
def test_differences_come_close_to_exact_derivatives(name: str, fmu, tmp_path: Path) -> None:
    # At the edge of a limit a difference is the mean of both sides.
    options = ["--at", "0.05", *(["--set", "u[1]=10"] if name == "Quadrotor" else [])]
    exact = linearise(fmu(name).path, *options)
    near = linearise(edited(fmu(name), tmp_path, NO_DERIVATIVES), *options)
    assert (exact["method"], near["method"]["by"]) == ({"by": "derivatives"}, "differences")
    assert [names(exact[kind]) for kind in KINDS] == [names(near[kind]) for kind in KINDS]
    for matrix in "ABCD":
        wanted, found = np.array(exact[matrix]), np.array(near[matrix])
        # The states of both are those of one simulation.
        np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6 * max(1.0, np.abs(wanted).max(initial=0)))


def test_an_input_at_a_bound_that_its_description_names_is_moved_inwards(fmu, tmp_path: Path) -> None:
    """The thrust acts from 0 on: the mean of both sides would be half of it."""
    bound = (r'(name="u\[1\]".*?<Real unit="N") nominal="5.0" start="4.905"', r'\1 min="0" start="4.905"')
    bounded = edited(fmu("Quadrotor"), tmp_path, NO_DERIVATIVES, bound)
    found, inside = (linearise(bounded, "--set", f"u[1]={thrust}") for thrust in (0, 4))
    assert found["method"]["by"] == inside["method"]["by"] == "differences"
    columns = [np.array(linear["B"])[:, 0] for linear in (found, inside)]
    np.testing.assert_allclose(*columns, rtol=1e-3, atol=1e-6)
    assert columns[0].max() > 1.0


KINDS = ["states", "inputs", "outputs"]


def state_space(folder: Path, seed: int) -> tuple[Path, list[np.ndarray]]:
    """A random stable plant whose states are its outputs, as an FMU for co-simulation that tells nothing of them."""
    random = np.random.default_rng(seed)
    n, m = int(random.integers(1, 5)), int(random.integers(1, 4))
    a = random.normal(size=(n, n)) * 5
    a -= (max(np.linalg.eigvals(a).real) + random.uniform(0.2, 5)) * np.eye(n)
    b = random.normal(size=(n, m)) * 10.0 ** random.uniform(-2, 2)
    model = {"A": a.tolist(), "B": b.tolist(), "C": np.eye(n).tolist()}
    (folder / "model.json").write_text(json.dumps(model))
    made = ["new", "state-space", "--name", "Plant", "--plant", folder / "model.json", "--out", folder / "Plant.toml"]
    for command in (made, ["export", folder / "Plant.toml", "--out", folder]):
        answer = adaptive_fmu(*command)
        assert answer.returncode == 0, answer
    plain = edited(
        Fmu(folder / "Plant.fmu", folder / "unpacked"), folder / "plain", NO_DERIVATIVES, CO_SIMULATION_ONLY, NO_STATES
    )
    return plain, [a, b]


@pytest.mark.parametrize("seed", range(6))
def test_responses_find_the_matrices_of_any_linear_plant(seed: int, tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    plant, (a, b) = state_space(tmp_path, seed)
    states = ",".join(f"y[{k + 1}]" for k in range(len(a)))
    found = linearise(plant, "--states", states)
    assert found["method"]["by"] == "responses" and found["method"]["misfit"] < 1e-3
    assert ",".join(names(found["states"])) == states
    # What limits it is the plant's own tolerance.
    np.testing.assert_allclose(found["A"], a, atol=1e-3 * np.abs(a).max())
    # The inputs, and the disturbances that add to them.
    np.testing.assert_allclose(found["B"], np.hstack([b, b]), atol=1e-3 * np.abs(b).max())
    # The states are outputs, and so is what is made of them.
    np.testing.assert_allclose(found["C"], np.vstack([np.eye(len(a))] * 2), atol=1e-6)


def test_a_unit_that_shows_too_few_states_is_refused(fmu, tmp_path: Path) -> None:
    plain = edited(fmu("TwoLinkRobot"), tmp_path, NO_DERIVATIVES, CO_SIMULATION_ONLY, NO_STATES)
    error = fails(plain, "--states", "x[1],x[2]")
    assert "--states" in error and "x[1], x[2]" in error, error
    assert "there is no Real output or local variable named `nothing`" in fails(plain, "--states", "nothing")
