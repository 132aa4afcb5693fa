"""Folders of the user: those that can't be written, those without programs, those full of descriptions."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import PROGRAM, adaptive_fmu
from test_foreign_plants import in_c

PLANT = '{"A": [[-2.0]], "B": [[3.0]], "C": [[1.0]], "D": [[0.0]]}'


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="there is no folder that nobody can write to")
def test_a_run_writes_to_out_only(tmp_path: Path) -> None:
    for command in (["run", "--until", "0.1"], ["sweep", "--until", "0.1", "--over", "plant.omega=1,2"]):
        answer = subprocess.run([PROGRAM, *command, "3.2.1-cosine", "--out", tmp_path], cwd="/proc", capture_output=True, text=True)
        assert answer.returncode == 0, answer.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["3.2.1-cosine", "3.2.1-cosine-sweep"]


@pytest.fixture
def without_programs(tmp_path: Path) -> Iterator[Path]:
    """A folder on a file system from which nothing is run."""
    folder = tmp_path / "noexec"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "noexec", "tmpfs", folder], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_temporary_folder_without_programs_is_named_with_what_to_set(without_programs: Path, tmp_path: Path) -> None:
    plant = in_c(tmp_path)
    environment = {**os.environ, "TMPDIR": str(without_programs)}
    command = [PROGRAM, "simulate", plant, "--until", "0.1", "--out", tmp_path / "out"]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert answer.returncode == 1
    assert f"{without_programs} is mounted noexec. Set TMPDIR" in answer.stderr, answer.stderr
    # An FMU of this program runs there: its library is loaded already.
    own = subprocess.run([*command[:2], "NonlinearSiso", *command[3:]], env=environment, capture_output=True, text=True, check=False)
    assert own.returncode == 0, own.stderr


def test_the_description_within_an_fmu_is_checked_and_exported_anew(tmp_path: Path) -> None:
    (tmp_path / "plant.json").write_text(PLANT)
    assert adaptive_fmu("new", "pid", "--name", "Own", "--plant", tmp_path / "plant.json", "--out", tmp_path / "Own.toml").returncode == 0
    assert adaptive_fmu("export", tmp_path / "Own.toml", "--out", tmp_path).returncode == 0
    checked = [adaptive_fmu("check", tmp_path / f"Own.{ending}") for ending in ("toml", "fmu")]
    assert checked[0].stdout == checked[1].stdout and checked[0].returncode == checked[1].returncode == 0
    again = adaptive_fmu("export", tmp_path / "Own.fmu", "--out", tmp_path / "again")
    assert (tmp_path / "again" / "Own.fmu").read_bytes() == (tmp_path / "Own.fmu").read_bytes(), again.stderr
    refused = adaptive_fmu("check", in_c(tmp_path))
    assert refused.returncode == 1 and "of another tool" in refused.stderr and "adaptive-fmu info" in refused.stderr


def test_the_descriptions_in_a_folder_are_exported(tmp_path: Path) -> None:
    (tmp_path / "plant.json").write_text(PLANT)
    folder = tmp_path / "designs"
    folder.mkdir()
    for kind in ("pid", "ladrc"):
        name, plant = kind.title(), tmp_path / "plant.json"
        made = adaptive_fmu("new", kind, "--name", name, "--plant", plant, "--out", folder / f"{name}.toml")
        assert made.returncode == 0, made.stderr
    (folder / "pyproject.toml").write_text("[project]\nname = 'other'\n")
    answer = adaptive_fmu("export", folder, "--out", tmp_path / "fmus")
    assert answer.returncode == 0, answer.stderr
    assert sorted(path.name for path in (tmp_path / "fmus").iterdir()) == ["Ladrc.fmu", "Pid.fmu"]
    (tmp_path / "empty").mkdir()
    empty = adaptive_fmu("export", tmp_path / "empty", "--out", tmp_path / "fmus")
    assert empty.returncode == 1 and "contains no description" in empty.stderr and "adaptive-fmu new" in empty.stderr
