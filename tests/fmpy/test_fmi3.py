"""FMUs of FMI 3.0: read and run by FMPy, with the numbers of those of FMI 2.0; arrays, Event Mode, derivatives in both directions."""

import ctypes
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from conftest import ROOT, Ran, adaptive_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from master import Exchange, Fmu, Unit, at_ease
from master3 import Fmu3, Unit3, dependencies
from sample import FMUS, NUMBER

# The types of FMI 2.0 in FMI 3.0.
TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}


@pytest.fixture(scope="module")
def fmu3(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Fmu3]:
    """An FMU by its name, exported once."""
    folder, opened = tmp_path_factory.mktemp("fmi3"), dict[str, Fmu3]()

    def get(name: str) -> Fmu3:
        if name not in opened:
            exported = adaptive_fmu("export", "--fmi", "3", name, "--out", folder)
            assert exported.returncode == 0, exported.stderr
            opened[name] = Fmu3(folder / f"{name}.fmu", tmp_path_factory.mktemp("unpacked"))
        return opened[name]

    return get


each_name = pytest.mark.parametrize("name", FMUS)


def varied(fmu: Fmu, seed: int) -> dict[str, float]:
    """Inputs at random, near their start values."""
    random = np.random.default_rng(seed)
    inputs = [v for v in fmu.variables.values() if v.causality == "input" and v.type == "Real"]
    return {v.name: float(v.start) + 0.01 * random.standard_normal() for v in inputs}


@each_name
def test_variables_are_those_of_fmi_2(name: str, fmu3: Callable[[str], Fmu3], fmu: Callable[[str], Fmu]) -> None:
    """The XML is valid by the standard's schema and FMPy's further checks; each element has its type, unit, limits and start value."""
    problems = validate_fmu(str(fmu3(name).file))
    assert problems == []
    new, old = fmu3(name), fmu(name).variables
    seen, states = set(), [rate.variable.derivative for rate in new.about.derivatives]
    for variable in new.about.modelVariables:
        if variable.causality in ("independent", "structuralParameter") or variable.name == "event_indicators":
            continue
        starts = None if variable.start is None else variable.start.split()
        for k, one in enumerate(new.elements[variable.name]):
            before = old[one]
            assert variable.type == TYPES[before.type], one
            for attribute in ("unit", "displayUnit", "min", "max", "causality", "variability"):
                assert getattr(variable, attribute) == getattr(before, attribute), (one, attribute)
            assert (starts[k] if starts else None) == before.start, one
            seen.add(one)
        nominals = {float(old[one].nominal or 1) for one in new.elements[variable.name]}
        if len(nominals) == 1:
            assert {float(variable.nominal or 1)} == nominals, variable.name
            assert variable.nominal or variable not in states, variable.name
    assert seen == set(old)


@each_name
def test_steps_give_the_bits_of_fmi_2(name: str, fmu3: Callable[[str], Fmu3], fmu: Callable[[str], Fmu]) -> None:
    """Without Event Mode, with the same inputs, new ones before each step."""
    old = fmu(name)
    inputs = at_ease(old) | varied(old, NUMBER)
    step = float(old.description.defaultExperiment.stepSize)
    outputs = fmu3(name).named(causality="output")
    with Unit3(fmu3(name)) as new, Unit(old) as before:
        for one, value in inputs.items():
            before[one] = value
        new.put(inputs)
        new.start()
        before.start()
        for k in range(10):
            moved = varied(old, NUMBER + k)
            new.put(moved)
            for one, value in moved.items():
                before[one] = value
            new.instance.doStep(k * step, step)
            before.step(k * step, step)
            for output in outputs:
                assert new[output] == [before[one] for one in new.fmu.elements[output]], output


