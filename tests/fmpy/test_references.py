"""Related files of FMUs and their reference experiments, by FMPy: the manifest and the experiments are read here from the two formats'
own terms, the FMUs are run along their stimuli by FMPy, and what deviates is found by `validate`, in FMUs of anybody."""

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from fmpy.util import read_csv
from master import Fmu

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
MANIFEST = f"{FOLDER}/fmi-ls-manifest.xml"
SPACE = "{http://fmi-standard.org/fmi-ls-manifest}"
# The roles of FMI-LS-REF 1.0.0-beta.1.
ROLES = re.compile(
    r"document|requirement|specification|model|parameter|system|testcase|experiment(/(smoke-test|validation|uncertainty-analysis))?|"
    r"result|method|rationale|report|request|delivery|configuration|signature|serialized-state(/.*)?|meta-data|other"
)
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
LARGEST = 100_000


class Related:
    """The related files of an FMU, as an importer reads them."""

    def __init__(self, file: Path) -> None:
        with zipfile.ZipFile(file) as archive:
            self.entries = {name: archive.read(name) for name in archive.namelist()}
        self.root = ElementTree.fromstring(self.entries[MANIFEST])
        self.files = [(node.get("role"), node.get("type"), node.get("source")) for node in self.root]

    def place(self, source: str) -> str:
        """The path in the archive that a source leads to."""
        parts: list[str] = []
        for part in PurePosixPath(FOLDER, source).parts:
            parts = parts[:-1] if part == ".." else [*parts, part]
        return "/".join(parts)

    def of_role(self, role: str) -> list[str]:
        return [self.place(source) for found, _, source in self.files if found == role]

    def values(self, place: str) -> dict[str, str]:
        """The values of a parameter set."""
        parameters = ElementTree.fromstring(self.entries[place]).iter(f"{SSV}Parameter")
        return {node.get("name"): node[0].get("value") for node in parameters}

    def table(self, source: str, folder: Path) -> np.ndarray:
        file = folder / Path(source).name
        file.write_bytes(self.entries[f"{FOLDER}/{source}"])
        return read_csv(file)

    def experiment(self) -> ElementTree.Element:
        [place] = self.of_role("experiment/validation")
        root = ElementTree.fromstring(self.entries[place])
        assert root.tag == "Experiments" and root.get("name")
        [experiment] = root
        return experiment


def test_the_manifest_is_one_of_the_layered_standard(each_fmu: Fmu) -> None:
    related = Related(each_fmu.path)
    assert related.root.tag == "fmiReferences"
    assert related.root.get(f"{SPACE}fmi-ls-name") == "org.fmi-standard.fmi-ls-ref"
    assert related.root.get(f"{SPACE}fmi-ls-version") == "1.0.0-beta.1"
    about = "Layered Standard providing information on related files included in an FMU."
    assert related.root.get(f"{SPACE}fmi-ls-description") == about
    assert {node.tag for node in related.root} == {"Related"}
    assert {key for node in related.root for key in node.attrib} == {"type", "source", "role", "description"}
    assert [role for role, _, _ in related.files if not ROLES.fullmatch(role)] == []
    assert [source for _, _, source in related.files if related.place(source) not in related.entries] == []
    for role in ("model", "report", "experiment/validation"):
        assert len(related.of_role(role)) == 1, role
    own = {name for name in related.entries if name.startswith(FOLDER)}
    experiment = related.experiment()
    named = {MANIFEST, *map(related.place, (source for _, _, source in related.files))}
    assert own <= named | {f"{FOLDER}/{node.get('source')}" for node in experiment}
    assert sum(len(related.entries[name]) for name in own if not name.endswith(".ssv")) < LARGEST
    assert set(experiment.keys()) == {"name", "description", "startTime", "stopTime", "tolerance", "stepSize"}
    tags = [node.tag for node in experiment]
    assert tags == [tag for tag in ("Parameters", "Stimuli", "References") if tag in tags] and "References" in tags


def deviation(experiment: ElementTree.Element, result: np.ndarray, references: np.ndarray) -> dict[str, float]:
    """The largest deviation of each output, relative to the largest value of its reference."""
    step = float(experiment.get("stepSize"))
    places = [int(np.argmin(abs(result["time"] - time))) for time in references["time"]]
    assert np.allclose(result["time"][places], references["time"], rtol=0, atol=1e-3 * step)
    found = {}
    for name in references.dtype.names[1:]:
        own = np.array([np.ravel(result[name][place]) for place in places], dtype=float)
        exact = np.reshape(references[name], own.shape)
        found[name] = float(np.max(np.max(abs(own - exact), axis=0) / np.maximum(np.max(abs(exact), axis=0), 1e-300)))
    return found


