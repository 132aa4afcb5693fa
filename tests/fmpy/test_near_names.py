"""What the program says of a name or a value that is wrong: what was meant, where it stands, and before anything runs."""

import re
from pathlib import Path

import pytest
from conftest import ROOT
from test_command_line import fails

LOOP, PLANT, CONTROLLER = "3.2.1-cosine", "NonlinearSiso", "L1NonlinearSiso"
DESCRIPTION = (ROOT / "modelDescription" / f"{CONTROLLER}.toml").read_text()
# A command, what it says that the user may have meant, and whether the names that there are are many.
MEANT = [
    (["run", "3.2.1-cosin"], "3.2.1-cosine", True),
    (["compare", LOOP, "3.2.1-sqare"], "3.2.1-square", True),
    (["export", "NonlinearSisso"], "NonlinearSiso", True),
    (["linearise", "NonlinearSisso"], "NonlinearSiso", True),
    (["linearise", PLANT, "--set", "omgea=1"], "omega", True),
    (["simulate", PLANT, "--record", "omgea"], "omega", True),
    (["linearise", PLANT, "--set", "X0[1]=1"], "x0[1]", True),
    (["run", LOOP, "--set", "plant.omgea=1"], "omega", True),
    (["run", LOOP, "--set", "controller.feedback_gain=1"], "feedback_gain[1,1]", True),
    (["run", LOOP, "--set", "plnt.omega=1"], "plant", False),
    (["tune", LOOP, "--parameter", "controller.adaptation_gian"], "controller.adaptation_gain", True),
    (["tune", LOOP, "--parameter", "plant.omega=1..2", "--square", "-1 controler.u[1]"], "controller.u[1]", True),
    (["export", "--composite", LOOP, "--without", "plnt"], "plant", False),
    (["export", PLANT, "--compile", "--platforms", "linux65"], "linux64", False),
]


@pytest.mark.parametrize(
    ("arguments", "name", "many"), MEANT, ids=lambda value: " ".join(value) if isinstance(value, list) else ""
)
def test_the_message_on_a_wrong_name_suggests_the_right_one(arguments: list[str], name: str, many: bool, tmp_path: Path) -> None:
    error = fails(*arguments, folder=tmp_path)
    assert f"did you mean `{name}`?" in error
    listed = error.split("There are: ")[1]
    assert len(listed.split(", ")) <= 9, "a list that nobody reads"
    assert (re.search(r", and \d+ more", listed) is not None) == many
    # Nothing was run, and nothing is left but the FMUs of a loop.
    assert [file for file in tmp_path.iterdir() if file.name != "fmus"] == []