@each_name
def test_rates_and_states_give_the_bits_of_fmi_2(name: str, fmu3: Callable[[str], Fmu3], fmu: Callable[[str], Fmu]) -> None:
    """In model exchange, at the start and where a solver tries other states."""
    old = fmu(name)
    inputs, count = varied(old, NUMBER), old.description.numberOfContinuousStates
    with Unit3(fmu3(name), exchange=True) as new, Exchange(old) as before:
        new.start(**inputs)
        before.start(**inputs)
        assert new.update() == before.settle()
        new.instance.enterContinuousTimeMode()
        for part in (1.0, 1.001):
            before.x = before.x * part
            x = (ctypes.c_double * count)(*before.x)
            new.instance.setContinuousStates(x, count)
            rates = (ctypes.c_double * count)()
            new.instance.getContinuousStateDerivatives(rates, count)
            assert list(rates) == list(before.rate())


@each_name
def test_derivatives_of_both_directions_agree(name: str, fmu3: Callable[[str], Fmu3], fmu: Callable[[str], Fmu]) -> None:
    """w·(J v) is (Jᵀ w)·v for directions at random, and J v has the bits of FMI 2.0."""
    old, new = fmu(name), fmu3(name)
    unknowns = [v for v in new.about.modelVariables if v.type == "Float64" and v.causality == "output"]
    unknowns += [v for v in new.about.modelVariables if v.name.startswith("der(")]
    knowns = [v for v in new.about.modelVariables if v.type == "Float64" and v.causality == "input"]
    states = {v.derivative.name: v.derivative for v in new.about.modelVariables if v.derivative is not None}
    knowns += [*states.values(), new.variables["time"]]
    if not unknowns or not knowns:
        return
    sizes = [sum(len(new.elements[v.name]) for v in some) for some in (unknowns, knowns)]
    random = np.random.default_rng(NUMBER)
    w, v = random.standard_normal(sizes[0]), random.standard_normal(sizes[1])
    references = [[one.valueReference for one in some] for some in (unknowns, knowns)]
    inputs = varied(old, NUMBER)
    with Unit3(new) as unit, Unit(old) as before:
        unit.start(**inputs)
        before.start(**inputs)
        forward = unit.instance.getDirectionalDerivative(*references, list(v), sizes[0])
        backward = unit.instance.getAdjointDerivative(*references, list(w), sizes[1])
        # FMI 2.0 has none by time.
        v_0 = list(v[:-1]) + [0.0]
        without_time = unit.instance.getDirectionalDerivative(*references, v_0, sizes[0])
        names = [[one for some in all_of for one in new.elements[some.name]] for all_of in (unknowns, knowns[:-1])]
        same = before.slave.getDirectionalDerivative(*[[before.reference(one) for one in some] for some in names], v_0[:-1])
    assert list(without_time) == list(same)
    terms = np.abs(w * np.array(forward)).sum() + np.abs(v * np.array(backward)).sum()
    assert abs(w @ np.array(forward) - v @ np.array(backward)) <= 1e-12 * max(terms, 1e-300)


@each_name
def test_elements_depend_on_elements_as_in_fmi_2(name: str, fmu3: Callable[[str], Fmu3], fmu: Callable[[str], Fmu]) -> None:
    """Of outputs and derivatives, while a simulation runs; and on time, which FMI 2.0 doesn't list."""
    new, structure = fmu3(name), fmu(name).description
    by_reference = {variable.valueReference: variable.name for variable in new.about.modelVariables}
    expected = {
        (one.variable.name, on.name) for one in [*structure.outputs, *structure.derivatives] for on in one.dependencies or []
    }
    found = set()
    with Unit3(new) as unit:
        unit.start(**varied(fmu(name), NUMBER))
        for variable in new.about.modelVariables:
            if variable.causality == "output" or variable.derivative is not None:
                own = new.elements[variable.name]
                for element, on, of, kind in dependencies(unit, variable.valueReference):
                    names = new.elements[by_reference[on]]
                    assert kind == 5
                    found.add((own[max(element, 1) - 1], names[max(of, 1) - 1]))
    assert {(one, on) for one, on in found if on != "time"} == expected


