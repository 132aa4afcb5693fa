"""What a release consists of beside programs: packages for a registry, the lists of what is linked, the entry for the list
of tools of the FMI project."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import jsonschema
import numpy as np
import pytest
from conftest import FMU_NAMES, LOOP_NAMES, PROGRAM, ROOT
from fmpy.util import read_csv

INCLUDED = re.compile(r'\b(?:include_str!|include_bytes!|include!)\(\s*"(.+?)"|#\[path = "(.+?)"\]')


def cargo(*arguments: str) -> str:
    command = ["cargo", *arguments, "--offline"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


WORKSPACE = json.loads(cargo("metadata", "--no-deps", "--format-version", "1"))["packages"]
PUBLISHED = {package["name"]: package for package in WORKSPACE if package["publish"] != []}


def packaged(name: str) -> set[str]:
    return set(cargo("package", "--list", "--allow-dirty", "--package", name).splitlines())


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_package_holds_every_file_that_its_code_includes_and_the_licences(name: str) -> None:
    folder, files = Path(PUBLISHED[name]["manifest_path"]).parent, packaged(name)
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= files
    for file in [file for file in files if file.endswith(".rs")]:
        for found in INCLUDED.findall((folder / file).read_text()):
            included = os.path.normpath(Path(file).parent / next(filter(None, found)))
            assert included in files, f"{file} includes {included}, which isn't in the package {name}"


def test_the_models_hold_what_their_build_script_embeds() -> None:
    places = ("modelDescription/*.toml", "modelDescription/icons/*", "modelDescription/references/*", "examples/*/response.txt")
    embedded = [file for place in places for file in ROOT.glob(place)]
    for structure in ROOT.glob("examples/*/SystemStructure.ssd"):
        embedded += [file for file in structure.parent.iterdir() if file.suffix in (".ssd", ".ssv")]
    assert {file.relative_to(ROOT).as_posix() for file in embedded} <= packaged("adaptive-fmu-models")


@pytest.mark.parametrize("name", PUBLISHED)
def test_packages_have_one_version_and_ask_for_each_other_by_it(name: str) -> None:
    package = PUBLISHED[name]
    assert package["version"] == PUBLISHED["adaptive-fmu"]["version"]
    own = [needed for needed in package["dependencies"] if needed["name"] in PUBLISHED and needed["kind"] != "dev"]
    assert [needed["req"] for needed in own] == [f"^{package['version']}"] * len(own)


def test_lock_files_and_the_citation_have_the_version_of_the_packages() -> None:
    version = PUBLISHED["adaptive-fmu"]["version"]
    files = subprocess.run(["git", "ls-files", "*Cargo.lock"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    found = {file: re.findall(r'name = "(.*)"\nversion = "(.*)"', (ROOT / file).read_text()) for file in files}
    others = {(file, name): of for file, packages in found.items() for name, of in packages if name in PUBLISHED and of != version}
    assert len(found) > 1 and others == {}
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()


def test_the_changelog_has_the_version_of_the_packages_and_dates() -> None:
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "[Unreleased]"
    versions = [re.fullmatch(r"\[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)", heading) for heading in headings[1:]]
    assert all(versions) and versions[0][1] == PUBLISHED["adaptive-fmu"]["version"]
    dates = [version[2] for version in versions]
    assert dates == sorted(dates, reverse=True)


def linked() -> set[str]:
    """The packages that the program is linked of on this platform, without those of this workspace."""
    output = cargo("tree", "--locked", "--package", "adaptive-fmu", "--edges", "normal", "--prefix", "none", "--format", "{p}")
    packages = {" ".join(line.split()[:2]).replace(" v", " ") for line in output.splitlines()}
    return {package for package in packages if package.split()[0] not in PUBLISHED}


def test_the_list_of_licences_is_of_the_locked_packages() -> None:
    """It is written by packaging/licences, which takes cargo-about; whether it is of this Cargo.lock can be told without."""
    head, *texts = (ROOT / "packaging" / "LICENCES.txt").read_text().split("=" * 96)
    listed = set(re.findall(r"^(\S+ \S+): \S", head, re.MULTILINE))
    assert linked() <= listed, "packaging/licences writes it anew"
    lock = dict.fromkeys(re.findall(r'name = "(.*)"\nversion = "(.*)"', (ROOT / "Cargo.lock").read_text()))
    assert listed <= {" ".join(package) for package in lock}, "packaging/licences writes it anew"
    with_text = {package for text in texts for package in re.findall(r"^    (\S+ \d\S+)$", text, re.MULTILINE)}
    assert listed <= with_text


@pytest.fixture(scope="module")
def bill(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the program is linked of, as CycloneDX."""
    if shutil.which("cargo-cyclonedx") is None:
        pytest.skip("cargo-cyclonedx isn't installed")
    out = tmp_path_factory.mktemp("sbom")
    output = subprocess.run([ROOT / "packaging" / "sbom", "--out", out], capture_output=True, text=True, check=True).stdout
    return Path(output.strip()).read_text()


def test_the_bill_of_materials_names_all_that_is_linked_and_no_folder_of_the_machine(bill: str) -> None:
    output = json.loads(bill)
    assert (output["bomFormat"], output["specVersion"]) == ("CycloneDX", "1.5")
    assert output["metadata"]["component"]["name"] == "adaptive-fmu"
    assert linked() <= {f"{component['name']} {component['version']}" for component in output["components"]}
    assert str(ROOT) not in bill and str(Path.home()) not in bill


