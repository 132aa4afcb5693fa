"""Loops as SSP: parameter sets, packed loops, and what a broken or hostile one is told."""

import json
import shutil
import struct
import warnings
import zipfile
from pathlib import Path

import fmpy
import pytest
from conftest import ROOT, adaptive_fmu, read_csv
from fmpy.ssp.ssd import read_ssd
from lxml import etree
from test_command_line import LOOPS, fails

SCHEMA = Path(fmpy.__file__).parent / "ssp" / "schema"
SQUARE = """<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" name="square" version="1.0">
  <ssv:Parameters>
    <ssv:Parameter name="reference.signal"><ssv:Enumeration value="square"/></ssv:Parameter>
  </ssv:Parameters>
</ssv:ParameterSet>
"""


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """All loops of the package as .ssp files."""
    out = tmp_path_factory.mktemp("packed")
    answer = adaptive_fmu("export", *(word for name in LOOPS for word in ("--ssp", name)), "--out", out, "--json")
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    assert json.loads(answer.stdout) == {"fmus": [], "ssps": [str(out / f"{name}.ssp") for name in LOOPS]}
    assert sorted(file.name for file in out.iterdir()) == [f"{name}.ssp" for name in LOOPS], "only what was asked for"
    return {name: out / f"{name}.ssp" for name in LOOPS}


@pytest.fixture
def loop(tmp_path: Path, fmu_folder: Path) -> Path:
    """A copy of the cosine loop with its FMUs beside it."""
    shutil.copytree(ROOT / "examples" / LOOPS[0], tmp_path / "loop")
    (tmp_path / "loop" / "resources").symlink_to(fmu_folder)
    return tmp_path / "loop"


