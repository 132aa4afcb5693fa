"""What version 0.1.0 wrote, in tests/fmpy/former: descriptions, a loop, a parameter set, results and a search."""

import csv
import json
import shutil
import subprocess
from pathlib import Path

import pytest
from conftest import PROGRAM
from fmpy import read_model_description

FORMER = Path(__file__).parent / "former"
LABEL = "max |voltage|, V"


def answer(*words: object, folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, check=False, cwd=folder)


@pytest.fixture
def work(tmp_path: Path) -> Path:
    shutil.copytree(FORMER, tmp_path, dirs_exist_ok=True)
    return tmp_path


def metric(folder: Path) -> float:
    metrics = json.loads((folder / "metrics.json").read_text())["metrics"]
    return next(metric["value"] for metric in metrics if metric["label"] == LABEL)


def test_descriptions_give_fmus_with_the_names_that_they_had(work: Path) -> None:
    made = answer("export", *sorted((work / "dc_motor").glob("*.toml")), "--out", "fmus", folder=work)
    assert made.returncode == 0, made.stderr
    assert {path.stem for path in (work / "fmus").glob("*.fmu")} == {"DcMotor", "DcMotorController", "DcMotorReference"}
    names = {variable.name for variable in read_model_description(work / "fmus/DcMotorController.fmu").modelVariables}
    assert {"speed_reference", "voltage", "adaptation_gain", "step_too_long", "time_at_limit", "projection_active"} <= names


@pytest.mark.parametrize("options", [[], ["--case", "tuned.ssv"]])
def test_a_loop_runs_with_its_signals_and_numbers(work: Path, options: list[str]) -> None:
    ran = answer("run", "dc_motor", "--composite", "--until", 1.2, "--step", 0.01, "--out", "new", *options, folder=work)
    assert ran.returncode == 0, ran.stderr
    new, former = (csv.DictReader((work / name).open()) for name in ("new/dc_motor-composite/result.csv", "dc_motor-composite/result.csv"))
    assert set(former.fieldnames) <= set(new.fieldnames)
    if options:
        assert metric(work / "new/dc_motor-composite") != metric(work / "dc_motor-composite"), "the parameter set has an effect"
    else:
        assert metric(work / "new/dc_motor-composite") == pytest.approx(metric(work / "dc_motor-composite"), rel=1e-5)
        for one, other in zip(new, former, strict=True):
            assert float(one["motor.speed"]) == pytest.approx(float(other["motor.speed"]), rel=1e-5, abs=1e-4)


def test_a_parameter_set_is_exported_with_the_fmu(work: Path) -> None:
    text = (work / "dc_motor/tuned.ssv").read_text().replace("controller.", "")
    (work / "controller.ssv").write_text(text)
    made = answer("export", "dc_motor/DcMotorController.toml", "--values", "controller.ssv", "--out", "fmus", folder=work)
    assert made.returncode == 0, made.stderr
    variables = read_model_description(work / "fmus/DcMotorController.fmu").modelVariables
    assert next(float(variable.start) for variable in variables if variable.name == "adaptation_gain") == pytest.approx(66948.81957103536)


def test_results_are_compared_and_not_run_again(work: Path) -> None:
    options = ["--composite", "--until", 1.2, "--step", 0.01]
    made = answer("compare", "dc_motor-composite", "dc_motor", *options, "--out", "both", folder=work)
    assert made.returncode == 0, made.stderr
    assert "have no checksums" in made.stderr and made.stdout.count("7.367") == 2, made.stdout
    again = answer("run", "--again", "dc_motor-composite", folder=work)
    assert again.returncode == 1
    assert "no settings of the run, as results of `simulate` and of version 0.1.0" in again.stderr


def test_a_search_is_not_continued_and_the_message_gives_the_options_for_a_new_one(work: Path) -> None:
    options = ["--parameter", "controller.adaptation_gain=100..100000", "--metric", LABEL, "--particles", 4, "--generations", 2]
    tuned = answer("tune", "dc_motor", *options, "--out", ".", folder=work)
    assert tuned.returncode == 1 and "--force" in tuned.stderr and "--tag" in tuned.stderr, tuned.stderr