def test_the_bill_of_materials_is_as_the_schema_of_cyclonedx_has_it(bill: str) -> None:
    validation = pytest.importorskip("cyclonedx.validation.json", reason="cyclonedx-python-lib isn't installed")
    version = pytest.importorskip("cyclonedx.schema").SchemaVersion.V1_5
    assert validation.JsonStrictValidator(version).validate_str(bill) is None


TOOLS = ROOT / "packaging" / "fmi-tools"


def test_the_entry_for_the_list_of_tools_is_as_its_rules_have_it() -> None:
    entry, schema = (json.loads((TOOLS / name).read_text()) for name in ("adaptive-fmu.json", "schema.json"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(entry, schema)
    assert "." not in entry["description"], "one sentence, without a dot"


def test_the_page_of_compatibility_names_the_versions_that_tests_use() -> None:
    page, requirements = (TOOLS / "README.md").read_text(), (ROOT / "tests" / "fmpy" / "requirements.txt").read_text()
    for tool, package in [("FMPy", "fmpy"), ("ecospy", "ecospy"), ("libcosimpy", "libcosimpy"), ("PythonFMU", "pythonfmu")]:
        version = re.search(rf"^{package}==(\S+)", requirements, re.MULTILINE)[1]
        assert re.search(rf"{tool}[ |]+{re.escape(version)}\b", page), package
    toolbox = re.search(r"^fmu-manipulation-toolbox==(\S+)", requirements, re.MULTILINE)[1]
    assert f"FMU Manipulation Toolbox {toolbox}" in page
    crate = re.search(r'name = "fmi"\nversion = "(.*)"', (ROOT / "tests" / "rust_importer" / "Cargo.lock").read_text())[1]
    assert f"| `fmi`, the Rust crate | {crate} |" in page


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    out = tmp_path_factory.mktemp("examples")
    command = [TOOLS / "examples", "--program", PROGRAM, "--out", out]
    subprocess.run(command, capture_output=True, text=True, check=True)
    return {folder.name: folder for folder in out.iterdir()}


def test_examples_are_as_the_rules_of_the_list_have_them_and_fmpy_computes_the_same(examples: dict[str, Path]) -> None:
    for name, folder in examples.items():
        fmu, reference, inputs = (folder / f"{name}{end}" for end in (".fmu", "_ref.csv", "_in.csv"))
        options = dict(line.split(", ") for line in (folder / f"{name}_ref.opt").read_text().splitlines())
        variables = {variable.name for variable in fmpy.read_model_description(str(fmu)).modelVariables}
        for file in (reference, inputs) if inputs.exists() else (reference,):
            head, *lines = file.read_text().splitlines()
            names = [part.strip('"') for part in head.split(",")]
            assert head == ",".join(f'"{part}"' for part in names) and names[0] == "time" and len(names) <= 11
            assert set(names[1:]) <= variables
            rows = [[float(number) for number in line.split(",")] for line in lines]
            times = [row[0] for row in rows]
            assert times == sorted(set(times)) and file.stat().st_size < 1e6
            assert (times[0], times[-1]) == pytest.approx((float(options["StartTime"]), float(options["StopTime"])))
        expected = read_csv(str(reference))
        result = fmpy.simulate_fmu(
            str(fmu),
            stop_time=float(options["StopTime"]),
            step_size=float(options["StepSize"]),
            output_interval=float(options["StepSize"]),
            input=read_csv(str(inputs)) if inputs.exists() else None,
            output=list(expected.dtype.names[1:]),
            fmi_type="CoSimulation",
        )
        for variable in expected.dtype.names[1:]:
            computed = np.interp(expected["time"], result["time"], result[variable].astype(float))
            assert np.abs(computed - expected[variable]).max() <= 1e-6 * max(1, np.abs(computed).max()), (name, variable)


@pytest.mark.slow
def test_one_command_makes_everything_that_a_release_page_holds(tmp_path: Path) -> None:
    """For the quickest platform; the others go the same way."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    if shutil.which("cc") is None or subprocess.run([sys.executable, "-m", "ziglang", "version"], check=False).returncode:
        pytest.skip("ziglang isn't installed")
    command = [ROOT / "packaging" / "release", "--here", "--platforms", "linux64", "--out", tmp_path / "page"]
    made = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    files = {file.name: file for file in (tmp_path / "page").iterdir()}
    version = json.loads(cargo("metadata", "--no-deps", "--format-version", "1"))["packages"][0]["version"]
    base = f"adaptive-fmu-{version}"
    assert {f"{base}-linux64.zip", f"{base}-fmus.zip", f"{base}-loops.zip", f"{base}-report.zip", "SHA256SUMS"} <= set(files)
    assert any(name.endswith(".whl") for name in files)
    with zipfile.ZipFile(files[f"{base}-fmus.zip"]) as archive:
        assert set(archive.namelist()) == {f"{name}.fmu" for name in FMU_NAMES}
        with zipfile.ZipFile(archive.open("L1TwinRotor.fmu")) as fmu:
            entries = set(fmu.namelist())
    assert "binaries/linux64/L1TwinRotor.so" in entries and any(name.startswith("sources/") for name in entries)
    with zipfile.ZipFile(files[f"{base}-loops.zip"]) as archive:
        assert set(archive.namelist()) == {f"{name}.ssp" for name in LOOP_NAMES}
    with zipfile.ZipFile(files[f"{base}-report.zip"]) as archive:
        assert "index.html" in archive.namelist()
    sums = dict(reversed(line.split("  ")) for line in files["SHA256SUMS"].read_text().splitlines())
    for name in set(files) - {"SHA256SUMS"}:
        assert sums[name] == hashlib.sha256(files[name].read_bytes()).hexdigest()
    again = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert again.returncode == 1 and "holds a release already" in again.stderr
