"""Equations that are compiled while loops run: results stay the same, and what is kept can't do harm."""

import json
import os
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import PROGRAM, adaptive_fmu

LOOPS = ["3.2.1-cosine", "3.3.1-case2", "6.5.1-mrac"]


def ran(
    loop: str, out: Path, cache: Path | str, *options: str | float, until: float = 0.3, **environment: str
) -> tuple[str, str]:
    """The table of a run that keeps kernels in a folder (nowhere where that is empty), and what was told."""
    words = [loop, "--until", until, "--json", "--out", out, *options]
    answer = adaptive_fmu("run", *words, ADAPTIVE_FMU_CACHE=str(cache), **environment)
    assert answer.returncode in (0, 3), answer.stderr
    return (Path(json.loads(answer.stdout)["results"]) / "result.csv").read_text(), answer.stderr


def compiling(loop: str, out: Path, cache: Path, *options: str) -> str:
    """The table of runs until one is long enough for a compiler to be called."""
    for _ in range(30):
        table, _ = ran(loop, out, cache, *options, until=2.0)
        if list(cache.glob("*.tmp*")) or list(cache.glob("*.kernel")):
            return table
    raise AssertionError("no compiler was called")


def kernels(cache: Path, number: int) -> list[Path]:
    """So many kernels, which are still being compiled when a short run ends, and nothing unfinished beside them."""
    end = time.monotonic() + 120
    while time.monotonic() < end:
        found = list(cache.glob("*.kernel"))
        if len(found) >= number and not list(cache.glob("*.tmp*")):
            return found
        time.sleep(0.05)
    raise AssertionError(f"{sorted(path.name for path in cache.iterdir())}: not {number} kernels")


