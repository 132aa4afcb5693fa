"""Requests to end, and what runs that were killed leave: finished work is kept, and rubbish goes with the next run."""

import contextlib
import fcntl
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from test_league import study

LOOP = "3.2.1-cosine"
# A run that nobody waits for.
ENDLESS = ["run", LOOP, "--until", "9000", "--step", "1e-3", "--json"]


@contextlib.contextmanager
def started(*words: str | Path, **options: object) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([str(PROGRAM), *map(str, words)], cwd=ROOT, stdout=subprocess.PIPE, text=True, **options)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def eventually(holds: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def listens(process: subprocess.Popen[str] | int) -> bool:
    """Whether a process answers requests to end itself."""
    number = process if isinstance(process, int) else process.pid
    status = Path(f"/proc/{number}/status").read_text()
    caught = next(line.split()[1] for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


def ended(folder: Path) -> str:
    return str(json.loads((folder / "metrics.json").read_text())["ended"])


@pytest.mark.skipif(shutil.which("timeout") is None, reason="there is no command `timeout`")
@pytest.mark.parametrize("how", ["TERM", "HUP"])
def test_a_run_that_timeout_ends_keeps_what_was_computed(how: str, tmp_path: Path) -> None:
    """It sends the signal to the process, and once more to its group."""
    words = ["timeout", "-s", how, "2", str(PROGRAM), *ENDLESS, "--out", str(tmp_path)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 124 and json.loads(done.stdout)["ended"] == ended(tmp_path / LOOP) == "interrupted"


def test_what_nohup_ignores_is_ignored(tmp_path: Path) -> None:
    def like_nohup() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    with started(*ENDLESS, "--out", tmp_path, preexec_fn=like_nohup) as process:
        eventually(lambda: listens(process))
        process.send_signal(signal.SIGHUP)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) == 130
    assert ended(tmp_path / LOOP) == "interrupted"


def test_a_league_that_is_ended_goes_on_where_it_was(tmp_path: Path) -> None:
    file, stored = study(tmp_path, tune='tune = ["K_p"]'), tmp_path / "out" / "integrator" / "p.json"
    words = ["league", "--study", str(file), "--quick", "--out", str(tmp_path / "out"), "--json"]
    with started(*words) as process:
        eventually(stored.is_file)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) in (130, 0)
    gains = json.loads(stored.read_text())["gains"]
    answer = adaptive_fmu(*words)
    assert answer.returncode == 0, answer.stderr
    (record,) = json.loads(answer.stdout)["pairs"]
    assert record["gains"] == gains and record["spread"] is not None


def children(of: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError):
            if f"PPid:\t{of}\n" in status.read_text():
                found.append(int(status.parent.name))
    return found


def test_units_in_processes_of_their_own_leave_the_answer_to_the_program(tmp_path: Path) -> None:
    """Slurm, systemd and containers ask all processes to end."""
    exported = adaptive_fmu("export", "ReferenceNonlinearSiso", "--compile", "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    words = ["simulate", tmp_path / "ReferenceNonlinearSiso.fmu", "--until", "9000", "--step", "1e-3", "--json", "--out", tmp_path]
    with started(*words) as process:
        eventually(lambda: listens(process) and any(map(listens, children(process.pid))))
        for unit in children(process.pid):
            os.kill(unit, signal.SIGTERM)
        time.sleep(0.2)
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=60)
        assert process.returncode == 130 and json.loads(out)["ended"] == "interrupted"


def test_a_program_that_is_served_ends_with_an_answer(tmp_path: Path) -> None:
    with started("serve", stdin=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stdout is not None
        words = [*ENDLESS, "--out", str(tmp_path)]
        process.stdin.write(json.dumps({"request": 1, "arguments": words, "folder": str(tmp_path)}) + "\n")
        process.stdin.flush()
        eventually(lambda: listens(process))
        process.send_signal(signal.SIGTERM)
        # Its input is open still.
        assert process.wait(timeout=30) == 0 and '{"end":130}' in os.fsdecode(os.read(process.stdout.fileno(), 1 << 20))[-100:]
    assert ended(tmp_path / LOOP) == "interrupted"


def test_what_a_killed_run_left_is_removed_by_the_next(tmp_path: Path) -> None:
    scratch, out = tmp_path / "tmp", tmp_path / "out"
    scratch.mkdir()
    environment = {**os.environ, "TMPDIR": str(scratch)}
    with started(*ENDLESS, "--tag", "killed", "--out", out, env=environment) as process:
        eventually(lambda: any(out.glob("*/.result.csv.*.part")) and any(scratch.iterdir()))
        process.kill()
    left = [*out.glob("*/.*.part"), *scratch.iterdir()]
    assert left
    # What another run uses, and what only looks like it, stays.
    used = scratch / ".adaptive-fmu-run-Ab12Cd" / "adaptive-fmu.lock"
    files = [out / ".result.csv.Ab12Cd.part", out / ".notes.part", out / "letter.part", used]
    names = ("adaptive-fmu-in-use", "adaptive-fmu-0.1.0-linux64", ".adaptive-fmu-run-backup")
    folders = [scratch / name for name in names]
    for folder in (used.parent, *folders):
        folder.mkdir()
    for file in files:
        file.touch()
    in_use = [os.open(path, os.O_RDONLY) for path in (files[0], used)]
    for descriptor in in_use:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    answer = adaptive_fmu("run", LOOP, "--until", "0.1", "--out", out, TMPDIR=str(scratch))
    for descriptor in in_use:
        os.close(descriptor)
    assert answer.returncode in (0, 3), answer.stderr
    assert not any(path.exists() for path in left), left
    assert all(path.exists() for path in (*files, *folders))
    assert adaptive_fmu("run", LOOP, "--until", "0.1", "--out", out, TMPDIR=str(scratch)).returncode in (0, 3)
    assert [path.exists() for path in files] == [False, True, True, False]
    assert all(folder.is_dir() for folder in folders) and not used.parent.exists()
