"""FMUs of FMI 3.0 in this program: of this package and of others, alone, in loops, with FMUs of FMI 2.0 beside them."""

import json
import re
import subprocess
import zipfile
from pathlib import Path

import adaptive_fmu as python
import fmpy
import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu, read_csv
from sample import FMUS, LOOPS, NUMBER

LOOP = "3.3.1-case2"
HEADERS = Path(fmpy.__file__).parent / "c-code"
LAWS = ("L1TwoLinkRobot", "PidNonlinearSiso", "LadrcTwoLinkRobot", "L1SampledTwoLinkRobot", "MracPpfCoupledMimo")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The FMUs of some loops, of each version."""
    made = {version: tmp_path_factory.mktemp(f"fmi{version}") for version in (2, 3)}
    names = ["ReferenceTwoLinkRobot", "TwoLinkRobot", *LAWS]
    for version, folder in made.items():
        answer = adaptive_fmu("export", "--fmi", str(version), *names, "--out", folder)
        assert answer.returncode == 0, answer.stderr
    return made


def run(out: Path, fmus: Path, *options: str, loop: str | Path = LOOP, step: str = "0.004") -> tuple[dict, dict[str, np.ndarray], bytes]:
    """metrics.json, the columns and the bytes of result.csv."""
    answer = adaptive_fmu("run", loop, "--fmus", fmus, "--until", "1", "--step", step, *options, "--out", out, "--json")
    # 3 where metrics of later times are missing.
    assert answer.returncode in (0, 3), answer.stderr
    folder = Path(json.loads(answer.stdout)["results"])
    metrics = json.loads((folder / "metrics.json").read_text())
    return metrics, read_csv(folder / "result.csv"), (folder / "result.csv").read_bytes()


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
def test_without_event_mode_a_loop_has_the_bits_of_fmi_2(order: str, folders: dict[int, Path], tmp_path: Path) -> None:
    old, new = (run(tmp_path / str(version), folders[version], "--order", order) for version in (2, 3))
    assert new[2] == old[2]
    assert new[0]["settings"]["order"] == order


def test_event_mode_is_the_default_where_all_have_it_that_pass_values_through(folders: dict[int, Path], tmp_path: Path) -> None:
    metrics, new, _ = run(tmp_path / "new", folders[3])
    assert metrics["settings"]["order"] == "event-mode"
    _, old, _ = run(tmp_path / "old", folders[2], "--order", "jacobi")
    answer = adaptive_fmu("run", LOOP, "--composite", "--until", "1", "--step", "0.004", "--out", tmp_path, "--json")
    whole = read_csv(Path(json.loads(answer.stdout)["results"]) / "result.csv")
    for joint in ("controller.u[1]", "controller.u[2]"):
        errors = [np.abs(each[joint] - whole[joint]).max() for each in (new, old)]
        assert errors[0] < 0.4 * errors[1], (joint, errors)


def test_versions_mix(folders: dict[int, Path], tmp_path: Path) -> None:
    """The plant of FMI 2.0, whose outputs are states: Event Mode stays. A reference of FMI 2.0 has no inputs."""
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for name, version in (("L1TwoLinkRobot", 3), ("TwoLinkRobot", 2), ("ReferenceTwoLinkRobot", 2)):
        (mixed / f"{name}.fmu").symlink_to(folders[version] / f"{name}.fmu")
    for order in ("jacobi", "gauss-seidel"):
        assert run(tmp_path / order, mixed, "--order", order)[2] == run(tmp_path / f"2{order}", folders[2], "--order", order)[2]
    metrics, columns, _ = run(tmp_path / "events", mixed, "--order", "event-mode")
    assert metrics["settings"]["order"] == "event-mode"
    assert np.isfinite(columns["controller.u[1]"]).all()


@pytest.mark.parametrize("loop", LOOPS)
def test_each_loop_runs_with_fmus_of_fmi_3(loop: str, tmp_path: Path) -> None:
    """By Event Mode; in Jacobi order with the bits of FMI 2.0."""
    structure = (ROOT / "examples" / loop / "SystemStructure.ssd").read_text()
    names = sorted(set(re.findall(r'source="resources/(\w+)\.fmu"', structure)))
    for version in ("2", "3"):
        answer = adaptive_fmu("export", "--fmi", version, *names, "--out", tmp_path / version)
        assert answer.returncode == 0, answer.stderr
    step = re.search(r'step="([^"]+)" order', structure)[1]
    until = str(20 * float(step))
    answers = []
    for version in ("2", "3"):
        words = ["run", loop, "--fmus", tmp_path / version, "--until", until, "--order", "jacobi", "--json"]
        answer = adaptive_fmu(*words, "--out", tmp_path / f"of_{version}")
        answers.append((answer.returncode, (tmp_path / f"of_{version}" / loop / "result.csv").read_bytes()))
    assert answers[0] == answers[1]
    by_events = adaptive_fmu("run", loop, "--fmus", tmp_path / "3", "--until", until, "--json", "--out", tmp_path / "events")
    # 3 where a metric misses its limit.
    assert by_events.returncode in (0, 3), by_events.stderr
    metrics = json.loads((tmp_path / "events" / loop / "metrics.json").read_text())
    assert metrics["settings"]["order"] == "event-mode"


def test_event_mode_is_refused_where_no_component_has_it(folders: dict[int, Path]) -> None:
    answer = adaptive_fmu("run", LOOP, "--fmus", folders[2], "--order", "event-mode")
    assert answer.returncode == 1
    assert "--order event-mode: no component has Event Mode. Export FMUs by `adaptive-fmu export --fmi 3`" in answer.stderr


def test_a_sample_is_taken_of_what_is_measured_at_its_time(folders: dict[int, Path], tmp_path: Path) -> None:
    """A sampled law at its sample time: with Event Mode its control follows from the plant's state at the same point."""
    made = adaptive_fmu(
        *("new", "loop", "--units", "ReferenceTwoLinkRobot", "TwoLinkRobot", "L1SampledTwoLinkRobot"),
        *("--step", "0.005", "--out", tmp_path / "loop"),
    )
    assert made.returncode == 0, made.stderr
    loop = tmp_path / "loop" / "SystemStructure.ssd"
    answer = adaptive_fmu("run", loop, "--composite", "--until", "1", "--out", tmp_path, "--json")
    whole = read_csv(Path(json.loads(answer.stdout)["results"]) / "result.csv")
    errors = {}
    for order in ("event-mode", "gauss-seidel", "jacobi"):
        _, columns, _ = run(tmp_path / order, folders[3], "--order", order, loop=loop, step="0.005")
        errors[order] = np.abs(columns["plant.x[1]"] - whole["plant.x[1]"]).max()
    assert errors["event-mode"] < 0.2 * min(errors["gauss-seidel"], errors["jacobi"]), errors


