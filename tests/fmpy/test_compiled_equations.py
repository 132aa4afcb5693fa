"""Equations that are compiled while loops run: results stay the same, with nothing but this program, and where it can't."""

import ctypes
import json
import os
import subprocess
import zipfile
from pathlib import Path

import pytest
from conftest import LOOP_NAMES, PROGRAM, ROOT, adaptive_fmu

LOOPS = ["3.2.1-cosine", "3.3.1-case2", "6.5.1-mrac"]
PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN = 65, 1
COMPILED = "compiled during the run"


def refuse_memory_for_code() -> None:
    """As systemd's MemoryDenyWriteExecute does: from now on, no memory that was written becomes code."""
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl")


def refuses() -> bool:
    """Whether this system can be asked to refuse it."""
    return subprocess.run(["true"], preexec_fn=refuse_memory_for_code, check=False).returncode == 0


def ran(loop: str, out: Path, *options: str | float, refused: bool = False, **environment: str) -> tuple[str, dict, str]:
    """The table of a run, its metrics with how it came to them, and what was told."""
    words = [PROGRAM, "run", loop, "--until", "2", "--json", "--out", out, *options]
    environment = {**os.environ, **environment}
    answer = subprocess.run(
        [str(word) for word in words],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=refuse_memory_for_code if refused else None,
    )
    assert answer.returncode in (0, 3), answer.stderr
    results = Path(json.loads(answer.stdout)["results"])
    recorded = json.loads((results / "metrics.json").read_text())
    return (results / "result.csv").read_text(), recorded, answer.stderr


def evaluated(recorded: dict) -> set[str]:
    """How the equations of a run's units were evaluated."""
    return {unit["evaluated"] for unit in recorded["units"].values()}


@pytest.mark.parametrize("form", [[], ["--composite"], ["--composite", "--set", "integration_method=stiff"]])
@pytest.mark.parametrize("loop", LOOPS)
def test_a_run_has_the_same_digits_where_no_memory_for_code_is_given(loop: str, form: list[str], tmp_path: Path) -> None:
    try:
        refuse = refuses()
    except subprocess.SubprocessError:
        pytest.skip("this system can't be asked to refuse memory for code")
    assert refuse
    table, metrics, recorded = ran(loop, tmp_path, "--verbose", *form)
    generic, of_generic, recorded_of_generic = ran(loop, tmp_path, "--verbose", *form, refused=True)
    assert generic == table and of_generic["metrics"] == metrics["metrics"]
    assert evaluated(metrics) == {COMPILED} and "compiled" in recorded
    [reason] = evaluated(of_generic)
    assert reason.startswith("not compiled: the system refuses memory for code"), reason
    assert "the system refuses memory for code" in recorded_of_generic and "the system refuses" not in recorded
    # Nothing is wrong: who doesn't ask isn't told.
    assert "refuses" not in ran(loop, tmp_path, *form, refused=True)[2]


def test_nothing_but_the_program_is_needed(tmp_path: Path) -> None:
    """No compiler, no shell, and no folder to write to."""
    expected, metrics, _ = ran("3.3.1-case2", tmp_path)
    assert evaluated(metrics) == {COMPILED}
    nothing = {"PATH": "", "CC": "no-such-compiler", "HOME": "", "ADAPTIVE_FMU_CACHE": ""}
    table, metrics, recorded = ran("3.3.1-case2", tmp_path, **nothing)
    assert table == expected and evaluated(metrics) == {COMPILED} and "compil" not in recorded


