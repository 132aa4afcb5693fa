"""Units as C source: compiled, they are the units of the generic form."""

import ctypes
import math
import os
import random
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
import sample
from conftest import PROGRAM, ROOT, adaptive_fmu
from fmpy.build import build_platform_binary
from laws import WARNINGS
from lxml import etree
from master import Fmu, Unit, refused

# One of each family, small and large, with states and without, with events of time and of state.
FAMILIES = [
    "Actuator",
    "FunnelNonlinearSiso",
    "FuzzyL1ActuatedSiso",
    "FuzzyL1TwoLinkRobot",
    "L1CoupledMimo",
    "L1LimitNonlinearSiso",
    "L1PpfCoupledMimo",
    "L1PpfTwoLinkRobot",
    "L1SampledTwoLinkRobot",
    "L1SampledUnmatchedMimo",
    "L1TwoLinkRobot",
    "LadrcNonlinearSiso",
    "MracPpfCoupledMimo",
    "MracPpfUnmatchedMimo",
    "NeuroPpfCoupledMimo",
    "NonlinearSiso",
    "ObserverQuadrotor",
    "PidNonlinearSiso",
    "Quadrotor",
    "Reference",
    "Sensor",
    "StateSpace",
    "TwoLinkRobot",
]
# These two are looked at for what the others haven't.
NAMES = FAMILIES if sample.ALL else sorted({*FAMILIES[sample.NUMBER % 6 :: 6], "L1PpfCoupledMimo", "L1TwoLinkRobot"})
# Steps of fixed length that are short enough for fast adaptation; and for that at inputs that jump.
MOST_FIXED_STEPS = 10_000
COMPILERS = [compiler for compiler in ["gcc", "clang"] if shutil.which(compiler)]


