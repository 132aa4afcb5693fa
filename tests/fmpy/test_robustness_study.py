"""The study of the robot's robustness: what it computes, and that no result of it is lost, whatever is interrupted."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import fmpy
import numpy as np
import pytest
from conftest import ROOT
from dask.distributed import Client
from scipy.stats import binomtest

STUDY = ROOT / "examples" / "robustness_dask"
sys.path.insert(0, str(STUDY))
# Cargo watches that folder: compiled Python in it would have it build the program again.
sys.dont_write_bytecode = True

import figure  # noqa: E402
import loop  # noqa: E402
import study  # noqa: E402

# A seed whose loops take little time; one of them fails.
SEED, LOOPS = 16, 6


def words(out: Path, *options: str | Path | int) -> list[str]:
    """What a user writes behind the name of the study."""
    return list(map(str, ("--out", out, "--seed", SEED, *options)))


def run(out: Path, *options: str | Path | int) -> subprocess.CompletedProcess[str]:
    """Runs the study as a user does."""
    command = [sys.executable, str(STUDY / "study.py"), *words(out, *options)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=300, check=False)


def rows(out: Path) -> list[dict[str, str]]:
    """The results in the order in which they came."""
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def unpacked(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, loop.Fmu]:
    """The FMUs of the study, in this process."""
    folder, loading = tmp_path_factory.mktemp("unpacked"), threading.Lock()
    for name in loop.FMUS:
        fmpy.extract(str(fmu_folder / f"{name}.fmu"), str(folder / name))
    return {name: loop.Fmu(folder / name, loading) for name in loop.FMUS}


@pytest.fixture(scope="module")
def in_a_row(unpacked: dict[str, loop.Fmu]) -> list[dict[str, str]]:
    """The loops one after the other in this process, as they would stand in the results."""
    samples = [loop.sample(SEED, k) for k in range(LOOPS)]
    found = [{"loop": k, **loop.run(unpacked, sample), **sample} for k, sample in enumerate(samples)]
    return [{name: str(value) for name, value in row.items()} for row in found]


def same(found: list[dict[str, str]], expected: list[dict[str, str]]) -> bool:
    """Whether each loop is there exactly once, with the same result to the last bit."""
    found = [{name: value for name, value in row.items() if value} for row in found]
    return sorted(found, key=lambda row: int(row["loop"])) == expected


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    """A scheduler and two workers as on machines of their own, which know nothing of this repository."""
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file, "--no-dashboard"]
    workers = [*dask, "worker", "--scheduler-file", file, "--nworkers", "2", "--nthreads", "1", "--no-dashboard"]
    log = (folder / "log").open("w")
    commands = (list(map(str, command)) for command in (scheduler, workers))
    started = [subprocess.Popen(command, cwd=folder, stdout=log, stderr=log) for command in commands]
    try:
        wait_for(file.exists)
        address = json.loads(file.read_text())["address"]
        with Client(address, timeout=60) as client:
            client.wait_for_workers(2, timeout=120)
            yield SimpleNamespace(address=address, processes=lambda: set(client.run(os.getpid).values()))
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait(timeout=20)
        log.close()


def wait_for(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def finished(
    cluster: SimpleNamespace, fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, subprocess.CompletedProcess[str], int]:
    """A study on that cluster, of which a worker is killed when there is a first result; the process killed."""
    killed = min(cluster.processes())
    out, done = tmp_path_factory.mktemp("study") / "out", []
    options = ("--scheduler", cluster.address, "--loops", LOOPS, "--fmus", fmu_folder)
    running = threading.Thread(target=lambda: done.append(run(out, *options)))
    running.start()
    wait_for(lambda: (out / "results.csv").exists() and rows(out))
    os.kill(killed, signal.SIGKILL)
    assert len(rows(out)) < LOOPS, "it was in the midst of it"
    running.join()
    return out, done[0], killed


def test_a_lost_worker_loses_no_result(finished, cluster: SimpleNamespace, in_a_row: list[dict[str, str]]) -> None:
    out, done, killed = finished
    assert done.returncode == 0, done.stderr
    assert killed not in cluster.processes()
    assert same(rows(out), in_a_row)


def test_the_study_tells_how_far_it_is_and_leaves_a_table_and_a_picture(finished) -> None:
    out, done, _ = finished
    failed = sum(row["outcome"] != loop.HELD for row in rows(out))
    assert f"{LOOPS} of {LOOPS} loops, {failed} failed" in done.stdout
    assert f"failed: {failed} of {LOOPS}" in (out / "summary.txt").read_text()
    assert (out / "failure_rate.svg").read_text().count("failure rate") and (out / "failure_rate.png").exists()


def test_an_interrupted_study_goes_on_where_it_was(
    finished, fmu_folder: Path, in_a_row: list[dict[str, str]], tmp_path: Path
) -> None:
    # The last line was being written when the power went.
    shutil.copytree(finished[0], tmp_path / "out")
    file = tmp_path / "out" / "results.csv"
    file.write_bytes(file.read_bytes()[:-20])
    done = run(tmp_path / "out", "--loops", LOOPS, "--workers", 1, "--fmus", fmu_folder)
    assert done.returncode == 0, done.stderr
    assert f"{LOOPS - 1} loops are in" in done.stdout and "1 are to be run" in done.stdout
    assert same(rows(tmp_path / "out"), in_a_row)


def test_a_study_that_is_done_runs_nothing(finished, fmu_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (finished[0] / "results.csv").read_bytes()
    missing = ("--scheduler", "tcp://127.0.0.1:9")
    assert study.main(words(finished[0], "--loops", LOOPS, "--fmus", fmu_folder, *missing)) == 0
    assert "0 are to be run" in capsys.readouterr().out
    assert (finished[0] / "results.csv").read_bytes() == before


def copied(fmus: Path, folder: Path) -> None:
    """Copies the FMUs, with an actuator under the sensor's name, which lacks the variables of that."""
    folder.mkdir()
    for name in loop.FMUS:
        shutil.copy(fmus / f"{name.replace('Sensor', 'Actuator')}.fmu", folder / f"{name}.fmu")


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """The line by which a study is refused."""

    def get(out: Path, *options: str | Path | int) -> str:
        assert study.main(words(out, *options)) == 1
        return capsys.readouterr().err

    return get