@pytest.mark.parametrize("form", [[], ["--composite"], ["--composite", "--set", "integration_method=stiff"]])
@pytest.mark.parametrize("loop", LOOPS)
def test_a_run_has_the_same_digits_with_and_without_compiled_equations(loop: str, form: list[str], tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    expected, _ = ran(loop, tmp_path, "", *form, until=2.0)
    assert not cache.exists()
    first = compiling(loop, tmp_path, cache, *form)
    kernels(cache, 1)
    then, told = ran(loop, tmp_path, cache, *form, until=2.0)
    assert first == then == expected and told == ""


def test_what_is_compiled_is_kept_for_the_next_run_and_another_parameter(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    compiling("3.2.1-cosine", tmp_path, cache, "--composite")
    before = {path: path.stat().st_mtime_ns for path in kernels(cache, 1)}
    changed = ["--composite", "--set", "controller.adaptation_gain=2e4"]
    assert ran("3.2.1-cosine", tmp_path, cache, *changed)[0] == ran("3.2.1-cosine", tmp_path, "", *changed)[0]
    after = {path: path.stat().st_mtime_ns for path in kernels(cache, 1)}
    assert before.items() <= after.items()


@pytest.mark.parametrize(
    ("compiler", "trouble"),
    [("no-such-compiler", "no C compiler: `no-such-compiler` isn't found"), ("false", "`false` fails (exit code 1)")],
)
def test_without_a_compiler_that_works_a_line_says_so_and_results_are_the_same(
    compiler: str, trouble: str, tmp_path: Path
) -> None:
    words = ["3.2.1-cosine", tmp_path]
    expected, _ = ran(*words, "", until=3)
    table, told = ran(*words, tmp_path / "cache", until=3, CC=compiler)
    assert table == expected and {path.suffix for path in (tmp_path / "cache").iterdir()} <= {".zip", ".described"}
    assert told.count("\n") == 1 and trouble in told and "the same results" in told and "CC" in told


@pytest.mark.parametrize("command", ["gcc -O1", "ccache gcc", '"{folder}/ccache" gcc "-DA=a b"', "{folder}/my own gcc"])
def test_the_compiler_may_be_a_command_with_arguments(command: str, tmp_path: Path) -> None:
    """As make, CMake and Python take `CC`; ccache is one of our own, which counts."""
    counted, cache = tmp_path / "counted", tmp_path / "cache"
    for name, calls in {"ccache": '"$@"', "my own gcc": 'gcc "$@"'}.items():
        (tmp_path / name).write_text(f'#!/bin/sh\necho "$@" >> "{counted}"\nexec {calls}\n')
        (tmp_path / name).chmod(0o755)
    of = {"CC": command.format(folder=tmp_path), "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = adaptive_fmu("export", "--compile", "NonlinearSiso", "--out", tmp_path / "fmus", **of)
    assert done.returncode == 0, done.stderr
    expected, _ = ran("3.2.1-cosine", tmp_path, "", "--composite", until=20.0)
    table, told = ran("3.2.1-cosine", tmp_path, cache, "--composite", until=20.0, **of)
    assert table == expected and "C compiler" not in told and kernels(cache, 1)
    # FMUs, and equations of runs: each call with what was given before what is asked.
    calls = counted.read_text().splitlines() if counted.exists() else []
    of_fmus, of_runs = ([call for call in calls if words in call] for words in ("all.c", "-fno-math-errno"))
    assert bool(of_fmus) == bool(of_runs) == ("my own" in command or "ccache" in command)
    assert all(call.startswith("gcc -DA=a b ") == ("-DA" in command) for call in of_fmus + of_runs)


def test_another_library_has_other_kernels_however_it_was_built(tmp_path: Path) -> None:
    """A user's own models change without a change of version or description."""
    cache, [library] = tmp_path / "cache", PROGRAM.parent.glob("deps/libadaptive_fmu_library.so")
    other = tmp_path / "libother.so"
    other.write_bytes(library.read_bytes() + b"\0")
    found = set[str]()
    for number, file in enumerate((library, other), 1):
        fmus = tmp_path / file.stem
        units = ["ReferenceNonlinearSiso", "L1NonlinearSiso", "NonlinearSiso"]
        answer = adaptive_fmu("export", *units, "--library", file, "--out", fmus)
        assert answer.returncode == 0, answer.stderr
        for _ in range(30):
            ran("3.2.1-cosine", tmp_path, cache, "--fmus", fmus, until=5.0)
            found = {path.stem for path in cache.glob("*.kernel")}
            if len(found) == 3 * number:
                break
        assert len(found) == 3 * number, found


def test_a_broken_kernel_is_made_anew(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    expected = compiling("3.2.1-cosine", tmp_path, cache, "--composite")
    [kernel] = kernels(cache, 1)
    whole = kernel.read_bytes()
    middle = len(whole) // 2
    zeroed = whole[:middle] + bytes(64) + whole[middle + 64 :]
    for broken in (b"", b"\x7fELF", whole[: len(whole) // 3], zeroed):
        kernel.write_bytes(broken)
        table, told = ran("3.2.1-cosine", tmp_path, cache, "--composite", until=2.0)
        assert table == expected and told.count(f"damaged files of the cache are made anew: {kernel}") == 1
        ran("3.2.1-cosine", tmp_path, cache, "--composite", until=20.0)
        # Each of these runs may have left a compiler that isn't done.
        kernels(cache, 1)
        assert kernel.read_bytes() == whole


def test_a_cache_that_cant_be_written_hinders_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    expected, _ = ran("3.2.1-cosine", tmp_path, "")
    assert ran("3.2.1-cosine", tmp_path, tmp_path / "file" / "cache") == (expected, "")


def test_programs_at_a_time_and_one_that_is_killed_leave_whole_kernels(tmp_path: Path) -> None:
    cache, expected = tmp_path / "cache", ran("3.3.1-case2", tmp_path, "", "--composite", until=2.0)[0]

    def one(number: int) -> str:
        return ran("3.3.1-case2", tmp_path / str(number), cache, "--composite", until=2.0)[0]

    with ThreadPoolExecutor(4) as several:
        assert set(several.map(one, range(4))) == {expected}
    kernels(cache, 1)
    words = [str(PROGRAM), "run", "3.4.2", "--composite", "--out", tmp_path / "killed"]
    with subprocess.Popen(words, cwd=tmp_path, env={"ADAPTIVE_FMU_CACHE": str(cache), "PATH": "/usr/bin:/bin"}) as process:
        time.sleep(0.4)
        process.kill()
    assert one(5) == expected
    assert ran("3.4.2", tmp_path, cache, "--composite")[0] == ran("3.4.2", tmp_path, "", "--composite")[0]


def test_an_fmu_of_a_kept_description_is_the_same_and_a_broken_one_is_made_anew(tmp_path: Path) -> None:
    cache, name = tmp_path / "cache", "L1NonlinearSiso"

    def exported(kept: Path | str) -> bytes:
        answer = adaptive_fmu("export", name, "--out", tmp_path, ADAPTIVE_FMU_CACHE=str(kept))
        assert answer.returncode == 0, answer.stderr
        return (tmp_path / f"{name}.fmu").read_bytes()

    expected = exported("")
    assert exported(cache) == expected
    [described] = cache.glob("*.described")
    whole = described.read_bytes()
    for broken in (whole, b"", whole[: len(whole) // 2], b'{"failure":"no"}'):
        described.write_bytes(broken)
        assert exported(cache) == expected and described.read_bytes() == whole
