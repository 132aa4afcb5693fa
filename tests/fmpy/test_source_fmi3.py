"""FMUs of FMI 3.0 as C source: compiled, they answer all calls as those of the generic form do, bit for bit, and log the same."""

import contextlib
import ctypes
import os
import random
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import sample
from conftest import ROOT, adaptive_fmu
from fmpy.build import build_platform_binary
from fmpy.fmi1 import FMICallException
from fmpy.model_description import read_build_description
from fmpy.validation import validate_fmu
from laws import WARNINGS
from lxml import etree
from master3 import Fmu3, Unit3, dependencies
from test_source_calls import Pair, bits

# A plant, sampled laws, flags, states of any kind and none, integer inputs, indicators; and some others.
ALWAYS = ["TwoLinkRobot", "L1SampledTwoLinkRobot", "PidNonlinearSiso"]
NAMES = sample.FMU_NAMES if sample.ALL else sorted({*ALWAYS, *sample.FMUS[sample.NUMBER % 5 :: 5]})
CALLED = ["TwoLinkRobot", "L1SampledTwoLinkRobot", "PidNonlinearSiso", "Actuator", "Reference"]
CALLS = 300
# Of the runtime of FMI 3.0 these have all, but for what is for integer inputs; and cppcheck is soon done.
SMALL = ["NonlinearSiso", "StateSpace", "ReferenceNonlinearSiso"]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., list[Fmu3]]:
    """An FMU in both forms, generic and compiled, by its name; or a whole loop, by that of its FMU and its own. Exported once."""
    folder, opened = tmp_path_factory.mktemp("fmi3"), dict[str, list[Fmu3]]()

    def get(name: str, loop: str | None = None) -> list[Fmu3]:
        if name not in opened:
            what = ["--composite", loop] if loop else [name]
            for form, options in enumerate(([], ["--compile"])):
                exported = adaptive_fmu("export", "--fmi", "3", *options, *what, "--out", folder / str(form))
                assert exported.returncode == 0, exported.stderr
            files = [folder / str(form) / f"{name}.fmu" for form in range(2)]
            opened[name] = [Fmu3(file, tmp_path_factory.mktemp(name)) for file in files]
        return opened[name]

    return get


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The unpacked FMU of a unit that has C sources and no library."""
    folder = tmp_path_factory.mktemp("sources")

    def unpacked(name: str) -> Path:
        if not (folder / name).is_dir():
            exported = adaptive_fmu("export", "--fmi", "3", "--source-only", name, "--out", folder)
            assert exported.returncode == 0, exported.stderr
            fmpy.extract(folder / f"{name}.fmu", folder / name)
        return folder / name

    return unpacked


def shown(fmus: list[Fmu3]) -> list[str]:
    """The variables that both forms compute: not what a design has fixed."""
    computed = [v.name for v in fmus[0].about.modelVariables if v.type == "Float64" and v.causality in ("output", "local")]
    return [name for name in computed if fmus[1].variables[name].variability != "constant"]


def at_random(unit: Unit3, numbers: random.Random) -> None:
    """Sets each real input to other numbers."""
    for name in unit.fmu.named(causality="input", type="Float64"):
        unit[name] = [numbers.uniform(-0.1, 0.1) for _ in unit.fmu.elements[name]]


def integrated_by(unit: Unit3, method: str) -> None:
    if (choice := unit.fmu.variables.get("integration_method")) is not None:
        unit["integration_method"] = next(int(item.value) for item in choice.declaredType.items if item.name == method)


def stepped(fmu: Fmu3, names: list[str], method: str, event_mode: bool, early_return: bool) -> list[Any]:
    """All that some variables have been, bit by bit, at random inputs, and all that steps have answered."""
    numbers, taken, step = random.Random(25), [], 7e-3
    with Unit3(fmu, event_mode=event_mode, early_return=early_return, logging=True) as unit:
        integrated_by(unit, method)
        at_random(unit, numbers)
        unit.start()
        time = 0.0
        # A funnel may be left at such inputs: both forms then refuse the same step, with the same message.
        with contextlib.suppress(FMICallException):
            for _ in range(30):
                at_random(unit, numbers)
                if event_mode:
                    taken.append((unit.update(), [struct.pack(f"{len(unit[name])}d", *unit[name]) for name in names]))
                    unit.instance.enterStepMode()
                needed, end, early, time = unit.instance.doStep(time, step)
                taken.append((needed, end, early, time, [struct.pack(f"{len(unit[name])}d", *unit[name]) for name in names]))
                if event_mode:
                    unit.instance.enterEventMode()
        taken.append(unit.messages)
    assert len(taken) > 30 or any(word in unit.messages[-1][2] for word in ("funnel", "epsilon")), unit.messages
    return taken


each_name = pytest.mark.parametrize("name", NAMES)


def skip_where_sizes_can_change(fmus: list[Fmu3]) -> None:
    """The generic form numbers variables then, and the other one elements (docs/fmi3.md)."""
    if any(v.causality == "structuralParameter" for v in fmus[0].about.modelVariables):
        pytest.skip("the generic form has other value references, since its sizes can change")


@pytest.mark.parametrize(("event_mode", "early_return"), [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("method", ["explicit", "stiff"])
@each_name
def test_steps_give_the_bits_of_the_generic_form(name: str, method: str, event_mode: bool, early_return: bool, both) -> None:
    fmus = both(name)
    if method == "stiff" and "integration_method" not in fmus[0].variables:
        pytest.skip("no states: nothing is integrated")
    runs = [stepped(fmu, shown(fmus), method, event_mode, early_return) for fmu in fmus]
    assert runs[0] == runs[1]


def test_a_composite_gives_the_bits_of_the_generic_form(both) -> None:
    fmus = both("Loop_3_2_1_cosine", "3.2.1-cosine")
    runs = [stepped(fmu, fmu.named(causality="output"), "explicit", True, True) for fmu in fmus]
    assert runs[0] == runs[1]


@each_name
def test_rates_and_indicators_give_the_bits_of_the_generic_form(name: str, both) -> None:
    """In model exchange, along the motion, with an event at each step."""
    answers = []
    skip_where_sizes_can_change(both(name))
    for fmu in both(name):
        numbers, taken = random.Random(7), []
        with Unit3(fmu, exchange=True, logging=True) as unit:
            at_random(unit, numbers)
            unit.start()
            instance, counts = unit.instance, [ctypes.c_size_t(), ctypes.c_size_t()]
            instance.fmi3GetNumberOfContinuousStates(instance.component, ctypes.byref(counts[0]))
            instance.fmi3GetNumberOfEventIndicators(instance.component, ctypes.byref(counts[1]))
            states, indicators = (count.value for count in counts)
            x, rates, z = ((ctypes.c_double * max(count, 1))() for count in (states, states, indicators))
            for k in range(1, 20):
                taken.append(unit.update())
                instance.enterContinuousTimeMode()
                instance.getContinuousStates(x, states)
                instance.getContinuousStateDerivatives(rates, states)
                for i in range(states):
                    x[i] += 1e-4 * rates[i]
                instance.setTime(1e-4 * k)
                instance.setContinuousStates(x, states)
                at_random(unit, numbers)
                instance.getEventIndicators(z, indicators)
                try:
                    taken.append((bytes(x), bytes(rates), bytes(z), instance.completedIntegratorStep()))
                except FMICallException:
                    # Fast states leave their range in such steps; both forms refuse the same one.
                    taken.append((k, bytes(x), bytes(rates)))
                    break
                instance.enterEventMode()
            taken.append(unit.messages)
        answers.append(taken)
    assert answers[0] == answers[1]


@each_name
def test_derivatives_are_those_of_the_generic_form(name: str, both) -> None:
    """In both directions, at the start and behind it; those that sum other products, to rounding."""
    fmus, found = both(name), []
    skip_where_sizes_can_change(fmus)
    real = [v for v in fmus[0].about.modelVariables if v.type == "Float64"]
    unknowns = [v for v in real if v.causality == "output" or v.derivative is not None]
    inputs = [v for v in real if v.causality == "input"]
    states = list({v.derivative.name: v.derivative for v in real if v.derivative is not None}.values())
    if not unknowns or not inputs:
        return
    count = lambda some: sum(len(fmus[0].elements[v.name]) for v in some)
    for fmu in fmus:
        numbers, taken = np.random.default_rng(3), []
        with Unit3(fmu, logging=True) as unit:
            at_random(unit, random.Random(3))
            unit.instance.enterInitializationMode(startTime=0.0)
            for knowns in (inputs, [*inputs, *states, fmu.variables["time"]]):
                references = [[v.valueReference for v in some] for some in (unknowns, knowns)]
                of, by = count(unknowns), count(knowns)
                taken.append(unit.instance.getDirectionalDerivative(*references, list(numbers.standard_normal(by)), of))
                taken.append(unit.instance.getAdjointDerivative(*references, list(numbers.standard_normal(of)), by))
                if knowns == inputs:
                    unit.instance.exitInitializationMode()
            outputs = [v.valueReference for v in unknowns if v.causality == "output" and v.variability == "continuous"]
            unit.instance.doStep(0.0, 1e-3)
            if outputs and all(len(fmu.elements[v.name]) == 1 for v in unknowns if v.valueReference in outputs):
                taken.append(unit.instance.getOutputDerivatives(outputs, [1] * len(outputs)))
        found.append(taken)
    for k, (one, other) in enumerate(zip(*found, strict=True)):
        if k in (1, 3):
            np.testing.assert_allclose(list(one), list(other), rtol=1e-12, atol=1e-13 * max(map(abs, one), default=0.0))
        else:
            assert bits([slope + 0.0 for slope in one]) == bits([slope + 0.0 for slope in other])


@each_name
def test_elements_depend_on_elements_as_in_the_generic_form(name: str, both) -> None:
    """Before the start and while a simulation runs; a parameter that the design has fixed is none to depend on."""
    fmus = both(name)
    skip_where_sizes_can_change(fmus)
    fixed = {v.valueReference for v in fmus[1].about.modelVariables if v.variability == "constant"}
    found = []
    for fmu in fmus:
        dependents = [v.valueReference for v in fmu.about.modelVariables if v.causality == "output" or v.derivative is not None]
        dependents += [v.derivative.valueReference for v in fmu.about.modelVariables if v.derivative is not None]
        dependents += [v.valueReference for v in fmu.about.modelVariables if v.name == "event_indicators"]
        with Unit3(fmu, logging=True) as unit:
            starts = [[one for one in dependencies(unit, of) if one[1] not in fixed] for of in dependents]
            unit.start()
            found.append((starts, [dependencies(unit, of) for of in dependents]))
    assert found[0] == found[1]


class Pair3(Pair):
    """A unit of FMI 3.0 in both forms, and a person at random who calls them."""

    def __init__(self, forms: list[Unit3], seed: int) -> None:
        self.forms, self.numbers, self.log = forms, random.Random(seed), list[str]()
        self.time, self.step, self.saved = 0.0, self.numbers.choice([1e-3, 1e-2]), {}
        variables = forms[0].fmu.variables.values()
        fixed = {v.name for v in forms[1].fmu.variables.values() if v.variability == "constant"}
        self.designed = {v.valueReference + k for v in variables if v.name in fixed for k in range(len(self.elements(v)))}
        free = [v for v in variables if v.name not in fixed and v.name != "integration_method"]
        self.reals = [v for v in free if v.type == "Float64"]
        self.others = [v for v in free if v.type != "Float64"]
        self.inputs = [v for v in self.reals if v.causality == "input"]
        self.outputs = [v for v in self.reals if v.causality == "output"]
        self.tunable = [v for v in self.reals if v.variability == "tunable"]
        self.sizes = {v.valueReference: len(self.elements(v)) for v in variables}

    def elements(self, variable: Any) -> list[str]:
        return self.forms[0].fmu.elements[variable.name]

    def size(self, references: list[int]) -> int:
        """Number of values of references, or, now and then, another one."""
        return sum(self.sizes.get(one, 1) for one in references) + (self.numbers.random() < 0.05)

    def values(self, size: int) -> list[float]:
        return [self.small() for _ in range(size)]

    def set_input(self) -> None:
        references = [self.reference(self.inputs)]
        values = self.values(self.size(references))
        self.ask(f"set {references} = {values}", lambda unit: unit.instance.setFloat64(references, values))

    def get(self) -> None:
        references = [self.reference(self.reals) for _ in range(self.numbers.randrange(4))]
        size = self.size(references)
        self.ask(f"get {references}, {size}", lambda unit: bits(unit.instance.getFloat64(references, size)))

    def tune(self) -> None:
        if self.tunable:
            variable = self.numbers.choice(self.tunable)
            part = self.numbers.choice([1.0, 1.01, -1.0, 0.0])
            values = [self.number(float(value) * part) for value in (variable.start or "1").split()]
            reference = variable.valueReference
            self.ask(f"{variable.name} = {values}", lambda unit: unit.instance.setFloat64([reference], values))

    def use_integers(self) -> None:
        references, kind = [self.reference(self.others)], self.numbers.choice(["Int32", "Int64", "Boolean"])
        size = self.size(references)
        if self.numbers.random() < 0.5:
            get = f"get{kind}"
            self.ask(f"{get} {references}", lambda unit: list(map(int, getattr(unit.instance, get)(references, size))))
        else:
            put, values = f"set{kind}", [self.numbers.choice([-1, 0, 1, 2, 3]) for _ in range(size)]
            self.ask(f"{put} {references} = {values}", lambda unit: getattr(unit.instance, put)(references, values))

    def differentiate(self) -> None:
        of, by = [self.reference(self.outputs)], [self.reference(self.numbers.choice([self.inputs, self.reals]))]
        many, few = self.size(of), self.size(by)
        seed = self.values(few)
        self.ask(
            f"d{of}/d{by}",
            lambda unit: bits([slope + 0.0 for slope in unit.instance.getDirectionalDerivative(of, by, seed, many)]),
        )
        order = self.numbers.choice([1, 1, 0])
        # FMPy has this function in co-simulation, and one value for each reference.
        if self.sizes.get(of[0]) == 1 and hasattr(self.forms[0].instance, "getOutputDerivatives"):
            self.ask(f"slope of {of}", lambda unit: bits(unit.instance.getOutputDerivatives(of, [order])))

    def depend(self) -> None:
        reference = self.reference([*self.outputs, *self.reals])
        self.ask(
            f"what {reference} depends on",
            lambda unit: [one for one in dependencies(unit, reference) if one[1] not in self.designed],
        )

    def save_or_restore(self) -> None:
        if not self.saved or self.numbers.random() < 0.4:
            states: list[Any] = []
            if self.ask("save", lambda unit: states.append(unit.instance.getFMUState())) is None:
                self.saved[len(self.log)] = states, self.time
            return
        states, time = self.saved[self.numbers.choice(list(self.saved))]
        if self.ask("restore", lambda unit: unit.instance.setFMUState(states[self.forms.index(unit)])) == 0:
            self.time = time

    def spoil(self) -> None:
        """A byte of a saved state is wrong."""
        if self.saved:
            states, _ = self.numbers.choice(list(self.saved.values()))
            place, bit = self.numbers.randrange(8, 10**6), 1 << self.numbers.randrange(8)

            def read(unit: Unit3) -> None:
                written = bytearray(unit.instance.serializeFMUState(states[self.forms.index(unit)]))
                written[place % len(written)] ^= bit
                unit.instance.deserializeFMUState(bytes(written))

            self.ask(f"byte {place}", read)

    def go_on(self) -> None:
        """A step, seldom one that can't be; through Event Mode, where there is one."""
        wrong = self.numbers.random() < 0.1
        time = self.numbers.choice([0.0, self.time + 1.0, self.number(self.time)]) if wrong else self.time
        step = self.numbers.choice([0.0, -1.0, 1e-300, self.step / 3]) if wrong else self.step
        answer = self.ask(f"step {time} + {step}", lambda unit: unit.instance.doStep(time, step))
        if isinstance(answer, tuple):
            self.time = answer[-1]

    def event(self) -> None:
        calls = ["enterEventMode", "updateDiscreteStates", "enterStepMode"]
        for name in calls if self.numbers.random() < 0.8 else [self.numbers.choice(calls)]:
            self.ask(name, lambda unit, name=name: getattr(unit.instance, name)())

    def begin(self) -> None:
        start, stop = self.number(0.0), self.number(5.0)
        self.ask("enter", lambda unit: unit.instance.enterInitializationMode(startTime=start, stopTime=stop, tolerance=1e-5))
        self.ask("exit", lambda unit: unit.instance.exitInitializationMode())

    def log_or_not(self) -> None:
        on, categories = self.numbers.random() < 0.5, self.numbers.choice([[], ["logEvents"], ["logStatusDiscard"], ["none"]])
        names = (ctypes.c_char_p * len(categories))(*[name.encode() for name in categories])
        self.ask(
            f"log {categories} {on}",
            lambda unit: unit.instance.fmi3SetDebugLogging(unit.instance.component, on, len(categories), names),
        )

    def end(self) -> None:
        name = self.numbers.choice(["terminate", "reset"])
        if self.ask(name, lambda unit: getattr(unit.instance, name)()) == 0 and name == "reset":
            self.time = 0.0

    def call(self, of_the_interface: list[Callable[[], None]]) -> None:
        often = [self.set_input, self.get, *3 * of_the_interface]
        sometimes = [self.tune, self.use_integers, self.differentiate, self.depend, self.save_or_restore]
        seldom = [self.spoil, self.begin, self.log_or_not, self.end]
        weights = [6] * len(often) + [2] * len(sometimes) + [0.5] * len(seldom)
        self.numbers.choices([*often, *sometimes, *seldom], weights)[0]()

    def event_of_exchange(self) -> None:
        for name in ("enterEventMode", "updateDiscreteStates", "enterContinuousTimeMode"):
            self.ask(name, lambda unit, name=name: getattr(unit.instance, name)())

    def integrate(self) -> None:
        time = self.number(self.time + self.step)
        self.ask(f"move to {time}", lambda unit: unit.instance.setTime(time))
        self.ask("complete", lambda unit: unit.instance.completedIntegratorStep())
        self.time += self.step


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", CALLED)
def test_co_simulation_is_the_same_at_any_calls(name: str, seed: int, both) -> None:
    """With Event Mode and without, with early return and without."""
    forms = [Unit3(fmu, event_mode=seed % 3 > 0, early_return=seed % 3 > 1, logging=seed % 2 > 0) for fmu in both(name)]
    for unit in forms:
        integrated_by(unit, "explicit")
    pair = Pair3(forms, seed)
    for k in range(CALLS):
        if k == 5:
            pair.begin()
        pair.call([pair.go_on, pair.event, pair.go_on])
    for unit in forms:
        unit.instance.freeInstance()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", CALLED)
