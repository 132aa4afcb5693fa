"""What lies in an exported FMU, and what its description says."""

import re
import struct
import zipfile
from pathlib import Path

import fmpy
import pytest
from conftest import FMU_NAMES, ROOT, adaptive_fmu
from fmpy.validation import validate_fmu
from lxml import etree
from master import Fmu

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"


def entry(fmu: Fmu, name: str) -> bytes:
    with zipfile.ZipFile(fmu.path) as archive:
        return archive.read(name)


def names_of(fmu: Fmu) -> list[str]:
    with zipfile.ZipFile(fmu.path) as archive:
        return archive.namelist()


def xml_of(fmu: Fmu) -> etree._Element:
    return etree.fromstring(entry(fmu, "modelDescription.xml"))


def test_every_description_becomes_an_fmu(fmu_folder: Path) -> None:
    assert sorted(file.stem for file in fmu_folder.glob("*.fmu")) == FMU_NAMES
    assert [file.name for file in fmu_folder.iterdir() if file.suffix != ".fmu"] == []


def test_fmpy_finds_nothing_to_complain_about(each_fmu: Fmu) -> None:
    assert validate_fmu(str(each_fmu.path)) == []


def test_the_description_keeps_to_the_standards_schema(each_fmu: Fmu) -> None:
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    assert schema.validate(xml_of(each_fmu)), schema.error_log


def test_the_description_is_the_one_that_was_reviewed(each_fmu: Fmu) -> None:
    reviewed = (ROOT / "modelDescription" / f"{each_fmu.name}.xml").read_bytes()
    assert entry(each_fmu, "modelDescription.xml") == reviewed


def test_the_archive_holds_binary_source_documentation_and_licences(each_fmu: Fmu) -> None:
    names = names_of(each_fmu)
    wanted = [
        "modelDescription.xml",
        f"binaries/linux64/{each_fmu.name}.so",
        "resources/description.toml",
        "documentation/index.html",
        "documentation/licenses/license.txt",
        "model.png",
    ]
    assert [name for name in wanted if name not in names] == []
    assert len(set(names)) == len(names)
    assert [name for name in names if name.startswith("/") or ".." in name or "\\" in name] == []
    source = (ROOT / "modelDescription" / f"{each_fmu.name}.toml").read_bytes()
    assert entry(each_fmu, "resources/description.toml") == source


def test_the_picture_is_a_png(each_fmu: Fmu) -> None:
    picture = entry(each_fmu, "model.png")
    assert picture[:8] == b"\x89PNG\r\n\x1a\n" and picture[12:16] == b"IHDR"
    width, height = struct.unpack(">II", picture[16:24])
    assert 32 <= width <= 2000 and 32 <= height <= 2000
    assert picture.endswith(b"IEND\xaeB`\x82")


def test_the_documentation_shows_equations_and_needs_no_network(each_fmu: Fmu) -> None:
    page = entry(each_fmu, "documentation/index.html").decode()
    assert "<math" in page and "</math>" in page
    assert "<script" not in page.lower()
    # The names of XML namespaces and the words of a licence are no links; whatever a browser would load is.
    loaded = re.findall(r"""(?:src|href|action|data)\s*=\s*["']?([^"'\s>]*)|url\(([^)]*)\)|@import\s+(\S*)""", page)
    assert [link for found in loaded for link in found if link and not link.startswith(("#", "data:"))] == []
    assert [
        name for name in each_fmu.variables if not name.startswith("der(") and f"<code>{name}</code>" not in page
    ] == []


def test_every_variable_has_a_description_and_every_real_its_unit(each_fmu: Fmu) -> None:
    variables = each_fmu.variables.values()
    assert [v.name for v in variables if not v.description or not v.description.strip()] == []
    assert [v.name for v in variables if v.type == "Real" and not v.unit] == []


def test_value_references_are_unique_over_all_types(each_fmu: Fmu) -> None:
    references = [v.valueReference for v in each_fmu.variables.values()]
    assert len(set(references)) == len(references)


def test_every_choice_names_its_items(each_fmu: Fmu) -> None:
    choices = [v for v in each_fmu.variables.values() if v.type == "Enumeration"]
    assert "on_step_failure" in [v.name for v in choices]
    for variable in choices:
        items = variable.declaredType.items
        assert [int(item.value) for item in items] == list(range(1, len(items) + 1)), variable.name
        assert all(item.name and item.description for item in items), variable.name
        assert len({item.name for item in items}) == len(items) >= 2, variable.name
        assert 1 <= int(variable.start) <= len(items), variable.name


