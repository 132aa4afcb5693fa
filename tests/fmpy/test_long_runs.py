"""Runs of more points than are kept in memory: their tables are written while they go on, and some points are drawn."""

import json
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from conftest import PROGRAM
from test_run_results import plots

STEP = 1e-3
SHORT, LONG, LONGER = 200_000, 1_500_000, 4_000_000
DESCRIPTION = """name = "Slow"
model = "state-space"
description = "A lag that the loop's ideal model knows nearly"

[structure]
A = [[-0.5]]
B = [[0.5]]
C = [[1.0]]
"""
UNIT = """<ssd:Component name="{}" type="application/x-fmu-sharedlibrary" source="resources/{}.fmu"><ssd:Connectors>
{}</ssd:Connectors></ssd:Component>"""
PORT = '<ssd:Connector name="{}" kind="{}"><ssc:Real/></ssd:Connector>'
STRUCTURE = f"""<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="long" version="1.0"><ssd:System name="loop"><ssd:Elements>
{UNIT.format("reference", "ReferenceNonlinearSiso", PORT.format("r[1]", "output"))}
{UNIT.format("plant", "Slow", PORT.format("u[1]", "input") + PORT.format("y[1]", "output"))}
</ssd:Elements><ssd:Connections>
<ssd:Connection startElement="reference" startConnector="r[1]" endElement="plant" endConnector="u[1]"/>
</ssd:Connections></ssd:System><ssd:DefaultExperiment startTime="0" stopTime="1"><ssd:Annotations>
<ssc:Annotation type="adaptive-fmu.closed-loop"><ClosedLoop name="long"><Master step="{STEP}" order="gauss-seidel"/>
<IdealModel name="y_m" input="reference.r[1]" numerator="0.55" denominator="1 0.5"/>
<Metric label="largest" statistic="max" of="plant.y[1]" minus="y_m"/>
<Metric label="mean" statistic="rms" of="plant.y[1]" from="7"/>
<Plot title="output and reference" signals="plant.y[1] y_m reference.r[1]"/>
</ClosedLoop></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment></ssd:SystemStructureDescription>
"""
VALUES = ["--set", "reference.cosine_amplitude[1]=2", "--set", "reference.cosine_frequency[1]=0.3"]


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory):
    """What runs the loop for so many points."""
    folder = tmp_path_factory.mktemp("loop")
    (folder / "SystemStructure.ssd").write_text(STRUCTURE)
    (folder / "Slow.toml").write_text(DESCRIPTION)
    return lambda points: [PROGRAM, "run", folder, "--json", "--until", str(STEP * points), *VALUES]


# A process of its own: what a process forks begins with that one's memory.
MEASURED = """import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], capture_output=True, text=True)
print(json.dumps([done.returncode, done.stdout, done.stderr, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024]))
"""


