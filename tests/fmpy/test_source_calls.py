"""The same calls, sensible and not, go to a unit of the generic form and to one compiled from its source: both answer alike,
bit for bit, and say the same."""

import ctypes
import random
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import adaptive_fmu
from fmpy.fmi1 import FMICallException
from master import Exchange, Fmu, Unit, refused

# A plant, a controller that says much, time events, states of any kind and none.
NAMES = ["TwoLinkRobot", "L1NonlinearSiso", "MracPpfCoupledMimo", "Actuator", "Reference"]
CALLS = 300
NO_NUMBERS = [float("nan"), float("inf"), -1e300]
NO_REFERENCES = [10**6, 2**32 - 1]


@pytest.fixture(scope="module")
def compiled_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """FMUs with libraries that are compiled from their sources."""
    folder = tmp_path_factory.mktemp("compiled")
    exported = adaptive_fmu("export", "--compile", *NAMES, "PidNonlinearSiso", "--out", folder)
    assert exported.returncode == 0, exported.stderr
    return folder


def bits(numbers: list[float]) -> bytes:
    """What they are, bit by bit; all that are no numbers are alike."""
    return struct.pack(f"{len(numbers)}d", *(number if number == number else float("nan") for number in numbers))


class Pair:
    """A unit in both forms, and a person at random who calls them."""

    def __init__(self, forms: list[Unit], seed: int) -> None:
        self.forms, self.numbers, self.log = forms, random.Random(seed), list[str]()
        self.time, self.step = 0.0, self.numbers.choice([1e-3, 1e-2])
        self.saved: dict[int, tuple[list[Any], float]] = {}
        variables = forms[0].fmu.variables.values()
        designed = {v.name for v in forms[1].fmu.variables.values() if v.variability == "constant"}
        free = [v for v in variables if v.name not in designed and v.name != "integration_method"]
        self.designed = {v.valueReference for v in variables if v.name in designed}
        self.reals = [v for v in free if v.type == "Real"]
        self.others = [v for v in free if v.type != "Real"]
        self.inputs = [v for v in self.reals if v.causality == "input"]
        self.outputs = [v for v in self.reals if v.causality == "output"]
        self.tunable = [v for v in self.reals if v.variability == "tunable"]

    def ask(self, what: str, call: Callable[[Unit], Any]) -> Any:
        """The answer of both, which is the same."""
        answers = [self._answer(unit, call) for unit in self.forms]
        self.log.append(f"{what}: {answers[0]}")
        assert answers[0] == answers[1], "\n".join(self.log[-8:])
        return answers[0][0]

    @staticmethod
    def _answer(unit: Unit, call: Callable[[Unit], Any]) -> tuple[Any, list]:
        count = len(unit.messages)
        try:
            answer = call(unit)
        except FMICallException as refusal:
            answer = refusal.status
        return answer, unit.messages[count:]

    def reference(self, known: list) -> int:
        """A value reference of one of these variables, or, now and then, of any or none."""
        if known and self.numbers.random() < 0.95:
            return self.numbers.choice(known).valueReference
        reference = self.numbers.choice([*NO_REFERENCES, self.numbers.randrange(300)])
        return NO_REFERENCES[0] if reference in self.designed else reference

    def number(self, number: float) -> float:
        """This number, or, now and then, none."""
        return self.numbers.choice(NO_NUMBERS) if self.numbers.random() < 0.03 else number

    def small(self) -> float:
        return self.number(self.numbers.uniform(-0.1, 0.1))

    def set_input(self) -> None:
        reference, value = self.reference(self.inputs), self.small()
        self.ask(f"set {reference} = {value}", lambda unit: unit.slave.setReal([reference], [value]))

    def get(self) -> None:
        references = [self.reference(self.reals) for _ in range(self.numbers.randrange(4))]
        self.ask(f"get {references}", lambda unit: bits(unit.slave.getReal(references)))

    def tune(self) -> None:
        if self.tunable:
            variable = self.numbers.choice(self.tunable)
            value = self.number(float(variable.start or 1.0) * self.numbers.choice([1.0, 1.01, -1.0, 0.0]))
            reference = variable.valueReference
            self.ask(f"{variable.name} = {value}", lambda unit: unit.slave.setReal([reference], [value]))

    def use_integers(self) -> None:
        reference, value = self.reference(self.others), self.numbers.choice([-1, 0, 1, 2, 3])
        get, set_ = self.numbers.choice([("getInteger", "setInteger"), ("getBoolean", "setBoolean")])
        if self.numbers.random() < 0.5:
            self.ask(f"{get} {reference}", lambda unit: list(map(int, getattr(unit.slave, get)([reference]))))
        else:
            self.ask(f"{set_} {reference} = {value}", lambda unit: getattr(unit.slave, set_)([reference], [value]))

    def differentiate(self) -> None:
        of, by = [self.reference(self.outputs)], [self.reference(self.inputs)]
        seed = [self.small()]
        # A derivative of 0 has no sign that counts.
        self.ask(
            f"d{of}/d{by}",
            lambda unit: bits([slope + 0.0 for slope in unit.slave.getDirectionalDerivative(of, by, seed)]),
        )

    def use_slopes(self) -> None:
        order, value = self.numbers.choice([1, 1, 1, 0, 2]), self.small()
        input_, output = self.reference(self.inputs), self.reference(self.outputs)
        self.ask(f"slope {input_}", lambda unit: unit.slave.setRealInputDerivatives([input_], [order], [value]))
        self.ask(f"slope of {output}", lambda unit: bits(unit.slave.getRealOutputDerivatives([output], [order])))

    def save_or_restore(self) -> None:
        if not self.saved or self.numbers.random() < 0.4:
            states: list[Any] = []
            if self.ask("save", lambda unit: states.append(unit.slave.getFMUstate())) is None:
                self.saved[len(self.log)] = states, self.time
            return
        states, time = self.saved[self.numbers.choice(list(self.saved))]
        of = lambda unit: states[self.forms.index(unit)]  # noqa: E731
        if self.ask("restore", lambda unit: unit.slave.setFMUstate(of(unit))) is None:
            self.time = time

    def spoil(self) -> None:
        """A byte of a saved state is wrong."""
        if self.saved:
            states, _ = self.numbers.choice(list(self.saved.values()))
            place, bit = self.numbers.randrange(8, 10**6), 1 << self.numbers.randrange(8)

            def read(unit: Unit) -> None:
                written = bytearray(unit.slave.serializeFMUstate(states[self.forms.index(unit)]))
                written[place % len(written)] ^= bit
                unit.slave.deSerializeFMUstate(bytes(written))

            self.ask(f"byte {place}", read)

    def go_on(self) -> None:
        """A step, seldom one that can't be."""
        wrong = self.numbers.random() < 0.1
        near = self.time + self.numbers.choice([-9e-4, 9e-4]) * self.step
        time = self.numbers.choice([0.0, self.time + 1.0, near, self.number(self.time)]) if wrong else self.time
        step = self.numbers.choice([0.0, -1.0, 1e-300, self.step / 3]) if wrong else self.step
        if self.ask(f"step {time} + {step}", lambda unit: unit.slave.doStep(time, step)) == 0:
            self.time = time + step

    def begin(self) -> None:
        name = self.numbers.choice(["enterInitializationMode", "exitInitializationMode"])
        self.ask(name, lambda unit: getattr(unit.slave, name)())

    def end(self) -> None:
        name = self.numbers.choice(["terminate", "reset"])
        if self.ask(name, lambda unit: getattr(unit.slave, name)()) == 0 and name == "reset":
            self.time = 0.0

    def set_up(self) -> None:
        stop, tolerance, start = (self.number(value) for value in (5.0, 1e-5, 0.0))
        self.ask(f"set up {start} … {stop}", lambda unit: unit.slave.setupExperiment(tolerance, start, stop))

    def call(self, of_the_interface: list[Callable[[], None]]) -> None:
        often = [self.set_input, self.get, *3 * of_the_interface]
        sometimes = [self.tune, self.use_integers, self.differentiate, self.save_or_restore]
        seldom = [self.spoil, self.begin, self.set_up, self.end]
        weights = [6] * len(often) + [2] * len(sometimes) + [0.3] * len(seldom)
        self.numbers.choices([*often, *sometimes, *seldom], weights)[0]()


