"""A small master on FMPy: units by variable names, and the closed loop of example 3.2.1."""

from ctypes import POINTER, c_double, c_uint
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.model_description import ModelDescription, ScalarVariable


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


class Reals:
    """Some real variables of a unit, read or set together without looking them up again."""

    def __init__(self, unit: Unit, names: list[str]) -> None:
        self.values = np.zeros(len(names))
        self._slave, self._count = unit.slave, len(names)
        self._references = (c_uint * len(names))(*map(unit.reference, names))
        self._pointer = (c_double * len(names)).from_buffer(self.values)

    def get(self) -> None:
        """Reads them into `values`."""
        self._slave.fmi2GetReal(self._slave.component, self._references, self._count, self._pointer)

    def set(self) -> None:
        """Sets them from `values`."""
        self._slave.fmi2SetReal(self._slave.component, self._references, self._count, self._pointer)


OUTPUTS = {"reference": ["r[1]"], "plant": ["x[1]", "x[2]", "y[1]"], "controller": ["u[1]"]}
INPUTS = {"reference": [], "plant": ["u[1]"], "controller": ["r[1]", "x[1]", "x[2]"]}


@dataclass
class Loop:
    """What was recorded of the closed loop, at every communication point."""

    time: np.ndarray
    r: np.ndarray
    x: np.ndarray
    y: np.ndarray
    u: np.ndarray

    def same_as(self, other: "Loop") -> bool:
        """Whether all of it is equal, bit for bit."""
        mine, theirs = vars(self).values(), vars(other).values()
        return all(a.tobytes() == b.tobytes() for a, b in zip(mine, theirs, strict=True))

    def part(self, first: int, last: int) -> "Loop":
        """The communication points from one to the other, both included."""
        return Loop(**{name: values[first : last + 1] for name, values in vars(self).items()})


class ClosedLoop:
    """Reference, plant and controller of example 3.2.1 with their connections."""

    def __init__(self, reference: Unit, plant: Unit, controller: Unit) -> None:
        self.units = {"reference": reference, "plant": plant, "controller": controller}
        self._outputs = {name: Reals(unit, OUTPUTS[name]) for name, unit in self.units.items()}
        self._inputs = {name: Reals(unit, INPUTS[name]) for name, unit in self.units.items()}
        # Every value that is handed on: outputs' buffer and place, inputs' buffer and place.
        to_controller = [("reference", 0, 0), ("plant", 0, 1), ("plant", 1, 2)]
        self._links = {
            "reference": [],
            "plant": [(self._outputs["controller"].values, 0, self._inputs["plant"].values, 0)],
            "controller": [
                (self._outputs[source].values, i, self._inputs["controller"].values, j)
                for source, i, j in to_controller
            ],
        }

    def take(self, name: str, read_again: bool = False) -> None:
        """Hands a unit its inputs; `read_again` reads its outputs once more after that, as OMSimulator does."""
        for source, i, target, j in self._links[name]:
            target[j] = source[i]
        self._inputs[name].set()
        if read_again:
            self.give(name)

    def give(self, name: str) -> None:
        """Reads a unit's outputs."""
        self._outputs[name].get()

    def forget(self) -> None:
        """Hands on nothing of an earlier run."""
        for reals in [*self._outputs.values(), *self._inputs.values()]:
            reals.values.fill(0.0)

    def start(self, time: float = 0.0, stop: float | None = None, inputs_set: bool = True) -> Self:
        """Initialises all units, with or without handing on values in Initialization Mode."""
        for unit in self.units.values():
            unit.slave.setupExperiment(startTime=time, stopTime=stop)
            unit.slave.enterInitializationMode()
        for _ in range(3 if inputs_set else 0):
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
        rows = np.empty((len(times), 5))
        outputs = list(self._outputs.values())
        rows[0] = np.concatenate([output.values for output in outputs])
        for k in range(len(times) - 1):
            time, duration = float(times[k]), float(times[k + 1] - times[k])
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
            rows[k + 1] = np.concatenate([output.values for output in outputs])
        return Loop(times, rows[:, 0].copy(), rows[:, 1:3].copy(), rows[:, 3].copy(), rows[:, 4].copy())


def closed_loop(
    fmu, stop: float, step: float, order: str = "gauss-seidel", signal: str = "cosine", **options: bool
) -> Loop:
    """Example 3.2.1 from rest through its three FMUs; `fmu` gives one by its name."""
    with Unit(fmu(REFERENCE)) as reference, Unit(fmu(PLANT)) as plant, Unit(fmu(CONTROLLER)) as controller:
        reference["signal"] = signal
        loop = ClosedLoop(reference, plant, controller)
        loop.start(stop=stop, inputs_set=options.pop("inputs_set", True))
        return loop.run(stop, step, order, **options)


def refused(call, *arguments: object) -> FMICallException:
    """The error that a call is answered with; none is a failure."""
    try:
        call(*arguments)
    except FMICallException as answer:
        return answer
    raise AssertionError(f"{call} was accepted")
