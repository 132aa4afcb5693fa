"""Archives with several structures, and the help: groups of commands, short summaries."""

import json
import re
import zipfile
from pathlib import Path

import adaptive_fmu
import pytest
from conftest import ROOT
from recorded import program

LOOP = "3.2.1-cosine"
MOST = 12
"""Options of a summary."""


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loop as an archive with another structure beside it, with that one alone, and with two that have other names."""
    folder = tmp_path_factory.mktemp("archives")
    made = program(folder, "export", "--ssp", LOOP, "--out", folder)
    assert made.returncode == 0, made.stderr
    [whole] = folder.glob("*.ssp")
    with zipfile.ZipFile(whole) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    usual = files.pop("SystemStructure.ssd")
    short = re.sub(rb'stopTime="[^"]*"', b'stopTime="0.5"', usual)
    for name, structures in {
        "both": {"SystemStructure.ssd": usual, "Short.ssd": short},
        "one": {"Short.ssd": short},
        "others": {"Long.ssd": usual, "Short.ssd": short},
    }.items():
        with zipfile.ZipFile(folder / f"{name}.ssp", "w") as archive:
            for file, data in {**files, **structures}.items():
                archive.writestr(file, data)
    return folder


def stop_time(folder: Path, *words: str) -> float:
    answer = program(folder, "info", *words, "--json")
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout)["stop_time"]


def test_the_usual_structure_is_taken_or_the_only_one_or_the_one_that_is_named(archives: Path) -> None:
    assert stop_time(archives, "both.ssp") == 60 and stop_time(archives, "both.ssp/Short.ssd") == 0.5
    assert stop_time(archives, "one.ssp") == 0.5 and stop_time(archives, "others.ssp/Long.ssd") == 60
    for variant in ("Short", "Short.ssd"):
        ran = program(archives, "run", "both.ssp", "--variant", variant, "--out", f"r{variant}", "--json")
        assert ran.returncode == 0, ran.stderr
        [row] = [Path(json.loads(ran.stdout)["results"])]
        assert (archives / row / "result.csv").read_text().splitlines()[-1].startswith("0.5,")
    ran = program(archives, "run", "one.ssp", "--out", "only")
    assert ran.returncode == 0 and "the structure of the archive is Short.ssd" in ran.stderr + ran.stdout
    # Python has it by its path.
    assert adaptive_fmu.Loop(archives / "others.ssp" / "Short.ssd").run().data.index[-1] == 0.5
    again = program(archives, "run", "--again", row, "--out", "again", "--json")
    assert json.loads(again.stdout)["again"]["same_numbers"], again.stderr


def test_a_structure_that_is_not_there_is_refused_with_those_that_are(archives: Path) -> None:
    refused = program(archives, "run", "others.ssp")
    assert refused.returncode == 1 and "several variants: Long.ssd, Short.ssd" in refused.stderr, refused.stderr
    refused = program(archives, "run", "others.ssp", "--variant", "Shor")
    assert refused.returncode == 1 and "did you mean `Short.ssd`?" in refused.stderr, refused.stderr
    with zipfile.ZipFile(archives / "others.ssp") as archive:
        archive.extractall(archives / "folder")
    refused = program(archives, "run", "folder", "--variant", "Shor")
    assert refused.returncode == 1 and "did you mean `Short.ssd`?" in refused.stderr, refused.stderr
    refused = program(archives, "run", LOOP, "--variant", "Short")
    assert refused.returncode == 1 and f"{LOOP}: has no variants; only folders and .ssp archives" in refused.stderr, refused.stderr


def commands(tmp_path: Path) -> list[str]:
    return re.findall(r"^  ([a-z]+) {2,}[A-Z]", program(tmp_path, "--help").stdout, re.M)


def test_each_command_is_listed_once_in_a_group(tmp_path: Path) -> None:
    text = program(tmp_path, "--help").stdout
    listed = commands(tmp_path)
    assert len(listed) == len(set(listed)) > 20
    groups = re.findall(r"^([A-Z][\w-]*):\n  [a-z]", text, re.M)
    assert groups == ["Everyday", "Data", "Comparison", "FMUs", "Results", "Set-up"]
    assert "\nOptions:\n" in text and "Exit codes" in text and "--version" in text


def test_summaries_are_short_and_the_help_has_all_options(tmp_path: Path) -> None:
    options = lambda text: set(re.findall(r"^ +(?:-\w, )?(--[a-z-]+)", text, re.M))  # noqa: E731
    for command in [*commands(tmp_path), "new loop"]:
        if command == "help":
            continue
        short, whole = (options(program(tmp_path, *command.split(), flag).stdout) for flag in ("-h", "--help"))
        assert len(short) <= MOST, (command, sorted(short))
        assert short <= whole and {"--quiet", "--verbose", "--jobs"} <= whole
    assert "(see more with '--help')" in program(tmp_path, "run", "-h").stdout
    assert {"--event", "--set"} <= options(program(tmp_path, "run", "-h").stdout)


def test_an_archive_with_descriptions_of_ones_own_runs_as_a_single_fmu_unless_an_fmu_was_renamed(tmp_path: Path) -> None:
    made = program(tmp_path, "export", "--ssp", ROOT / "examples/own/dc_motor", "--out", tmp_path)
    assert made.returncode == 0, made.stderr
    [whole] = tmp_path.glob("*.ssp")
    done = program(tmp_path, "run", whole, "--composite", "--until", "0.05", "--out", "single")
    assert done.returncode in {0, 3}, done.stderr
    # As tools do that number the FMUs of an archive.
    with zipfile.ZipFile(whole) as archive:
        files = {name.replace("/DcMotor.fmu", "/0001_DcMotor.fmu"): archive.read(name) for name in archive.namelist()}
    files["SystemStructure.ssd"] = files["SystemStructure.ssd"].replace(b"/DcMotor.fmu", b"/0001_DcMotor.fmu")
    with zipfile.ZipFile(tmp_path / "renamed.ssp", "w") as archive:
        for file, data in files.items():
            archive.writestr(file, data)
    done = program(tmp_path, "run", "renamed.ssp", "--until", "0.05", "--out", "renamed")
    assert done.returncode in {0, 3} and "must be" not in done.stderr, done.stderr