def start_values(related: Related, experiment: ElementTree.Element, variables: dict) -> dict[str, object]:
    """Those of the experiment; FMPy takes items of enumerations by their numbers."""
    node = experiment.find("Parameters")
    values: dict[str, object] = {} if node is None else dict(related.values(f"{FOLDER}/{node.get('source')}"))
    return {name: number_of(variables[name], value) for name, value in values.items()}


def number_of(variable: object, value: object) -> object:
    if variable.type != "Enumeration":
        return value
    return next(item.value for item in variable.declaredType.items if item.name == value)


def simulated(related: Related, file: Path, folder: Path, interface: str) -> tuple[ElementTree.Element, dict[str, float]]:
    """The experiment of an FMU, and the largest deviation of each output where FMPy runs it."""
    experiment = related.experiment()
    sources = {node.tag: node.get("source") for node in experiment}
    references = related.table(sources["References"], folder)
    step = float(experiment.get("stepSize"))
    about = fmpy.read_model_description(str(file))
    variables = {variable.name: variable for variable in about.modelVariables}
    result = fmpy.simulate_fmu(
        str(file),
        validate=False,
        start_time=float(experiment.get("startTime")),
        stop_time=float(experiment.get("stopTime")),
        output_interval=step,
        relative_tolerance=1e-9 if interface == "ModelExchange" else None,
        fmi_type=interface,
        input=related.table(sources["Stimuli"], folder) if "Stimuli" in sources else None,
        output=list(references.dtype.names[1:]),
        start_values=start_values(related, experiment, variables),
    )
    return experiment, deviation(experiment, result, references)


def test_fmpy_finds_the_references_in_co_simulation(each_fmu: Fmu, tmp_path: Path) -> None:
    experiment, found = simulated(Related(each_fmu.path), each_fmu.path, tmp_path, "CoSimulation")
    assert {name: off for name, off in found.items() if not off <= float(experiment.get("tolerance"))} == {}


# An L1 controller, a sampled law, one with a switch, one whose experiment has parameters, a plant, and a sensor.
BY_A_SOLVER = ["L1SampledNonlinearSiso", "FuzzyL1CoupledMimo", "PidNonlinearSiso", "TwoLinkRobot", "UnmatchedMimo", "Sensor"]


@pytest.mark.parametrize("name", BY_A_SOLVER)
def test_a_solver_finds_the_references_in_model_exchange(name: str, fmu: Callable[[str], Fmu], tmp_path: Path) -> None:
    related = Related(fmu(name).path)
    experiment, found = simulated(related, fmu(name).path, tmp_path, "ModelExchange")
    assert {output: off for output, off in found.items() if not off <= float(experiment.get("tolerance"))} == {}


@pytest.mark.parametrize("name", ["L1SampledTwoLinkRobot", "StateSpace", "ReferenceTwoLinkRobot"])
def test_an_fmu_of_fmi_3_has_the_same_results(name: str, fmu: Callable[[str], Fmu], tmp_path: Path) -> None:
    """FMPy 0.3.32 takes no stimuli of arrays with different sizes: there validate runs the experiment."""
    exported = adaptive_fmu("export", "--fmi", "3", name, "--out", tmp_path / "fmi3")
    assert exported.returncode == 0, exported.stderr
    file = tmp_path / "fmi3" / f"{name}.fmu"
    related = Related(file)
    if name.startswith("L1"):
        replays(file)
    else:
        experiment, found = simulated(related, file, tmp_path, "CoSimulation")
        assert {output: off for output, off in found.items() if not off <= float(experiment.get("tolerance"))} == {}
    older = Related(fmu(name).path)
    numbers = [re.split(r"[,\s]+", text.decode())[1:] for text in (each.entries[f"{FOLDER}/references.csv"] for each in (related, older))]
    both = [[word for word in words if word and word[0] in "-0123456789"] for words in numbers]
    assert both[0] == both[1]


# Its state grows by e^20 in a second, so that its experiment ends before its third input moves.
STILL = {"CoupledMimo": ["u[3]"]}


def test_the_experiments_are_worth_something(each_fmu: Fmu, tmp_path: Path) -> None:
    """Outputs move, inputs too, and there are enough rows; results that are hardly any have a tolerance that says so."""
    related = Related(each_fmu.path)
    experiment = related.experiment()
    sources = {node.tag: node.get("source") for node in experiment}
    references = related.table(sources["References"], tmp_path)
    assert len(references) >= 5 and float(experiment.get("tolerance")) <= 0.1
    inputs = [v.name for v in each_fmu.variables.values() if v.causality == "input"]
    assert ("Stimuli" in sources) == bool(inputs)
    if inputs:
        stimuli = related.table(sources["Stimuli"], tmp_path)
        assert list(stimuli.dtype.names) == ["time", *inputs]
        still = [name for name in inputs if np.ptp(stimuli[name]) == 0.0]
        assert still == STILL.get(each_fmu.name, [])
    if each_fmu.name != "Reference":  # It has no shape until it is given one.
        assert any(np.ptp(references[name]) > 0.0 for name in references.dtype.names[1:])


