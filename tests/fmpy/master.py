"""A small master on FMPy: units by variable names, closed loops of any units, and that of example 3.2.1."""

import functools
import json
import os
import subprocess
import tomllib
from ctypes import POINTER, c_double, c_int, c_uint
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.model_description import ModelDescription, ScalarVariable

ROOT = Path(__file__).resolve().parents[2]
REFERENCE, PLANT, CONTROLLER = "ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso"


class Fmu:
    """An unpacked FMU with its description."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path, self.folder = path, folder
        fmpy.extract(str(path), str(folder))
        self.description: ModelDescription = fmpy.read_model_description(str(path))
        self.name: str = self.description.modelName
        self.variables: dict[str, ScalarVariable] = {v.name: v for v in self.description.modelVariables}

    def named(self, **attributes: str) -> list[str]:
        """Names of the variables with these attributes, say `causality="input"`."""
        fits = lambda v: all(getattr(v, key) == value for key, value in attributes.items())  # noqa: E731
        return [v.name for v in self.variables.values() if fits(v)]

    def item(self, name: str, item: str) -> int:
        """The number of an item of an enumeration."""
        return next(int(known.value) for known in self.variables[name].declaredType.items if known.name == item)


@functools.cache
def trials() -> dict[str, dict[str, dict[str, float | str]]]:
    """Start values for tests that each kind of system gives, by what they are for."""
    program = os.environ.get("ADAPTIVE_FMU_PROGRAM")
    command = [program] if program else ["cargo", "run", "--release", "-q", "--"]
    output = subprocess.run([*command, "list", "--json"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {kind["name"]: kind["trial"] for kind in json.loads(output)["kinds"]}


def tried(fmu: Fmu, *purposes: str) -> dict[str, float]:
    """Those of its kind's start values for tests that a unit has; an item of an enumeration as its number."""
    description = fmu.folder / "resources" / "description.toml"
    kind = tomllib.loads(description.read_text())["model"] if description.is_file() else ""
    given: dict[str, float | str] = {}
    for purpose in purposes:
        given |= trials().get(kind, {}).get(purpose, {})
    names = fmu.named(causality="parameter") + fmu.named(causality="input")
    values = {name: given.get(name, given.get(name.split("[")[0])) for name in names}
    number = lambda name, value: fmu.item(name, value) if isinstance(value, str) else value  # noqa: E731
    return {name: number(name, value) for name, value in values.items() if value is not None}


def at_ease(fmu: Fmu) -> dict[str, float]:
    """Values by which a unit stands inputs that no plant answers, at any step: wide funnels, gentle gains."""
    return tried(fmu, "alone", "smooth")


@dataclass(frozen=True)
class Message:
    """What a unit logged."""

    status: int
    category: str
    text: str


class Unit:
    """An instance of an FMU whose values are read and set by name; an enumeration takes its item's name, too."""

    interface: type[FMU2Slave] | type[FMU2Model] = FMU2Slave

    def __init__(self, fmu: Fmu, name: str = "unit", logging: bool = False) -> None:
        self.fmu, self.messages = fmu, list[Message]()
        self.slave = self.interface(
            instanceName=name,
            guid=fmu.description.guid,
            modelIdentifier=fmu.description.coSimulation.modelIdentifier,
            unzipDirectory=str(fmu.folder),
        )
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)
        self.slave.instantiate(callbacks=self._callbacks, loggingOn=logging)

    def _log(self, _environment: int, _name: bytes, status: int, category: bytes, text: bytes) -> None:
        self.messages.append(Message(status, category.decode(), text.decode()))

    def free(self) -> None:
        """Frees the instance, once."""
        if self.slave is not None:
            self.slave.freeInstance()
            self.slave = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.free()

    def reference(self, name: str) -> int:
        """Value reference of a variable."""
        return self.fmu.variables[name].valueReference

    def __getitem__(self, name: str) -> float:
        kind, reference = self.fmu.variables[name].type, [self.reference(name)]
        if kind == "Real":
            return self.slave.getReal(reference)[0]
        return self.slave.getBoolean(reference)[0] if kind == "Boolean" else self.slave.getInteger(reference)[0]

    def __setitem__(self, name: str, value: float | str) -> None:
        variable, reference = self.fmu.variables[name], [self.reference(name)]
        if variable.type == "Real":
            self.slave.setReal(reference, [value])
        elif variable.type == "Boolean":
            self.slave.setBoolean(reference, [value])
        else:
            if isinstance(value, str):
                value = next(int(item.value) for item in variable.declaredType.items if item.name == value)
            self.slave.setInteger(reference, [value])

    def everything(self) -> dict[str, float]:
        """All values."""
        return {name: self[name] for name in self.fmu.variables}

    def start(self, time: float = 0.0, stop: float | None = None, tolerance: float | None = None, **inputs) -> Self:
        """Goes through Initialization Mode, in which these inputs are set."""
        self.slave.setupExperiment(startTime=time, stopTime=stop, tolerance=tolerance)
        self.slave.enterInitializationMode()
        for name, value in inputs.items():
            self[name] = value
        self.slave.exitInitializationMode()
        return self

    def step(self, time: float, step: float) -> None:
        """One communication step."""
        self.slave.doStep(time, step)

    def slope(self, name: str) -> float:
        """Time derivative of an output."""
        return self.slave.getRealOutputDerivatives([self.reference(name)], [1])[0]

    def set_slope(self, name: str, slope: float) -> None:
        """Rate of an input during the next step."""
        self.slave.setRealInputDerivatives([self.reference(name)], [1], [slope])


