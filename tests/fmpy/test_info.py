"""What an FMU tells of itself, read from its archive alone."""

import json
import subprocess
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT, adaptive_fmu
from master import CONTROLLER, PLANT
from test_command_line import fails

FOREIGN = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Foreign" guid="{1}" numberOfEventIndicators="0">
  <ModelExchange modelIdentifier="foreign"/>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" description="a&#10;b"><Real/></ScalarVariable>
  </ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""


def info(file: Path) -> dict:
    answer = adaptive_fmu("info", file, "--json")
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    return json.loads(answer.stdout)


def entry(file: Path, name: str) -> str:
    with zipfile.ZipFile(file) as archive:
        return archive.read(name).decode()


def test_info_shows_what_the_fmu_was_built_of(fmu) -> None:
    plant = fmu(PLANT)
    output = info(plant.path)
    compiler = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True).stdout.strip()
    build = output["build"]
    assert build["package"] == f"adaptive-fmu {build['version']}" == output["generationTool"]
    assert (build["target"], build["compiler"]) == ("x86_64-unknown-linux-gnu", compiler)
    assert len(build["source"]) == 16 and int(build["source"], 16) and build["optimised"]
    assert build == json.loads(entry(plant.path, "resources/build.json"))
    assert (output["interfaces"], output["platforms"]) == (["co-simulation", "model exchange"], ["linux64"])
    assert (output["sourceCode"], output["parameterSets"]) == (False, [])
    with zipfile.ZipFile(plant.path) as archive:
        assert output["unpackedSize"] == sum(file.file_size for file in archive.infolist())
    assert output["size"] == plant.path.stat().st_size


def test_info_reads_the_build_that_lies_in_the_archive(fmu, tmp_path: Path) -> None:
    other = tmp_path / "Other.fmu"
    with zipfile.ZipFile(fmu(PLANT).path) as archive, zipfile.ZipFile(other, "w") as changed:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "resources/build.json":
                content = json.dumps(json.loads(content) | {"package": "their_plant 7.1.0", "target": "riscv"}).encode()
            changed.writestr(name, content)
        changed.writestr("binaries/win64/Other.dll", "x")
        changed.writestr("sources/all.c", "x")
        changed.writestr("resources/high.ssv", "x")
    output = info(other)
    assert (output["build"]["package"], output["build"]["target"]) == ("their_plant 7.1.0", "riscv")
    assert (output["platforms"], output["sourceCode"]) == (["linux64", "win64"], True)
    assert output["parameterSets"] == ["resources/high.ssv"]
    shown = adaptive_fmu("info", other).stdout
    for words in ["their_plant 7.1.0", "riscv", "platforms: linux64, win64, and source code", "resources/high.ssv"]:
        assert words in shown