def test_fmpy_simulates_all_that_it_can(fmu3: Callable[[str], Fmu3], fmu: Callable[[str], Fmu]) -> None:
    """Co-simulation with and without Event Mode, and model exchange: the plant of example 3.2.1 for a second."""
    results = [
        fmpy.simulate_fmu(str(fmu3("NonlinearSiso").file), stop_time=1.0, output_interval=0.01, fmi_type=kind, **options)
        for kind, options in [
            ("CoSimulation", {}),
            ("CoSimulation", {"use_event_mode": True, "early_return_allowed": True}),
            ("ModelExchange", {"relative_tolerance": 1e-8}),
        ]
    ]
    before = fmpy.simulate_fmu(str(fmu("NonlinearSiso").path), stop_time=1.0, output_interval=0.01, fmi_type="CoSimulation")
    for result in results:
        columns = [result[name] for name in result.dtype.names if name != "time"]
        x = np.column_stack([column.reshape(len(column), -1) for column in columns])
        y = np.column_stack([before[name] for name in before.dtype.names if name != "time"])
        assert x.shape == y.shape
        assert np.abs(x - y).max() <= 1e-6 * (1 + np.abs(y).max())


def test_saved_states_continue_with_the_same_bits(fmu3: Callable[[str], Fmu3]) -> None:
    """As bytes, too, in another instance; a state saved in Event Mode is restored there."""
    unit = fmu3("L1SampledTwoLinkRobot")
    with Unit3(unit, event_mode=True) as one, Unit3(unit, event_mode=True) as other:
        for instance in (one, other):
            instance.start()
        saved = one.instance.getFMUState()
        stored = one.instance.serializeFMUState(saved)
        one.update()
        one.instance.enterStepMode()
        one.instance.doStep(0.0, 0.02)
        reached = one["u"]
        other.instance.setFMUState(other.instance.deserializeFMUState(stored))
        other.update()
        other.instance.enterStepMode()
        other.instance.doStep(0.0, 0.02)
        assert other["u"] == reached
        one.instance.setFMUState(saved)
        one.update()
        one.instance.enterStepMode()
        one.instance.doStep(0.0, 0.02)
        assert one["u"] == reached
        one.instance.freeFMUState(saved)


def test_samples_are_time_events(fmu3: Callable[[str], Fmu3]) -> None:
    """A sampled law tells when its next sample is due, asks for Event Mode there, acts on the inputs that are set in it, and ends a
    step early that goes beyond, where the master allows that."""
    unit = fmu3("L1SampledTwoLinkRobot")
    period = float(unit.variables["sample_time"].start)
    # A sample is due a little before its time, which masters round.
    about = lambda time: pytest.approx(time, rel=1e-6)
    with Unit3(unit, event_mode=True, early_return=True) as law:
        law.start()
        assert law.update() == about(period)
        law.instance.enterStepMode()
        needed, end, early, reached = law.instance.doStep(0.0, 0.4 * period)
        assert (needed, end, early, reached) == (False, False, False, 0.4 * period)
        needed, end, early, reached = law.instance.doStep(0.4 * period, period)
        assert (needed, end, early) == (True, False, True) and reached == about(period)
        before = law["u"]
        law.instance.enterEventMode()
        law.put({"x[1]": 0.1, "x[2]": -0.1})
        assert law.update() == about(2 * period)
        sampled = law["u"]
        law.instance.enterStepMode()
        assert sampled != before and law["u"] == sampled
    with Unit3(unit, event_mode=True) as law:
        law.start()
        law.update()
        law.instance.enterStepMode()
        _, _, early, reached = law.instance.doStep(0.0, 1.5 * period)
        assert (early, reached) == (False, 1.5 * period)


def test_inputs_of_the_first_event_mode_are_those_of_the_start(fmu3: Callable[[str], Fmu3]) -> None:
    """A master that sets no inputs in Initialization Mode: the first sample takes what it sets before the first update."""
    unit, inputs = fmu3("L1SampledNonlinearSiso"), {"x[1]": 0.3, "r[1]": 0.5}
    with Unit3(unit) as early, Unit3(unit, event_mode=True) as late:
        early.start(**inputs)
        late.start()
        late.put(inputs)
        late.update()
        assert late["u"] == early["u"] != [0.0]


