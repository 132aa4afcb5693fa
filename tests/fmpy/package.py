"""A packed loop (an .ssp) as FMPy reads it: its units, connections and start values."""

import zipfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from fmpy.ssp.ssd import Parameter, read_ssd
from lxml import etree
from master import ClosedLoop, Connections, Fmu, Loop, Unit


class Package:
    """A loop whose units FMPy runs; `folder` takes what is unpacked."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path, self.folder = path, folder
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
            root = etree.fromstring(archive.read("SystemStructure.ssd"))
        system = read_ssd(str(path)).system
        self.fmus = {unit.name: Fmu(folder / unit.source, folder / unit.name) for unit in system.elements}
        bound = [
            (unit.name, values)
            for unit in system.elements
            for b in unit.parameterBindings
            for values in b.parameterValues
        ]
        self.values: list[tuple[str, Parameter]] = [
            (unit, value) for unit, values in bound for value in values.parameters
        ]
        self.connections: Connections = [
            (f"{c.startElement}.{c.startConnector}", f"{c.endElement}.{c.endConnector}") for c in system.connections
        ]
        self.step = float(root.find(".//{*}ClosedLoop/{*}Master").get("step"))
        # That of separate units, which these are, or of any.
        failure = root.find(".//{*}ClosedLoop/{*}ExpectedFailure")
        self.fails_at = float("inf") if failure is None else float(failure.get("from"))

    def outputs(self, *kinds: str) -> list[str]:
        """Names of all outputs of these types, unit.variable."""
        return [
            f"{unit}.{name}"
            for unit, fmu in self.fmus.items()
            for kind in kinds
            for name in fmu.named(causality="output", type=kind)
        ]

    def run(self, times: np.ndarray, steps: np.ndarray, order: str, read_again: bool = False) -> Loop:
        """In FMPy, from one of these times to the next, by these steps."""
        with ExitStack() as stack:
            units = {name: stack.enter_context(Unit(fmu, name)) for name, fmu in self.fmus.items()}
            for name, parameter in self.values:
                units[name][parameter.name] = value_of(parameter)
            return ClosedLoop(units, self.connections).start().follow(times, steps, order, read_again)


def value_of(parameter: Parameter) -> float | str:
    """Its value; that of an enumeration is an item's name."""
    if parameter.type == "Boolean":
        return parameter.value in ("true", "1")
    return {"Real": float, "Integer": int}.get(parameter.type, str)(parameter.value)
