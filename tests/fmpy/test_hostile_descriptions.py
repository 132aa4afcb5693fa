"""Descriptions (TOML) that are broken or meant to do harm, given to the program; what is in them alone is tested by
tests/models/hostile_descriptions.rs."""

import os
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT, adaptive_fmu, files_in
from master import PLANT

TOML = (ROOT / "modelDescription" / f"{PLANT}.toml").read_text()
L1 = (ROOT / "modelDescription" / "L1NonlinearSiso.toml").read_text()


def of(model: str, structure: str) -> str:
    return f'name = "X"\nmodel = "{model}"\ndescription = ""\n[structure]\n{structure}\n'


# What is written into the file, and a word of what is told.
HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "name"),
    "zeros": (bytes(1000), "line 1: contains a NUL character"),
    "no UTF-8": (TOML.encode() + b"\n# \xff\xfe", f"line {TOML.count(chr(10)) + 2}: is not UTF-8"),
    "UTF-16": (TOML.encode("utf-16"), "line 1: is not UTF-8"),
    "a binary": (b"\x7fELF" + bytes(range(256)) * 50, "UTF-8"),
    "hundreds of MB": ("# " + "x" * 300_000_000, "longer than"),
    "a long string": (TOML.replace('description = "', 'description = "' + "x" * 5_000_000), "longer than"),
    "long name of a model": (TOML.replace('"nonlinear-siso"', f'"{"x" * 1_000_000}"'), "model"),
    "number beyond all": (L1.replace("adaptation_gain = 1e5", "adaptation_gain = 1e999"), "line"),
    "integer beyond all": (of("reference", "channels = 99999999999999999999"), "line 5"),
    "largest integer": (of("sensor", "channels = 1\ndelay_samples = 9223372036854775807"), "delay_samples"),
    "many channels": (of("reference", "channels = 1000000000"), "channels"),
    "deep lists": ("x = " + "[" * 1_000_000, "line 1"),
    "deep tables": ("[" + ".".join(["a"] * 300_000) + "]", "line 1"),
    "terminal escape": (TOML + "\n'\x1b[31m' = 1\n", "line"),
    "unknown key with an escape": (TOML + '\n[start]\n"\\u001b[2J" = 1.0\n', "no such parameter"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_description_is_refused_in_a_line_and_leaves_nothing(bounded, name: str, tmp_path: Path) -> None:
    content, word = HOSTILE[name]
    (tmp_path / "mine.toml").write_bytes(content.encode() if isinstance(content, str) else content)
    answer = bounded("export", "mine.toml", "--out", "out", folder=tmp_path)
    assert answer.returncode == 1 and answer.stdout == "", answer
    assert "mine.toml" in answer.stderr and word in answer.stderr and answer.stderr.count("\n") == 1, answer.stderr
    assert "\x1b" not in answer.stderr and len(answer.stderr) < 5000
    assert files_in(tmp_path) == {"mine.toml"}


def test_what_is_no_file_is_refused_without_waiting(bounded, tmp_path: Path) -> None:
    for name in ["mine.toml", "mine.fmu", "mine.ssd", "mine.ssp", "mine.ssv", "mine.so"]:
        os.mkfifo(tmp_path / name)
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "folder.fmu").mkdir()
    for arguments in [
        ("export", "mine.toml"),
        ("export", PLANT, "--library", "mine.so"),
        ("export", PLANT, "--values", "mine.ssv"),
        ("export", PLANT, "--values", "."),
        ("info", "mine.fmu"),
        ("info", "folder.fmu"),
        ("linearise", "mine.fmu"),
        ("run", "mine.ssd"),
        ("run", "mine.ssp"),
        ("run", "3.2.1-cosine", "--case", "mine.ssv"),
    ]:
        answer = bounded(*arguments, folder=tmp_path)
        assert answer.returncode == 1 and "regular file" in answer.stderr, answer
    answer = bounded("export", "folder.toml", folder=tmp_path)
    assert answer.returncode == 1 and "contains no description" in answer.stderr, answer


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_what_may_not_be_read_or_written_is_reported(bounded, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(TOML)
    (tmp_path / "mine.toml").chmod(0)
    assert "denied" in bounded("export", "mine.toml", folder=tmp_path).stderr
    (tmp_path / "out").mkdir(mode=0o500)
    assert "denied" in bounded("export", PLANT, "--out", "out", folder=tmp_path).stderr


def test_other_line_ends_and_a_byte_order_mark_do_no_harm(bounded, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_bytes(b"\xef\xbb\xbf" + TOML.replace("\n", "\r\n").encode())
    assert bounded("export", "mine.toml", "--out", "out", folder=tmp_path).returncode == 0
    assert files_in(tmp_path) == {"mine.toml", f"out/{PLANT}.fmu"}


def test_a_mistake_in_a_description_within_an_archive_is_reported_with_its_line(tmp_path: Path) -> None:
    own = ROOT / "examples" / "own" / "dc_motor"
    text = (own / "DcMotor.toml").read_text().replace("u_min = [-12.0]", "u_mim = [-12.0]")
    line = text[: text.index("u_mim")].count("\n") + 1
    with zipfile.ZipFile(tmp_path / "mine.ssp", "w") as archive:
        archive.write(own / "SystemStructure.ssd", "SystemStructure.ssd")
        for file in own.glob("*.toml"):
            archive.writestr(f"resources/{file.name}", text if file.name == "DcMotor.toml" else file.read_text())
    answer = adaptive_fmu("run", "mine.ssp", "--until", "0.1", folder=tmp_path)
    assert answer.returncode == 1
    assert f"mine.ssp/resources/DcMotor.toml: line {line}: [start] u_mim" in answer.stderr, answer.stderr
