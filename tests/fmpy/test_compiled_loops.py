"""Loops whose units are compiled from their C sources: the same numbers in other masters as in FMPy, and the design that the
loop asks for.

ADAPTIVE_FMU_COMPILED_LOOPS=all takes every loop in place of some, which takes minutes.
"""

import json
import re
from pathlib import Path

import fmpy
import numpy as np
import pytest
import sample
from conftest import ROOT, adaptive_fmu, read_csv
from loops import pack
from lxml import etree
from masters import TOLERANCE, differences, in_fmpy, run_in, steps_of
from package import Package

# They set what the design of a unit reads, which a compiled one is designed with; of the first that is all that they set.
DESIGNED = ["3.3.1-case2", "3.3.1-case2-bench", "4-case3", "4-case3-fuzzy", "7.5.2"]
LOOPS = sample.LOOPS if sample.ALL else ["3.3.1-case2", ["3.2.1-cosine", "6.5.1-mrac", "7.5.1"][sample.NUMBER % 3]]
VALUES = Path(fmpy.__file__).parent / "ssp" / "schema" / "SystemStructureParameterValues.xsd"


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Package]:
    """Loops, packed with compiled units."""
    files = pack(tmp_path_factory.mktemp("packed"), *LOOPS, form="--compile")
    return {file.stem: Package(file, tmp_path_factory.mktemp(file.stem)) for file in files}


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("master", ["ecos", "libcosim"])
def test_every_output_has_the_value_that_it_has_in_fmpy(master: str, name: str, packages, tmp_path: Path) -> None:
    package = packages[name]
    assert all((fmu.folder / "sources" / "unit.c").exists() for fmu in package.fmus.values())
    recorded = run_in(master, package, steps_of(package), tmp_path)
    found = differences(recorded, in_fmpy(package, master, "jacobi"))
    assert found and all(difference <= TOLERANCE for difference in found.values()), found


def table(folder: Path, *words: str | Path) -> dict[str, np.ndarray]:
    """What a short run records."""
    done = adaptive_fmu("run", *words, "--in-process", "--until", "0.05", "--json", "--out", folder / "results")
    assert done.returncode in (0, 3), done.stderr
    return read_csv(Path(json.loads(done.stdout)["results"]) / "result.csv")


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    """Two forms of the same units, both held to 1e-6; a count of events and the like is left out."""
    for name in set(one) & set(other):
        scale = max(1.0, np.abs(other[name]).max())
        assert np.abs(one[name] - other[name]).max() < 1e-4 * scale, name


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("designed")
    packed = adaptive_fmu("export", "--source", *(f"--ssp={name}" for name in DESIGNED), "--out", folder)
    assert packed.returncode == 0, packed.stderr
    return folder


@pytest.mark.parametrize("name", DESIGNED)
def test_a_packed_loop_has_the_design_that_it_asks_for(name: str, designed: Path, tmp_path: Path) -> None:
    package = Package(designed / f"{name}.ssp", tmp_path / "unpacked")
    constants = package.fmus["controller"].named(variability="constant")
    # As the loop's own file has it; no master is asked to set it.
    given = {p.get("name"): p[0].get("value") for p in etree.parse(ROOT / "examples" / name / "controller.ssv").iter("{*}Parameter")}
    read = {variable: given.pop(variable) for variable in constants if variable in given}
    starts = {variable: float(package.fmus["controller"].variables[variable].start) for variable in read}
    assert read and starts == {variable: float(value) for variable, value in read.items()}
    left = etree.parse(package.folder / "controller.ssv")
    assert {p.get("name") for p in left.iter("{*}Parameter")} == set(given)
    schema = etree.XMLSchema(etree.parse(VALUES))
    assert schema.validate(left), schema.error_log
    same(table(tmp_path, package.path), table(tmp_path, name))


def test_the_loop_that_is_run_after_an_export_has_its_own_design(tmp_path: Path) -> None:
    words = ["L1TwoLinkRobot", "TwoLinkRobot", "ReferenceTwoLinkRobot", "--source", "--out", tmp_path]
    plain = adaptive_fmu("export", *words)
    assert plain.returncode == 0, plain.stderr
    run = lambda loop: adaptive_fmu("run", loop, "--until", "0.01", "--fmus", tmp_path, "--out", tmp_path / "results")
    refused, text = run("3.3.1-case2"), (ROOT / "modelDescription" / "L1TwoLinkRobot.toml").read_text()
    pole = re.search(r"^pole_real = \[(.+?),", text, re.M)[1]
    message = f"`controller.pole_real[1]` can't be set: the FMU was designed with the value {pole}. "
    assert refused.returncode == 1 and message in refused.stderr and "--run LOOP" in refused.stderr, refused.stderr
    done = adaptive_fmu("export", *words, "--run", "3.3.1-case2", folder=tmp_path)
    assert done.returncode == 0 and "L1TwoLinkRobot.fmu is designed with the values of 3.3.1-case2" in done.stderr, done.stderr
    same(table(tmp_path, "3.3.1-case2", "--fmus", tmp_path), table(tmp_path, "3.3.1-case2"))