def test_start_values_lie_within_their_limits(each_fmu: Fmu) -> None:
    for variable in (v for v in each_fmu.variables.values() if v.start is not None and v.type == "Real"):
        low, high = float(variable.min or "-inf"), float(variable.max or "inf")
        assert low <= float(variable.start) <= high, variable.name


def test_the_experiment_is_given_with_a_step(each_fmu: Fmu) -> None:
    experiment = each_fmu.description.defaultExperiment
    assert float(experiment.startTime) == 0.0
    assert 0.0 < float(experiment.stepSize) < float(experiment.stopTime)
    own = each_fmu.variables.get("relative_tolerance")
    assert float(experiment.tolerance) == (float(own.start) if own else 1e-6)


def test_initial_unknowns_are_outputs_states_and_derivatives_and_nothing_else(each_fmu: Fmu) -> None:
    description = each_fmu.description
    rates = [unknown.variable for unknown in description.derivatives]
    calculated = lambda variables: {v.name for v in variables if v.initial == "calculated"}  # noqa: E731
    wanted = calculated(v for v in description.modelVariables if v.causality == "output")
    wanted |= calculated(rates) | calculated(rate.derivative for rate in rates)
    assert {unknown.variable.name for unknown in description.initialUnknowns} == wanted


def test_every_output_is_listed_in_the_model_structure_with_its_dependencies(each_fmu: Fmu) -> None:
    outputs = {unknown.variable.name: unknown for unknown in each_fmu.description.outputs}
    assert set(outputs) == set(each_fmu.named(causality="output"))
    # An absent list would mean: depends on everything.
    assert all(unknown.get("dependencies") is not None for unknown in xml_of(each_fmu).findall(".//Outputs/Unknown"))


def test_nothing_with_equal_content_differs_between_two_exports(tmp_path: Path) -> None:
    surroundings = [{"TZ": "Asia/Tokyo", "LC_ALL": "C"}, {"TZ": "America/Lima", "LC_ALL": "de_DE.UTF-8"}]
    for place, surrounding in zip(["a", "b"], surroundings, strict=True):
        assert adaptive_fmu("export", "--all", "--out", tmp_path / place, **surrounding).returncode == 0
    for name in FMU_NAMES:
        first, second = (tmp_path / place / f"{name}.fmu" for place in ["a", "b"])
        assert first.read_bytes() == second.read_bytes(), name
        # The clock went on by less than an archive can tell; so no time at all may stand in it.
        with zipfile.ZipFile(first) as archive:
            assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


@pytest.mark.parametrize(
    ("name", "output", "known"),
    [
        ("ReferenceNonlinearSiso", "r[1]", []),
        ("ReferenceNonlinearSiso", "dr[1]", []),
        ("Reference", "ddr[1]", []),
        ("NonlinearSiso", "x[2]", ["x[2]"]),
        ("NonlinearSiso", "y[1]", ["x[1]"]),
        ("L1NonlinearSiso", "u[1]", ["u_manual[1]", "u_ad[1]"]),
        ("L1NonlinearSiso", "step_too_long", []),
    ],
)
def test_an_output_depends_on_what_the_equations_read(fmu, name: str, output: str, known: list[str]) -> None:
    (unknown,) = [u for u in fmu(name).description.outputs if u.variable.name == output]
    assert [v.name for v in unknown.dependencies] == known


@pytest.mark.parametrize(
    ("name", "rate", "known"),
    [
        ("NonlinearSiso", "der(x[1])", {"x[2]"}),
        ("NonlinearSiso", "der(x[2])", {"x[1]", "x[2]", "u[1]"}),
        (
            "L1NonlinearSiso",
            "der(u_ad[1])",
            {"r[1]", "x[1]", "x[2]", "u_manual[1]", "u_ad[1]"}
            | {"omega_hat[1,1]", "theta_hat[1,1]", "theta_hat[1,2]", "sigma_hat[1]"},
        ),
        ("L1NonlinearSiso", "der(sigma_hat[1])", {"x[1]", "x[2]", "x_hat[1]", "x_hat[2]", "sigma_hat[1]"}),
    ],
)
def test_a_rate_depends_on_what_the_equations_read(fmu, name: str, rate: str, known: set[str]) -> None:
    (unknown,) = [u for u in fmu(name).description.derivatives if u.variable.name == rate]
    assert {v.name for v in unknown.dependencies} == known