def duration(fmu: Fmu, inputs: dict[str, float]) -> float:
    """While the fastest oscillation turns through 200 rad, where a unit has one; else 1 s or its experiment, if shorter."""
    if "adaptation_frequency" not in fmu.variables:
        return min(1.0, float(fmu.description.defaultExperiment.stopTime))
    time, phase = 0.0, 0.0
    with Unit(fmu) as unit:
        unit.start(**inputs)
        while phase < 200.0:
            frequency = unit["adaptation_frequency"]
            unit.step(time, 1 / frequency)
            # It grows, for no plant answers.
            time, phase = time + 1 / frequency, phase + max(1.0, unit["adaptation_frequency"] / frequency)
    return time


class Exchange(Unit):
    """An instance for model exchange: what solves it has its states, and reads their derivatives."""

    interface = FMU2Model

    def __init__(self, fmu: Fmu, name: str = "unit", logging: bool = False) -> None:
        super().__init__(fmu, name, logging)
        self.states = fmu.description.numberOfContinuousStates

    def settle(self) -> float | None:
        """Updates discrete states until none changes, and goes on to Continuous-Time Mode; the next time event."""
        again = True
        while again:
            again, end, _, _, event_known, event = self.slave.newDiscreteStates()
            assert not end
        self.slave.enterContinuousTimeMode()
        return event if event_known else None

    @property
    def x(self) -> np.ndarray:
        """The continuous states."""
        x = np.empty(self.states)
        self.slave.getContinuousStates(x.ctypes.data_as(POINTER(c_double)), self.states)
        return x

    @x.setter
    def x(self, x: np.ndarray) -> None:
        x = np.ascontiguousarray(x, dtype=float)
        self.slave.setContinuousStates(x.ctypes.data_as(POINTER(c_double)), self.states)

    def rate(self) -> np.ndarray:
        """The derivatives of the states."""
        dx = np.empty(self.states)
        self.slave.getDerivatives(dx.ctypes.data_as(POINTER(c_double)), self.states)
        return dx


class Values:
    """Some variables of a unit of one type, read or set together without looking them up again."""

    _NUMBERS = {"Real": (c_double, float), "Integer": (c_int, np.intc), "Boolean": (c_int, np.intc)}

    def __init__(self, unit: Unit, names: list[str], kind: str = "Real") -> None:
        number, array = self._NUMBERS[kind]
        self.values = np.zeros(len(names), array)
        self._slave, self._count = unit.slave, len(names)
        self._get, self._set = (getattr(unit.slave, f"fmi2{word}{kind}") for word in ("Get", "Set"))
        self._references = (c_uint * len(names))(*map(unit.reference, names))
        self._pointer = (number * len(names)).from_buffer(self.values)

    def get(self) -> None:
        """Reads them into `values`."""
        self._get(self._slave.component, self._references, self._count, self._pointer)

    def set(self) -> None:
        """Sets them from `values`."""
        self._set(self._slave.component, self._references, self._count, self._pointer)


@dataclass
class Loop:
    """What was recorded of a closed loop at every communication point: `loop["plant.y[1]"]`."""

    time: np.ndarray
    signals: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[name]

    # The signals of example 3.2.1.
    @property
    def r(self) -> np.ndarray:
        return self["reference.r[1]"]

    @property
    def x(self) -> np.ndarray:
        return np.column_stack([self["plant.x[1]"], self["plant.x[2]"]])

    @property
    def y(self) -> np.ndarray:
        return self["plant.y[1]"]

    @property
    def u(self) -> np.ndarray:
        return self["controller.u[1]"]

    def same_as(self, other: "Loop") -> bool:
        """Whether all of it is equal, bit for bit."""
        same = self.time.tobytes() == other.time.tobytes() and self.signals.keys() == other.signals.keys()
        return same and all(values.tobytes() == other[name].tobytes() for name, values in self.signals.items())

    def part(self, first: int, last: int) -> "Loop":
        """The communication points from one to the other, both included."""
        chosen = slice(first, last + 1)
        return Loop(self.time[chosen], {name: values[chosen] for name, values in self.signals.items()})

    def followed_by(self, later: "Loop") -> "Loop":
        """With a run that begins where this one ends."""
        signals = {name: np.concatenate([values, later[name][1:]]) for name, values in self.signals.items()}
        return Loop(np.concatenate([self.time, later.time[1:]]), signals)


Connections = list[tuple[str, str]]


