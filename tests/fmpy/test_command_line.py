"""The program as a user runs it: what it prints, what it writes, how it ends."""

import json
import shutil
from pathlib import Path

import fmpy
import numpy as np
import pytest
from conftest import FMU_NAMES, ROOT, adaptive_fmu, read_csv
from fmpy.validation import validate_fmu
from lxml import etree
from master import CONTROLLER, PLANT, Fmu, Unit, closed_loop

LOOPS = ["3.2.1-cosine", "3.2.1-square"]
PLANT_TOML = (ROOT / "modelDescription" / f"{PLANT}.toml").read_text()


def fails(*arguments: str | Path, folder: Path = ROOT) -> str:
    """What is told on stderr when something can't be done; nothing goes to stdout."""
    answer = adaptive_fmu(*arguments, folder=folder)
    assert (answer.returncode, answer.stdout) == (1, ""), answer
    # A library that was built for tests says so.
    lines = [line for line in answer.stderr.splitlines() if not line.startswith("warning: the library was built without")]
    assert lines[0].startswith("error: ") and "panicked" not in answer.stderr, answer
    return answer.stderr


def test_list_names_every_fmu_and_loop_as_json() -> None:
    answer = adaptive_fmu("list", "--json")
    assert (answer.returncode, answer.stderr) == (0, "")
    listed = json.loads(answer.stdout)
    assert sorted(entry["name"] for entry in listed["fmus"]) == FMU_NAMES
    assert all(entry["versions"] == ["2.0", "3.0"] for entry in listed["fmus"])
    assert sorted(entry["name"] for entry in listed["loops"]) == sorted(ssd.parent.name for ssd in ROOT.glob("examples/*/*.ssd"))
    assert set(LOOPS) <= {entry["name"] for entry in listed["loops"]}
    assert all(entry["description"] for entries in listed.values() for entry in entries)


def test_list_names_them_for_people_too() -> None:
    answer = adaptive_fmu("list")
    assert answer.returncode == 0 and [name for name in FMU_NAMES + LOOPS if name not in answer.stdout] == []


def test_info_as_json_is_that_of_the_description(each_fmu) -> None:
    answer = adaptive_fmu("info", each_fmu.path, "--json")
    assert (answer.returncode, answer.stderr) == (0, "")
    output = json.loads(answer.stdout)
    assert (output["name"], output["guid"]) == (each_fmu.name, each_fmu.description.guid)
    variables = {v["name"]: v for v in output["variables"]}
    assert set(variables) == set(each_fmu.variables)
    for name, variable in each_fmu.variables.items():
        assert (variables[name]["causality"], variables[name]["unit"]) == (variable.causality, variable.unit)
        assert variables[name]["valueReference"] == variable.valueReference
    assert output["source"] == (ROOT / "modelDescription" / f"{each_fmu.name}.toml").read_text()


@pytest.fixture(scope="module", params=["gauss-seidel", "jacobi"])
def short_run(request, fmu_folder, tmp_path_factory):
    """Two seconds of the cosine loop, run by the program: its order, its answer, its folder."""
    out = tmp_path_factory.mktemp("results")
    command = ["run", "3.2.1-cosine", "--json", "--until", "2", "--order", request.param]
    return request.param, adaptive_fmu(*command, "--fmus", fmu_folder, "--out", out), out / "3.2.1-cosine"


def test_run_ends_well_with_metrics_csv_and_plot(short_run) -> None:
    _, answer, folder = short_run
    assert (answer.returncode, answer.stderr) == (0, "")
    output = json.loads(answer.stdout)
    assert (output["loop"], output["warnings"]) == ("3.2.1-cosine", [])
    metrics = {metric["label"]: metric["value"] for metric in output["metrics"]}
    # Two of three begin at 5 s: they have no value yet, and so none that could be taken for a good one.
    assert [label for label, value in metrics.items() if value is None] == [label for label in metrics if "5 s" in label]
    table = read_csv(folder / "result.csv")
    assert len(table["time"]) == 2001 and table["time"][-1] == 2.0
    assert metrics["max |u|"] == np.abs(table["controller.u[1]"]).max()
    assert json.loads((folder / "metrics.json").read_text())["metrics"] == output["metrics"]
    plot = etree.parse(folder / "plot.svg").getroot()
    assert plot.tag.endswith("svg") and plot.findall(".//{*}polyline") + plot.findall(".//{*}path")


def test_run_and_fmpy_compute_the_same_loop(short_run, fmu) -> None:
    order, _, folder = short_run
    table, loop = read_csv(folder / "result.csv"), closed_loop(fmu, 2.0, 1e-3, order)
    columns = {"reference.r[1]": loop.r, "plant.y[1]": loop.y, "controller.u[1]": loop.u}
    columns |= {f"plant.x[{i}]": loop.x[:, i - 1] for i in (1, 2)}
    for name, values in columns.items():
        assert np.abs(table[name] - values).max() <= 1e-9, name


