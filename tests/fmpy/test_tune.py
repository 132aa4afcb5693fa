"""Tuning a loop's parameters by a particle swarm: what is found, what is left, and what is refused."""

import json
import shutil
import signal
import subprocess
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu, read_csv
from test_command_line import fails

LOOP = "4-case1-fuzzy"
# As one unit, as fast as its objective allows: it moves by less than 1e-5 of its value.
FAST = ["--composite", "--set", "relative_tolerance=1e-4", "--set", "integration_method=stiff"]
CORNERS = ["VL_c", "VL_l", "L_l", "L_c", "L_h", "S_l", "S_c", "VS_l", "VS_c"]
# A search that takes no time.
SMALL = ["--until", "0.2", "--particles", "6", *FAST]


def tune(out: Path, *options: str | Path | float, code: int = 0) -> dict:
    answer = adaptive_fmu("tune", *options, "--json", "--out", out)
    assert (answer.returncode, answer.stderr) == (code, ""), answer
    return json.loads(answer.stdout)


def values_of(file: Path) -> dict[str, float]:
    space = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
    entries = ElementTree.parse(file).getroot().iter(f"{space}Parameter")
    return {entry.attrib["name"]: float(entry[0].attrib["value"]) for entry in entries}


def objective(table: dict[str, np.ndarray]) -> float:
    """Of the columns of a run recorded every 10 ms."""
    e, u = table["reference.r[1]"] - table["plant.y[1]"], table["controller.u[1]"]
    return np.sum(e**2 + 1e-3 * u**2)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Path]:
    """Twenty particles in twenty generations, as the loop says it is tuned: what was told, and the folder of results."""
    output = tune(tmp_path_factory.mktemp("tuned"), LOOP, *FAST, "--seed", 2, "--particles", 20, "--generations", 20)
    return output, Path(output["results"])


def test_a_small_swarm_finds_output_sets_with_the_objective_that_is_to_be_reached(tuned) -> None:
    output, _ = tuned
    assert (output["runs"], output["generations"], output["ended"]) == (400, 20, "complete")
    assert output["objective"]["best"] <= 55.6 and round(output["objective"]["start"], 1) == 71.9
    # At the tolerance of every run the best is what the search took it for.
    assert output["objective"]["verified"] == pytest.approx(output["objective"]["best"], rel=1e-4)


def test_the_loop_with_the_values_found_has_the_objective_that_is_reported(tuned, tmp_path: Path) -> None:
    output, folder = tuned
    options = ["--composite", "--until", 8, "--step", 0.01, "--case", folder / "tuned.ssv"]
    assert adaptive_fmu("run", LOOP, *options, "--out", tmp_path).returncode == 0
    table = read_csv(tmp_path / f"{LOOP}-composite" / "result.csv")
    assert objective(table) == pytest.approx(output["objective"]["verified"], rel=1e-9)


def test_what_is_found_is_written_as_parameter_sets_within_the_bounds(tuned, fmu) -> None:
    output, folder = tuned
    of_loop, of_unit = values_of(folder / "tuned.ssv"), values_of(folder / "controller.ssv")
    assert of_loop == output["parameters"] == {f"controller.{name}": value for name, value in of_unit.items()}
    variables = fmu("FuzzyL1ActuatedSiso").variables
    assert list(of_unit) == CORNERS
    assert all(float(variables[name].min) <= value <= float(variables[name].max) for name, value in of_unit.items())
    picture = (folder / "convergence.svg").read_text()
    assert all(words in picture for words in ["generation", "best so far", "median particle so far"])


def test_an_fmu_is_exported_with_the_values_found(tuned, tmp_path: Path) -> None:
    _, folder = tuned
    name, values = "FuzzyL1ActuatedSiso", folder / "controller.ssv"
    answer = adaptive_fmu("export", name, "--values", values, "--out", tmp_path)
    assert answer.returncode == 0, answer
    output = json.loads(adaptive_fmu("info", tmp_path / f"{name}.fmu", "--json").stdout)
    start = {variable["name"]: variable["start"] for variable in output["variables"]}
    assert {corner: float(start[corner]) for corner in CORNERS} == values_of(values)
    assert "has no such variable" in fails("export", name, "--values", folder / "tuned.ssv", "--out", tmp_path)
    assert "2 FMUs" in fails("export", name, "L1ActuatedSiso", "--values", values, "--out", tmp_path)


