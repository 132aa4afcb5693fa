"""The program in a terminal: how much it tells, colours, completions, manual pages, pages that it opens."""

import json
import os
import pty
import re
import shutil
import stat
import subprocess
from pathlib import Path

import pytest
from conftest import FMU_NAMES, LOOP_NAMES, PROGRAM, adaptive_fmu

RUN = ["run", "3.2.1-cosine", "--until", "0.05"]
BRAILLE = re.compile("[\u2800-\u28ff]")
ESCAPE = "\x1b["


def in_a_terminal(*arguments: str, folder: Path, **environment: str) -> str:
    """What a person sees who runs the program in a terminal."""
    seen = bytearray()

    def read(terminal: int) -> bytes:
        data = os.read(terminal, 1 << 16)
        seen.extend(data)
        return b""

    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        environment = {
            "TERM": "xterm",
            **{key: os.environ[key] for key in os.environ if key not in ("NO_COLOR", "CI")},
            **environment,
        }
        os.execve(PROGRAM, [PROGRAM, *arguments], environment)
    try:
        while True:
            read(terminal)
    except OSError:
        pass
    os.waitpid(child, 0)
    os.close(terminal)
    return seen.decode(errors="replace")


def test_a_sketch_is_for_a_terminal_and_not_for_a_pipe(tmp_path: Path) -> None:
    piped = adaptive_fmu(*RUN, folder=tmp_path)
    assert piped.returncode == 0 and not BRAILLE.search(piped.stdout) and ESCAPE not in piped.stdout + piped.stderr
    assert BRAILLE.search(in_a_terminal(*RUN, folder=tmp_path))
    assert not BRAILLE.search(in_a_terminal(*RUN, "--quiet", folder=tmp_path))