def test_model_exchange_is_the_same_at_any_calls(name: str, seed: int, both) -> None:
    forms = [Unit3(fmu, exchange=True, logging=seed % 2 > 0) for fmu in both(name)]
    pair = Pair3(forms, seed)
    for k in range(CALLS):
        if k == 5:
            pair.begin()
        pair.call([pair.event_of_exchange, pair.integrate])
    for unit in forms:
        unit.instance.freeInstance()


def test_the_build_description_is_that_of_the_standard(both, sources: Callable[[str], Path]) -> None:
    """FMPy validates it by its schema; modelDescription.xml names no sources, and what the design has fixed."""
    file = both("TwoLinkRobot")[1].file
    assert validate_fmu(str(file)) == []
    (configuration,) = read_build_description(file)
    (files,) = configuration.sourceFileSets
    assert (configuration.modelIdentifier, files.language, files.sourceFiles) == ("TwoLinkRobot", "C99", ["all.c"])
    assert files.includeDirectories == ["."]
    assert [(definition.name, definition.value, definition.optional) for definition in files.preprocessorDefinitions] == [
        ("FMI3_FUNCTION_PREFIX", "", True)
    ]
    folder = sources("L1TwoLinkRobot")
    assert not etree.parse(folder / "modelDescription.xml").xpath("//SourceFiles") and not (folder / "binaries").exists()
    made = Fmu3(folder.with_suffix(".fmu"), folder)
    assert made.variables["Q"].variability == "constant" and made.variables["adaptation_gain"].variability == "tunable"
    assert {"fmi3.c", "fmi3.h"} <= {file.name for file in (folder / "sources").iterdir()}
    assert not list((folder / "sources").glob("fmi2*"))