@pytest.fixture(scope="module")
def compiled_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """FMUs with libraries that are compiled from their sources."""
    folder = tmp_path_factory.mktemp("compiled")
    exported = adaptive_fmu("export", "--compile", *NAMES, "--composite", "3.2.1-cosine", "--out", folder)
    assert exported.returncode == 0, exported.stderr
    return folder


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder `sources` of a unit."""
    folder = tmp_path_factory.mktemp("sources")

    def unpacked(name: str) -> Path:
        if not (folder / name).is_dir():
            exported = adaptive_fmu("export", "--source-only", name, "--out", folder)
            assert exported.returncode == 0, exported.stderr
            zipfile.ZipFile(folder / f"{name}.fmu").extractall(folder / name)
        return folder / name / "sources"

    return unpacked


def outputs_of(unit: Unit, names: list[str], method: str, steps: int, step: float, law: str | None = None) -> list[bytes]:
    """All that some variables have been, bit by bit, at random inputs."""
    numbers, taken = random.Random(25), []
    inputs = [n for n in unit.fmu.named(causality="input") if unit.fmu.variables[n].type == "Real"]
    if "integration_method" in unit.fmu.variables:
        unit["integration_method"] = unit.fmu.item("integration_method", method)
        unit["fixed_steps"] = MOST_FIXED_STEPS
    if law is not None:
        unit["law"] = unit.fmu.item("law", law)
    unit.start()
    for k in range(steps):
        for name in inputs:
            unit[name] = numbers.uniform(-0.1, 0.1)
        unit.slave.doStep(k * step, step)
        taken.append(struct.pack(f"{len(names)}d", *(unit[name] for name in names)))
    return taken


@pytest.mark.parametrize("method", ["explicit", "stiff", "fixed"])
@pytest.mark.parametrize("name", NAMES)
def test_compiled_units_give_the_bits_of_the_generic_ones(name, method, compiled_folder, fmu, tmp_path) -> None:
    generic, compiled = fmu(name), Fmu(compiled_folder / f"{name}.fmu", tmp_path)
    if method != "explicit" and "integration_method" not in generic.variables:
        pytest.skip("no states: nothing is integrated")
    shown = shown_by_both(generic, compiled)
    runs = []
    for made in (generic, compiled):
        unit = Unit(made, name)
        runs.append(outputs_of(unit, shown, method, 30, 1e-3))
        unit.free()
    assert runs[0] == runs[1]


def shown_by_both(generic: Fmu, compiled: Fmu) -> list[str]:
    """The numbers that a unit shows, but for those that its design has fixed."""
    names = [v.name for v in generic.variables.values() if v.type == "Real" and v.causality in ("output", "local")]
    return [name for name in names if compiled.variables[name].variability != "constant"]


@pytest.mark.parametrize("method", ["explicit", "stiff", "fixed"])
def test_a_sampled_barrier_compiled_gives_the_bits_of_the_generic_one(method, compiled_folder, fmu, tmp_path) -> None:
    name = "L1PpfCoupledMimo"
    generic, compiled = fmu(name), Fmu(compiled_folder / f"{name}.fmu", tmp_path)
    shown = shown_by_both(generic, compiled)
    runs = {law: [] for law in ("sampled", "continuous")}
    for law, of_both in runs.items():
        for made in (generic, compiled):
            unit = Unit(made, name)
            of_both.append(outputs_of(unit, shown, method, 30, 1e-3, law))
            unit.free()
    assert runs["sampled"][0] == runs["sampled"][1]
    assert runs["sampled"][0] != runs["continuous"][0]


def test_a_composite_compiled_gives_the_bits_of_the_generic_one(compiled_folder, tmp_path) -> None:
    exported = adaptive_fmu("export", "--composite", "3.2.1-cosine", "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    name = "Loop_3_2_1_cosine.fmu"
    runs = []
    for folder in (tmp_path, compiled_folder):
        made = Fmu(folder / name, tmp_path / f"unpacked {len(runs)}")
        unit = Unit(made, "loop")
        runs.append(outputs_of(unit, made.named(causality="output"), "explicit", 100, 1e-2))
        unit.free()
    assert runs[0] == runs[1]


def test_the_description_names_the_sources_and_what_the_design_has_fixed(compiled_folder, tmp_path) -> None:
    made = Fmu(compiled_folder / "L1TwoLinkRobot.fmu", tmp_path)
    described = etree.parse(tmp_path / "modelDescription.xml")
    for interface in ("CoSimulation", "ModelExchange"):
        assert described.xpath(f"/fmiModelDescription/{interface}/SourceFiles/File/@name") == ["all.c"]
    designed = made.variables["Q[1,1]"]
    assert (designed.causality, designed.variability, designed.initial) == ("local", "constant", "exact")
    assert designed.description.endswith("(designed at export)")
    assert made.variables["adaptation_gain"].variability == "tunable"
    assert fmpy.validation.validate_fmu(str(made.path)) == []
    unit = Unit(made, "designed")
    reference = designed.valueReference
    refused(lambda: unit.slave.setReal([reference], [1.0]))
    unit.start()
    assert math.isclose(unit.slave.getReal([reference])[0], float(designed.start))
    unit.free()


def test_fmpy_compiles_the_sources(sources, fmu, tmp_path, monkeypatch) -> None:
    sources("NonlinearSiso")
    unpacked = tmp_path / "NonlinearSiso"
    shutil.copytree(sources("NonlinearSiso").parent, unpacked)
    # CMake stands beside Python, as FMPy finds it in an environment that is active.
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    build_platform_binary(unpacked)
    settings = {"stop_time": 1.0, "output_interval": 0.01, "start_values": {"integration_method": 2}}
    results = [fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", **settings) for file in (unpacked, fmu("NonlinearSiso").path)]
    assert all((results[0][name] == results[1][name]).all() for name in results[0].dtype.names)


@pytest.mark.parametrize("define", ["", "-DUNIT_FLOAT", "-DFMI2_STATIC_INSTANCES=2", "-DFMI2_FUNCTION_PREFIX=Unit_"])
@pytest.mark.parametrize("name", ["L1TwoLinkRobot", "Sensor", "Reference"])
def test_sources_are_compiled_without_a_warning(name, define, sources, tmp_path) -> None:
    for compiler in COMPILERS:
        command = [compiler, *WARNINGS, *filter(None, [define]), "-c", sources(name) / "all.c", "-o", tmp_path / "all.o"]
        compiled = subprocess.run(command, capture_output=True, text=True, check=False)
        assert compiled.returncode == 0, compiled.stderr


def test_static_instances_take_no_memory(sources, tmp_path) -> None:
    command = ["gcc", "-std=c99", "-O2", "-DFMI2_STATIC_INSTANCES=2", "-c", sources("L1TwoLinkRobot") / "all.c"]
    subprocess.run([*command, "-o", tmp_path / "all.o"], check=True)
    asked = subprocess.run(["nm", "-u", tmp_path / "all.o"], capture_output=True, text=True, check=True).stdout
    assert not {"malloc", "calloc", "realloc", "free", "printf", "snprintf"} & set(asked.split()), asked


@pytest.mark.parametrize("level", ["-O2", "-O3"])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_messages_have_numbers_by_the_fewest_digits_however_they_are_compiled(compiler, level, sources, tmp_path) -> None:
    # gcc 12.2 once lost digits at -O3, which CMake asks for.
    main, program = ROOT / "tests" / "fmpy" / "numbers_told.c", tmp_path / "digits"
    command = [compiler, "-std=c99", level, f"-I{sources('NonlinearSiso')}", main, "-lm", "-o", program]
    subprocess.run(command, check=True)
    answer = subprocess.run([program], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stdout


@pytest.mark.slow
def test_three_units_run_in_one_program_under_sanitizers(sources, unit, tmp_path) -> None:
    names = ["NonlinearSiso", "L1NonlinearSiso", "ReferenceNonlinearSiso"]
    flags = ["-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    for name in names:
        prefix = f"-DFMI2_FUNCTION_PREFIX={name}_"
        subprocess.run(["gcc", *flags, prefix, "-c", sources(name) / "all.c", "-o", tmp_path / f"{name}.o"], check=True)
    defines = [f"-D{name}_GUID={quoted_guid(sources(name))}" for name in names]
    for name in names:
        variables = fmpy.read_model_description(str(sources(name).parent)).modelVariables
        references = {v.name: v.valueReference for v in variables}
        shown = {"r": "r[1]", "u": "u[1]", "x1": "x[1]", "x2": "x[2]", "method": "integration_method"}
        defines += [f"-D{name}_{short}={references[full]}" for short, full in shown.items() if full in references]
    main = ROOT / "tests" / "fmpy" / "three_units.c"
    objects = [tmp_path / f"{name}.o" for name in names]
    program = tmp_path / "program"
    subprocess.run(["gcc", *flags, *defines, f"-I{sources(names[0])}", main, *objects, "-lm", "-o", program], check=True)
    answer = subprocess.run([program], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    assert float(answer.stdout) == largest_error_of_generic_units(unit)


def test_a_refusal_without_a_number_is_reported_without_undefined_behaviour(sources, tmp_path) -> None:
    """The sampled law is for co-simulation: in model exchange it is refused by a reason that holds no value."""
    name, main, program = "MracPpfCoupledMimo", tmp_path / "main.c", tmp_path / "program"
    law = next(v for v in fmpy.read_model_description(str(sources(name).parent)).modelVariables if v.name == "law")
    item = next(item.value for item in law.declaredType.items if item.name == "sampled")
    main.write_text(f"""