def change(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def result(loop: str | Path, out: Path, *arguments: str | Path) -> tuple[str, bytes]:
    """The name of a loop that ran for half a second, and all that it recorded."""
    answer = adaptive_fmu("run", loop, "--until", "0.5", "--json", "--out", out, *arguments)
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    name = json.loads(answer.stdout)["loop"]
    return name, (out / name / "result.csv").read_bytes()


@pytest.mark.parametrize("name", LOOPS)
def test_a_packed_loop_a_folder_and_a_file_run_as_the_loop_of_that_name(packed, name, fmu_folder, tmp_path) -> None:
    expected = result(name, tmp_path, "--fmus", fmu_folder)
    assert expected[0] == name
    folder = ROOT / "examples" / name
    assert result(packed[name], tmp_path / "packed") == expected
    assert result(folder, tmp_path / "folder", "--fmus", fmu_folder) == expected
    assert result(folder / "SystemStructure.ssd", tmp_path / "file", "--fmus", fmu_folder) == expected


def test_a_packed_loop_uses_its_own_fmus_unless_others_are_named(packed, tmp_path) -> None:
    (tmp_path / "empty").mkdir()
    assert ".fmu" in fails("run", packed[LOOPS[0]], "--fmus", tmp_path / "empty", "--out", tmp_path)


def test_packing_again_gives_the_same_bytes(packed, tmp_path) -> None:
    assert adaptive_fmu("export", "--ssp", ROOT / "examples" / LOOPS[0], "--out", tmp_path).returncode == 0
    assert (tmp_path / f"{LOOPS[0]}.ssp").read_bytes() == packed[LOOPS[0]].read_bytes()


def validate(root: etree._Element, schema: str) -> None:
    # Each annotation holds what its owner defines: the schema says nothing of it.
    found = etree.XMLSchema(etree.parse(SCHEMA / schema))
    assert found.validate(root), found.error_log


@pytest.mark.parametrize("name", LOOPS)
def test_loops_keep_to_the_schema_of_ssp(packed, name: str) -> None:
    folder = ROOT / "examples" / name
    validate(etree.parse(folder / "SystemStructure.ssd").getroot(), "SystemStructureDescription.xsd")
    with zipfile.ZipFile(packed[name]) as archive:
        validate(etree.fromstring(archive.read("SystemStructure.ssd")), "SystemStructureDescription.xsd")
        for file in folder.glob("*.ssv"):
            validate(etree.fromstring(archive.read(file.name)), "SystemStructureParameterValues.xsd")
            assert archive.read(file.name) == file.read_bytes()
    read = read_ssd(str(packed[name]))
    assert [element.name for element in read.system.elements] == ["reference", "plant", "controller"]
    assert len(read.system.connections) == 4


@pytest.mark.parametrize("name", LOOPS)
def test_other_masters_find_their_annotations_first_and_attributes_where_they_read_them(packed, name: str) -> None:
    with zipfile.ZipFile(packed[name]) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
    # OMSimulator reads no other children of the root, and the first annotation alone.
    assert [child.tag.split("}")[1] for child in root] == ["System", "DefaultExperiment"]
    for place in ["System", "DefaultExperiment"]:
        assert root.find(f"{{*}}{place}/{{*}}Annotations/{{*}}Annotation").get("type") == "org.openmodelica"
    assert root.find(".//{*}FixedStepMaster").get("stepSize") == "0.001"
    assert root.find(".//{*}FixedStepAlgorithm").get("baseStepSize") == "0.001"
    # libcosim takes an attribute of these, a declared namespace too, for an element.
    text = etree.tostring(root).decode()
    assert all(f"<{tag}>" in text for tag in ["osp:Algorithm", "ssd:Annotations", "ssd:Elements", "ssd:Connections"])
    assert root.get("name").replace("_", "").isalnum() and root.get("name")[0].isalpha()


def test_a_value_that_other_masters_leave_out_is_reported_when_a_loop_is_packed(loop, tmp_path) -> None:
    # The FMU starts with the cosine.
    parameter = '<ssv:Parameter name="signal"><ssv:Enumeration value="square"/></ssv:Parameter></ssv:Parameters>'
    change(loop / "reference.ssv", "</ssv:Parameters>", parameter)
    binding = '<ssd:ParameterBinding source="reference.ssv"/>'
    change(loop / "SystemStructure.ssd", binding, binding * 2)
    answer = adaptive_fmu("export", "--ssp", loop, "--out", tmp_path)
    assert answer.returncode == 0 and "warning: `reference.signal`" in answer.stderr
    assert "warning: `reference` has several parameter sets" in answer.stderr
    with zipfile.ZipFile(tmp_path / f"{LOOPS[0]}.ssp") as archive:
        # They refuse a file that names an item.
        assert '<ssv:Parameter name="signal"><ssv:Integer value="2"/>' in archive.read("reference.ssv").decode()
    bindings = '<ssd:ParameterBindings><ssd:ParameterBinding prefix="reference." source="reference.ssv"/></ssd:ParameterBindings>'
    change(loop / "SystemStructure.ssd", "<ssd:Elements>", f"{bindings}<ssd:Elements>")
    assert "warning: the system has parameters" in adaptive_fmu("export", "--ssp", loop, "--out", tmp_path).stderr


def test_a_case_is_another_set_of_start_values(loop, fmu_folder, tmp_path) -> None:
    (tmp_path / "square.ssv").write_text(SQUARE)
    (loop / "beside.ssv").write_text(SQUARE)
    _, square = result(LOOPS[1], tmp_path / "square", "--fmus", fmu_folder)
    assert result(loop, tmp_path / "one", "--case", tmp_path / "square.ssv")[1] == square
    assert result(loop, tmp_path / "two", "--case", "beside.ssv")[1] == square
    assert result(loop, tmp_path / "three")[1] != square


def test_a_single_value_prevails_and_may_name_the_fmu(loop, tmp_path) -> None:
    (tmp_path / "square.ssv").write_text(SQUARE)
    values = ["--case", tmp_path / "square.ssv", "--set", "ReferenceNonlinearSiso.signal=cosine"]
    assert result(loop, tmp_path / "one", *values) == result(loop, tmp_path / "two")
    out = tmp_path / "three"
    result(loop, out, "--set", "plant.x0[1]=0.25", "--set", "plant.a1 = 2")
    assert read_csv(out / LOOPS[0] / "result.csv")["plant.x[1]"][0] == 0.25


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("controller.gain=1", ["controller.gain", "L1NonlinearSiso"]),
        ("observer.gain=1", ["observer.gain", "reference, plant, controller"]),
        ("plant.a1=high", ["plant.a1", "high", "number"]),
        ("plant.a1=inf", ["plant.a1", "finite"]),
        ("reference.signal=triangle", ["reference.signal", "cosine (1), square (2)"]),
        ("plant.y[1]=1", ["plant.y[1]", "output"]),
        ("plant.u[1]=1", ["plant.u[1]", "connected"]),
        ("plant.a1", ["UNIT.variable=value"]),
        ("a1=1", ["UNIT.variable"]),
    ],
)
def test_a_single_value_that_does_not_fit_is_refused(loop, value: str, words: list[str], tmp_path) -> None:
    error = fails("run", loop, "--set", value, "--until", "0.1", "--out", tmp_path / "out")
    assert all(word in error for word in words), error