def test_a_run_leaves_nothing_in_the_cache_but_what_its_fmus_are_made_of(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    ran("3.2.1-cosine", tmp_path, ADAPTIVE_FMU_CACHE=str(cache))
    assert {path.suffix for path in cache.iterdir()} <= {".described", ".library", ".zip"}


@pytest.mark.parametrize("command", ["gcc -O1", "ccache gcc", '"{folder}/ccache" gcc "-DA=a b"', "{folder}/my own gcc"])
def test_the_compiler_of_fmus_may_be_a_command_with_arguments(command: str, tmp_path: Path) -> None:
    """As make, CMake and Python take `CC`; ccache is one of our own, which counts."""
    counted = tmp_path / "counted"
    for name, calls in {"ccache": '"$@"', "my own gcc": 'gcc "$@"'}.items():
        (tmp_path / name).write_text(f'#!/bin/sh\necho "$@" >> "{counted}"\nexec {calls}\n')
        (tmp_path / name).chmod(0o755)
    of = {"CC": command.format(folder=tmp_path), "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = adaptive_fmu("export", "--compile", "NonlinearSiso", "--out", tmp_path / "fmus", **of)
    assert done.returncode == 0, done.stderr
    # Each call with what was given before what is asked.
    calls = counted.read_text().splitlines() if counted.exists() else []
    assert bool([call for call in calls if "all.c" in call]) == ("my own" in command or "ccache" in command)
    assert all(call.startswith("gcc -DA=a b ") == ("-DA" in command) for call in calls)
    # Runs ask no compiler.
    ran("3.2.1-cosine", tmp_path, "--composite", **of)
    assert (counted.read_text().splitlines() if counted.exists() else []) == calls


def test_an_fmu_of_a_cached_description_is_the_same_and_a_broken_one_is_made_anew(tmp_path: Path) -> None:
    cache, name = tmp_path / "cache", "L1NonlinearSiso"

    def exported(cache: Path | str) -> bytes:
        answer = adaptive_fmu("export", name, "--out", tmp_path, ADAPTIVE_FMU_CACHE=str(cache))
        assert answer.returncode == 0, answer.stderr
        return (tmp_path / f"{name}.fmu").read_bytes()

    expected = exported("")
    assert exported(cache) == expected
    [described] = cache.glob("*.described")
    whole = described.read_bytes()
    for broken in (whole, b"", whole[: len(whole) // 2], b'{"failure":"no"}'):
        described.write_bytes(broken)
        assert exported(cache) == expected and described.read_bytes() == whole


def test_fmus_of_another_build_are_loaded_by_each_loop_anew_and_run_alike(tmp_path: Path) -> None:
    """Each loop of a command loads such a library to another place, and frees it again; kernels outlive that."""
    exported = adaptive_fmu("export", "--all", "--out", tmp_path / "own")
    assert exported.returncode == 0, exported.stderr
    (tmp_path / "other").mkdir()
    for file in (tmp_path / "own").glob("*.fmu"):
        with zipfile.ZipFile(file) as own, zipfile.ZipFile(tmp_path / "other" / file.name, "w") as other:
            for name in own.namelist():
                # What stands behind a library changes nothing but its checksum.
                other.writestr(name, own.read(name) + (b"\0" if name.startswith("binaries/") else b""))
    tables = []
    for name in ("own", "other"):
        out = tmp_path / f"{name} results"
        answer = adaptive_fmu("run", "--all", "--until", 0.2, "--json", "--fmus", tmp_path / name, "--out", out)
        assert answer.returncode in (0, 3), answer.stderr
        tables.append({file.parent.name: file.read_text() for file in out.glob("*/result.csv")})
    assert len(tables[0]) == len(LOOP_NAMES) and tables[0] == tables[1]


STUDIES = {
    "verify": ["3.3.1-case2", "--vary=plant.m1=±10%", "--runs=6", "--event=0.2: plant.m2=1.5", "--require=max |u_1| <= 1000"],
    "verify, at the start": ["3.3.1-case2", "--vary=plant.x0[1]=-0.1..0.1", "--runs=6", "--require=max |u_1| <= 1000"],
    "sweep": ["3.3.1-case2", "--composite", "--over=plant.m1=0.9,1,1.1", "--over=plant.m2=1,1.1,1.2"],
}


@pytest.mark.parametrize("study", STUDIES)
def test_runs_of_a_study_are_the_same_where_no_memory_for_code_is_given(study: str, tmp_path: Path) -> None:
    """All parameters but the varied ones are constants of the compiled equations; an event may change one more."""
    try:
        refuses()
    except subprocess.SubprocessError:
        pytest.skip("this system can't be asked to refuse memory for code")
    tables = []
    for refused in (False, True):
        answer = subprocess.run(
            [PROGRAM, study.split(",")[0], *STUDIES[study], "--until=0.5", "--json", "--out", tmp_path / str(refused)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=100,
            preexec_fn=refuse_memory_for_code if refused else None,
        )
        assert answer.returncode == 0, answer.stderr
        [table] = Path(json.loads(answer.stdout)["results"]).glob("*.csv")
        tables.append(table.read_text())
    assert tables[0] == tables[1] and len(tables[0].splitlines()) > 6