#include "all.c"
#include <stdio.h>
static void print_message(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String text, ...)
{{
    (void)e, (void)n, (void)s, (void)c;
    puts(text);
}}
int main(void)
{{
    const fmi2CallbackFunctions callbacks = {{ print_message, NULL, NULL, NULL, NULL }};
    const fmi2ValueReference law = {law.valueReference};
    const fmi2Integer sampled = {item};
    fmi2Component c = fmi2Instantiate("unit", fmi2ModelExchange, UNIT_GUID, "", &callbacks, 0, 0);
    fmi2SetInteger(c, &law, 1, &sampled);
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    return fmi2ExitInitializationMode(c) == fmi2Error ? 0 : 1;
}}
""")
    flags = ["-std=c99", "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all", f"-I{sources(name)}"]
    subprocess.run(["gcc", *flags, main, "-lm", "-o", program], check=True)
    answer = subprocess.run([program], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    assert "only an FMU that is stepped in co-simulation is sampled" in answer.stdout


def largest_error_of_generic_units(unit: Callable[..., Unit]) -> float:
    """What three_units.c does, by the units of the generic form."""
    reference, plant, controller = unit("ReferenceNonlinearSiso"), unit("NonlinearSiso"), unit("L1NonlinearSiso")
    for integrated in (plant, controller):
        integrated["integration_method"] = integrated.fmu.item("integration_method", "explicit")
    for made in (reference, plant, controller):
        made.start()
    largest = 0.0
    for k in range(4000):
        controller["r[1]"], controller["x[1]"], controller["x[2]"] = reference["r[1]"], plant["x[1]"], plant["x[2]"]
        plant["u[1]"] = controller["u[1]"]
        if k >= 2000:
            largest = max(largest, abs(plant["x[1]"] - reference["r[1]"]))
        reference.step(1e-3 * k, 1e-3)
        controller.step(1e-3 * k, 1e-3)
        plant["u[1]"] = controller["u[1]"]
        plant.step(1e-3 * k, 1e-3)
    return largest


def quoted_guid(folder: Path) -> str:
    """A unit's GUID as C has it."""
    return next(line.split(maxsplit=2)[2] for line in (folder / "unit.h").read_text().splitlines() if "UNIT_GUID" in line)


def test_the_same_description_gives_the_same_bytes(sources, tmp_path) -> None:
    first = (sources("Quadrotor") / "unit.c").read_bytes()
    subprocess.run([PROGRAM, "export", "--source-only", "Quadrotor", "--out", tmp_path], check=True, capture_output=True)
    assert zipfile.ZipFile(tmp_path / "Quadrotor.fmu").read("sources/unit.c") == first