@pytest.mark.parametrize("interface", ["cs", "me"])
def test_a_unit_alone_has_the_numbers_of_fmi_2(interface: str, folders: dict[int, Path], tmp_path: Path) -> None:
    name = LAWS[NUMBER % len(LAWS)]
    results = []
    for version in (2, 3):
        file, out = folders[version] / f"{name}.fmu", tmp_path / str(version)
        answer = adaptive_fmu("simulate", file, "--interface", interface, "--until", "0.2", "--step", "0.005", "--out", out)
        assert answer.returncode == 0, answer.stderr
        results.append((out / name / "result.csv").read_bytes())
    assert results[0] == results[1]


def test_a_linear_model_is_that_of_fmi_2(folders: dict[int, Path]) -> None:
    old, new = (adaptive_fmu("linearise", folders[version] / "TwoLinkRobot.fmu", "--json") for version in (2, 3))
    assert (old.returncode, new.returncode) == (0, 0), new.stderr
    assert json.loads(new.stdout) == json.loads(old.stdout)


def test_a_trim_point_a_sweep_and_a_comparison_are_those_of_fmi_2(folders: dict[int, Path], tmp_path: Path) -> None:
    words = ["--free", "u[1],u[2]", "--want", "x[1]=0.3", "--want", "x[2]=0.2", "--json"]
    trimmed = [adaptive_fmu("linearise", folders[version] / "TwoLinkRobot.fmu", *words) for version in (2, 3)]
    assert trimmed[0].returncode == 0, trimmed[0].stderr
    assert trimmed[1].stdout == trimmed[0].stdout
    for words in (["sweep", LOOP, "--over", "plant.m1=1,1.2"], ["compare", LOOP, f"other={LOOP}:plant.m1=1.1"]):
        messages = []
        for version in (2, 3):
            options = ["--fmus", folders[version], "--order", "jacobi", "--until", "0.2", "--step", "0.002"]
            answer = adaptive_fmu(*words, *options, "--out", tmp_path / str(version), "--json")
            assert answer.returncode in (0, 3), answer.stderr
            messages.append(re.sub(rf'"[^"]*{re.escape(str(tmp_path))}[^"]*"|"seconds":[^,}}]*', "", answer.stdout))
        assert messages[0] == messages[1]