def test_results_of_another_set_up_are_not_mixed(finished, refused, fmu_folder: Path, tmp_path: Path) -> None:
    out = finished[0]
    before = (out / "results.csv").read_bytes()
    copied(fmu_folder, tmp_path / "fmus")
    assert "another set-up (seed)" in refused(out, "--fmus", fmu_folder, "--seed", SEED + 1)
    assert "another set-up (SensorTwoLinkRobot)" in refused(out, "--fmus", tmp_path / "fmus")
    assert (out / "results.csv").read_bytes() == before


def test_missing_fmus_and_a_missing_scheduler_are_told(refused, fmu_folder: Path, tmp_path: Path) -> None:
    assert "ReferenceTwoLinkRobot.fmu: No such file" in refused(tmp_path / "out", "--fmus", tmp_path)
    missing = "tcp://127.0.0.1:9"
    assert f"no scheduler at {missing}" in refused(tmp_path / "out", "--fmus", fmu_folder, "--scheduler", missing)


def test_an_exception_in_a_loop_is_a_result_with_its_message(fmu_folder: Path, cluster, tmp_path: Path) -> None:
    copied(fmu_folder, tmp_path / "fmus")
    options = ("--loops", 2, "--scheduler", cluster.address, "--fmus", tmp_path / "fmus")
    for again in ([], ["--again"]):
        done = run(tmp_path / "out", *options, *again)
        assert done.returncode == 1 and "2 are to be run" in done.stdout, done
        found = rows(tmp_path / "out")
        assert [row["outcome"] for row in found] == [loop.EXCEPTION] * 2
        assert all(row["message"].startswith("KeyError: ") for row in found)
    assert "failed: 0 of 0" in done.stdout


def test_a_unit_that_refuses_its_values_is_a_failure_with_its_reason(unpacked: dict[str, loop.Fmu]) -> None:
    failed = loop.run(unpacked, loop.design() | {"m1": -1.0})
    assert failed["outcome"] == loop.UNIT_FAILED and "m1" in failed["message"]


def test_the_loop_as_designed_is_the_one_that_the_program_runs(unpacked: dict[str, loop.Fmu], ran) -> None:
    _, recorded = ran("3.3.1-case2-bench", "--until", loop.STOP)
    found = loop.run(unpacked, loop.design())
    judged = recorded["time"] > loop.JUDGED_FROM - 1e-9
    for i in loop.JOINTS:
        error = (recorded[f"reference.r[{i}]"] - recorded[f"plant.y[{i}]"])[judged]
        assert found[f"rms_e{i}"] == pytest.approx(np.sqrt((error**2).mean()), rel=1e-4)
        assert found[f"max_u{i}"] == pytest.approx(np.abs(recorded[f"actuator.y[{i}]"]).max(), rel=1e-4)


def test_samples_depend_on_seed_and_number_alone_and_fill_their_ranges() -> None:
    assert loop.sample(SEED, 5) == loop.sample(SEED, 5) != loop.sample(SEED + 1, 5)
    samples = [loop.sample(SEED, k) for k in range(1000)]
    for quantity in loop.QUANTITIES:
        values = np.array([sample[quantity.name] for sample in samples])
        assert quantity.low <= values.min() and values.max() <= quantity.high
        # Each tenth of the samples up to where a tenth should be, within five standard deviations.
        for tenth in () if quantity.choices else range(1, 10):
            assert abs((values < quantity.at(tenth / 10)).mean() - tenth / 10) < 5 * np.sqrt(0.25 / len(values))
        for choice in quantity.choices:
            assert abs((values == choice).mean() - 1 / len(quantity.choices)) < 5 * np.sqrt(0.25 / len(values))


@pytest.mark.parametrize(("failed", "count"), [(0, 10), (3, 10), (10, 10), (147, 1000)])
def test_intervals_are_those_of_wilson(failed: int, count: int) -> None:
    expected = binomtest(failed, count).proportion_ci(0.95, method="wilson")
    assert figure.interval(failed, count) == pytest.approx((expected.low, expected.high), abs=1e-4)