def test_a_single_value_that_its_unit_refuses_ends_the_run_with_the_units_reason(loop, tmp_path) -> None:
    answer = adaptive_fmu("run", loop, "--set", "controller.omega_min[1,1]=9", "--out", tmp_path / "out")
    assert answer.returncode == 1 and "controller: " in answer.stderr and "omega_min[1,1] = 9" in answer.stderr


def test_a_single_value_beyond_its_units_limits_is_refused_before_the_run(loop, tmp_path) -> None:
    error = fails("run", loop, "--set", "controller.adaptation_gain=-1", "--out", tmp_path / "out")
    assert "--set controller.adaptation_gain=-1" in error and "must be at least 0" in error


def test_an_input_left_open_is_a_warning(loop, tmp_path) -> None:
    structure = loop / "SystemStructure.ssd"
    connection = '<ssd:Connection startElement="controller" startConnector="u[1]" endElement="plant" endConnector="u[1]"/>'
    change(structure, connection, "")
    answer = adaptive_fmu("run", loop, "--until", "0.1", "--json", "--out", tmp_path)
    assert [warning for warning in json.loads(answer.stdout)["warnings"] if "plant.u[1]" in warning and "line " in warning]


def test_states_of_different_units_are_not_connected_unawares(loop, tmp_path) -> None:
    change(loop / "SystemStructure.ssd", 'startConnector="x[1]" endElement', 'startConnector="x[2]" endElement')
    error = fails("run", loop, "--out", tmp_path)
    assert all(word in error for word in ["line ", "plant.x[2]", "1/s", "controller.x[1]", "suppressUnitConversion"]), error


def archive(file: Path, *entries: tuple[str, str | bytes]) -> Path:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as written, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, content in entries:
            written.writestr(name, content)
    return file


def test_a_broken_or_hostile_archive_is_refused_and_writes_nothing_elsewhere(loop, tmp_path) -> None:
    structure = (loop / "SystemStructure.ssd").read_text()
    parameters = (loop / "reference.ssv").read_text()
    ssd, ssv = ("SystemStructure.ssd", structure), ("reference.ssv", parameters)
    huge = archive(tmp_path / "huge.ssp", ssd, ssv)
    # The size that the last entry of the directory claims.
    raw = bytearray(huge.read_bytes())
    struct.pack_into("<I", raw, raw.rindex(b"PK\x01\x02") + 24, 0xFFFFFFF0)
    huge.write_bytes(raw)
    away = structure.replace('source="reference.ssv"', 'source="../secret.ssv"')
    (tmp_path / "secret.ssv").write_text(parameters)
    cases = {
        "up": (archive(tmp_path / "up.ssp", ssd, ssv, ("../escaped.txt", "x")), "outside"),
        "twice": (archive(tmp_path / "twice.ssp", ssd, ssv, ssd), "several entries"),
        "huge": (huge, "bytes"),
        "away": (archive(tmp_path / "away.ssp", ("SystemStructure.ssd", away), ssv), "../secret.ssv"),
        "nothing": (archive(tmp_path / "nothing.ssp", ssv), "SystemStructure.ssd"),
        "no parameters": (archive(tmp_path / "half.ssp", ssd), "reference.ssv"),
        "no text": (archive(tmp_path / "text.ssp", ("SystemStructure.ssd", b"\xff\xfe\x00"), ssv), "UTF-8"),
    }
    (tmp_path / "no.ssp").write_text("no archive")
    cases["no archive"] = (tmp_path / "no.ssp", "archive")
    cases["gone"] = (tmp_path / "gone.ssp", "gone.ssp")
    for name, (file, word) in cases.items():
        error = fails("run", file, "--fmus", loop / "resources", "--out", tmp_path / "out")
        assert word in error and error.count("\n") == 1, (name, error)
    assert not list(tmp_path.rglob("escaped.txt")) and not (tmp_path / "out").exists()
