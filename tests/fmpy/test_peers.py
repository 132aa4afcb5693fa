"""The comparison with peers runs, has all its rows, and compares only what is accurate. What it takes is not judged:
a machine that runs tests is no place to measure."""

import json
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import ROOT

pytestmark = pytest.mark.slow

LOOPS = ["3.3.1-case1", "3.3.1-case2", "3.3.2-case1", "3.3.3", "3.4.2", "4-case1", "7.5.3-case1"]
PARTS = [
    "Van der Pol, a step of 10 ms",
    "Van der Pol, a step of 1 ms",
    "3.3.1-case2, 0.5 s by separate FMUs",
    "3.3.2-case1, 0.5 s by separate FMUs",
    "4-case1, 0.5 s by separate FMUs, equations compiled",
    *(f"{loop}, 0.5 s as a single FMU" for loop in LOOPS),
    "4-case1, as it is",
    "`run --all`",
    "instance made",
    "library loaded",
    "`export L1MaresAuv`",
    "`export --all`",
    "number of states",
    "single FMU, stiff, compiled",
    "compiled units",
]
PEERS = [
    "C (gcc",
    "a loop in Python around its calls",
    "PythonFMU",
    "RK4 steps every",
    "general explicit method",
    "generic equations",
    "the generic form",
]


@pytest.fixture(scope="module")
def rows() -> list[dict]:
    done = subprocess.run(
        [ROOT / "benches" / "peers", "--quick", "--json"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_growth_is_measured_and_plotted(tmp_path) -> None:
    plot = tmp_path / "growth.svg"
    done = subprocess.run(
        [ROOT / "benches" / "peers", "--quick", "--growth", plot], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    panels = ["by states", "by components", "by points", "by instances"]
    assert all(panel in done.stdout and panel in plot.read_text() for panel in panels), done.stdout
    assert ElementTree.parse(plot).getroot().tag.endswith("svg")


def has_cvode() -> bool:
    """Whether the compiler finds it: its rows are left out otherwise."""
    command = ["cc", "-dM", "-E", "-include", "cvode/cvode.h", "-xc", "/dev/null"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "SUNDIALS_VERSION_MAJOR 6" in done.stdout


def test_every_figure_is_there(rows) -> None:
    for part in PARTS:
        assert any(part in row["what"] for row in rows), part
    for peer in [*PEERS, *["CVODE"] * has_cvode()]:
        assert any(peer in row["peer"] for row in rows), peer
    for row in rows:
        measured = row["ours"] + row["theirs"]
        assert row["ours"] and np.isfinite(measured).all() and (row["theirs"] or row["peer"] == "–"), row


def test_what_is_compared_is_accurate(rows) -> None:
    compared = [row for row in rows if row["theirs"]]
    assert compared and all(row["errors"] and row["accurate"] for row in compared), compared