def test_the_same_seed_gives_the_same_search_on_any_number_of_threads(tmp_path: Path) -> None:
    def found(*options: str | int) -> dict:
        output = tune(tmp_path, LOOP, *SMALL, "--generations", 3, "--force", *options)
        assert output["runs"] == 3 * 6
        return output["parameters"]

    assert found("--threads", 1) == found("--threads", 3) != found("--seed", 2)


def test_a_search_that_goes_on_ends_as_one_that_was_never_stopped(tmp_path: Path) -> None:
    straight = tune(tmp_path / "straight", LOOP, *SMALL, "--generations", 5)
    tune(tmp_path / "twice", LOOP, *SMALL, "--generations", 2)
    resumed = tune(tmp_path / "twice", LOOP, *SMALL, "--generations", 5)
    assert (resumed["runs"], straight["runs"]) == (3 * 6, 5 * 6)
    left = [tmp_path / one / f"{LOOP}-tuned" for one in ("straight", "twice")]
    assert len({(folder / "search.json").read_text() for folder in left}) == 1
    assert resumed["parameters"] == straight["parameters"]
    # What is done already is not done again, with or without the option of earlier versions.
    for again in ([], ["--resume"]):
        done = tune(tmp_path / "twice", LOOP, *SMALL, "--generations", 5, *again)
        assert (done["runs"], done["parameters"]) == (0, straight["parameters"])
    assert len({(folder / "search.json").read_text() for folder in left}) == 1


def test_another_search_in_the_same_folder_is_refused_unless_it_is_forced_or_has_a_name(tmp_path: Path) -> None:
    words = [LOOP, *SMALL, "--generations", 2]
    tune(tmp_path, *words)
    folder = tmp_path / f"{LOOP}-tuned"
    left = {file.name: file.read_bytes() for file in folder.iterdir()}
    for options, differing in [
        (["--seed", 7], "seed was 1, is 7"),
        (["--set", "plant.x0[1]=0.1"], 'values.plant.x0[1] was not there, is "0.1"'),
        (["--sample", 0.02], "objective.squares.sample was 0.01, is 0.02"),
    ]:
        refusal = fails("tune", *words, *options, "--out", tmp_path)
        assert "search.json: belongs to another search: " in refusal and differing in refusal, refusal
        assert "--force replaces it" in refusal and "--tag NAME stores the new results next to it" in refusal
        assert {file.name: file.read_bytes() for file in folder.iterdir()} == left
    named = tune(tmp_path, *words, "--seed", 7, "--tag", "seed=7")
    assert Path(named["results"]) == tmp_path / f"{LOOP}-tuned@seed=7"
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == left
    forced = tune(tmp_path, *words, "--seed", 7, "--force")
    assert forced["runs"] == named["runs"] == 2 * 6 and forced["parameters"] == named["parameters"]
    assert (folder / "search.json").read_bytes() == (Path(named["results"]) / "search.json").read_bytes()
    assert adaptive_fmu("tune", *words, "--force", "--resume", "--out", tmp_path).returncode == 2