class ExchangePair(Pair):
    """The same in model exchange."""

    def event(self) -> None:
        update = lambda unit: tuple(unit.slave.newDiscreteStates())  # noqa: E731
        self.ask("event", lambda unit: unit.slave.enterEventMode())
        self.ask("update", update)
        self.ask("continue", lambda unit: unit.slave.enterContinuousTimeMode())

    def integrate(self) -> None:
        time, change = self.number(self.time + self.step), self.numbers.uniform(-1e-3, 1e-3)

        def move(unit: Unit) -> bytes:
            unit.slave.setTime(time)
            unit.x = unit.x + change
            return bits(unit.rate().tolist())

        self.ask(f"move to {time}", move)
        self.time += self.step

    def complete(self) -> None:
        self.ask("complete", lambda unit: tuple(unit.slave.completedIntegratorStep()))

    def indicate(self) -> None:
        count = self.forms[0].fmu.description.numberOfEventIndicators
        values = (ctypes.c_double * max(count, 1))()

        def read(unit: Unit) -> bytes:
            unit.slave.getEventIndicators(values, count)
            return bits(list(values))

        self.ask("indicators", read)


@pytest.fixture
def forms(request: pytest.FixtureRequest, fmu, compiled_folder: Path, tmp_path: Path) -> Iterator[Callable]:
    """Makes a unit in both forms."""
    made: list[Unit] = []

    def make(kind: type[Unit], name: str) -> list[Unit]:
        for form in (fmu(name), Fmu(compiled_folder / f"{name}.fmu", tmp_path)):
            made.append(kind(form, name, logging=True))
            if "integration_method" in form.variables:
                made[-1]["integration_method"] = "explicit"
        return made

    yield make
    for unit in made:
        unit.free()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", NAMES)
