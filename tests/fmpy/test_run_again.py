"""Results tell how they came about, are run again, stand side by side, and have rows as few as are wanted."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from conftest import ROOT, adaptive_fmu, read_csv
from test_command_line import fails

LOOP = "3.2.1-cosine"
SET = ["--set", "controller.adaptation_gain=2e4", "--set", "plant.omega=2.5", "--order", "jacobi", "--step", "0.002"]


def ran(out: Path, *options: str | Path | float, loop: str | Path = LOOP) -> dict:
    """What metrics.json tells of a run of a tenth of a second."""
    answer = adaptive_fmu("run", loop, "--until", 0.1, "--json", "--out", out, *options)
    assert answer.returncode in (0, 3), answer
    return json.loads((Path(json.loads(answer.stdout)["results"]) / "metrics.json").read_text())


def again(folder: Path, *options: str | Path) -> tuple[dict, str]:
    answer = adaptive_fmu("run", "--again", folder, "--json", *options)
    assert answer.returncode in (0, 3), answer
    return json.loads(answer.stdout), answer.stderr


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("results")
    ran(out, *SET)
    return out / LOOP


def test_results_record_their_provenance(results: Path) -> None:
    recorded = json.loads((results / "metrics.json").read_text())
    assert recorded["versions"].keys() == {"program", "sources", "format"} and len(recorded["source"]["checksum"]) == 64
    settings = recorded["settings"]
    assert (settings["stop_time"], settings["step"], settings["order"]) == (0.1, 0.002, "jacobi")
    assert settings["set"] == ["controller.adaptation_gain=2e4", "plant.omega=2.5"]
    units = recorded["units"]
    assert set(units) == {"reference", "plant", "controller"}
    # What the loop sets is the unit's own value here; what the user sets isn't.
    assert units["reference"]["parameters"] == {}
    assert units["controller"]["parameters"]["adaptation_gain"] == 2e4 and units["plant"]["parameters"]["omega"] == 2.5
    assert all(unit["guid"].startswith("{") and unit["file"] is None for unit in units.values())
    assert units["plant"]["integration"]["relative_tolerance"] > 0


def test_a_run_again_gives_the_same_numbers(results: Path) -> None:
    output, notes = again(results)
    assert output["again"] == {"of": str(results), "differences": [], "same_numbers": True}
    assert "is identical to that of" in notes and "differs" not in notes
    other = Path(output["results"])
    assert other.name == f"{LOOP}@again" and other.parent == results.parent
    assert (other / "result.csv").read_bytes() == (results / "result.csv").read_bytes()
    # It takes nothing's place that it is compared with.
    assert "--tag" in fails("run", "--again", other)
    assert again(other, "--tag", "third")[0]["again"]["same_numbers"]


def test_a_missing_loop_is_reported_as_its_results_name_it(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples" / "own" / "dc_motor", tmp_path / "loops" / "dc_motor")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert adaptive_fmu("run", "loops/dc_motor", "--until", 0.1, "--out", "results", folder=tmp_path).returncode in (0, 3)
    error = fails("run", "--again", tmp_path / "results" / "dc_motor", folder=elsewhere)
    assert "the run used the loop `loops/dc_motor`, relative to the folder in which it was started" in error
    assert list(elsewhere.iterdir()) == []


def test_a_composite_is_run_again_as_one(tmp_path: Path) -> None:
    output = ran(tmp_path, "--composite", "--set", "relative_tolerance=1e-4")
    assert output["settings"]["order"] is None and output["settings"]["composite"]
    repeated, _ = again(tmp_path / f"{LOOP}-composite")
    assert repeated["again"]["differences"] == [] and repeated["again"]["same_numbers"]


def test_a_changed_loop_a_changed_set_and_another_version_are_noticed(tmp_path: Path) -> None:
    loop = shutil.copytree(ROOT / "examples" / LOOP, tmp_path / "loop")
    case = tmp_path / "fast.ssv"
    space = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    values = '<ssv:Parameter name="plant.omega"><ssv:Real value="%s"/></ssv:Parameter>'
    case_text = f'<ssv:ParameterSet xmlns:ssv="{space}" version="1.0" name="fast"><ssv:Parameters>{values}'
    case_text += "</ssv:Parameters></ssv:ParameterSet>"
    case.write_text(case_text % 2.5)
    ran(tmp_path, "--case", case, loop=loop)
    results = tmp_path / LOOP
    assert again(results)[0]["again"]["differences"] == []
    # The same numbers, but the text is another one.
    structure = loop / "SystemStructure.ssd"
    structure.write_text(structure.read_text().replace("</ssd:System>", "</ssd:System><!-- edited -->", 1))
    output, notes = again(results)
    (difference,) = output["again"]["differences"]
    assert difference.startswith("source.checksum was") and output["again"]["same_numbers"] and difference in notes
    case.write_text(case_text % 3)
    output, _ = again(results)
    words = " ".join(output["again"]["differences"])
    assert "settings.cases" in words and "units.plant.parameters.omega was 2.5, is 3.0" in words
    assert not output["again"]["same_numbers"]
    metrics = results / "metrics.json"
    known = json.loads(metrics.read_text())
    known["versions"]["sources"] = "0123"
    metrics.write_text(json.dumps(known))
    assert any(d.startswith('versions.sources was "0123"') for d in again(results)[0]["again"]["differences"])


def test_an_fmu_from_elsewhere_is_reported_by_file_and_checksum(fmu_folder: Path, tmp_path: Path) -> None:
    fmus = shutil.copytree(fmu_folder, tmp_path / "fmus")
    output = ran(tmp_path, "--fmus", fmus)
    file = output["units"]["plant"]["file"]
    assert file["name"] == str(fmus / "NonlinearSiso.fmu") and len(file["checksum"]) == 64
    assert again(tmp_path / LOOP)[0]["again"]["same_numbers"]
    with (fmus / "NonlinearSiso.fmu").open("r+b") as archive:
        # The date of an entry: the unit is the same, the file isn't.
        archive.seek(10)
        archive.write(b"\x01")
    differences = again(tmp_path / LOOP)[0]["again"]["differences"]
    assert [d.split(" ")[0] for d in differences] == ["units.plant.file.checksum"]


def test_results_of_an_earlier_version_and_no_results_are_refused(tmp_path: Path) -> None:
    assert "metrics.json" in fails("run", "--again", tmp_path)
    (tmp_path / "metrics.json").write_text('{"loop": "x", "ended": "complete", "metrics": []}')
    assert "by its name" in fails("run", "--again", tmp_path)
    (tmp_path / "metrics.json").write_text('{"versions": {"format": 99}}')
    assert "later version" in fails("run", "--again", tmp_path)


def cut(text: str) -> str:
    """The end of the last number is gone."""
    return text[:-3] + "\n"


def without_numbers(text: str) -> str:
    """A hundred rows of a column without a number."""
    rows = [line.split(",") for line in text.splitlines()]
    for row in rows[-20:]:
        row[-5:] = ["nan"] * 5
    return "".join(f"{','.join(row)}\n" for row in rows)


DAMAGES = {
    "a number that is cut": (cut, "was changed after its run"),
    "nan": (without_numbers, "was changed after its run"),
    "a number more": (lambda text: text.replace("0.1", "0.2", 1), "was changed after its run"),
    "lost rows": (lambda text: text[: text.rindex("\n", 0, -1) + 1], "it has 50 of 51 rows"),
    "the file": (lambda _: None, "result.csv"),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_a_damaged_table_is_neither_compared_nor_run_again(what: str, results: Path, tmp_path: Path) -> None:
    folder, (damage, reason) = shutil.copytree(results, tmp_path / LOOP), DAMAGES[what]
    table = folder / "result.csv"
    damaged = damage(table.read_text())
    table.unlink()
    if damaged is not None:
        table.write_text(damaged)
    for words in [("compare", results, folder), ("run", "--again", folder)]:
        error = fails(*words, "--out", tmp_path / "out")
        assert str(table) in error and reason in error
    assert not (tmp_path / "out").exists()


def test_results_without_checksums_are_compared_with_a_note(results: Path, tmp_path: Path) -> None:
    """As version 0.1 wrote them."""
    folder = shutil.copytree(results, tmp_path / LOOP)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["written"].pop("files").keys() == {"result.csv"}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    for words in [("compare", results, folder), ("run", "--again", folder)]:
        answer = adaptive_fmu(*words, "--out", tmp_path / "out")
        assert answer.returncode in (0, 3) and answer.stderr.count("results of `simulate` and of version 0.1 have no checksums") == 1, answer


def test_runs_under_tags_are_side_by_side(tmp_path: Path) -> None:
    for tag in ["slow", "fast"]:
        assert ran(tmp_path, "--tag", tag)["loop"] == f"{LOOP}@{tag}"
    assert sorted(folder.name for folder in tmp_path.iterdir()) == [f"{LOOP}@fast", f"{LOOP}@slow"]
    for bad in ["../x", "a/b", ".x", ""]:
        answer = adaptive_fmu("run", LOOP, f"--tag={bad}", "--out", tmp_path)
        assert answer.returncode == 2 and "letters" in answer.stderr


def test_few_rows_are_written_and_metrics_are_of_all_points(results: Path, tmp_path: Path) -> None:
    output = ran(tmp_path, *SET, "--every", 0.01)
    assert output["metrics"] == json.loads((results / "metrics.json").read_text())["metrics"]
    all_rows, few = read_csv(results / "result.csv"), read_csv(tmp_path / LOOP / "result.csv")
    assert few["time"] == pytest.approx(np.linspace(0, 0.1, 11))
    assert np.array_equal(few["plant.x[1]"], all_rows["plant.x[1]"][::5])
    # No multiple of the step: the next point, and the last.
    ran(tmp_path, *SET, "--every", 0.005, "--tag", "odd")
    times = read_csv(tmp_path / f"{LOOP}@odd" / "result.csv")["time"]
    assert times[:4] == pytest.approx([0, 0.006, 0.01, 0.016]) and times[-1] == pytest.approx(0.1)
    # Again, they are as few.
    output, _ = again(tmp_path / f"{LOOP}@odd")
    assert output["again"]["same_numbers"]


def test_parquet_holds_the_columns_of_the_csv_and_their_units(tmp_path: Path) -> None:
    marks = ran(tmp_path, "--parquet")["written"]["files"]
    for name in ["result.csv", "result.parquet"]:
        assert marks[name]["checksum"] == hashlib.sha256((tmp_path / LOOP / name).read_bytes()).hexdigest()
    table, file = read_csv(tmp_path / LOOP / "result.csv"), tmp_path / LOOP / "result.parquet"
    read = pyarrow.parquet.read_table(file)
    assert read.column_names == list(table) and len(table) > 10
    for name in table:
        assert np.array_equal(read[name].to_numpy(), table[name]), name
    metadata = {key.decode(): value.decode() for key, value in read.schema.metadata.items()}
    assert metadata["unit of time"] == "s"
    assert {mark["rows"] for mark in marks.values()} == {len(table["time"])}
    # The table's other form is checked as well.
    content = file.read_bytes()
    file.write_bytes(content[:-100] + bytes(1) + content[-99:])
    assert str(file) in fails("run", "--again", tmp_path / LOOP)
    file.write_bytes(content)
    assert pyarrow.parquet.ParquetFile(file).metadata.created_by.startswith("adaptive-fmu ")
    # A run without it leaves none of other numbers.
    ran(tmp_path)
    assert not file.exists()
