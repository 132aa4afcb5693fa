"""Units of FMI 3.0 on FMPy, by the names of their variables."""

import ctypes
from pathlib import Path
from typing import Self

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Model, FMU3Slave


class Fmu3:
    """An FMU of FMI 3.0, unpacked."""

    def __init__(self, file: Path, folder: Path) -> None:
        self.file, self.folder = file, folder
        fmpy.extract(file, folder)
        self.about = fmpy.read_model_description(file)
        self.variables = {variable.name: variable for variable in self.about.modelVariables}
        self.elements = {name: elements(variable) for name, variable in self.variables.items()}

    def named(self, **attributes: str) -> list[str]:
        """Names of the variables with these attributes."""
        return [v.name for v in self.about.modelVariables if all(getattr(v, key) == value for key, value in attributes.items())]


class Unit3:
    """An instance; values are arrays of numbers, by the names of variables."""

    def __init__(
        self, fmu: Fmu3, exchange: bool = False, event_mode: bool = False, early_return: bool = False, logging: bool | None = None
    ) -> None:
        """With `logging`, which is loggingOn, messages are kept; else FMPy prints them."""
        self.fmu = fmu
        self.messages = list[tuple[int, str, str]]()
        kind = FMU3Model if exchange else FMU3Slave
        interface = fmu.about.modelExchange if exchange else fmu.about.coSimulation
        self.instance = kind(
            guid=fmu.about.instantiationToken,
            unzipDirectory=str(fmu.folder),
            modelIdentifier=interface.modelIdentifier,
            instanceName="unit",
        )
        options = {} if exchange else {"eventModeUsed": event_mode, "earlyReturnAllowed": early_return}
        if logging is not None:
            options |= {"loggingOn": logging, "logMessage": self._log}
        self.instance.instantiate(**options)
        self.event_mode = event_mode or exchange

    def _log(self, _environment: int, status: int, category: bytes, text: bytes) -> None:
        self.messages.append((status, category.decode(), text.decode()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.instance.freeInstance()

    def reference(self, name: str) -> int:
        return self.fmu.variables[name].valueReference

    def __getitem__(self, name: str) -> list[float]:
        kind = self.fmu.variables[name].type
        get = getattr(self.instance, "getInt64" if kind == "Enumeration" else f"get{kind}")
        return list(get([self.reference(name)], len(self.fmu.elements[name])))

    def __setitem__(self, name: str, values: float | list[float]) -> None:
        kind = self.fmu.variables[name].type
        put = getattr(self.instance, "setInt64" if kind == "Enumeration" else f"set{kind}")
        put([self.reference(name)], values if isinstance(values, list) else [values])

    def put(self, values: dict[str, float]) -> None:
        """Sets elements by the names that they have in FMI 2.0."""
        for name, own in self.fmu.elements.items():
            if any(one in values for one in own):
                before = self[name]
                self[name] = [values.get(one, old) for one, old in zip(own, before, strict=True)]

    def start(self, **inputs: float) -> Self:
        """Goes through Initialization Mode, in which these inputs are set, and through the first Event Mode."""
        self.instance.enterInitializationMode(startTime=0.0)
        self.put(inputs)
        self.instance.exitInitializationMode()
        return self

    def update(self) -> float | None:
        """Updates discrete states until none changes; the next time event."""
        again = True
        while again:
            again, end, _, _, known, event = self.instance.updateDiscreteStates()
            assert not end
        return event if known else None


def elements(variable: object) -> list[str]:
    """The names that the elements of a variable have in FMI 2.0."""
    if not variable.dimensions:
        return [variable.name]
    name, is_rate = variable.name, variable.name.startswith("der(")
    name = name[4:-1] if is_rate else name
    names = [f"{name}[{','.join(str(k + 1) for k in index)}]" for index in np.ndindex(*variable.shape)]
    return [f"der({one})" for one in names] if is_rate else names


def dependencies(unit: Unit3, reference: int) -> list[tuple[int, int, int, int]]:
    """fmi3GetVariableDependencies: element, and reference, element and kind of what it depends on."""
    instance, count = unit.instance, ctypes.c_size_t()
    instance.fmi3GetNumberOfVariableDependencies(instance.component, reference, ctypes.byref(count))
    n = count.value
    found = (ctypes.c_size_t * n)(), (ctypes.c_uint32 * n)(), (ctypes.c_size_t * n)(), (ctypes.c_int * n)()
    instance.fmi3GetVariableDependencies(instance.component, reference, *found, n)
    return list(zip(*found, strict=True))