def test_a_loop_that_is_run_after_an_export_leaves_the_values_that_were_asked_for(tmp_path: Path) -> None:
    poles = "".join(f'<s:Parameter name="pole_real[{k}]"><s:Real value="-7"/></s:Parameter>' for k in (1, 2))
    (tmp_path / "set.ssv").write_text(
        '<s:ParameterSet xmlns:s="http://ssp-standard.org/SSP1/SystemStructureParameterValues" name="p" version="1.0">'
        f"<s:Parameters>{poles}</s:Parameters></s:ParameterSet>"
    )
    fmus = ["L1TwoLinkRobot", "TwoLinkRobot", "ReferenceTwoLinkRobot"]
    assert adaptive_fmu("export", *fmus, "--source", "--out", tmp_path).returncode == 0
    others = [(tmp_path / f"{name}.fmu").read_bytes() for name in fmus[1:]]
    words = ["export", fmus[0], "--source", "--values", tmp_path / "set.ssv", "--out", tmp_path]
    assert adaptive_fmu(*words).returncode == 0
    asked = (tmp_path / f"{fmus[0]}.fmu").read_bytes()
    refused = adaptive_fmu(*words, "--run", "3.3.1-case2", folder=tmp_path)
    assert refused.returncode == 1 and "the FMU was designed with the value -7" in refused.stderr, refused.stderr
    assert [(tmp_path / f"{name}.fmu").read_bytes() for name in fmus] == [asked, *others]


STRUCTURE = """<SystemStructureDescription xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription" name="two" version="1.0">
<System name="two"><Elements>{}</Elements></System><DefaultExperiment startTime="0" stopTime="1"/></SystemStructureDescription>"""
COMPONENT = """<Component name="{}" source="resources/L1ActuatedSiso.fmu"><ParameterBindings><ParameterBinding><ParameterValues>
<v:ParameterSet xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues" name="p" version="1.0"><v:Parameters>
<v:Parameter name="pole_imag[1]"><v:Real value="{}"/></v:Parameter><v:Parameter name="pole_imag[2]"><v:Real value="-{}"/></v:Parameter>
</v:Parameters></v:ParameterSet></ParameterValues></ParameterBinding></ParameterBindings></Component>"""


def test_components_of_one_fmu_have_one_design(tmp_path: Path) -> None:
    for name, (first, second) in {"alike": (0.5, 0.5), "apart": (0.5, 0.25)}.items():
        (tmp_path / name).mkdir()
        components = COMPONENT.format("a", first, first) + COMPONENT.format("b", second, second)
        (tmp_path / name / "SystemStructure.ssd").write_text(STRUCTURE.format(components))
    export = lambda *words: adaptive_fmu("export", "--ssp", *words, "--out", tmp_path)
    assert export(tmp_path / "alike", "--source").returncode == 0
    refused = export(tmp_path / "apart", "--source")
    assert refused.returncode == 1 and "`a` and `b` are components of the same FMU, L1ActuatedSiso" in refused.stderr, refused
    assert "pole_imag[1]" in refused.stderr
    assert export(tmp_path / "apart").returncode == 0, "the generic form is designed where it runs"


def test_what_fails_of_a_batch_keeps_nothing_else_from_being_exported(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('name = "Own"\nmodel = "none"\n')
    words = ["own.toml", "NonlinearSiso", "--ssp", "no-such-loop", "--ssp", "3.2.1-cosine", "--composite", "3.2.1-cosine"]
    done = adaptive_fmu("export", *words, "--out", "fmus", folder=tmp_path)
    written = ["fmus/NonlinearSiso.fmu", "fmus/Loop_3_2_1_cosine.fmu", "fmus/3.2.1-cosine.ssp"]
    assert done.returncode == 1 and done.stdout.splitlines() == written
    assert all((tmp_path / file).is_file() for file in written)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 2 and "own.toml" in errors[0] and "no-such-loop" in errors[1], done.stderr