class ClosedLoop:
    """Units by their names and connections between their real variables: ("plant.y[1]", "controller.y[1]")."""

    def __init__(self, units: dict[str, Unit], connections: Connections) -> None:
        self.units = units
        self._outputs = {name: self._outputs_of(unit) for name, unit in units.items()}
        self.signals = [f"{name}.{v}" for name, parts in self._outputs.items() for names, _ in parts for v in names]
        ends = [[end.split(".", 1) for end in connection] for connection in connections]
        inputs = {name: [variable for _, (unit, variable) in ends if unit == name] for name in units}
        self._inputs = {name: Values(unit, inputs[name]) for name, unit in units.items()}
        # What each unit is handed: buffer and place of the output, place of the input.
        self._links: dict[str, list[tuple[np.ndarray, int, int]]] = {name: [] for name in units}
        for (source, output), (target, _) in ends:
            names, reals = next(part for part in self._outputs[source] if output in part[0])
            assert reals.values.dtype == float, f"{source}.{output} is no real variable"
            self._links[target].append((reals.values, names.index(output), len(self._links[target])))

    @staticmethod
    def _outputs_of(unit: Unit) -> list[tuple[list[str], Values]]:
        """The outputs of a unit, those of a type together."""
        named = [(unit.fmu.named(causality="output", type=kind), kind) for kind in ("Real", "Integer", "Boolean")]
        return [(names, Values(unit, names, kind)) for names, kind in named if names]

    def take(self, name: str, read_again: bool = False) -> None:
        """Hands a unit its inputs; `read_again` reads its outputs once more after that, as OMSimulator does."""
        inputs = self._inputs[name]
        for source, i, j in self._links[name]:
            inputs.values[j] = source[i]
        inputs.set()
        if read_again:
            self.give(name)

    def give(self, name: str) -> None:
        """Reads a unit's outputs."""
        for _, values in self._outputs[name]:
            values.get()

    def _row(self) -> np.ndarray:
        return np.concatenate([values.values for parts in self._outputs.values() for _, values in parts])

    def forget(self) -> None:
        """Hands on nothing of an earlier run."""
        for values in [*(values for parts in self._outputs.values() for _, values in parts), *self._inputs.values()]:
            values.values.fill(0)

    def start(self, time: float = 0.0, stop: float | None = None, inputs_set: bool = True) -> Self:
        """Initialises all units, with or without handing on values in Initialization Mode."""
        for unit in self.units.values():
            unit.slave.setupExperiment(startTime=time, stopTime=stop)
            unit.slave.enterInitializationMode()
        for _ in self.units if inputs_set else []:
            for name in self.units:
                self.take(name)
                self.give(name)
        for unit in self.units.values():
            unit.slave.exitInitializationMode()
        for name in self.units:
            self.give(name)
        return self

    def run(
        self,
        stop: float,
        step: float,
        order: str = "gauss-seidel",
        start: float = 0.0,
        first: int = 0,
        read_again: bool = False,
    ) -> Loop:
        """Steps all units, from communication point `first` on."""
        count = round((stop - start) / step)
        times = start + step * np.arange(first, count + 1)
        return self.follow(times, np.diff(times), order, read_again)

    def follow(self, times: np.ndarray, steps: np.ndarray, order: str, read_again: bool = False) -> Loop:
        """Steps all units from one of these times to the next, by these steps."""
        rows = np.empty((len(times), len(self.signals)))
        rows[0] = self._row()
        for k, (time, duration) in enumerate(zip(times[:-1].tolist(), steps.tolist(), strict=True)):
            if order == "jacobi":
                for name in self.units:
                    self.take(name, read_again)
            for name, unit in self.units.items():
                if order == "gauss-seidel":
                    self.take(name, read_again)
                unit.step(time, duration)
                if order == "gauss-seidel":
                    self.give(name)
            if order == "jacobi":
                for name in self.units:
                    self.give(name)
            rows[k + 1] = self._row()
        return Loop(times, {name: rows[:, place].copy() for place, name in enumerate(self.signals)})


def example(reference: Unit, plant: Unit, controller: Unit) -> ClosedLoop:
    """Example 3.2.1."""
    connections = [(f"plant.{x}", f"controller.{x}") for x in ("x[1]", "x[2]")]
    connections += [("reference.r[1]", "controller.r[1]"), ("controller.u[1]", "plant.u[1]")]
    return ClosedLoop({"reference": reference, "plant": plant, "controller": controller}, connections)


def closed_loop(
    fmu, stop: float, step: float, order: str = "gauss-seidel", signal: str = "cosine", **options: bool
) -> Loop:
    """Example 3.2.1 from rest through its three FMUs; `fmu` gives one by its name."""
    with Unit(fmu(REFERENCE)) as reference, Unit(fmu(PLANT)) as plant, Unit(fmu(CONTROLLER)) as controller:
        reference["signal"] = signal
        loop = example(reference, plant, controller)
        loop.start(stop=stop, inputs_set=options.pop("inputs_set", True))
        return loop.run(stop, step, order, **options)


def refused(call, *arguments: object) -> FMICallException:
    """The error that a call is answered with; none is a failure."""
    try:
        call(*arguments)
    except FMICallException as answer:
        return answer
    raise AssertionError(f"{call} was accepted")