def test_flags_that_change_ask_for_event_mode(fmu3: Callable[[str], Fmu3]) -> None:
    """Discrete variables are read at events: a flag that a step sets comes with one."""
    unit = fmu3("PidNonlinearSiso")
    with Unit3(unit, event_mode=True) as law:
        law["u_max"], law["u_min"] = 0.1, -0.1
        law.start(**{"r[1]": 5.0, "y[1]": 0.0})
        law.update()
        law.instance.enterStepMode()
        asked = []
        for k in range(3):
            before, needed = law["time_at_limit"], law.instance.doStep(0.01 * k, 0.01)[0]
            assert needed == (law["time_at_limit"] != before)
            asked.append(needed)
        assert asked == [False, True, True]


def test_a_discarded_step_can_be_tried_again(fmu3: Callable[[str], Fmu3]) -> None:
    """As if it had not been asked for."""
    unit = fmu3("NeuroPpfTwoLinkRobot")
    discard = next(int(item.value) for item in unit.variables["on_step_failure"].declaredType.items if item.name == "discard")
    with Unit3(unit) as law:
        law["on_step_failure"] = discard
        law.start()
        law.instance.doStep(0.0, 0.0005)
        before = law["x[1]"]
        # Far out of the funnel.
        law["x[1]"] = 50.0
        with pytest.raises(FMICallException) as error:
            law.instance.doStep(0.0005, 0.01)
        assert error.value.status == 2
        law["x[1]"] = before
        assert law.instance.doStep(0.0005, 0.0005) == (False, False, False, 0.001)


class Loop:
    """A loop of separate FMUs of FMI 3.0 whose master enters Event Mode at every communication point: all inputs are set there, in
    order, before a step is taken."""

    def __init__(self, name: str, fmu3: Callable[[str], Fmu3]) -> None:
        ssd = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
        ssv = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
        system = ElementTree.parse(ROOT / "examples" / name / "SystemStructure.ssd").getroot().find(f"{ssd}System")
        self.units = dict[str, Unit3]()
        for component in system.iter(f"{ssd}Component"):
            unit = Unit3(fmu3(Path(component.get("source")).stem), event_mode=True)
            files = [binding.get("source") for binding in component.iter(f"{ssd}ParameterBinding")]
            sets = [ElementTree.parse(ROOT / "examples" / name / file).getroot() for file in files if file]
            values = {p.get("name"): next(iter(p)) for given in (component, *sets) for p in given.iter(f"{ssv}Parameter")}
            unit.put({one: number(value, unit, one) for one, value in values.items()})
            self.units[component.get("name")] = unit
        self.wires = [
            (*(c.get(key) for key in ("startElement", "startConnector", "endElement", "endConnector")),)
            for c in system.iter(f"{ssd}Connection")
            if c.get("startElement") and c.get("endElement")
        ]

    def value(self, unit: str, element: str) -> float:
        """An element, by its name in FMI 2.0."""
        own = self.units[unit]
        name = next(name for name, all_of in own.fmu.elements.items() if element in all_of)
        return own[name][own.fmu.elements[name].index(element)]

    def exchange(self) -> None:
        """Sets all inputs, three times: what passes through a unit is then where it goes."""
        for _ in range(3):
            for source, output, target, value in self.wires:
                self.units[target].put({value: self.value(source, output)})

    def run(self, step: float, stop: float, watched: tuple[str, list[str]]) -> np.ndarray:
        for unit in self.units.values():
            unit.instance.enterInitializationMode(startTime=0.0)
        self.exchange()
        for unit in self.units.values():
            unit.instance.exitInitializationMode()
        rows = []
        for k in range(round(stop / step) + 1):
            self.exchange()
            for unit in self.units.values():
                unit.update()
            self.exchange()
            rows.append([self.value(watched[0], element) for element in watched[1]])
            for unit in self.units.values():
                unit.instance.enterStepMode()
                unit.instance.doStep(k * step, step)
                unit.instance.enterEventMode()
        return np.array(rows)

    def free(self) -> None:
        for unit in self.units.values():
            unit.instance.freeInstance()