def test_fmpy_compiles_the_sources(sources, both, tmp_path, monkeypatch) -> None:
    unpacked = tmp_path / "NonlinearSiso"
    shutil.copytree(sources("NonlinearSiso"), unpacked)
    # CMake stands beside Python, as FMPy finds it in an environment that is active.
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    build_platform_binary(unpacked)
    settings = {"stop_time": 1.0, "output_interval": 0.01, "start_values": {"integration_method": 2}}
    results = [
        fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", **settings) for file in (unpacked, both("NonlinearSiso")[0].file)
    ]
    assert all((results[0][name] == results[1][name]).all() for name in results[0].dtype.names)


@pytest.mark.parametrize("define", ["", "-DUNIT_FLOAT", "-DUNIT_STATIC_INSTANCES=2", "-DFMI3_FUNCTION_PREFIX=Unit_"])
@pytest.mark.parametrize("name", NAMES)
def test_sources_are_compiled_without_a_warning(name: str, define: str, sources) -> None:
    for compiler in filter(shutil.which, ["gcc", "clang"] if sample.ALL else ["gcc"]):
        command = [compiler, *WARNINGS, *filter(None, [define]), "-fsyntax-only", sources(name) / "sources" / "all.c"]
        compiled = subprocess.run(command, capture_output=True, text=True, check=False)
        assert compiled.returncode == 0, compiled.stderr


