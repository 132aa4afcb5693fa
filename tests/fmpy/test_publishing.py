"""The packages for a registry: they hold what they are built from, and ask for each other by the version that they have."""

import json
import os
import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT

INCLUDED = re.compile(r'\b(?:include_str!|include_bytes!|include!)\(\s*"(.+?)"|#\[path = "(.+?)"\]')


def cargo(*arguments: str) -> str:
    command = ["cargo", *arguments, "--offline"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


WORKSPACE = json.loads(cargo("metadata", "--no-deps", "--format-version", "1"))["packages"]
PUBLISHED = {package["name"]: package for package in WORKSPACE if package["publish"] != []}


def held(name: str) -> set[str]:
    return set(cargo("package", "--list", "--allow-dirty", "--package", name).splitlines())


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_package_holds_every_file_that_its_code_includes_and_the_licences(name: str) -> None:
    folder, files = Path(PUBLISHED[name]["manifest_path"]).parent, held(name)
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= files
    for file in [file for file in files if file.endswith(".rs")]:
        for found in INCLUDED.findall((folder / file).read_text()):
            included = os.path.normpath(Path(file).parent / next(filter(None, found)))
            assert included in files, f"{file} includes {included}, which isn't in the package {name}"


def test_the_program_holds_what_its_build_script_embeds() -> None:
    embedded = [*ROOT.glob("modelDescription/*.toml")]
    for structure in ROOT.glob("examples/*/SystemStructure.ssd"):
        embedded += [file for file in structure.parent.iterdir() if file.suffix in (".ssd", ".ssv")]
    assert {file.relative_to(ROOT).as_posix() for file in embedded} <= held("adaptive-fmu")


@pytest.mark.parametrize("name", PUBLISHED)
def test_packages_have_one_version_and_ask_for_each_other_by_it(name: str) -> None:
    package = PUBLISHED[name]
    assert package["version"] == PUBLISHED["adaptive-fmu"]["version"]
    own = [needed for needed in package["dependencies"] if needed["name"] in PUBLISHED]
    assert [needed["req"] for needed in own] == [f"^{package['version']}"] * len(own)


def test_the_changelog_begins_with_the_version_of_the_packages() -> None:
    versions = re.findall(r"^## \[?(\d+\.\d+\.\d+)\]?(?: - (\d{4}-\d\d-\d\d)| \(unreleased\))$", CHANGELOG, re.MULTILINE)
    assert versions and versions[0][0] == PUBLISHED["adaptive-fmu"]["version"]
    assert all(date for _, date in versions[1:]), "a version that others follow has a date"


CHANGELOG = (ROOT / "CHANGELOG.md").read_text()
