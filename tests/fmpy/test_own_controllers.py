"""Plants that are not of the thesis, controlled by units that were made with text files alone."""

import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from jsonschema import Draft7Validator
from master import ClosedLoop, Fmu, Unit

OWN = ROOT / "examples" / "own"


@dataclass
class Drive:
    """A plant with its controller, as a user asks `new` for them."""

    folder: str
    name: str
    plant: str
    output: str
    control: str
    states: list[str]
    bandwidth: str
    reference: str
    step: float
    # Largest control that acts, and the time in which the ideal model has come within 2 % after the step at 1 s.
    limit: float
    settling: float
    # Settling time, s, and overshoot of the worst plant within 20 % by element, as `check` says them.
    worst: tuple[float, float]

    def ask(self, folder: Path) -> None:
        """Writes the three descriptions into a folder."""
        plant = ["--plant", OWN / self.folder / "model.json"]
        design = ["--bandwidth", self.bandwidth, "--reference", self.reference]
        for kind, name, options in [
            ("state-space", self.name, []),
            ("l1", f"{self.name}Controller", design),
            ("reference", f"{self.name}Reference", ["--reference", self.reference]),
        ]:
            asked = adaptive_fmu("new", kind, "--name", name, *plant, *options, "--out", folder / f"{name}.toml")
            assert asked.returncode == 0, asked.stderr


MOTOR = Drive(
    "dc_motor", "DcMotor", "motor", "speed", "voltage", ["speed", "current"], "20", "100", 1e-4, 12.0, 0.25, (0.357, 0.0274)
)
TWO_MASSES = Drive(
    "two_mass_drive",
    "TwoMassDrive",
    "drive",
    "load_speed",
    "torque",
    ["motor_speed", "twist", "load_speed"],
    "15",
    "50",
    5e-4,
    2.0,
    0.3,
    (0.447, 0.321),
)
DRIVES = pytest.mark.parametrize("drive", [MOTOR, TWO_MASSES], ids=lambda drive: drive.folder)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Drive], Path]:
    """The folder of a drive's descriptions, its loop and its FMUs, from `new` and `export`, once."""
    folders: dict[str, Path] = {}

    def get(drive: Drive) -> Path:
        if drive.folder not in folders:
            folder = tmp_path_factory.mktemp(drive.folder)
            drive.ask(folder)
            (folder / "SystemStructure.ssd").write_text((OWN / drive.folder / "SystemStructure.ssd").read_text())
            exported = adaptive_fmu("export", *sorted(folder.glob("*.toml")), "--out", folder)
            assert exported.returncode == 0, exported.stderr
            folders[drive.folder] = folder
        return folders[drive.folder]

    return get


@pytest.fixture
def closed(begun, tmp_path: Path):
    """Closes a drive's loop in FMPy: times, outputs and controls, with parameters of the plant as they are set."""
    units: list[Unit] = []

    def close(drive: Drive, stop: float, height: float | None = None, **plant: np.ndarray) -> tuple[np.ndarray, ...]:
        names = {"reference": "Reference", "plant": "", "controller": "Controller"}
        made = {}
        for name, suffix in names.items():
            target = tmp_path / f"{name} {len(units)}"
            target.mkdir()
            made[name] = Unit(Fmu(begun(drive) / f"{drive.name}{suffix}.fmu", target), name)
            units.append(made[name])
        for name, matrix in plant.items():
            for (i, j), value in np.ndenumerate(matrix):
                made["plant"][f"{name}[{i + 1},{j + 1}]"] = value
        if height is not None:
            made["reference"]["step_height[1,1]"] = height
        reference = f"{drive.output}_reference"
        links = [(f"reference.{reference}", f"controller.{reference}")]
        links += [(f"plant.{state}", f"controller.{state}") for state in drive.states]
        links += [(f"controller.{drive.control}", f"plant.{drive.control}")]
        loop = ClosedLoop(made, links).start().run(stop, drive.step)
        return loop.time, loop[f"plant.{drive.output}"], loop[f"controller.{drive.control}"]

    yield close
    for unit in units:
        unit.free()


def model(drive: Drive) -> SimpleNamespace:
    """The nominal plant."""
    identified = json.loads((OWN / drive.folder / "model.json").read_text())
    return SimpleNamespace(**{name: np.array(identified[name]) for name in "ABC"})


def off(drive: Drive, factor: float) -> dict[str, np.ndarray]:
    """The plant with so many times the inertia that it moves."""
    plant = model(drive)
    row = drive.states.index(drive.output)
    A = plant.A.copy()
    A[row] /= factor
    return {"A": A}