def test_a_loop_that_was_edited_is_another_search(tmp_path: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(ROOT / "examples" / LOOP, own)
    tune(tmp_path, own, *SMALL, "--generations", 1)
    structure = own / "SystemStructure.ssd"
    structure.write_text(structure.read_text() + "<!-- edited -->\n")
    refusal = fails("tune", own, *SMALL, "--generations", 2, "--out", tmp_path)
    assert "run.source.checksum was" in refusal and "--force" in refusal


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_search_keeps_the_best_so_far(how: int, tmp_path: Path) -> None:
    command = ["tune", LOOP, *FAST, "--until", "1", "--particles", "8", "--generations", "100000"]
    words = [str(PROGRAM), *command, "--json", "--out", str(tmp_path)]
    folder = tmp_path / f"{LOOP}-tuned"
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        end = time.monotonic() + 120
        while not (folder / "search.json").exists() and time.monotonic() < end:
            time.sleep(0.05)
        process.send_signal(how)
        out, _ = process.communicate(timeout=60)
    output = json.loads(out)
    assert (process.returncode, output["ended"]) == (130, "interrupted")
    assert output["generations"] >= 1 and output["objective"]["best"] <= output["objective"]["start"]
    assert values_of(folder / "tuned.ssv") == output["parameters"] and len(output["parameters"]) == 9


def test_a_run_that_fails_counts_as_worst_and_ends_nothing(tmp_path: Path) -> None:
    # Where VS_l is not below S_l the controller refuses.
    options = ["--parameter", "controller.VS_l=0.3..0.5", "--parameter", "controller.S_l=0.3..0.6", "--generations", 4]
    output = tune(tmp_path, LOOP, *SMALL, *options)
    assert output["ended"] == "complete" and 0 < output["failed"] < output["runs"] == 24
    assert output["parameters"]["controller.VS_l"] < output["parameters"]["controller.S_l"]


def test_where_every_run_fails_the_reason_is_reported(tmp_path: Path) -> None:
    options = ["--parameter", "controller.VS_l=0.45..0.5", "--set", "controller.S_l=0.3", "--generations", 1]
    refusal = fails("tune", LOOP, *SMALL, *options, "--out", tmp_path)
    assert "none of 6 runs completed" in refusal and "must be below controller.S_l = 0.3" in refusal


def test_any_parameter_of_any_loop_is_tuned_for_any_of_its_metrics(fmu_folder: Path, tmp_path: Path) -> None:
    parameter = "controller.feedback_gain[1,1]"
    options = ["--parameter", f"{parameter}=5..40", "--metric", "max |u|", "--until", 0.5, "--fmus", fmu_folder]
    output = tune(tmp_path, "3.2.1-cosine", *options, "--particles", 5, "--generations", 4)
    assert 5 <= output["parameters"][parameter] <= 40 and output["objective"]["best"] <= output["objective"]["start"]
    answer = adaptive_fmu(
        "run", "3.2.1-cosine", "--until", 0.5, "--json", "--fmus", fmu_folder, "--out", tmp_path,
        "--set", f"{parameter}={output['parameters'][parameter]!r}",
    )  # fmt: skip
    measured = {metric["label"]: metric["value"] for metric in json.loads(answer.stdout)["metrics"]}
    assert measured["max |u|"] == output["objective"]["best"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["4-case1", "--composite"], "0 parameters to tune"),
        ([LOOP, "--parameter", "controller.nothing"], "there is no parameter `controller.nothing`"),
        ([LOOP, "--parameter", "controller.k_f=0..1"], "only Real parameters can be tuned"),
        ([LOOP, "--parameter", "controller.fuzzy_output=0..1"], "only Real parameters can be tuned"),
        ([LOOP, "--parameter", "controller.k_e"], "has no upper bound"),
        # What is no limit bounds no search.
        ([LOOP, "--parameter", "controller.u_max[1]"], "has no lower bound"),
        ([LOOP, "--parameter", "controller.VL_c=11..9"], "the lower bound must be below the upper one"),
        ([LOOP, "--parameter", "controller.VL_c=1..9"], "must lie within 8..12"),
        ([LOOP, "--parameter", "controller.VL_c", "--parameter", "controller.VL_c"], "is given twice"),
        ([LOOP, "--square", "1 controller.w[1]"], "there is no signal `controller.w[1]`"),
        ([LOOP, "--metric", "max |w|"], "the loop has no metric `max |w|`; did you mean `max |u|`? There are: "),
        ([LOOP, "--sample", "0.0125", "--step", "0.01"], "sample = 0.0125 s: must be a multiple"),
        (["4-case1", "--parameter", "controller.adaptation_gain=1..9"], "nothing to minimise"),
    ],
)
def test_a_search_that_makes_no_sense_is_refused(options, reason: str, fmu_folder: Path, tmp_path: Path) -> None:
    fmus = [] if "--composite" in options else ["--fmus", fmu_folder]
    assert reason in fails("tune", *options, *fmus, "--out", tmp_path)


def test_a_swarm_without_particles_is_refused(tmp_path: Path) -> None:
    for option in (["--particles", 0], ["--generations", 0], ["--parameter", "a.b=1"], ["--square", "1 a b"]):
        assert adaptive_fmu("tune", LOOP, *option, "--out", tmp_path).returncode == 2