@pytest.mark.parametrize("name", SMALL[sample.NUMBER % 3 :] if sample.ALL else SMALL[sample.NUMBER % 3 :][:1])
def test_cppcheck_finds_nothing(name: str, sources) -> None:
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck isn't installed")
    command = ["cppcheck", "--std=c99", "--quiet", "-DUNIT_ANY", "--enable=warning,portability,performance"]
    found = subprocess.run([*command, sources(name) / "sources" / "all.c"], capture_output=True, text=True, check=True)
    assert found.stderr == ""


@pytest.mark.parametrize("define", ["", "-DUNIT_STATIC_INSTANCES=2"])
@pytest.mark.parametrize("name", ["NonlinearSiso", "L1SampledNonlinearSiso", "Actuator"])
def test_sanitizers_find_nothing_in_the_lifetime_of_an_instance(name: str, define: str, sources, tmp_path) -> None:
    """Both interfaces, saved states, derivatives, dependences, and calls with what is refused (`one_unit_3.c`)."""
    folder, program = sources(name) / "sources", tmp_path / "program"
    flags = ["-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", *filter(None, [define])]
    main = ROOT / "tests" / "fmpy" / "one_unit_3.c"
    subprocess.run(["gcc", *flags, f"-I{folder}", main, folder / "all.c", "-lm", "-o", program], check=True)
    ran = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout + ran.stderr) == (0, "")


def test_what_is_refused_leaves_no_instance(both) -> None:
    """Another token, no name, scheduled execution: with the function's name."""
    _, compiled = both("Reference")
    with Unit3(compiled, logging=False) as unit:
        instance = unit.instance
        for arguments, message in [
            ((b"unit", b"{another}"), "fmi3InstantiateModelExchange: the instantiation token `{another}` is not that"),
            ((b"", instance.guid.encode()), "fmi3InstantiateModelExchange: instanceName is NULL or empty"),
            ((b"unit", None), "fmi3InstantiateModelExchange: instantiationToken is NULL"),
        ]:
            made = instance.fmi3InstantiateModelExchange(*arguments, None, False, False, None, instance.logMessage)
            assert made is None and unit.messages.pop()[2].startswith(message)
        with pytest.raises(FMICallException):
            instance.enterStepMode()
        assert unit.messages.pop()[2].startswith("fmi3EnterStepMode is not allowed while the instance is instantiated")