def settled(time: np.ndarray, y: np.ndarray, height: float) -> float:
    """How long after its step at 1 s the output comes within 2 % of it, to stay."""
    outside = time[np.abs(y - height) > 0.02 * height]
    return float(outside[-1]) - 1.0


@DRIVES
def test_the_examples_are_what_new_writes(drive: Drive, begun) -> None:
    written = {file.name: file.read_text() for file in begun(drive).glob("*.toml")}
    assert written == {file.name: file.read_text() for file in (OWN / drive.folder).glob("*.toml")}


@DRIVES
def test_the_output_follows_a_step_and_stays(drive: Drive, closed) -> None:
    time, y, u = closed(drive, 2.0)
    height = float(drive.reference)
    assert settled(time, y, height) < drive.settling
    assert y.max() < 1.001 * height
    assert np.abs(u).max() < drive.limit
    assert np.abs(y[time > 1.8] - height).max() < 1e-4 * height


@DRIVES
def test_check_reports_what_the_worst_plant_does(drive: Drive, begun) -> None:
    output = json.loads(adaptive_fmu("check", begun(drive) / f"{drive.name}Controller.toml", "--json").stdout)
    found = {finding["name"]: finding["value"] for finding in output["findings"] if finding["section"] == "Uncertain plants"}
    assert (found["settling time"], found["overshoot"] / 100) == pytest.approx(drive.worst, rel=0.01)


def follows_as_predicted(drive: Drive, time: np.ndarray, y: np.ndarray, u: np.ndarray) -> None:
    height, (settling, overshoot) = float(drive.reference), drive.worst
    assert settled(time, y, height) < 1.1 * settling
    assert y.max() < (1 + 1.1 * overshoot + 0.02) * height
    assert np.abs(u).max() <= drive.limit
    assert np.abs(y[time > 1.8] - height).max() < 1e-3 * height


@DRIVES
@pytest.mark.parametrize("factor", [0.85, 0.95, 1.05, 1.2])
def test_it_does_so_with_an_inertia_that_is_off(drive: Drive, factor: float, closed) -> None:
    follows_as_predicted(drive, *closed(drive, 2.0, **off(drive, factor)))


@DRIVES
@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_it_does_so_with_an_input_that_does_more_or_less_than_it_should(drive: Drive, factor: float, closed) -> None:
    follows_as_predicted(drive, *closed(drive, 2.0, B=factor * model(drive).B))


@DRIVES
def test_a_control_at_its_limit_is_respected_and_does_not_wind_up(drive: Drive, closed) -> None:
    # So large a step that the control stands at its limit on the way, though not in the end.
    height = (2.2 if drive is MOTOR else 2.0) * float(drive.reference)
    time, y, u = closed(drive, 2.0, height)
    assert np.abs(u).max() == drive.limit
    assert (np.abs(u) == drive.limit).sum() * drive.step > 0.02, "it stands at its limit for a while"
    assert y.max() < 1.03 * height
    assert settled(time, y, height) < 1.5 * drive.settling


@DRIVES
@pytest.mark.parametrize("form", [[], ["--composite"]], ids=["separate", "whole"])
def test_run_exports_the_fmus_whose_descriptions_are_next_to_the_loop(
    drive: Drive, form: list[str], tmp_path: Path
) -> None:
    ran = adaptive_fmu("run", OWN / drive.folder, *form, "--json", "--out", tmp_path)
    assert ran.returncode == 0, ran.stderr
    output = json.loads(ran.stdout)
    limited = [metric for metric in output["metrics"] if metric["limit"] is not None]
    assert len(limited) == 2 and all(metric["value"] <= metric["limit"] for metric in limited)
    if form:
        return
    slow = adaptive_fmu("run", OWN / drive.folder, "--set", f"{drive.plant}.u_max[1]=0.01", "--json", "--out", tmp_path)
    assert slow.returncode == 3, "the values of a user's own plant can be set"


# The page, and what `new` and `schema` answer.

PAGE = (ROOT / "docs" / "own_controller.md").read_text()


def test_the_line_for_python_control_writes_what_new_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path)
    exec(block, {"sys": SimpleNamespace(D=np.zeros((1, 1)), **vars(model(MOTOR)))})
    done = adaptive_fmu("new", "l1", "--name", "Mine", "--plant", tmp_path / "mine/model.json", "--out", tmp_path / "a.toml")
    assert done.returncode == 0, done.stderr
    assert tomllib.loads((tmp_path / "a.toml").read_text())["structure"]["A"] == model(MOTOR).A.tolist()


def test_the_model_on_the_page_is_the_one_that_lies_ready() -> None:
    (block,) = re.findall(r"```json\n(.*?)```", PAGE, re.S)
    assert json.loads(block) == json.loads((OWN / "dc_motor" / "model.json").read_text())