def number(value: ElementTree.Element, unit: Unit3, element: str) -> float:
    """A value of a parameter set; an item of an enumeration as its number."""
    text = value.get("value")
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        items = unit.fmu.variables[element].declaredType.items
        return next(int(item.value) for item in items if item.name == text)


def test_event_mode_takes_the_delay_out_of_a_loop(fmu3: Callable[[str], Fmu3], ran: Callable[..., Ran]) -> None:
    """Example 3.3.1 case 2 in steps of 4 ms, all FMUs together: the torques' peaks come nearer to those of the continuous loop."""
    torques = ["u[1]", "u[2]"]
    loop = Loop("3.3.1-case2", fmu3)
    try:
        found = np.abs(loop.run(0.004, 2.0, ("controller", torques))).max(axis=0)
    finally:
        loop.free()

    def peaks(*options: str | float) -> np.ndarray:
        _, recorded = ran("3.3.1-case2", *options)
        early = recorded["time"] <= 2.0
        return np.array([np.abs(recorded[f"controller.{torque}"][early]).max() for torque in torques])

    continuous, of_fmi_2 = peaks("--composite"), peaks("--order", "jacobi", "--step", 0.004)
    assert found[0] == pytest.approx(continuous[0], rel=0.03)
    assert np.all(found - continuous <= 0.4 * (of_fmi_2 - continuous)) and np.all(of_fmi_2 > 1.5 * continuous)
    documented = re.findall(r"^\| .* \| (\d+), (\d+) \|$", (ROOT / "docs" / "fmi3.md").read_text(), re.MULTILINE)
    measured = [of_fmi_2, peaks("--order", "gauss-seidel", "--step", 0.004), found, continuous]
    np.testing.assert_allclose(np.array(documented, dtype=float), measured, rtol=0.01)