@pytest.mark.parametrize("name", LOOPS)
def test_run_of_a_whole_example_keeps_within_its_limits(name: str, fmu_folder, tmp_path) -> None:
    answer = adaptive_fmu("run", name, "--json", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode == 0, answer
    metrics = json.loads(answer.stdout)["metrics"]
    assert len(metrics) >= 2 and all(metric["value"] <= metric["limit"] for metric in metrics if metric["limit"])


def test_a_metric_beyond_its_limit_has_its_own_exit_code(fmu_folder, tmp_path) -> None:
    shutil.copytree(ROOT / "examples" / "3.2.1-cosine", tmp_path / "strict")
    strict = tmp_path / "strict" / "SystemStructure.ssd"
    strict.write_text(strict.read_text().replace('limit="2.85"', 'limit="0.001"'))
    answer = adaptive_fmu("run", strict, "--json", "--until", "0.5", "--fmus", fmu_folder, "--out", tmp_path / "out")
    assert (answer.returncode, answer.stderr) == (3, "")


def test_run_for_people_prints_the_metrics_and_where_the_files_are(fmu_folder, tmp_path) -> None:
    answer = adaptive_fmu("run", "3.2.1-square", "--until", "1", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode == 0 and "max |u|" in answer.stdout and str(tmp_path) in answer.stdout


def test_run_takes_the_fmus_of_a_folder_as_they_are(fmu_folder: Path, tmp_path: Path) -> None:
    command = ["run", "3.2.1-cosine", "--json", "--until", "0.1", "--out", tmp_path / "out"]
    before = {file: file.stat().st_mtime_ns for file in fmu_folder.iterdir()}
    assert adaptive_fmu(*command, "--fmus", fmu_folder).returncode == 0
    assert {file: file.stat().st_mtime_ns for file in fmu_folder.iterdir()} == before
    (tmp_path / "empty").mkdir()
    assert "ReferenceNonlinearSiso.fmu" in fails(*command, "--fmus", tmp_path / "empty")


def test_run_without_a_folder_never_shows_the_numbers_of_an_older_export(tmp_path: Path) -> None:
    stale = [tmp_path / "fmus" / f"{name}.fmu" for name in [CONTROLLER, PLANT, "ReferenceNonlinearSiso"]]
    stale[0].parent.mkdir()
    for file in stale:
        file.write_text("an older export")
    done = adaptive_fmu("run", "3.2.1-cosine", "--json", "--until", "0.1", "--out", tmp_path, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert all(file.read_text() == "an older export" for file in stale)


def test_what_cant_be_done_is_reported_on_stderr_with_exit_code_1(tmp_path: Path) -> None:
    assert "3.2.1-cosine" in fails("run", "3.2.1-cosinus", "--out", tmp_path)
    assert PLANT in fails("export", "NonlinearSisso", "--out", tmp_path)
    assert "gone.fmu" in fails("info", tmp_path / "gone.fmu")
    assert "gone.toml" in fails("export", tmp_path / "gone.toml", "--out", tmp_path)
    assert "gone.ssd" in fails("run", tmp_path / "gone.ssd", "--out", tmp_path)
    no_archive = tmp_path / "text.fmu"
    no_archive.write_text("no archive")
    assert "text.fmu" in fails("info", no_archive)
    assert [file.name for file in tmp_path.iterdir()] == ["text.fmu"]


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["run"],
        ["run", LOOPS[0], "--step", "small"],
        ["run", LOOPS[0], "--step", "0"],
        ["run", LOOPS[0], "--step=-0.001"],
        ["run", LOOPS[0], "--step", "nan"],
        ["run", LOOPS[0], "--until", "inf"],
        ["run", LOOPS[0], "--order", "backwards"],
        ["export", PLANT, "--all"],
        ["list", "--xml"],
        ["info"],
    ],
    ids=" ".join,
)
def test_wrong_arguments_end_with_exit_code_2(arguments: list[str]) -> None:
    answer = adaptive_fmu(*arguments)
    assert (answer.returncode, answer.stdout) == (2, "") and "--help" in answer.stderr


TWINS = """name = "R"
model = "reference"
description = "two signals of one name"
[structure]
channels = 1
signals = [{ name = "twin", description = "", parts = [] }, { name = "twin", description = "", parts = ["square"] }]
"""
BROKEN = {
    "two signals of one name": (TWINS, "twin"),
    "no TOML": ("name = [", "line 1"),
    "no model": ('name = "A"\n', "model"),
    "unknown model": (PLANT_TOML.replace('"nonlinear-siso"', '"l2"'), "l2"),
    "unknown key": (PLANT_TOML + "\n[strat]\nomega = 1.0\n", "strat"),
    "unknown start value": (PLANT_TOML + "\n[start]\nomgea = 1.0\n", "omgea"),
    "start value that is no number": (PLANT_TOML + "\n[start]\nomega = nan\n", "omega"),
    "start value of a wrong size": (PLANT_TOML + "\n[start]\nx0 = [1.0]\n", "x0"),
    "step of zero": (PLANT_TOML.replace("step = 0.001", "step = 0.0"), "step"),
    "path for a name": (PLANT_TOML.replace(f'"{PLANT}"', '"../../escaped"'), "name"),
    "absolute path for a name": (PLANT_TOML.replace(f'"{PLANT}"', '"/escaped"'), "name"),
    "line break in a name": (PLANT_TOML.replace(f'"{PLANT}"', '"A\\nB"'), "name"),
    "NUL in a name": (PLANT_TOML.replace(f'"{PLANT}"', '"A\\u0000"'), "name"),
    "no name": (PLANT_TOML.replace(f'"{PLANT}"', '""'), "name"),
    "endless name": (PLANT_TOML.replace(f'"{PLANT}"', f'"{"a" * 5000}"'), "name"),
    "too many channels": (
        'name = "R"\nmodel = "reference"\ndescription = ""\n[structure]\nchannels = 1000000000\n',
        "channels",
    ),
    "deep nesting": ("x = " + "[" * 100_000, "line 1"),
}


@pytest.mark.parametrize("text", BROKEN)
def test_a_description_that_cant_be_used_is_refused_and_leaves_no_file_behind(text: str, tmp_path: Path) -> None:
    content, word = BROKEN[text]
    file, out = tmp_path / "inner" / "mine.toml", tmp_path / "inner" / "out"
    file.parent.mkdir()
    file.write_text(content)
    error = fails("export", file, "--out", out)
    assert "mine.toml" in error and word in error
    assert not out.exists() or list(out.iterdir()) == []
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == ["mine.toml"]


def test_markup_and_control_characters_in_a_description_stay_text(tmp_path: Path) -> None:
    hostile = """</p><script>alert("1")</script> & ]]> " ' <img src=x onerror=alert(1)>"""
    lines = ["name = 'Hostile'", "model = 'nonlinear-siso'", f"description = '''{hostile}'''"]
    (tmp_path / "mine.toml").write_text("\n".join(lines))
    assert adaptive_fmu("export", tmp_path / "mine.toml", "--out", tmp_path).returncode == 0
    file = tmp_path / "Hostile.fmu"
    assert validate_fmu(str(file)) == []
    output = json.loads(adaptive_fmu("info", file, "--json").stdout)
    assert output["description"] == hostile
    shutil.unpack_archive(file, tmp_path / "unpacked", "zip")
    page = (tmp_path / "unpacked" / "documentation" / "index.html").read_text()
    assert "<script" not in page and "<img" not in page and "&lt;script&gt;" in page


@pytest.mark.parametrize("character", ["\\u0000", "\\u0001", "\\u001b", "\\uffff"])
def test_a_character_that_xml_cant_hold_is_refused_or_left_out(character: str, tmp_path: Path) -> None:
    text = PLANT_TOML.replace('description = "', f'description = "a{character}b ')
    (tmp_path / "mine.toml").write_text(text)
    answer = adaptive_fmu("export", tmp_path / "mine.toml", "--out", tmp_path / "out")
    assert "panicked" not in answer.stderr
    if answer.returncode == 0:
        assert validate_fmu(str(tmp_path / "out" / f"{PLANT}.fmu")) == []
    else:
        assert answer.returncode == 1 and not list((tmp_path / "out").glob("*"))


def test_a_file_that_is_no_library_of_models_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "library.so"
    text.write_text("no library")
    assert "library.so" in fails("export", PLANT, "--library", text, "--out", tmp_path / "out")
    # A real library, but without models.
    (other,) = (Path(fmpy.__file__).parent / "logging" / "linux64").glob("*.so")
    assert "models" in fails("export", PLANT, "--library", other, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []


def test_why_a_library_cant_be_loaded_is_reported(tmp_path: Path) -> None:
    text = tmp_path / "library.so"
    text.write_text("no library" * 1000)
    assert "invalid ELF header" in fails("export", PLANT, "--library", text, "--out", tmp_path)
    assert "No such file" in fails("export", PLANT, "--library", tmp_path / "gone.so", "--out", tmp_path)


def test_a_folder_that_cant_be_written_is_reported(tmp_path: Path) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.write_text("")
    assert str(in_the_way) in fails("export", PLANT, "--out", in_the_way)


def test_a_design_of_ones_own_is_exported_from_a_text_file_and_runs(tmp_path: Path) -> None:
    text = (ROOT / "modelDescription" / f"{CONTROLLER}.toml").read_text()
    text = text.replace(f'"{CONTROLLER}"', '"MyController"').replace("[[20.0]]", "[[33.0]]")
    (tmp_path / "mine.toml").write_text(text)
    answer = adaptive_fmu("export", tmp_path / "mine.toml", "--out", tmp_path, "--json")
    assert json.loads(answer.stdout) == {"fmus": [str(tmp_path / "MyController.fmu")]}
    with Unit(Fmu(tmp_path / "MyController.fmu", tmp_path / "unpacked")) as mine:
        mine.start(**{"r[1]": 1.0}).step(0.0, 1e-6)
        assert mine["feedback_gain[1,1]"] == 33.0
        # u' = K r at rest.
        assert mine["u[1]"] == pytest.approx(33e-6, rel=1e-4)