def test_new_overwrites_nothing_unless_forced(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("mine")
    refused = adaptive_fmu("new", "l1", "--name", "Mine", "--out", file)
    assert refused.returncode == 1 and "--force" in refused.stderr and file.read_text() == "mine"
    assert adaptive_fmu("new", "l1", "--name", "Mine", "--out", file, "--force").returncode == 0
    assert tomllib.loads(file.read_text())["name"] == "Mine"


@pytest.mark.parametrize(
    ("arguments", "status", "named"),
    [
        (["l2", "--name", "X"], 2, "fuzzy-l1"),
        (["l1"], 2, "--name"),
        (["l1", "--name", "X", "--states", "0"], 2, "1 … 50"),
        (["l1", "--name", "X", "--states", "1000000000"], 2, "1000000000"),
        (["l1", "--name", "X", "--inputs", "-1"], 2, "-1"),
        (["l1", "--name", "X", "--bandwidth", "nan"], 2, "above 0"),
        (["l1", "--name", "X", "--reference", "0"], 2, "above 0"),
        (["l1", "--name", "a b", "--states", "2"], 1, "C identifier"),
        (["l1", "--name", "../x", "--states", "2"], 1, "C identifier"),
        (["l1", "--name", "X", "--plant", "no.json"], 1, "no.json"),
        (["l1", "--name", "X", "--plant", "Cargo.toml"], 1, "not valid JSON"),
        (["l1", "--name", "X", "--plant", "/dev/zero"], 1, "/dev/zero"),
        (["l1", "--name", "X", "--bandwidth", "1e300"], 1, "X.toml"),
        (["l1", "--name", "X", "--reference", "1e300"], 1, "X.toml"),
    ],
)
def test_what_new_is_asked_for_wrongly_is_refused_and_nothing_written(
    arguments: list[str], status: int, named: str, tmp_path: Path
) -> None:
    refused = adaptive_fmu("new", *arguments, "--out", tmp_path / "X.toml")
    assert refused.returncode == status and named in refused.stderr, refused.stderr
    assert "panicked" not in refused.stderr and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["pid", "l1", "l1-sampled", "mrac-ppf", "state-space"])
def test_new_ends_as_check_does(kind: str, tmp_path: Path) -> None:
    """The file is written all the same where the design isn't sound."""
    new = adaptive_fmu("new", kind, "--name", "X", "--out", tmp_path / "X.toml")
    check = adaptive_fmu("check", tmp_path / "X.toml")
    assert new.returncode == check.returncode and new.returncode in (0, 3), new.stderr
    [error] = re.findall("^Not sound: (.*)$", new.stderr, re.M) or [None]
    assert (error is not None) == (check.returncode == 3)
    assert error is None or error in check.stdout


SCHEMA = json.loads((ROOT / "modelDescription" / "description.schema.json").read_text())


def wrong(text: str) -> list[str]:
    """What the schema finds in a description."""
    return [error.message for error in Draft7Validator(SCHEMA).iter_errors(tomllib.loads(text))]


def test_the_schema_is_one_and_the_program_prints_it() -> None:
    Draft7Validator.check_schema(SCHEMA)
    assert json.loads(adaptive_fmu("schema").stdout) == SCHEMA


@pytest.mark.parametrize(
    "file", [*sorted((ROOT / "modelDescription").glob("*.toml")), *sorted(OWN.glob("*/*.toml"))], ids=lambda file: file.stem
)
def test_a_description_has_nothing_that_the_schema_does_not_know(file: Path) -> None:
    assert wrong(file.read_text()) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("model = ", "modell = "),
        ('"l1"', '"l2"'),
        ("regressor", "regresor"),
        ('"state"', '"norm"'),
        ("baseline", "base_line"),
        ('"outside"', '"beside"'),
        ("stop_time", "stoptime"),
        ("[structure]", "[structures]"),
        ("[names]", "[nams]"),
        ("[[0.0], [500.0]]", "[0.0, 500.0]"),
        ('units = { r = ["rad/s"]', 'units = { z = ["rad/s"]'),
        ('r = ["speed_reference"]', "r = [1]"),
    ],
)
def test_an_editor_finds_a_wrong_key_or_item(old: str, new: str) -> None:
    text = (OWN / "dc_motor" / "DcMotorController.toml").read_text()
    assert text.count(old) >= 1 and wrong(text) == []
    assert wrong(text.replace(old, new, 1)) != []


def test_what_new_writes_names_the_schema_next_to_it(begun) -> None:
    folder = begun(MOTOR)
    first = (folder / "DcMotorController.toml").read_text().splitlines()[0]
    assert first == "#:schema ./description.schema.json"
    assert json.loads((folder / "description.schema.json").read_text()) == SCHEMA