def test_cases_of_the_thesis_apply_as_they_are(each_fmu: Fmu) -> None:
    related = Related(each_fmu.path)
    for place in related.of_role("parameter"):
        values = related.values(place)
        assert values
        start = {name: number_of(each_fmu.variables[name], value) for name, value in values.items()}
        # FMPy refuses those that it can't set.
        fmpy.simulate_fmu(str(each_fmu.path), stop_time=2e-3, output_interval=1e-3, fmi_type="CoSimulation", start_values=start)


def test_the_cases_are_those_of_the_loops(fmu: Callable[[str], Fmu]) -> None:
    robot = Related(fmu("L1TwoLinkRobot").path)
    slow = robot.values(f"{FOLDER}/3.3.1-case2.ssv")
    assert slow["pole_real[1]"] == "-30" and slow["pole_imag[4]"] == "-0.5"
    fuzzy = Related(fmu("FuzzyL1ActuatedSiso").path)
    assert float(fuzzy.values(f"{FOLDER}/4-case1-fuzzy-tuned.ssv")["VL_c"]) == 10.56940058380095


def changed(file: Path, out: Path, **texts: Callable[[str], str]) -> Path:
    """A copy of an FMU with other related files."""
    with zipfile.ZipFile(file) as archive, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as copy:
        for name in archive.namelist():
            edit = texts.get(Path(name).stem.replace("-", "_")) if name.startswith(FOLDER) else None
            data = archive.read(name)
            copy.writestr(name, edit(data.decode()).encode() if edit else data)
    return out


def replays(file: Path) -> None:
    """The experiment of an FMU within its tolerance, by validate."""
    answer = adaptive_fmu("validate", file, "--json")
    assert answer.returncode == 0, answer
    [replayed] = json.loads(answer.stdout)["experiments"]
    assert replayed["experiment"] == "reference" and replayed["outputs"]
    assert [output for output in replayed["outputs"] if not output["largest"] <= replayed["tolerance"]] == []


def test_validate_replays_the_experiment(each_fmu: Fmu) -> None:
    replays(each_fmu.path)


def test_validate_finds_a_wrong_reference(fmu: Callable[[str], Fmu], tmp_path: Path) -> None:
    file = fmu("TwoLinkRobot").path

    def other_end(text: str) -> str:
        *lines, last = text.splitlines()
        cells = last.split(",")
        cells[1] = str(1.01 * float(cells[1]) + 0.01)
        return "\n".join([*lines, ",".join(cells), ""])

    wrong = changed(file, tmp_path / "wrong.fmu", references=other_end)
    answer = adaptive_fmu("validate", wrong)
    assert answer.returncode == 3
    [line] = [line for line in answer.stdout.splitlines() if line.startswith("error")]
    assert re.search(r"`x\[1\]` is -?[\d.]+ at [\d.]+ s, its reference -?[\d.]+\. It deviates by \d\.\de-\d", line), line


def test_a_path_outside_the_fmu_is_refused(fmu: Callable[[str], Fmu], tmp_path: Path) -> None:
    def outside(text: str) -> str:
        return text.replace('source="references.csv"', 'source="../../../references.csv"')

    file = changed(fmu("TwoLinkRobot").path, tmp_path / "outside.fmu", reference=outside)
    answer = adaptive_fmu("validate", file)
    assert answer.returncode == 3 and "`../../../references.csv` leads outside the FMU" in answer.stdout

    def absolute(text: str) -> str:
        return text.replace('source="reference.exp"', 'source="/etc/passwd"')

    file = changed(fmu("TwoLinkRobot").path, tmp_path / "absolute.fmu", fmi_ls_manifest=absolute)
    answer = adaptive_fmu("validate", file, "--no-run")
    assert answer.returncode == 3 and "`/etc/passwd` leads outside the FMU" in answer.stdout


EXPERIMENT = """<?xml version="1.0" encoding="UTF-8"?>
<Experiments name="smoke"><Experiment name="step" tolerance="1e-3">
<TransientSimulation startTime="0" stopTime="0.1" stepSize="1e-3"/>
<Stimuli source="in%20put.csv"/><References source="out.csv"/></Experiment></Experiments>
"""
RELATED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref"
 fmi-ls:fmi-ls-version="1.0.0-beta.1" fmi-ls:fmi-ls-description="">
<Related type="application/x-ma-hs-experiments" source="tests/smoke.exp" role="experiment"/>
<Related type="text/plain" source="https://example.org/requirements.txt" role="requirement"/></fmiReferences>
"""


MOTOR = """
name = "Motor"
model = "state-space"
description = "A motor"

