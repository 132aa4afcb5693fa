"""All loops at once: what the table tells, and how it ends."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from conftest import LOOP_NAMES, ROOT, adaptive_fmu

# With signals held a step longer, the peaks of the control are higher; a short run shows them.
BEYOND = ["--order", "jacobi", "--until", "0.3"]
# Ends with an error by its nature, and is there to show it.
DIVERGING = "4-case3"


def run_all(*options: str | Path, code: int) -> subprocess.CompletedProcess[str]:
    answer = adaptive_fmu("run", "--all", *options)
    assert answer.returncode == code, answer
    return answer


def rows(table: str) -> dict[str, str]:
    """What the table tells of each loop."""
    starts = {name: re.search(rf"^{re.escape(name)} +(.*)$", table, re.M) for name in LOOP_NAMES}
    assert all(starts.values()), table
    return {name: found[1] for name, found in starts.items()}


@pytest.fixture(scope="module")
def every(fmu_folder: Path, tmp_path_factory) -> tuple[Path, list[dict]]:
    """The folder of a run of all loops, and what it told."""
    out = tmp_path_factory.mktemp("all")
    answer = run_all("--json", "--fmus", fmu_folder, "--out", out, code=0)
    assert answer.stderr == ""
    return out, json.loads(answer.stdout)["loops"]


@pytest.mark.slow
def test_every_loop_of_the_package_is_run_and_holds(every) -> None:
    out, rows = every
    assert [one["loop"] for one in rows] == LOOP_NAMES
    assert [one["name"] for one in json.loads(adaptive_fmu("list", "--json").stdout)["loops"]] == LOOP_NAMES
    for one in rows:
        assert (one["verdict"], Path(one["results"])) == ("holds", out / one["loop"]) and one["seconds"] > 0.0
        assert json.loads((out / one["loop"] / "metrics.json").read_text())["metrics"] == one["metrics"]


@pytest.mark.slow
def test_a_loop_that_is_to_fail_holds_when_it_does(every) -> None:
    _, rows = every
    failed = {one["loop"]: one["error"] for one in rows if one["ended"] == "failed"}
    assert "diverges" in failed[DIVERGING]
    assert all("<ExpectedFailure" in (ROOT / "examples" / name / "SystemStructure.ssd").read_text() for name in failed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["3.2.1-square", "4-case3"])
def test_a_loop_among_all_has_the_results_that_it_has_alone(every, name: str, fmu_folder, tmp_path) -> None:
    out, _ = every
    adaptive_fmu("run", name, "--json", "--fmus", fmu_folder, "--out", tmp_path)
    for file in ["result.csv", "metrics.json", "plot.svg", "index.html"]:
        assert (tmp_path / name / file).read_bytes() == (out / name / file).read_bytes(), file


def test_a_loop_beyond_its_limit_is_named_and_has_its_exit_code(fmu_folder: Path, tmp_path: Path) -> None:
    output = json.loads(run_all("--json", *BEYOND, "--fmus", fmu_folder, "--out", tmp_path, code=3).stdout)["loops"]
    table = run_all(*BEYOND, "--fmus", fmu_folder, "--out", tmp_path, code=3).stdout
    beyond = []
    for one in output:
        limits = [(m["value"], m["limit"]) for m in one["metrics"] if None not in (m["value"], m["limit"])]
        if one["ended"] == "complete" and any(value > limit for value, limit in limits):
            beyond.append(one["loop"])
    assert beyond and [one["loop"] for one in output if one["verdict"] == "beyond limit"] == beyond
    assert [name for name, row in rows(table).items() if row.startswith("beyond limit")] == beyond
    assert (
        f"{len(LOOP_NAMES) - len(beyond)} of {len(LOOP_NAMES)} loops pass; beyond limit: {', '.join(beyond)}" in table
    )


def test_a_loop_that_cant_be_run_is_reported_and_the_others_run(fmu_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(fmu_folder, tmp_path / "fmus")
    (tmp_path / "fmus" / "TwoLinkRobot.fmu").unlink()
    answer = run_all("--until", "0.05", "--fmus", tmp_path / "fmus", "--out", tmp_path / "out", code=1)
    broken = [name for name in LOOP_NAMES if name not in {folder.name for folder in (tmp_path / "out").iterdir()}]
    assert {"3.3.1-case1", "3.3.1-case2"} <= set(broken) < set(LOOP_NAMES)
    assert [name for name, row in rows(answer.stdout).items() if row.startswith("failed")] == broken
    reasons = answer.stderr.splitlines()
    assert sorted(reason.split(": ")[1] for reason in reasons) == broken
    assert all(reason.startswith("error: ") and "TwoLinkRobot.fmu" in reason for reason in reasons)


def test_the_table_shows_metrics_limits_and_times(fmu_folder: Path, tmp_path: Path) -> None:
    output = rows(run_all("--until", "0.2", "--fmus", fmu_folder, "--out", tmp_path, code=0).stdout)
    assert re.fullmatch(r"passes +\d+\.\d s  max \|y - y_m\| –  .*max \|u\| \d\.\d+ ≤ 2\.85", output["3.2.1-cosine"])
    assert re.fullmatch(r"passes +\d+\.\d s  failed at t = 0\.11\d* s, as expected", output[DIVERGING])


def test_all_loops_as_a_composite_each(fmu_folder: Path, tmp_path: Path) -> None:
    # Before the one that diverges does so.
    answer = run_all("--composite", "--until", "0.05", "--json", "--out", tmp_path, code=0)
    assert [one["loop"] for one in json.loads(answer.stdout)["loops"]] == [f"{name}-composite" for name in LOOP_NAMES]


@pytest.mark.parametrize("options", [["4-case1"], ["--set", "plant.x0[1]=1"], ["--case", "plant.ssv"]], ids=" ".join)
def test_options_that_are_for_one_loop_are_refused(options: list[str]) -> None:
    assert "--all" in run_all(*options, code=2).stderr
