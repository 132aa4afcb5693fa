"""Sweeps by executors: the same to the bit by threads, processes and Dask on two workers, whatever is lost or interrupted meanwhile."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
from adaptive_fmu import Sweep, _executor, _study
from conftest import ROOT
from dask.distributed import Client
from test_foreign_plants import in_c

LOOP = "3.2.1-cosine"
GAIN, OMEGA = "controller.adaptation_gain", "plant.omega"
#: One of them fails.
POINTS = pd.DataFrame({GAIN: [1e3, 1e4, 2e4, 3e4, 12345.678], OMEGA: [1.0, 2.0, -1.0, 0.5, 1 / 3]})


def same(found: Sweep, expected: Sweep) -> None:
    """All numbers and texts are the same, to the last bit."""
    pd.testing.assert_frame_equal(found.data, expected.data, check_exact=True)
    assert len(found.results) == len(expected.results)
    for one, other in zip(found.results, expected.results, strict=True):
        pd.testing.assert_frame_equal(one.data, other.data, check_exact=True)
        pd.testing.assert_frame_equal(one.metrics, other.metrics, check_exact=True)
        facts = [(each.name, each.ended, each.units, each.warnings, each.notes, each.settings, each.plots) for each in (one, other)]
        assert facts[0] == facts[1]


def wait_for(condition: Callable[[], object], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def expected() -> Sweep:
    swept = adaptive_fmu.Loop(LOOP).sweep(POINTS, until=3, keep=True)
    assert swept.data["ended"].tolist() == ["complete", "complete", "failed", "complete", "complete"]
    return swept


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """A scheduler and two workers on the loopback address, as on machines of their own: with another working folder."""
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file, "--no-dashboard"]
    workers = [*dask, "worker", "--scheduler-file", file, "--nworkers", "2", "--nthreads", "1", "--no-dashboard"]
    environment = {**os.environ, "TMPDIR": str(folder)}
    with (folder / "log").open("w") as log:
        commands = (list(map(str, command)) for command in (scheduler, workers))
        started = [subprocess.Popen(command, cwd=folder, stdout=log, stderr=log, env=environment) for command in commands]
        try:
            # It is there before its text is.
            wait_for(lambda: file.exists() and file.read_text())
            with Client(json.loads(file.read_text())["address"], timeout=60) as client:
                client.wait_for_workers(2, timeout=60)
                yield client
        finally:
            for process in reversed(started):
                process.terminate()
                process.wait(timeout=20)
    # Files that were sent to the workers went with the sweeps, those of a killed worker aside.
    left = [path for path in folder.glob("adaptive_fmu_study_*") if any(path.iterdir())]
    assert len(left) <= 1, left


@pytest.fixture(params=["threads", "processes", "client", "executor of the client"])
def executor(request: pytest.FixtureRequest) -> Iterator[object]:
    if request.param == "threads":
        with ThreadPoolExecutor(2) as pool:
            yield pool
    elif request.param == "processes":
        # Forked, where that is how processes begin: they may not take the conversations of this one.
        with ProcessPoolExecutor(2) as pool:
            yield pool
    else:
        client = request.getfixturevalue("client")
        yield client if request.param == "client" else client.get_executor(retries=1)


def test_each_executor_gives_the_same_to_the_bit(executor: object, expected: Sweep) -> None:
    loop = adaptive_fmu.Loop(LOOP)
    same(loop.sweep(POINTS, until=3, keep=True, executor=executor), expected)
    metrics = loop.sweep(POINTS, until=3, executor=executor)
    pd.testing.assert_frame_equal(metrics.data, expected.data, check_exact=True)
    assert metrics.results == []


def test_rows_of_a_table_are_the_runs_one_by_one(expected: Sweep) -> None:
    assert expected.data[[GAIN, OMEGA]].equals(POINTS)
    for row, result in zip(POINTS.to_dict("records"), expected.results, strict=True):
        if result.ended == "complete":
            single = adaptive_fmu.Loop(LOOP).run(until=3, values=row)
            pd.testing.assert_frame_equal(result.data, single.data, check_exact=True)
    # Of the same values, all combinations and the table of them are the same.
    axes = {GAIN: [1e3, 1e4], OMEGA: np.array([1.0, 2.0])}
    table = pd.DataFrame([(gain, omega) for gain in axes[GAIN] for omega in axes[OMEGA]], columns=list(axes))
    loop = adaptive_fmu.Loop(LOOP)
    same(loop.sweep(table, until=1), loop.sweep(axes, until=1))
    assert len(loop.sweep(table.iloc[:0], until=1)) == 0


def test_an_object_with_a_method_submit_will_do(expected: Sweep) -> None:
    class Later:
        """Future of another library."""

        def __init__(self, call: Callable[[], object]) -> None:
            self.result = call

    class Elsewhere:
        def submit(self, function: Callable[..., object], *words: object) -> Later:
            return Later(lambda: function(*words))

    same(adaptive_fmu.Loop(LOOP).sweep(POINTS, until=3, keep=True, executor=Elsewhere()), expected)
    for wrong, reason in [({"executor": 3}, "method `submit`"), ({"executor": Elsewhere(), "workers": 2}, "exclude each other")]:
        with pytest.raises(adaptive_fmu.ArgumentError, match=reason):
            adaptive_fmu.Loop(LOOP).sweep(POINTS, **wrong)


@pytest.fixture
def own(tmp_path: Path) -> adaptive_fmu.Loop:
    """A loop with an FMU of another tool and a description, by paths that mean nothing to the workers."""
    plant = {"A": [[-2.0]], "B": [[3.0]], "C": [[1.0]], "D": [[0.0]], "inputs": ["volts"], "outputs": ["omega"]}
    (tmp_path / "plant.json").write_text(json.dumps(plant))
    pid = adaptive_fmu.new("pid", tmp_path / "Drive.toml", plant=tmp_path / "plant.json")
    links = {"drive.omega": "motor.speed", "motor.voltage": "drive.volts", "drive.omega_reference": "wanted.r[1]"}
    parts = [("motor", in_c(tmp_path)), ("drive", pid), ("wanted", "ReferenceNonlinearSiso")]
    with pytest.warns(UserWarning, match="algebraic loop"):
        return adaptive_fmu.Loop.connect(*parts, connect=links, step=0.001, until=0.5)


def test_workers_of_dask_get_the_files(own: adaptive_fmu.Loop, client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "examples" / "3.3.1-case2-bench" / "controller.ssv").read_text()
    head, rest = text[: text.index("<!--")], "</ssv:Parameters>\n</ssv:ParameterSet>\n"
    Path("set.ssv").write_text(f'{head}<ssv:Parameter name="drive.K_i[1]"><ssv:Real value="20.0"/></ssv:Parameter>{rest}')
    own.save("saved")
    over = {"drive.K_p[1]": [0.5, 1.0, 2.0]}
    for loop in (own, adaptive_fmu.Loop("saved"), *map(adaptive_fmu.Loop, adaptive_fmu.export(ssp="saved", out="archive"))):
        expected = loop.sweep(over, case="set.ssv", keep=True)
        assert (expected.data["ended"] == "complete").all()
        same(loop.sweep(over, case="set.ssv", keep=True, executor=client), expected)
    assert not any(client.run(lambda: __import__("adaptive_fmu")._worker._folders).values())
    with pytest.raises(adaptive_fmu.Error, match="there is no `motor.nix`"):
        own.sweep({"motor.nix": [1.0]}, executor=client)


#: Runs that take a tenth of a second and more each.
MANY = {"plant.x0[1]": [k * 1e-3 for k in range(40)]}
LONG = {"until": 30}


@pytest.fixture(scope="module")
def many() -> Sweep:
    return adaptive_fmu.Loop(LOOP).sweep(MANY, **LONG)


def lines(folder: Path) -> list[bytes]:
    file = folder / "runs.jsonl"
    return file.read_bytes().splitlines(keepends=True) if file.is_file() else []


def killed_meanwhile(folder: Path, sweep: Callable[[], Sweep], victim: Callable[[], int]) -> Sweep:
    """The sweep, of which a process is killed when there are some runs."""
    found: Future[Sweep] = Future()

    def run() -> None:
        try:
            found.set_result(sweep())
        except adaptive_fmu.Error as error:
            found.set_exception(error)

    thread = threading.Thread(target=run)
    thread.start()
    wait_for(lambda: len(lines(folder)) >= 3)
    os.kill(victim(), signal.SIGKILL)
    assert len(lines(folder)) < len(MANY["plant.x0[1]"]), "it was in the midst of it"
    thread.join()
    return found.result()


@pytest.mark.parametrize("files", [False, True])
def test_a_killed_worker_of_dask_loses_nothing(client: Client, many: Sweep, tmp_path: Path, files: bool) -> None:
    """Dask repeats its runs, and sends the files to the worker that takes its place."""
    loop = adaptive_fmu.Loop(ROOT / "examples" / LOOP if files else LOOP)
    victim = min(client.run(os.getpid).values())
    found = killed_meanwhile(tmp_path, lambda: loop.sweep(MANY, executor=client, out=tmp_path, **LONG), lambda: victim)
    pd.testing.assert_frame_equal(found.data, many.data, check_exact=True)
    assert len(lines(tmp_path)) == len(many)
    client.wait_for_workers(2, timeout=60)
    assert victim not in client.run(os.getpid).values()


def test_a_killed_program_of_a_worker_loses_nothing(client: Client, many: Sweep, tmp_path: Path) -> None:
    # A worker that hasn't run anything yet has no program.
    client.run(lambda: len(__import__("adaptive_fmu").kinds()))
    programs = client.run(lambda: [one.process.pid for one in [*__import__("adaptive_fmu")._pool._idle]])
    victim = [pid for of in programs.values() for pid in of][0]
    loop = adaptive_fmu.Loop(LOOP)
    found = killed_meanwhile(tmp_path, lambda: loop.sweep(MANY, executor=client, out=tmp_path, **LONG), lambda: victim)
    pd.testing.assert_frame_equal(found.data, many.data, check_exact=True)


def test_a_killed_process_of_a_pool_loses_no_run_that_was_done(many: Sweep, tmp_path: Path) -> None:
    loop = adaptive_fmu.Loop(LOOP)
    with ProcessPoolExecutor(2) as pool:
        victim = pool.submit(os.getpid).result()
        with pytest.raises(adaptive_fmu.Error, match="a new executor is needed .* The same call continues") as error:
            killed_meanwhile(tmp_path, lambda: loop.sweep(MANY, executor=pool, out=tmp_path, **LONG), lambda: victim)
    before, partial = lines(tmp_path), error.value.partial.data
    assert 3 <= len(before) == len(partial) < len(many)
    assert set(partial["plant.x0[1]"]) == {float(json.loads(line)["words"][0].split("=")[1]) for line in before}
    with ProcessPoolExecutor(2) as pool:
        found = loop.sweep(MANY, executor=pool, out=tmp_path, **LONG)
    pd.testing.assert_frame_equal(found.data, many.data, check_exact=True)
    assert lines(tmp_path)[: len(before)] == before and len(lines(tmp_path)) == len(many)


INTERRUPTED = f"""
import signal; signal.signal(signal.SIGINT, signal.default_int_handler)
import adaptive_fmu, sys
from concurrent.futures import ProcessPoolExecutor
from dask.distributed import Client