def ran(words: list, out: Path, *options: str | float) -> tuple[Path, float]:
    """The results of a run, and the most memory that it had, MB."""
    command = [sys.executable, "-c", MEASURED, *words, "--out", out, *map(str, options)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, answer, notes, memory = json.loads(done.stdout)
    assert code == 0, notes
    return Path(json.loads(answer)["results"]), memory


def read(results: Path) -> dict[str, np.ndarray]:
    """Its table."""
    table = pyarrow.csv.read_csv(results / "result.csv")
    return {name: table[name].to_numpy() for name in table.column_names}


def metrics_of(results: Path) -> dict:
    return json.loads((results / "metrics.json").read_text())


@pytest.fixture(scope="module")
def long_run(words, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float, dict[str, np.ndarray]]:
    """Results of a long run, its memory, and its table."""
    results, memory = ran(words(LONG), tmp_path_factory.mktemp("long"), "--parquet")
    return results, memory, read(results)


def test_memory_does_not_grow_with_the_number_of_points(long_run, words, tmp_path: Path) -> None:
    short, of_short = ran(words(SHORT), tmp_path)
    assert "drawn" not in metrics_of(short) and "points are drawn" not in (short / "index.html").read_text()
    _, of_longer = ran(words(LONGER), tmp_path, "--every", 1)
    assert long_run[1] < of_short + 40 and of_longer < long_run[1] + 5, (of_short, long_run[1], of_longer)


def test_every_point_is_in_both_tables(long_run) -> None:
    results, _, table = long_run
    assert {"time", "reference.r[1]", "plant.y[1]", "y_m"} <= set(table)
    assert np.array_equal(table["time"], np.append(np.arange(LONG) * STEP, LONG * STEP))
    columns = pyarrow.parquet.read_table(results / "result.parquet")
    assert columns.column_names == list(table) and pyarrow.parquet.ParquetFile(results / "result.parquet").num_row_groups > 3
    assert all(np.array_equal(columns[name].to_numpy(), values) for name, values in table.items())
    # The ideal model goes on from block to block: after its start it is 1.1 times the output.
    late = table["time"] > 60
    assert table["y_m"][late] == pytest.approx(1.1 * table["plant.y[1]"][late], abs=2e-3)


def test_metrics_are_of_all_points(long_run) -> None:
    results, _, table = long_run
    largest, mean = (metric["value"] for metric in metrics_of(results)["metrics"])
    assert largest == np.abs(table["plant.y[1]"] - table["y_m"]).max()
    of_rows = table["plant.y[1]"][table["time"] >= 7 - 1e-9]
    assert mean == pytest.approx(np.sqrt(np.mean(of_rows**2)), rel=1e-12)


def test_the_page_states_how_many_points_it_draws_and_loses_no_peak(long_run) -> None:
    results, _, table = long_run
    drawn, page = metrics_of(results)["drawn"], (results / "index.html").read_text()
    assert drawn["of"] == LONG + 1 and 20_000 < drawn["points"] < LONG / 10
    assert f"{drawn['points']} of {LONG + 1} points are drawn" in page and "result.csv has all" in page
    assert len(page) < 500_000
    for curve in (curve for plot in plots(results / "index.html") for curve in plot["curves"]):
        values, y = table[curve["name"]], np.array(curve["y"])
        assert (y.min(), y.max()) == pytest.approx((values.min(), values.max()), rel=1e-5)
        assert (curve["x"][0], curve["x"][-1]) == (0, LONG * STEP)
        of_run = values[np.rint(np.array(curve["x"]) / STEP).astype(int)]
        assert y == pytest.approx(of_run, rel=1e-5, abs=1e-5), curve["name"]


def test_fewer_rows_are_those_of_a_run_in_memory(long_run, words, tmp_path: Path) -> None:
    table = long_run[2]
    results, _ = ran(words(LONG), tmp_path, "--every", 0.7004)
    few = read(results)
    multiples = np.floor(np.round(table["time"] / 0.7004, 9))
    rows = np.append(np.flatnonzero(np.diff(multiples, prepend=-1)), LONG)
    assert all(np.array_equal(few[name], values[np.unique(rows)]) for name, values in table.items())
    assert "result.csv has one row every 0.7004 s" in (results / "index.html").read_text()
    assert metrics_of(results)["metrics"] == metrics_of(long_run[0])["metrics"]


def test_an_interrupted_run_leaves_what_it_came_to(long_run, words, tmp_path: Path) -> None:
    process = subprocess.Popen([*words(LONG * 4), "--out", tmp_path], stdout=subprocess.PIPE, text=True)
    part = tmp_path / "long"
    while process.poll() is None and sum(file.stat().st_size for file in part.glob(".result.csv.*")) < 1e6:
        pass
    process.send_signal(signal.SIGINT)
    answer = json.loads(process.communicate()[0])
    assert (process.returncode, answer["ended"], metrics_of(part)["ended"]) == (130, "interrupted", "interrupted")
    table, whole = read(part), long_run[2]
    count = min(len(table["time"]), LONG)
    assert count > 100_000 and len(table["time"]) == metrics_of(part)["drawn"]["of"]
    assert all(np.array_equal(values[:count], whole[name][:count]) for name, values in table.items())
    assert [file.name for file in part.iterdir() if file.name.startswith(".")] == []


def test_a_table_that_finds_no_room_ends_the_run_and_the_earlier_one_stays(words, tmp_path: Path) -> None:
    results, _ = ran(words(100), tmp_path)
    before = {file.name: file.read_bytes() for file in results.iterdir()}

    def little_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000_000, 10_000_000))

    done = subprocess.run(
        [*words(LONG * 4), "--out", tmp_path], capture_output=True, text=True, check=False, preexec_fn=little_room
    )
    assert (done.returncode, done.stdout) == (1, "") and re.search(r"long/result\.csv: File too large", done.stderr), done
    assert {file.name: file.read_bytes() for file in results.iterdir()} == before