def test_quiet_leaves_results_and_errors(tmp_path: Path) -> None:
    done = adaptive_fmu(*RUN, "--quiet", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["3.2.1-cosine", "measured", "limit"] and len(lines) == 4, lines
    assert (tmp_path / "results" / "3.2.1-cosine" / "index.html").is_file()
    assert adaptive_fmu("--quiet", "export", "NonlinearSiso", folder=tmp_path).stdout == "fmus/NonlinearSiso.fmu\n"
    wrong = adaptive_fmu("run", "nothing", "-q", folder=tmp_path)
    assert wrong.returncode == 1 and wrong.stderr.startswith("error: there is no loop named `nothing`")


def test_verbose_logs_where_fmus_come_from_and_how_they_run(tmp_path: Path) -> None:
    usual, done = adaptive_fmu(*RUN, "--json", folder=tmp_path), adaptive_fmu(*RUN, "--json", "-v", folder=tmp_path)
    assert "steps of" not in usual.stderr and json.loads(done.stdout)["ended"] == "complete"
    assert "from 0 s to 0.05 s in steps of 0.001 s, gauss-seidel" in done.stderr
    for unit, fmu in [("plant", "NonlinearSiso"), ("controller", "L1NonlinearSiso")]:
        assert re.search(rf"{unit}: \S*{fmu}.fmu, in this process, equations (compiled|not compiled)", done.stderr)
    assert adaptive_fmu("list", "-q", "-v").returncode == 2


def test_verbose_logs_the_integration_method_and_the_eigenvalue_that_decided(tmp_path: Path) -> None:
    stderr = lambda *more: adaptive_fmu(*RUN, *more, "--json", "-v", folder=tmp_path).stderr  # noqa: E731
    method = r"3.2.1-cosine\S*: {}: integrated by the {} from t = \S+ s"
    value = r": the eigenvalue -\S+( ± \S+i)? 1/s allows substeps of \S+ s at order 5"
    lines = stderr()
    assert re.search(method.format("plant", "explicit method"), lines)
    assert re.search(method.format("controller", "explicit method") + value, lines), lines
    assert re.search(method.format("\\S+", r"explicit method") + value, stderr("--composite"))
    stiff = stderr("--set", "controller.integration_method=stiff")
    assert re.search(method.format("controller", "stiff method") + ", as integration_method asks", stiff), stiff
    for quiet in [adaptive_fmu(*RUN, folder=tmp_path), adaptive_fmu(*RUN, "-q", folder=tmp_path)]:
        assert "integrated" not in quiet.stdout + quiet.stderr, "nobody asked"


def test_errors_are_red_where_a_terminal_shows_colours_and_nobody_minds(tmp_path: Path) -> None:
    wrong = ["run", "nothing"]
    red = f"{ESCAPE}1m{ESCAPE}31merror:{ESCAPE}0m there is no loop"
    assert red in in_a_terminal(*wrong, folder=tmp_path)
    for plain in [{"NO_COLOR": "1"}, {"TERM": "dumb"}, {"CLICOLOR": "0"}]:
        assert in_a_terminal(*wrong, folder=tmp_path, **plain).startswith("error: there is no loop"), plain
    clean = {"NO_COLOR": "", "CLICOLOR_FORCE": ""}
    assert adaptive_fmu(*wrong, **clean).stderr.startswith("error: ")
    assert adaptive_fmu(*wrong, **clean | {"CLICOLOR_FORCE": "1"}).stderr.startswith(red)
    assert adaptive_fmu(*wrong, NO_COLOR="1", CLICOLOR_FORCE="1").stderr.startswith("error: ")
    # The arguments' own mistakes, too.
    assert ESCAPE in adaptive_fmu("fly", **clean | {"CLICOLOR_FORCE": "1"}).stderr
    assert ESCAPE not in adaptive_fmu("fly", **clean).stderr


def test_jobs_limits_what_is_done_at_a_time_and_changes_no_result(tmp_path: Path) -> None:
    for folder, jobs in [("one", ["--jobs", "1"]), ("several", ["--jobs", "3"])]:
        command = ["compare", "3.2.1-cosine", "3.2.1-square", "--until", "0.05", "--json", "--out", tmp_path / folder]
        assert adaptive_fmu(*command, *jobs, folder=tmp_path).returncode == 0
    tables = [(tmp_path / folder / "3.2.1-square" / "result.csv").read_bytes() for folder in ("one", "several")]
    assert tables[0] == tables[1]
    assert "number would be zero" in adaptive_fmu("list", "--jobs", "0").stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_completions_are_sound_and_know_loops_and_fmus(shell: str, tmp_path: Path) -> None:
    done = adaptive_fmu("completions", shell)
    assert (done.returncode, done.stderr) == (0, "")
    (file := tmp_path / "script").write_text(done.stdout)
    assert "quiet" in done.stdout and "linearise" in done.stdout and "unit-process" not in done.stdout
    assert [name for name in LOOP_NAMES + FMU_NAMES if name not in done.stdout] == []
    if program := shutil.which(shell if shell != "powershell" else "pwsh"):
        subprocess.run([program, "-n", file] if shell != "powershell" else [program, "-File", file], check=True)


def completed(script: Path, *words: str) -> set[str]:
    """What bash offers for the last word."""
    line = " ".join(words)
    asked = f"""source {script}
COMP_WORDS=({" ".join(f"'{word}'" for word in words)}) COMP_CWORD={len(words) - 1} COMP_LINE='{line}' COMP_POINT={len(line)}
_adaptive__fmu {words[0]} '{words[-1]}' '{words[-2]}'
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    return set(subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True).stdout.split())


def test_bash_completes_commands_options_loops_and_fmus(tmp_path: Path) -> None:
    (script := tmp_path / "script").write_text(adaptive_fmu("completions", "bash").stdout)
    assert completed(script, "adaptive-fmu", "lin") == {"linearise"}
    assert completed(script, "adaptive-fmu", "run", "3.2.1") == {"3.2.1-cosine", "3.2.1-mrac", "3.2.1-square"}
    assert completed(script, "adaptive-fmu", "export", "L1Nonl") == {"L1NonlinearSiso"}
    assert completed(script, "adaptive-fmu", "export", "--run", "3.2.1-c") == {"3.2.1-cosine"}
    assert completed(script, "adaptive-fmu", "run", "--unt") == {"--until"}


def test_powershell_completes_loops_and_fmus_by_place_and_behind_options() -> None:
    script = adaptive_fmu("completions", "powershell").stdout

    def names(key: str) -> list[str]:
        """The names that the script offers for a key of one of its two tables."""
        (line,) = re.findall(rf"^        '{key}' = @\((.*)\)$", script, re.M)
        return re.findall(r"'([^']+)'", line)

    assert names("run") == names("tune") == names("export --composite") == LOOP_NAMES
    assert names("export") == names("check") == FMU_NAMES
    assert set(names("simulate")) == {*LOOP_NAMES, *FMU_NAMES}
    # What is offered is filtered by what was typed, after the names are added.
    assert script.index("foreach ($name in $names)") < script.index("$completions.Where{") < script.index("Sort-Object")


@pytest.mark.skipif(shutil.which("pwsh") is None, reason="there is no PowerShell")
def test_powershell_offers_what_fits(tmp_path: Path) -> None:
    (script := tmp_path / "script.ps1").write_text(adaptive_fmu("completions", "powershell").stdout)

    def offered(line: str) -> set[str]:
        asked = f"(TabExpansion2 '{line}' {len(line)}).CompletionMatches.CompletionText"
        command = ["pwsh", "-NoProfile", "-Command", f". {script}; {asked}"]
        return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())

    assert offered("adaptive-fmu run 3.2.1") == {"3.2.1-cosine", "3.2.1-mrac", "3.2.1-square"}
    assert offered("adaptive-fmu export Quadrotor L1Nonl") == {"L1NonlinearSiso"}
    assert offered("adaptive-fmu export --run 3.2.1-c") == {"3.2.1-cosine"}


def test_fish_completes_loops_and_files(tmp_path: Path) -> None:
    if not (fish := shutil.which("fish")):
        pytest.skip("there is no fish")
    (script := tmp_path / "script").write_text(adaptive_fmu("completions", "fish").stdout)
    asked = f"source {script}; complete -C 'adaptive-fmu run 3.2.1'"
    offered = subprocess.run([fish, "--no-config", "-c", asked], capture_output=True, text=True, check=True, cwd=tmp_path).stdout
    assert {line.split("\t")[0] for line in offered.splitlines()} >= {"3.2.1-cosine", "3.2.1-square"}


def test_the_manual_has_a_page_for_every_command(tmp_path: Path) -> None:
    done = adaptive_fmu("manual", "--out", tmp_path / "man1")
    pages = {file.name: file.read_text() for file in (tmp_path / "man1").iterdir()}
    assert done.returncode == 0 and {Path(line).name for line in done.stdout.splitlines()} == set(pages)
    listed = re.findall(r"^  ([a-z]+) +[A-Z]", adaptive_fmu("--help").stdout, re.M)
    commands = set(listed) - {"help"}
    assert len(listed) == len(set(listed)) > 20
    assert set(pages) == {"adaptive-fmu.1", "adaptive-fmu-new-loop.1", *(f"adaptive-fmu-{name}.1" for name in commands)}
    assert all(page.count("\n.SH NAME\n") == 1 for page in pages.values())
    assert "Exit codes" in pages["adaptive-fmu.1"] and "NO_COLOR" in pages["adaptive-fmu.1"]


@pytest.fixture
def opener(tmp_path: Path) -> tuple[dict[str, str], Path]:
    """An opener that notes what it is to open: the environment in which it is found, and its notes."""
    (folder := tmp_path / "bin").mkdir()
    notes = tmp_path / "opened"
    (program := folder / "xdg-open").write_text(f'#!/bin/sh\necho "$@" >> {notes}\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}, notes


def test_open_shows_the_page_that_a_command_wrote(opener: tuple[dict[str, str], Path], tmp_path: Path) -> None:
    environment, notes = opener
    for command, page in [
        (RUN, "results/3.2.1-cosine/index.html"),
        (["simulate", "NonlinearSiso", "--until", "0.05"], "results/NonlinearSiso/index.html"),
        (["compare", "3.2.1-cosine", "3.2.1-square", "--until", "0.05"], "results/comparison/index.html"),
    ]:
        assert adaptive_fmu(*command, folder=tmp_path, **environment).returncode == 0 and not notes.exists()
        assert adaptive_fmu(*command, "--open", folder=tmp_path, **environment).returncode == 0
        assert notes.read_text() == page + "\n" and (tmp_path / page).is_file()
        notes.unlink()


def test_a_page_that_cant_be_opened_is_a_warning(opener: tuple[dict[str, str], Path], tmp_path: Path) -> None:
    environment, _ = opener
    (tmp_path / "bin" / "xdg-open").write_text("#!/bin/sh\nexit 3\n")
    done = adaptive_fmu(*RUN, "--open", folder=tmp_path, **environment)
    assert done.returncode == 0 and "warning: could not open results/3.2.1-cosine/index.html in a browser: xdg-open" in done.stderr
    gone = adaptive_fmu(*RUN, "--open", folder=tmp_path, PATH=str(tmp_path))
    assert gone.returncode == 0 and "in a browser: xdg-open" in gone.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["linearise", "NonlinearSiso", "--at", "-1"], "--at = -1: must be at or after the start time"),
        (["linearise", "NonlinearSiso", "--at", "inf"], "must be a finite number"),
        (["run", "3.2.1-cosine", "--until", "-5"], "'-5' for '--until"),
        (["run", "3.2.1-cosine", "--step", "-1e-3"], "'-1e-3' for '--step"),
        (["simulate", "NonlinearSiso", "--tolerance", "-1"], "'-1' for '--tolerance"),
        (["new", "pid", "--name", "A", "--bandwidth", "-2"], "'-2' for '--bandwidth"),
        (["tune", "3.2.1-cosine", "--cognitive", "-2"], "'-2' for '--cognitive"),
        (["tune", "3.2.1-cosine", "--parameter", "controller.adaptation_gain=-5..-1"], "-5..-1: must lie within 0..inf"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_negative_number_is_a_value_and_is_judged_as_one(words: list[str], message: str, tmp_path: Path) -> None:
    done = adaptive_fmu(*words, folder=tmp_path)
    assert done.returncode in (1, 2) and message in done.stderr


def test_negative_start_values_and_weights_are_taken(tmp_path: Path) -> None:
    output = json.loads(adaptive_fmu("linearise", "NonlinearSiso", "--set", "x0[1]=-1", "--json").stdout)
    assert output["states"][0]["value"] == -1
    done = adaptive_fmu(*RUN, "--set", "plant.x0[1]=-0.5", "--json", folder=tmp_path)
    assert done.returncode == 0, done