def main():
    where, folder = sys.argv[1:]
    executor = {{"none": lambda: None, "processes": lambda: ProcessPoolExecutor(2)}}.get(where, lambda: Client(where))()
    try:
        adaptive_fmu.Loop({LOOP!r}).sweep({MANY!r}, executor=executor, out=folder, **{LONG!r})
    except adaptive_fmu.Interrupted as interrupted:
        print(len(interrupted.partial), str(interrupted).endswith("The same call continues"))

if __name__ == "__main__":
    main()
"""


@pytest.mark.parametrize("where", ["none", "processes", "dask"])
def test_an_interrupted_sweep_goes_on_in_its_folder(where: str, client: Client, many: Sweep, tmp_path: Path) -> None:
    address = client.scheduler.address if where == "dask" else where
    script, folder = tmp_path / "script.py", tmp_path / "out"
    script.write_text(INTERRUPTED)
    running = subprocess.Popen([sys.executable, script, address, folder], stdout=subprocess.PIPE, text=True)
    wait_for(lambda: len(lines(folder)) >= 3)
    running.send_signal(signal.SIGINT)
    output, _ = running.communicate(timeout=30)
    before = lines(folder)
    assert output.split() == [str(len(before)), "True"] and len(before) < len(many)
    wait_for(lambda: not client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)))
    # The last line was being written when the power went.
    (folder / "runs.jsonl").write_bytes(b"".join(before)[:-20])
    found = adaptive_fmu.Loop(LOOP).sweep(MANY, out=folder, **LONG)
    pd.testing.assert_frame_equal(found.data, many.data, check_exact=True)
    assert lines(folder)[: len(before) - 1] == before[:-1] and len(lines(folder)) == len(many)


def test_a_sweep_in_a_folder_goes_on_with_further_values_and_their_signals(expected: Sweep, tmp_path: Path) -> None:
    loop = adaptive_fmu.Loop(LOOP)
    loop.sweep(POINTS[:2], until=3, out=tmp_path)
    same(loop.sweep(POINTS[:3], until=3, out=tmp_path, keep=True), loop.sweep(POINTS[:3], until=3, keep=True))
    before = lines(tmp_path)
    # Signals of the first two are missing at first, so these were run again.
    assert len(before) == 5
    for _ in range(2):
        same(loop.sweep(POINTS, until=3, out=tmp_path, keep=True), expected)
    assert lines(tmp_path)[:5] == before and len(lines(tmp_path)) == 7
    metrics = loop.sweep(POINTS, until=3, out=tmp_path)
    pd.testing.assert_frame_equal(metrics.data, expected.data, check_exact=True)


def test_another_sweep_in_the_folder_is_refused_with_what_differs(tmp_path: Path) -> None:
    loop = adaptive_fmu.Loop(LOOP)
    arguments = {"until": 0.1, "plant": {"a1": 1.0}, "out": tmp_path / "out"}
    loop.sweep({OMEGA: [1.0]}, **arguments)
    for other, message in [
        ({"until": 0.2}, "until was 0.1, is 0.2"),
        ({"plant": {"a1": 2.0}}, 'values was {"plant.a1": "1.0"}, is {"plant.a1": "2.0"}'),
        ({"step": 0.01, "composite": True}, "step was null, is 0.01; composite was false, is true"),
    ]:
        with pytest.raises(adaptive_fmu.Error) as error:
            loop.sweep({OMEGA: [1.0]}, **{**arguments, **other})
        assert message in str(error.value) and "force=True replaces it" in str(error.value), error.value
    with pytest.raises(adaptive_fmu.Error, match=r'over was \["plant.omega"\], is \["plant.a1"\]'):
        loop.sweep({"plant.a1": [1.0]}, **arguments)
    other = loop.sweep({OMEGA: [1.0]}, **{**arguments, "until": 0.2, "force": True})
    assert len(lines(tmp_path / "out")) == 1
    pd.testing.assert_frame_equal(other.data, loop.sweep({OMEGA: [1.0]}, until=0.2, plant={"a1": 1.0}).data, check_exact=True)


def test_changed_files_of_a_loop_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    loop = adaptive_fmu.Loop.connect("ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso", until=0.1)
    adaptive_fmu.Loop(loop.save(folder)).sweep({OMEGA: [1.0]}, out=tmp_path / "out")
    file = folder / "SystemStructure.ssd"
    file.write_text(file.read_text().replace('step="0.001"', 'step="0.002"'))
    with pytest.raises(adaptive_fmu.Error, match="files was .* is "):
        adaptive_fmu.Loop(folder).sweep({OMEGA: [1.0]}, out=tmp_path / "out")


def test_only_files_that_a_request_names_are_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("run", "--json", "case.ssv", "record.csv"):
        (tmp_path / name).write_text(name)
    sent = _executor.packed(None, ["run", "--json", "--case=case.ssv", "--", "record.csv", "nothing.csv"])
    assert sorted(sent.words) == ["--case=case.ssv", "record.csv"]
    assert sorted(sent.contents.values()) == [b"case.ssv", b"record.csv"]


def test_a_worker_with_another_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_executor, "version", lambda: "adaptive-fmu 0.0.7")
    with ThreadPoolExecutor(1) as pool, pytest.raises(adaptive_fmu.Error, match=r"has adaptive-fmu .*, but adaptive-fmu 0\.0\.7 is"):
        adaptive_fmu.Loop(LOOP).sweep({OMEGA: [1.0]}, until=0.1, executor=pool)


def test_runs_are_counted_as_they_come(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    counts: list[int] = []

    @contextmanager
    def counted(name: str, runs: int, wanted: bool | None) -> Iterator[Callable[..., None]]:
        assert (name, runs, wanted) == (LOOP, 5, True)
        yield lambda runs=1: counts.append(runs)

    monkeypatch.setattr(_study, "counted", counted)
    adaptive_fmu.Loop(LOOP).sweep(POINTS, until=0.1, progress=True, out=tmp_path)
    with ThreadPoolExecutor(2) as pool:
        adaptive_fmu.Loop(LOOP).sweep(POINTS, until=0.1, progress=True, executor=pool)
        adaptive_fmu.Loop(LOOP).sweep(POINTS, until=0.1, progress=True, out=tmp_path, executor=pool)
    assert counts == [0, 1, 1, 1, 1, 1] * 2 + [5]


def test_a_machine_that_no_longer_answers_does_not_stop_the_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent:
        def run(self, *_: object) -> None:
            time.sleep(15)

    monkeypatch.setattr(_executor, "PATIENCE", 0.1)
    begun = time.monotonic()
    _executor._forget(Silent(), "study")
    assert time.monotonic() - begun < 10


FORKED = f"""
import os, signal, threading, time
import adaptive_fmu
from adaptive_fmu import _pool
loop = adaptive_fmu.Loop({LOOP!r})
running = threading.Thread(target=lambda: loop.run(until=100, progress=False))
running.start()
while not _pool._busy:
    time.sleep(0.001)
child = os.fork()
if child == 0:
    loop.run(until=0.1)
    time.sleep(20)
    os._exit(0)
running.join()
begun = time.monotonic()
conversation = _pool._idle.pop()
conversation.end()
print(conversation.process.returncode, time.monotonic() - begun < 10)
os.kill(child, signal.SIGKILL)
"""


def test_a_forked_process_does_not_hold_the_program_of_its_parent() -> None:
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=50, check=False)
    assert done.stdout.split() == ["0", "True"], done