def test_co_simulation_is_the_same_at_any_calls(name: str, seed: int, forms: Callable) -> None:
    pair = Pair(forms(Unit, name), seed)
    for k in range(CALLS):
        if k in (5, 15) and seed > 0:
            pair.ask("begin", lambda unit, k=k: [unit.slave.enterInitializationMode, unit.slave.exitInitializationMode][k > 5]())
        pair.call([pair.go_on, pair.go_on, pair.use_slopes])


@pytest.mark.parametrize("name", ["L1NonlinearSiso", "Reference"])
def test_integers_of_a_saved_state_that_no_instance_has_are_refused_alike(name: str, forms: Callable) -> None:
    """With a checksum that fits. Their number stands before the values, which end the bytes."""
    pair, checksum, count = Pair(forms(Unit, name), 0), slice(12, 16), slice(50, 58)
    for unit in pair.forms:
        unit.start()

    def forged(place: int, value: int) -> Any:
        def read(unit: Unit) -> None:
            written = bytearray(unit.slave.serializeFMUstate(unit.slave.getFMUstate()))
            first = len(written) - 4 * (int.from_bytes(written[count], "little") - place)
            written[first : first + 4] = struct.pack("<i", value)
            written[checksum] = struct.pack("<I", zlib.crc32(written[checksum.stop :]))
            unit.slave.deSerializeFMUstate(bytes(written))

        return pair.ask(f"integer {place} = {value}", read)

    written = pair.forms[0].slave.serializeFMUstate(pair.forms[0].slave.getFMUstate())
    places = range(int.from_bytes(written[count], "little"))
    refused = [forged(place, value) == 3 for place in places for value in (-(2**31), 2_000_000_000)]
    assert sum(refused) > len(places) and all(forged(place, 1) is None for place in places)
    if "fixed_steps" in pair.forms[0].fmu.variables:
        reference = pair.forms[0].fmu.variables["fixed_steps"].valueReference
        reals = int.from_bytes(written[42:50], "little")
        assert forged(reference - reals, 500_000_000) == 3
        assert "fixed_steps = 500000000: must be within 1 … 10000" in pair.forms[1].messages[-1].text


def test_both_round_the_step_that_they_advise_down(forms: Callable) -> None:
    messages = []
    for unit in forms(Unit, "PidNonlinearSiso"):
        unit["K_p[1]"], unit["K_i[1]"], unit["K_d[1]"] = 2.0, 0.0, 0.0
        unit.start()
        for k in range(40):
            unit["y[1]"] = -(0.812**k)
            unit.step(k * 1e-3, 1e-3)
        messages.append([message.text for message in unit.messages if message.category == "logStepTooLong"])
    # 0.65 of the limit of 0.13 over a move of 0.188: 4.49e-4 s.
    assert messages[0] == messages[1] and "Try 4.4e-4 s or less" in messages[0][0]


@pytest.mark.parametrize("clock", ["single precision", "microseconds"])
def test_both_follow_a_host_whose_clock_is_coarse_and_log_it_once(clock: str, forms: Callable) -> None:
    read = {"single precision": lambda t: float(np.float32(t)), "microseconds": lambda t: round(t, 6)}[clock]
    answers = []
    for unit in forms(Unit, "TwoLinkRobot"):
        unit.start(time=0.7)
        for k in range(1610):
            unit["u[1]"] = 20.0 if k % 40 < 20 else -20.0
            unit.step(read(0.7 + k / 700), 1 / 700)
        # Not before the point of the last step, whatever the step.
        end = read(0.7 + 1609 / 700) + 1 / 700
        unit.step(end, 1e-6)
        refusal = refused(unit.step, end - 1e-5, 1.0)
        answers.append((unit["x[1]"], unit["x[2]"], [*map(str, unit.messages)], str(refusal.status)))
    assert answers[0] == answers[1]
    warnings = [message for message in answers[0][2] if "logStatusWarning" in message]
    assert len(warnings) == 1 and "currentCommunicationPoint = " in warnings[0], warnings
    assert "is before that of the last step" in answers[0][2][-1]


@pytest.mark.parametrize("method", ["automatic", "stiff", "fixed"])
def test_both_log_the_integration_method_and_the_eigenvalue_that_decided(method: str, forms: Callable) -> None:
    messages = []
    for unit in forms(Unit, "TwoLinkRobot"):
        unit["integration_method"] = method
        unit.start()
        for k in range(200):
            unit["u[1]"] = 50.0 if k % 40 < 20 else -50.0
            unit.step(k * 0.01, 0.01)
        messages.append(unit.messages)
    assert messages[0] == messages[1]
    texts = [message.text for message in messages[0] if "integrated by" in message.text]
    assert texts and ("eigenvalue" in texts[0] if method == "automatic" else "as integration_method asks" in texts[0])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", NAMES)
def test_model_exchange_is_the_same_at_any_calls(name: str, seed: int, forms: Callable) -> None:
    pair = ExchangePair(forms(Exchange, name), seed)
    for k in range(CALLS):
        if k in (5, 15) and seed > 0:
            pair.ask("begin", lambda unit, k=k: [unit.slave.enterInitializationMode, unit.slave.exitInitializationMode][k > 5]())
        pair.call([pair.event, pair.integrate, pair.complete, pair.indicate])