def test_a_composite_is_one_fmu(tmp_path: Path, ran: Callable[..., Ran]) -> None:
    """Its components' vectors are arrays, and its torques are those of the loop as one FMU."""
    exported = adaptive_fmu("export", "--fmi", "3", "--composite", "3.3.1-case2", "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    file = str(tmp_path / "Loop_3_3_1_case2.fmu")
    assert validate_fmu(file) == []
    found = fmpy.simulate_fmu(file, stop_time=2.0, step_size=0.01, output_interval=0.01, fmi_type="CoSimulation")
    _, recorded = ran("3.3.1-case2", "--composite", "--step", 0.01)
    for k, torque in enumerate(found["controller.u"].T):
        np.testing.assert_allclose(torque, recorded[f"controller.u[{k + 1}]"][: len(torque)], rtol=0, atol=1e-3)


@pytest.fixture
def refused(fmu3: Callable[[str], Fmu3], capfd: pytest.CaptureFixture[str]) -> Iterator[Callable[..., str]]:
    """What an instance logs as it refuses a call."""

    def call(what: Callable[[], object]) -> str:
        capfd.readouterr()
        with pytest.raises(FMICallException):
            what()
        return "".join(capfd.readouterr())

    yield call


def test_what_is_refused_is_named(fmu3: Callable[[str], Fmu3], refused: Callable[..., str]) -> None:
    """Numbers of values, elements of arrays, types, modes: with the function's name in FMI 3.0, and nothing changed."""
    unit = fmu3("L1TwoLinkRobot")
    with Unit3(unit) as law:
        r = law.reference("r")
        assert "fmi3SetFloat64: nValues = 3, but these variables have 2 values" in refused(
            lambda: law.instance.setFloat64([r], [0.0] * 3)
        )
        assert "`r[2]` is an element of an array" in refused(lambda: law.instance.setFloat64([r + 1], [0.0]))
        choice = law.reference("integration_method")
        assert "fmi3SetInt32: `integration_method`" in refused(lambda: law.instance.setInt32([choice], [1]))
        assert "is no item" in refused(lambda: law.instance.setInt64([choice], [99]))
        assert "`r[2]` = NaN must be a finite number" in refused(lambda: law.instance.setFloat64([r], [0.0, math.nan]))
        assert "no structural parameters" in refused(lambda: law.instance.enterConfigurationMode())
        assert law["r"] == [0.0, 0.0]
        assert "calculated values are available from Initialization Mode on" in refused(lambda: law["u"])
        law.start()
        assert "fmi3EnterEventMode: the instance was made with eventModeUsed = false" in refused(
            lambda: law.instance.enterEventMode()
        )
        assert "fmi3DoStep: communicationStepSize = -1" in refused(lambda: law.instance.doStep(0.0, -1.0))
        assert "no variable of type Float32" in refused(lambda: law.instance.getFloat32([0], 1))
        law.instance.doStep(0.0, 0.001)


def calls_at_random(unit: Unit3, random: np.random.Generator) -> None:
    """A call of any function, with references, numbers of values and numbers that may be none."""
    instance = unit.instance
    known = [variable.valueReference for variable in unit.fmu.about.modelVariables]
    references = [int(random.choice([*known, max(known) + 1, 2**32 - 1])) for _ in range(random.integers(3))]
    values = [float(random.choice([0.0, 1.0, -1e3, math.nan, math.inf])) for _ in range(random.integers(5))]
    point = float(random.choice([0.0, 0.001, 0.002, -1.0, math.nan]))
    calls = [
        lambda: instance.getFloat64(references, len(values)),
        lambda: instance.setFloat64(references, values),
        lambda: instance.getInt64(references, len(values)),
        lambda: instance.setInt64(references, [int(value) if math.isfinite(value) else 7 for value in values]),
        lambda: instance.getBoolean(references, len(values)),
        lambda: instance.setInt32(references, [1] * len(values)),
        lambda: instance.getDirectionalDerivative(references, references[:1], values, len(references)),
        lambda: instance.getAdjointDerivative(references, references[:1], values, len(references)),
        lambda: instance.getOutputDerivatives(references, [1] * len(references)),
        lambda: dependencies(unit, references[0] if references else 0),
        lambda: instance.enterInitializationMode(startTime=0.0),
        lambda: instance.exitInitializationMode(),
        lambda: instance.enterEventMode(),
        lambda: instance.updateDiscreteStates(),
        lambda: instance.enterStepMode(),
        lambda: instance.doStep(point, 0.001),
        lambda: instance.reset(),
        lambda: instance.enterConfigurationMode(),
        lambda: instance.fmi3EvaluateDiscreteStates(instance.component),
        lambda: instance.terminate(),
    ]
    try:
        calls[random.integers(len(calls))]()
    except FMICallException as error:
        assert error.status in (2, 3)


@pytest.mark.parametrize("name", FMUS[NUMBER % 3 :: 3])
def test_calls_at_random_are_answered(name: str, fmu3: Callable[[str], Fmu3], capfd: pytest.CaptureFixture[str]) -> None:
    """In any order, with anything: each is answered, no fault is reported, and the instance can be reset and used."""
    random = np.random.default_rng(NUMBER)
    with Unit3(fmu3(name), event_mode=bool(NUMBER % 2)) as unit:
        for _ in range(300):
            calls_at_random(unit, random)
        unit.instance.reset()
        unit.start()
    assert "internal fault" not in "".join(capfd.readouterr())


def test_pointers_that_are_null_are_refused(fmu3: Callable[[str], Fmu3], capfd: pytest.CaptureFixture[str]) -> None:
    """With the function's own name."""
    with Unit3(fmu3("NonlinearSiso")) as unit:
        unit.start()
        component, instance = unit.instance.component, unit.instance
        for call in (
            lambda: instance.fmi3GetFloat64(component, None, 1, None, 1),
            lambda: instance.fmi3DoStep(component, 0.0, 0.1, True, None, None, None, None),
            lambda: instance.fmi3GetFMUState(component, None),
        ):
            capfd.readouterr()
            with pytest.raises(FMICallException):
                call()
            assert "fmi3" in (output := "".join(capfd.readouterr())) and "a pointer is NULL" in output and "fmi2" not in output