[experiment]
stop_time = 0.1
step = 0.001

[structure]
A = [[-0.5, 250.0], [-25.0, -500.0]]
B = [[0.0], [500.0]]
C = [[1.0, 0.0]]
"""


@pytest.mark.parametrize("factor", [1.0, 1.02])
def test_an_fmu_with_experiments_of_another_tool_is_compared_with_its_references(factor: float, tmp_path: Path) -> None:
    """A motor from rest at 5 V, by the exact solution of its two linear rates, and by one with an error of 2 %."""
    (tmp_path / "Motor.toml").write_text(MOTOR)
    assert adaptive_fmu("export", "Motor.toml", "--no-reference-results", "--out", "fmus", folder=tmp_path).returncode == 0
    rates, force = np.array([[-0.5, 250.0], [-25.0, -500.0]]), np.array([0.0, 500.0])
    poles, modes = np.linalg.eig(rates)
    rest = np.linalg.solve(rates, -force * 5.0)
    times = np.arange(0.01, 0.1, 0.01)
    speeds = [(rest + (modes @ (np.exp(poles * t) * np.linalg.solve(modes, -rest))).real)[0] for t in times]
    rows = "".join(f"{time!r},{factor * speed!r}\n" for time, speed in zip(times.tolist(), map(float, speeds), strict=True))
    file = tmp_path / "Motor.fmu"
    with zipfile.ZipFile(tmp_path / "fmus" / "Motor.fmu") as own, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in own.namelist():
            if name != MANIFEST:
                archive.writestr(name, own.read(name))
        archive.writestr(MANIFEST, RELATED)
        archive.writestr(f"{FOLDER}/tests/smoke.exp", EXPERIMENT)
        archive.writestr(f"{FOLDER}/tests/in put.csv", "time,u[1]\n0,5\n0.1,5\n")
        archive.writestr(f"{FOLDER}/tests/out.csv", f"time,y[1]\n{rows}")
    answer = adaptive_fmu("validate", file, "--json")
    output = json.loads(answer.stdout)
    [replayed] = output["experiments"]
    [speed] = replayed["outputs"]
    if factor == 1.0:
        assert answer.returncode == 0 and speed["largest"] < 1e-3
    else:
        assert answer.returncode == 3 and 0.015 < speed["largest"] < 0.025
        assert [finding["section"] for finding in output["findings"] if finding["severity"] == "error"] == ["FMI-LS-REF"]


def test_a_changed_description_has_results_of_its_own(fmu: Callable[[str], Fmu], tmp_path: Path) -> None:
    (tmp_path / "fmus").mkdir()
    text = (ROOT / "modelDescription" / "TwoLinkRobot.toml").read_text()
    (tmp_path / "TwoLinkRobot.toml").write_text(text + "\n[start]\nm1 = 1.7\n")
    exported = adaptive_fmu("export", "TwoLinkRobot.toml", "--out", "fmus", folder=tmp_path)
    assert exported.returncode == 0 and exported.stderr == "", exported
    file = tmp_path / "fmus" / "TwoLinkRobot.fmu"
    references = f"{FOLDER}/references.csv"
    assert Related(file).entries[references] != Related(fmu("TwoLinkRobot").path).entries[references]
    answer = adaptive_fmu("validate", file)
    assert answer.returncode == 0, answer


def test_reference_results_can_be_left_out(tmp_path: Path) -> None:
    exported = adaptive_fmu("export", "StateSpace", "--no-reference-results", "--out", tmp_path)
    assert exported.returncode == 0 and exported.stderr == ""
    related = Related(tmp_path / "StateSpace.fmu")
    assert sorted(role for role, _, _ in related.files) == ["model", "report"]


def test_a_design_of_ones_own_has_reference_results_and_its_file_is_the_same_each_time(tmp_path: Path) -> None:
    plant = tmp_path / "plant.json"
    plant.write_text(json.dumps({"A": [[-1.0, 2.0], [0.0, -3.0]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]], "D": [[0.0]]}))
    made = adaptive_fmu("new", "l1", "--name", "Own", "--plant", plant, "--bandwidth", "5", folder=tmp_path)
    assert made.returncode == 0, made
    files = []
    for cache in ("one", "other"):
        exported = adaptive_fmu("export", "Own.toml", "--out", cache, folder=tmp_path, ADAPTIVE_FMU_CACHE=str(tmp_path / f"{cache}-cache"))
        assert exported.returncode == 0 and exported.stderr == "", exported
        files.append((tmp_path / cache / "Own.fmu").read_bytes())
    assert files[0] == files[1]
    assert Related(tmp_path / "one" / "Own.fmu").of_role("experiment/validation")