def test_info_of_an_fmu_of_another_tool_shows_what_isnt_in_it(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.fmu"
    with zipfile.ZipFile(foreign, "w") as archive:
        archive.writestr("modelDescription.xml", FOREIGN)
        archive.writestr("resources/build.json", "not what it seems")
    output = info(foreign)
    assert (output["build"], output["source"], output["platforms"]) == (None, None, [])
    assert (output["interfaces"], output["generationTool"]) == (["model exchange"], "")
    shown = adaptive_fmu("info", foreign)
    assert shown.returncode == 0
    for words in ["an unnamed tool", "no information about its build", "not in it", "platforms: none", "model exchange"]:
        assert words in shown.stdout
    # A text of others breaks no line.
    assert "a\\nb" in shown.stdout
    assert "can't run on this platform" in fails("linearise", foreign)


def test_a_description_with_other_values_keeps_the_comments_of_the_one_it_comes_from(tmp_path: Path) -> None:
    text = (ROOT / "modelDescription" / f"{CONTROLLER}.toml").read_text()
    text = text.replace("adaptation_gain = 1e5", "# fast\nadaptation_gain = 1e5 # 1/s^2")
    (tmp_path / "mine.toml").write_text("# my design\n" + text)
    values = tmp_path / "slow.ssv"
    values.write_text(
        '<ParameterSet version="1.0" name="slow"><Parameters><Parameter name="adaptation_gain"><Real value="25000"/>'
        '</Parameter><Parameter name="sigma_bound[1]"><Real value="8"/></Parameter></Parameters></ParameterSet>'
    )
    answer = adaptive_fmu("export", tmp_path / "mine.toml", "--values", values, "--out", tmp_path)
    assert answer.returncode == 0, answer
    stored = entry(tmp_path / f"{CONTROLLER}.fmu", "resources/description.toml")
    assert stored.startswith("# my design\n") and "# fast\nadaptation_gain = 25000.0 # 1/s^2\n" in stored
    assert [line for line in text.splitlines() if line.strip().startswith("#") and line not in stored] == []


def test_a_composite_holds_the_descriptions_of_its_units(tmp_path: Path) -> None:
    assert adaptive_fmu("export", "--composite", "3.2.1-cosine", "--out", tmp_path).returncode == 0
    source = info(tmp_path / "Loop_3_2_1_cosine.fmu")["source"]
    for name in ["ReferenceNonlinearSiso", PLANT, CONTROLLER]:
        written = (ROOT / "modelDescription" / f"{name}.toml").read_text().splitlines()
        commented = "\n".join(f"# {line}".rstrip() for line in written)
        assert source.count(commented) == 1, name
    # What a person changes in it can be exported again.
    (tmp_path / "again.toml").write_text(source)
    again = tmp_path / "again"
    assert adaptive_fmu("export", tmp_path / "again.toml", "--out", again).returncode == 0
    assert (again / "Loop_3_2_1_cosine.fmu").read_bytes() == (tmp_path / "Loop_3_2_1_cosine.fmu").read_bytes()


@pytest.mark.parametrize("name", [PLANT, CONTROLLER])
def test_the_description_in_an_fmu_gives_the_same_fmu_again(fmu, name: str, tmp_path: Path) -> None:
    (tmp_path / "again.toml").write_text(entry(fmu(name).path, "resources/description.toml"))
    assert adaptive_fmu("export", tmp_path / "again.toml", "--out", tmp_path).returncode == 0
    assert (tmp_path / f"{name}.fmu").read_bytes() == fmu(name).path.read_bytes()


def test_info_shows_whose_an_fmu_is(fmu, tmp_path: Path) -> None:
    plant = fmu(PLANT).path
    about = info(plant)["about"]
    assert about["author"] == "The adaptive-fmu authors" and about["license"] == "MIT OR Apache-2.0"
    assert about["version"] == info(plant)["build"]["version"] and about["copyright"].startswith("Copyright (c) ")
    assert "author: The adaptive-fmu authors; version: " in adaptive_fmu("info", plant).stdout
    page = entry(plant, "documentation/index.html")
    assert "By The adaptive-fmu authors, version " in page and "license MIT OR Apache-2.0" in page
    # A user's own says what its description says, and nothing else.
    own = tmp_path / "Mine.toml"
    written = adaptive_fmu("new", "pid", "--name", "Mine", "--out", own)
    assert written.returncode == 0, written.stderr
    own.write_text(own.read_text().replace("[experiment]", 'author = "Jane <Doe>"\n\n[experiment]'))
    exported = adaptive_fmu("export", own, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    assert info(tmp_path / "Mine.fmu")["about"] == {"author": "Jane <Doe>"}
    assert "By Jane &lt;Doe&gt;." in entry(tmp_path / "Mine.fmu", "documentation/index.html")


def test_a_limit_that_is_none_is_shown_as_such(fmu) -> None:
    controller = fmu(CONTROLLER).path
    lines = {line.split()[0]: line for line in adaptive_fmu("info", controller).stdout.splitlines() if line.strip()}
    assert "no limit" in lines["u_max[1]"].removesuffix("(1e15: no limit)") and "000000" not in lines["u_max[1]"]
    page = entry(controller, "documentation/index.html")
    assert "<td>no limit<td>" in page and "1000000000000000" not in page
    # A number for a tool all the same.
    limit = next(v for v in info(controller)["variables"] if v["name"] == "u_max[1]")
    assert float(limit["start"]) == 1e15