@pytest.mark.parametrize(
    ("arguments", "range"),
    [
        (["run", LOOP, "--set", "plant.x0[3]=1"], "within 1 … 2 in `x0`"),
        (["linearise", PLANT, "--set", "x0[0]=1"], "within 1 … 2 in `x0`"),
        (["linearise", CONTROLLER, "--set", "A_m[1,3]=1"], "within 1 … 2 and 1 … 2 in `A_m`"),
        (["simulate", PLANT, "--record", "x[7]"], "within 1 … 2 in `x`"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_the_message_on_a_wrong_index_has_the_range(arguments: list[str], range: str, tmp_path: Path) -> None:
    assert range in fails(*arguments, folder=tmp_path)


# A change of a description, the line that it is in, and what is told of it.
WRONG = [
    ("adaptation_gain = 1e5", "adaptation_gian = 1e5", ["[start] adaptation_gian", "did you mean `adaptation_gain`?"]),
    ("adaptation_gain = 1e5", "adaptation_gain = -1e5", ["adaptation_gain = -100000", "must be above 0"]),
    ("adaptation_gain = 1e5", 'adaptation_gain = "fast"', ["[start] adaptation_gain", "must be a finite number"]),
    ("feedback_gain = [[20.0]]", '"feedback_gain[2,1]" = 1.0', ["its indices must be within 1 … 1 and 1 … 1"]),
    ("theta_bound = [10.0]", "theta_bound = [10.0, 1.0]", ["[start] theta_bound", "list of 1 numbers"]),
    ('regressor = "state"', 'regresor = "state"', ["there is no key `regresor`", "did you mean `regressor`?"]),
    ('regressor = "state"', 'regressor = "stat"', ["`stat`", "did you mean `state`?"]),
    ('x = ["1", "1/s"]', 'xx = ["1", "1/s"]', ["[structure]", "there is no key `xx`"]),
    ("[start]", "[strat]", ["there is no key `strat`", "did you mean `start`?"]),
    ("step = 0.001", "stpe = 0.001", ["there is no key `stpe`", "did you mean `step`?"]),
    ("step = 0.001", "step = -1", ["experiment.step = -1", "above 0"]),
    ('model = "l1"', 'model = "l1x"', ["there is no such kind", "did you mean `l1`?"]),
    ("[start]", '[names]\nadaptation_gian = "x"\n[start]', ["[names] adaptation_gian", "did you mean `adaptation_gain`?"]),
]


@pytest.mark.parametrize(("before", "after", "words"), WRONG, ids=[after for _, after, _ in WRONG])
def test_an_error_in_a_description_is_reported_with_its_line(before: str, after: str, words: list[str], tmp_path: Path) -> None:
    text = DESCRIPTION.replace(before, after, 1)
    assert text != DESCRIPTION
    (tmp_path / "mine.toml").write_text(text)
    key = re.split(r" = |\n\[start", after)[0].split("\n")[-1]
    line = next(k for k, found in enumerate(text.splitlines(), 1) if key in found and found[:1] != "#")
    if '"l1x"' in after:
        line = next(k for k, found in enumerate(text.splitlines(), 1) if found.startswith("model"))
    error = fails("check", tmp_path / "mine.toml")
    assert f"mine.toml: line {line}" in error, error
    assert [word for word in words if word not in error] == [], error


SET = """<?xml version="1.0"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="v">
<ssv:Parameters>
<ssv:Parameter name="{}"><ssv:Real value="{}"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>
"""


def test_what_is_wrong_in_a_parameter_set_is_reported_with_its_line(tmp_path: Path) -> None:
    (file := tmp_path / "mine.ssv").write_text(SET.format("plant.omgea", 1))
    assert re.search(r"mine.ssv: line 4: .*did you mean `omega`\?", fails("run", LOOP, "--case", file, folder=tmp_path))
    file.write_text(SET.format("controller.relative_tolerance", 3))
    allowed = r"mine.ssv: line 4: .*must be within 1e-12 … 0.01"
    for command in [["run", LOOP], ["compare", LOOP, "3.2.1-square"], ["tune", LOOP]]:
        assert re.search(allowed, fails(*command, "--case", file, folder=tmp_path))
    assert re.search(
        r"--set .*must be within 1e-12 … 0.01", fails("run", LOOP, "--set", "plant.relative_tolerance=1", folder=tmp_path)
    )
    file.write_text(SET.format("relative_tolerance", -1))
    assert re.search(allowed, fails("export", PLANT, "--values", file, folder=tmp_path))
    # What the unit itself refuses: an upper bound below the lower one.
    file.write_text(SET.format("omega_max[1,1]", 0.1))
    assert re.search(r"mine.ssv: line 4: .*omega_max", fails("export", CONTROLLER, "--values", file, folder=tmp_path))
    error = fails("run", LOOP, "--case", "refrence.ssv", folder=tmp_path)
    assert "did you mean `reference.ssv`?" in error


def test_what_is_wrong_in_a_loop_is_reported_with_its_line_and_what_was_meant(tmp_path: Path) -> None:
    text = (ROOT / "examples" / LOOP / "SystemStructure.ssd").read_text()
    (tmp_path / "reference.ssv").write_text((ROOT / "examples" / LOOP / "reference.ssv").read_text())
    file = tmp_path / "SystemStructure.ssd"
    for before, after, meant in [
        ('startElement="plant"', 'startElement="plnat"', "plant"),
        ('startConnector="u[1]"', 'startConnector="U[1]"', "u[1]"),
    ]:
        assert before in text
        file.write_text(text.replace(before, after, 1))
        line = next(k for k, found in enumerate(file.read_text().splitlines(), 1) if after in found)
        error = fails("run", file, folder=tmp_path)
        assert f"SystemStructure.ssd: line {line}: " in error and f"did you mean `{meant}`?" in error


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_path_that_is_no_file_is_reported(command: str, tmp_path: Path) -> None:
    file = tmp_path / "plant.json"
    file.write_text("{}")
    assert f"named `{file}` (the file or folder of this name is not one); " in fails(command, file)
