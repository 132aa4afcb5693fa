"""Sweeps: what single runs give, also when they are interrupted and go on; and comparisons of anything."""

import csv
import json
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from lxml import html

LOOP = "3.2.1-cosine"
GAIN, OMEGA = "controller.adaptation_gain", "plant.omega"
SHORT = ["--until", "6", "--step", "0.005"]


def fails(*arguments: str | Path) -> str:
    """Why something can't be done; nothing goes to stdout."""
    answer = adaptive_fmu(*arguments)
    assert (answer.returncode, answer.stdout) == (1, ""), answer
    return next(line for line in answer.stderr.splitlines() if line.startswith("error: "))


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "points.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def swept(out: Path, *options: str, code: int = 0) -> Path:
    answer = adaptive_fmu("sweep", LOOP, *options, "--json", "--out", out)
    assert answer.returncode == code, answer
    return Path(json.loads(answer.stdout)["results"])


@pytest.fixture(scope="module")
def gains(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep over a gain, whose unit need not be named."""
    return swept(tmp_path_factory.mktemp("gains"), "--over", "adaptation_gain=1e3..1e5/log3", *SHORT)


def test_a_sweep_measures_what_single_runs_do(gains: Path, tmp_path: Path) -> None:
    points = rows(gains)
    assert [point[GAIN] for point in points] == ["1000", "10000", "100000"]
    for point in points:
        options = ["--set", f"{GAIN}={point[GAIN]}", "--json", "--out", tmp_path]
        output = json.loads(adaptive_fmu("run", LOOP, *SHORT, *options).stdout)
        assert {m["label"]: m["value"] for m in output["metrics"]} == {
            m["label"]: float(point[m["label"]]) for m in output["metrics"]
        }
        assert point["ended"] == "complete" and point["message"] == ""


def test_its_page_has_a_diagram_a_metric_and_a_curve_a_run(gains: Path) -> None:
    text = (gains / "index.html").read_text()
    page = html.document_fromstring(text)
    assert "default-src 'none'" in text and not page.xpath("//*[@src]") and not page.find_class("bad")
    labels = [column for column in rows(gains)[0] if column not in (GAIN, "ended", "message")]
    titles = [svg.get("aria-label") for svg in page.iter("svg")]
    assert titles[: len(labels)] == labels
    # The ideal model and the reference are the same in all runs: a dashed line beside the output.
    assert titles[len(labels) :] == ["plant.y[1]", "controller.u[1]"]
    runs = [f"{GAIN} = {gain}" for gain in [1000, 10000, 100000]]
    for svg, same in zip(list(page.iter("svg"))[len(labels) :], [["y_m", "reference.r[1]"], []], strict=True):
        assert [title.text for title in svg.iter("title")] == runs + same
    assert len(page.get_element_by_id("runs").findall(".//tr")) == 1 + 3


def test_its_axes_have_the_words_of_those_of_a_run(tmp_path: Path) -> None:
    motor, short = ROOT / "examples" / "own" / "dc_motor", ["--until", "2", "--step", "0.005"]
    answer = adaptive_fmu("sweep", motor, "--over", "motor.B[2,1]=400,600", *short, "--json", "--out", tmp_path)
    page = html.document_fromstring((Path(json.loads(answer.stdout)["results"]) / "index.html").read_text())
    axes = {svg.get("aria-label"): svg.xpath("./*[local-name() = 'text'][not(@x) or @y = '312']/text()") for svg in page.iter("svg")}
    ran = adaptive_fmu("run", motor, *short, "--json", "--out", tmp_path)
    drawn = html.document_fromstring((Path(json.loads(ran.stdout)["results"]) / "index.html").read_text())
    plots = [json.loads(script.text) for script in drawn.xpath("//script[@type='application/json']")]
    of_run = {curve["name"]: [plot["x"], plot["y"]] for plot in plots for curve in plot["curves"]}
    assert axes["motor.speed"] == of_run["motor.speed"] == ["time (s)", "angular speed (rad/s)"]
    assert all(axes[name] == of_run[name] for name in axes if name in of_run)


def test_a_metric_that_no_run_has_is_reported_and_a_limit_is_named(tmp_path: Path) -> None:
    folder = swept(tmp_path, "--over", f"{GAIN}=1e3,1e4", "--until", "1")
    page = html.document_fromstring((folder / "index.html").read_text())
    text = page.text_content()
    assert text.count("No run has a value of this metric") == 2 and "Dashed: its limit, 2.85." in text
    assert [svg.get("aria-label") for svg in page.iter("svg")][0] == "max |u|"


def test_two_parameters_have_a_map_whose_failing_cells_are_marked(tmp_path: Path) -> None:
    # With the wrong sign of the input gain, no control can hold the loop.
    folder = swept(tmp_path, "--over", f"{GAIN}=1e3,1e4", "--over", "plant.omega=1,-2", *SHORT)
    points = rows(folder)
    assert [(p[GAIN], p[OMEGA]) for p in points] == [("1e3", "1"), ("1e3", "-2"), ("1e4", "1"), ("1e4", "-2")]
    assert [p["ended"] for p in points] == ["complete", "failed"] * 2
    assert all(p["message"] and p["max |u|"] == "" for p in points[1::2])
    page = html.document_fromstring((folder / "index.html").read_text())
    maps = page.find_class("map")
    assert len(maps) == 3
    for heat in maps:
        cells = [cell.text_content().strip() for cell in heat.iter("td")]
        assert cells[1] == cells[3] == "failed" and float(cells[0]) > 0
    colours = [re.findall(r"background: (rgb[^;]+); color: (#\w+)", cell.get("style", "")) for cell in maps[0].iter("td")]
    assert colours[0] and colours[1] == []


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_sweep_goes_on_to_the_same_table(how: int, tmp_path: Path) -> None:
    options = ["--over", "adaptation_gain=1e3..1e5/log4", "--until", "60"]
    whole = swept(tmp_path / "whole", *options)
    command = [str(PROGRAM), "sweep", LOOP, *options, "--json", "--jobs", "1", "--out", str(tmp_path)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    record, end = tmp_path / f"{LOOP}-sweep" / "sweep.json", time.monotonic() + 300
    while not record.is_file() and time.monotonic() < end:
        time.sleep(0.01)
    process.send_signal(how)
    out, _ = process.communicate(timeout=120)
    output = json.loads(out)
    assert process.returncode == 130 and output["ended"] == "interrupted" and 1 <= len(output["points"]) < 4
    page = html.document_fromstring((record.parent / "index.html").read_text())
    assert "interrupted" in page.find_class("bad")[0].text_content()
    before = json.loads(record.read_text())["points"]
    folder = swept(tmp_path, *options)
    for name in ["points.csv", "index.html", "sweep.json"]:
        assert (folder / name).read_bytes() == (whole / name).read_bytes(), name
    after = json.loads(record.read_text())["points"]
    assert [now for now, was in zip(after, before, strict=True) if was] == [was for was in before if was]


def test_only_the_same_sweep_goes_on_from_what_no_hand_has_changed(gains: Path, tmp_path: Path) -> None:
    again = ["sweep", LOOP, *SHORT, "--out"]
    left = {file.name: file.read_bytes() for file in gains.iterdir()}
    other = fails(*again, gains.parent, "--over", f"{GAIN}=1e3..1e5/log4")
    assert "belongs to another sweep: over was" in other and "--force" in other and "--tag" in other
    step = fails(*again, gains.parent, "--over", f"{GAIN}=1e3..1e5/log3", "--order", "jacobi")
    assert 'run.settings.order was "gauss-seidel", is "jacobi"' in step
    assert {file.name: file.read_bytes() for file in gains.iterdir()} == left
    folder = tmp_path / f"{LOOP}-sweep"
    folder.mkdir()
    text = (gains / "sweep.json").read_text()
    (folder / "sweep.json").write_text(text.replace('"failure":null', '"failure":"no"', 1))
    over = ["--over", f"{GAIN}=1e3..1e5/log3", *SHORT]
    assert "checksum" in fails(*again, tmp_path, *over[:2])
    # What can't be gone on from is replaced where that is asked for, or stays beside a sweep of another name.
    assert swept(tmp_path, *over, "--tag", "other") == tmp_path / f"{LOOP}-sweep@other"
    assert "checksum" in fails(*again, tmp_path, *over[:2])
    assert swept(tmp_path, *over, "--force") == folder
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == left
    # The same sweep called again, also as earlier versions wanted it, computes nothing and keeps the same files.
    assert swept(tmp_path, *over, "--resume") == folder
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == left


def test_names_and_values_are_checked_before_anything_runs(tmp_path: Path) -> None:
    def refused(over: str) -> str:
        return fails("sweep", LOOP, "--over", over, "--out", tmp_path)

    assert "there is no parameter `adaption`" in refused("adaption=1,2")
    assert "adaptation_gain" in refused("adaptation=1,2")
    several = refused("relative_tolerance=1e-4,1e-5")
    assert "several components" in several and "plant.relative_tolerance" in several
    assert "must be a finite number" in refused(f"{GAIN}=1,fast")
    assert "must be at least 0" in refused(f"{GAIN}=-1,1")
    assert "connected" in refused("plant.u[1]=1,2")
    assert list(tmp_path.iterdir()) == []
    assert adaptive_fmu("sweep", LOOP, "--over", "k=1..2", "--out", tmp_path).returncode == 2


def test_anything_is_compared_on_one_page(tmp_path: Path) -> None:
    case = tmp_path / "fast.ssv"
    space = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    case.write_text(
        f'<ssv:ParameterSet xmlns:ssv="{space}" version="1.0" name="fast"><ssv:Parameters>'
        f'<ssv:Parameter name="{GAIN}"><ssv:Real value="2e4"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    )
    short = ["--until", "0.5", "--out", tmp_path]
    assert adaptive_fmu("run", LOOP, "--tag", "old", *short).returncode == 0
    old = tmp_path / f"{LOOP}@old"
    runs = [LOOP, f"{LOOP}@{case}", f"{LOOP}:adaptation_gain=1e3,{OMEGA}=2.5", str(old)]
    answer = adaptive_fmu("compare", *runs, *short, "--json")
    assert answer.returncode == 0, answer
    output = json.loads(answer.stdout)
    names = [LOOP, f"{LOOP}@fast", f"{LOOP}@adaptation_gain=1e3,{OMEGA}=2.5", str(old)]
    assert [one["loop"] for one in output["loops"]] == names
    assert output["loops"][0]["metrics"] == output["loops"][3]["metrics"] != output["loops"][2]["metrics"]
    gain = [json.loads((tmp_path / name / "metrics.json").read_text())["units"]["controller"] for name in names[1:3]]
    assert [unit["parameters"]["adaptation_gain"] for unit in gain] == [2e4, 1e3]
    page = html.document_fromstring((tmp_path / "comparison" / "index.html").read_text())
    assert [cell.text_content().strip() for cell in page.get_element_by_id("metrics").find(".//tr")] == ["metric", *names]


def test_what_can_not_be_compared_is_refused_before_anything_runs(tmp_path: Path) -> None:
    out = ["--until", "0.5", "--out", tmp_path]
    assert "several components" in fails("compare", LOOP, f"{LOOP}:relative_tolerance=1e-4", *out)
    assert "there is no parameter" in fails("compare", LOOP, f"{LOOP}:nothing=1", *out)
    assert "must be at least 0" in fails("compare", LOOP, f"{LOOP}:adaptation_gain=-1", *out)
    assert "Name each run once" in fails("compare", LOOP, LOOP, *out)
    assert list(tmp_path.iterdir()) == []