def test_a_loop_is_made_of_fmus_of_fmi_3(folders: dict[int, Path], tmp_path: Path) -> None:
    """Connected, named and stepped as one of FMI 2.0, with its values."""
    made = []
    for version in (2, 3):
        units = [folders[version] / f"{name}.fmu" for name in ("ReferenceTwoLinkRobot", "TwoLinkRobot", "L1TwoLinkRobot")]
        out = tmp_path / str(version) / "robot"
        answer = adaptive_fmu("new", "loop", "--units", *units, "--step", "0.001", "--out", out)
        assert answer.returncode == 0, answer.stderr
        made.append((out / "SystemStructure.ssd").read_text().replace(str(folders[version]), ""))
        ran = adaptive_fmu("run", out, "--order", "jacobi", "--until", "0.01", "--out", out / "results", "--json")
        assert ran.returncode in (0, 3), ran.stderr
        made.append(next((out / "results").glob("*/result.csv")).read_bytes())
    assert made[:2] == made[2:]


def test_a_controller_is_made_for_a_plant_of_fmi_3(folders: dict[int, Path], tmp_path: Path) -> None:
    written = []
    for version in (2, 3):
        out = tmp_path / f"{version}.toml"
        words = ["new", "ladrc", "--plant", folders[version] / "TwoLinkRobot.fmu", "--bandwidth", "10", "--outputs", "x[1],x[2]"]
        answer = adaptive_fmu(*words, "--name", "Law", "--out", out)
        written.append((answer.returncode, answer.stderr, out.read_text() if out.exists() else None))
    assert written[0] == written[1]


@pytest.mark.parametrize("name", FMUS)
def test_what_is_exported_is_sound(name: str, tmp_path: Path) -> None:
    """With its reference experiment, whose arrays may have one element only."""
    exported = adaptive_fmu("export", "--fmi", "3", name, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    answer = adaptive_fmu("validate", tmp_path / f"{name}.fmu")
    assert (answer.returncode, "sound, errors: 0, warnings: 0; run for 20 steps" in answer.stdout) == (0, True), answer.stdout


def test_an_fmu_takes_the_place_of_the_other_version_with_a_line(tmp_path: Path) -> None:
    """And back; loops as archives are of FMI 2.0."""
    for version, message in [
        ("2", ""),
        ("3", "was an FMU of FMI 2.0, and is one of FMI 3.0 now"),
        ("3", ""),
        ("2", "of FMI 3.0, and is one of FMI 2.0 now"),
    ]:
        exported = adaptive_fmu("export", "--fmi", version, "NonlinearSiso", "--out", tmp_path)
        assert exported.returncode == 0
        assert message in exported.stderr if message else exported.stderr == ""
        assert fmpy.read_model_description(tmp_path / "NonlinearSiso.fmu").fmiVersion == f"{version}.0"
    of_3 = adaptive_fmu("export", "--fmi", "3", "NonlinearSiso", "--out", tmp_path / "3")
    assert of_3.returncode == 0
    for arguments in ({"fmi": 5}, {"fmi": 3, "ssp": "3.2.1-cosine"}):
        with pytest.raises(python.ArgumentError, match="fmi"):
            python.export("NonlinearSiso", out=tmp_path, **arguments)
    read = adaptive_fmu("info", tmp_path / "3" / "NonlinearSiso.fmu")
    assert read.returncode == 0 and "FMI 3.0, generated by adaptive-fmu" in read.stdout


@pytest.fixture(scope="module")
def all_types(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another tool's FMU, with an array of each type."""
    folder = tmp_path_factory.mktemp("all_types")
    foreign, library = ROOT / "tests" / "foreign", folder / "AllTypes.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-O1", "-w", "-I", HEADERS, "-o", library, foreign / "all_types.c"], check=True
    )
    with zipfile.ZipFile(folder / "AllTypes.fmu", "w") as archive:
        archive.write(foreign / "all_types.xml", "modelDescription.xml")
        archive.write(library, "binaries/x86_64-linux/AllTypes.so")
    return folder / "AllTypes.fmu"


