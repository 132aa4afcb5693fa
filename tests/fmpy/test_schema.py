"""The schema by which editors check descriptions: Python's jsonschema finds what it underlines, and so does Taplo, the checker
of TOML in editors, where it is there."""

import json
import shutil
import subprocess
import sysconfig
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT
from jsonschema import Draft7Validator

SCHEMA = json.loads((ROOT / "modelDescription" / "description.schema.json").read_text())
OWN = ROOT / "examples" / "own" / "dc_motor" / "DcMotorController.toml"
PLAIN, NAMED = (ROOT / "modelDescription" / "L1NonlinearSiso.toml").read_text(), OWN.read_text()
TAPLO = shutil.which("taplo", path=sysconfig.get_path("scripts")) or shutil.which("taplo")


def found(text: str) -> str:
    return "\n".join(error.message for error in Draft7Validator(SCHEMA).iter_errors(tomllib.loads(text)))


def started(line: str) -> str:
    """The controller of example 3.2.1 with another line in [start]."""
    key = line.split(" = ")[0]
    other_lines = [own for own in PLAIN.splitlines() if not own.startswith(f"{key} = ")]
    return "\n".join([*other_lines, line]) + "\n"


WRONG = [
    ("adaption_gain = 1e5", "adaption_gain"),  # a typo
    ('adaptation_gain = "large"', "large"),  # a text for a number
    ("adaptation_gain = -1.0", "-1.0"),  # not positive
    ("adaptation_gain = [1e5]", "[100000.0]"),  # a list for a scalar
    ("theta_bound = 10.0", "10.0"),  # a scalar for a list
    ("theta_bound = [-1.0]", "-1.0"),
    ('"theta_bound[1]" = -1.0', "-1.0"),
    ('"theta_bond[1]" = 1.0', "theta_bond[1]"),
    ("A_m = [0.0, 1.0]", "0.0"),  # a list for rows
    ('u_ad_start = "bump"', "bump"),  # no item
    ("enabled = 1", "1"),
    ("relative_tolerance = 1.0", "1.0"),
    ("fixed_steps = 1.5", "1.5"),
    ("K_p = [1.0]", "K_p"),  # a key of another kind
    ("rho_0 = [1.0, \"wide\"]", "wide"),
]
RIGHT = ["adaptation_gain = 5", "r = [1.0]", '"r[1]" = 1.0', "Q = [[1, 0], [0, 1]]", '"Q[1,2]" = 0.5', "enabled = false",
         'u_ad_start = "bumpless"', "rho_0 = [2.0]", "pole_real = [-9, -9]", "work_limit = 1e9", 'integration_method = "stiff"']


@pytest.mark.parametrize(("line", "named"), WRONG)
def test_an_editor_underlines_what_cannot_start(line: str, named: str) -> None:
    assert found(PLAIN) == ""
    assert named in found(started(line)), found(started(line))


@pytest.mark.parametrize("line", RIGHT)
def test_an_editor_leaves_alone_what_can(line: str) -> None:
    assert found(started(line)) == ""


def test_own_names_may_be_in_start() -> None:
    assert found(NAMED) == ""
    assert found(NAMED.replace("[start]\n", "[start]\nspeed_reference = 3.0\n")) == ""
    # What the model knows is checked all the same.
    assert "wide" in found(NAMED.replace("adaptation_gain = ", 'adaptation_gain = "wide" # ', 1))


def test_the_schema_describes_a_key_of_start_with_its_unit() -> None:
    kind = next(kind["then"] for kind in SCHEMA["allOf"] if kind["if"]["properties"]["model"]["const"] == "sensor")
    start = kind["properties"]["start"]["properties"]
    properties = {name: SCHEMA["definitions"][value["$ref"].split("/")[-1]] if "$ref" in value else value for name, value in start.items()}
    assert properties["delay"]["description"].endswith("[s]") and "delay" in properties["delay"]["description"]
    assert all(value["description"] for value in properties.values())


@pytest.mark.parametrize(
    ("key", "fits"),
    [("author", "Jane Doe"), ("version", "1.0"), ("license", "MIT"), ("copyright", "(c) 2026 Jane Doe")],
)
def test_an_editor_knows_whose_a_unit_is(key: str, fits: str) -> None:
    own = "\n".join(line for line in PLAIN.splitlines() if not line.startswith(f"{key} = "))
    assert found(f'{key} = "{fits}"\n{own}') == ""
    assert found(f"{key} = 2\n{own}") != "" and found(f'{key}s = "{fits}"\n{own}') != ""


def test_the_schema_is_small_enough_for_an_editor() -> None:
    assert (ROOT / "modelDescription" / "description.schema.json").stat().st_size < 400_000


@pytest.mark.skipif(TAPLO is None, reason="taplo isn't installed")
@pytest.mark.parametrize(("line", "named"), [(None, None), *WRONG])
def test_taplo_underlines_the_same(line: str | None, named: str | None, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    shutil.copy(ROOT / "modelDescription" / "description.schema.json", tmp_path)
    file.write_text("#:schema ./description.schema.json\n" + (started(line) if line else PLAIN))
    checked = subprocess.run([TAPLO, "lint", file], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (checked.returncode == 0) == (line is None), checked.stderr
    if line:
        assert line in checked.stderr, checked.stderr