@pytest.mark.parametrize("hosting", [[], ["--in-process"]])
def test_values_of_all_types_pass_through_arrays(hosting: list[str], all_types: Path, tmp_path: Path) -> None:
    """Elements are set one by one, the others keep their start values."""
    given = {"length[2]": "-99.5", "short[1]": "0.1", "byte[1,2]": "-128", "word[1]": "65535", "colour[1]": "green"}
    given |= {"long": "2147483647", "on[2]": "false"}
    sets = [word for name, value in given.items() for word in ("--set", f"{name}={value}")]
    answer = adaptive_fmu("simulate", all_types, *sets, *hosting, "--out", tmp_path)
    assert answer.returncode == 0, answer.stderr
    last = {name: values[-1] for name, values in read_csv(tmp_path / "AllTypes" / "result.csv").items()}
    expected = {"y_length[1]": 1, "y_length[2]": -99.5, "y_short[1]": float(np.float32(0.1)), "y_short[2]": 0.5}
    expected |= {"y_byte[1]": 0, "y_byte[2]": -128, "y_word[1]": 65535, "y_word[2]": 0}
    expected |= {"y_colour[1]": 7, "y_colour[2]": 7, "y_long": 2147483647, "y_on[1]": 0, "y_on[2]": 0}
    assert {name: last[name] for name in expected} == expected


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("byte[1,1]=200", "AllTypes: fmi3SetInt32 failed at t = 0 s: `byte` = 200: Int8 must be within -128 … 127"),
        ("long=-1", "AllTypes: fmi3SetInt32 failed at t = 0 s: `long` = -1: UInt64 must be within 0 … 18446744073709552000"),
        ("text=good bye", "AllTypes: fmi3DoStep failed at t = 0 s: the text is not hello"),
        ("crash=1", "AllTypes: fmi3DoStep failed at t = 0 s: crashed with signal 6 (SIGABRT, call of abort)"),
        ("crash=2", "AllTypes: fmi3DoStep failed at t = 0 s: it can't make this step"),
        ("crash=3", "AllTypes: fmi3DoStep failed at t = 0 s: the FMU requested to end the simulation"),
        ("length[3]=1", "there is no parameter or input named `length[3]`; its index must be within 1 … 2"),
    ],
)
def test_what_fails_names_function_and_reason(given: str, message: str, all_types: Path, tmp_path: Path) -> None:
    answer = adaptive_fmu("simulate", all_types, "--set", given, "--out", tmp_path)
    assert answer.returncode == 1
    assert message in answer.stderr, answer.stderr


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<Binary", '<Clock name="c" valueReference="96"/><Binary', "`c` is a Clock, which `adaptive-fmu` can't activate"),
        ("<CoSimulation", "<ScheduledExecution", "the FMU is for Scheduled Execution only"),
        ('start="1 2"', 'start="1 2 3"', "`length`: 3 start values, but 2 elements"),
        ('valueReference="11" dependencies', 'valueReference="12" dependencies', 'valueReference = "12"'),
    ],
)
def test_what_cannot_be_run_is_refused_with_the_reason(old: str, new: str, message: str, all_types: Path, tmp_path: Path) -> None:
    file = tmp_path / "Changed.fmu"
    with zipfile.ZipFile(all_types) as archive, zipfile.ZipFile(file, "w") as changed:
        text = archive.read("modelDescription.xml").decode()
        assert old in text
        changed.writestr("modelDescription.xml", text.replace(old, new, 1))
    for command in (["simulate"], ["validate", "--no-run"]):
        answer = adaptive_fmu(*command, file)
        assert answer.returncode in (1, 3)
        assert message in answer.stderr + answer.stdout, answer
