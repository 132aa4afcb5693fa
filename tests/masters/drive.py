"""What a unit alone is given in every master: start values, and inputs that change at every step."""

import math
from dataclasses import dataclass

import numpy as np
from master import Exchange, Fmu, Loop, Unit, at_ease, tried
from masters import points


@dataclass(frozen=True)
class Drive:
    """Inputs before each of `count` steps; numbers all, a truth value is 0 or 1."""

    fmu: Fmu
    count: int
    step: float
    parameters: dict[str, float]
    inputs: list[str]
    rows: np.ndarray

    @property
    def start(self) -> dict[str, float]:
        """All values that are set before the first step."""
        return self.parameters | self.first

    @property
    def first(self) -> dict[str, float]:
        """The first inputs."""
        return dict(zip(self.inputs, self.rows[0].tolist(), strict=True))

    @property
    def outputs(self) -> dict[str, str]:
        """All outputs by their names, each with its type."""
        return {name: self.kind(name) for name in self.fmu.named(causality="output")}

    def kind(self, name: str) -> str:
        """Type of a variable as masters tell types apart: an enumeration is a whole number."""
        kind = self.fmu.variables[name].type
        return "Integer" if kind == "Enumeration" else kind

    def value(self, name: str, number: float) -> float | int | bool:
        """A number as a value of a variable."""
        return {"Real": float, "Integer": int, "Boolean": bool}[self.kind(name)](number)

    def typed(self, numbers: dict[str, float]) -> dict[str, float | int | bool]:
        """Numbers as values of variables."""
        return {name: self.value(name, number) for name, number in numbers.items()}


def drive(fmu: Fmu, count: int, step: float | None = None, enumerations: bool = True) -> Drive:
    """Real inputs swing four times, each in a phase of its own; a truth value is false in the middle third.

    Without `enumerations`, for masters that know none, those stand as they are, and a funnel is as wide on both sides.
    """
    start = at_ease(fmu) | tried(fmu, "moving")
    start = {name: value for name, value in start.items() if enumerations or fmu.variables[name].type != "Enumeration"}
    inputs = fmu.named(causality="input")
    k = np.arange(count)
    swing = lambda i: 0.3 * np.cos(0.7 * i + 8 * math.pi * k / count)  # noqa: E731
    middle = (k < count // 3) | (k >= 2 * count // 3)
    columns = [middle if fmu.variables[name].type == "Boolean" else swing(i) for i, name in enumerate(inputs)]
    rows = np.array(columns, dtype=float).reshape(len(inputs), count).T
    return Drive(fmu, count, step or float(fmu.description.defaultExperiment.stepSize), start, inputs, rows)


def resting(fmu: Fmu, count: int) -> Drive:
    """Start values of the description throughout, for masters that are told no others."""
    inputs = fmu.named(causality="input")
    numbers = {"true": 1.0, "false": 0.0}
    first = [numbers[start] if start in numbers else float(start) for start in (fmu.variables[i].start for i in inputs)]
    rows = np.tile(np.array(first), (count, 1))
    return Drive(fmu, count, float(fmu.description.defaultExperiment.stepSize), {}, inputs, rows)


def untouched(fmu: Fmu, step: float) -> Drive:
    """Nothing is set and nothing connected, as at a tool's first try: for 1 s, or its experiment where that is shorter."""
    count = round(min(1.0, float(fmu.description.defaultExperiment.stopTime)) / step)
    return Drive(fmu, count, step, {}, [], np.zeros((count, 0)))


def grid(of: Drive) -> tuple[np.ndarray, np.ndarray]:
    """Communication points and steps as FMPy tells them to units."""
    return points("FMPy", of.step, of.count)


def by_plain_calls(of: Drive, times: np.ndarray, steps: np.ndarray) -> Loop:
    """Outputs in co-simulation at each of these times, called by nothing but the functions of the standard."""
    with Unit(of.fmu) as unit:
        _begin(unit, of)
        rows = [_read(unit, of)]
        for time, step, row in zip(times[:-1].tolist(), steps.tolist(), of.rows.tolist(), strict=True):
            _set(unit, of, row)
            unit.step(time, step)
            rows.append(_read(unit, of))
    return _recorded(of, times, rows)


def by_plain_exchange(of: Drive) -> Loop:
    """Outputs in model exchange by Euler's steps, each between two events at which inputs are set."""
    times, steps = grid(of)
    with Exchange(of.fmu) as unit:
        _begin(unit, of)
        unit.settle()
        rows = [_read(unit, of)]
        for time, step, row in zip(times[:-1].tolist(), steps.tolist(), of.rows.tolist(), strict=True):
            unit.slave.enterEventMode()
            _set(unit, of, row)
            unit.settle()
            x = unit.x + step * unit.rate()
            unit.slave.setTime(time + step)
            unit.x = x
            unit.slave.completedIntegratorStep()
            rows.append(_read(unit, of))
    return _recorded(of, times, rows)


def _begin(unit: Unit, of: Drive) -> None:
    for name, value in of.typed(of.parameters).items():
        unit[name] = value
    unit.start(**of.typed(of.first))


def _set(unit: Unit, of: Drive, row: list[float]) -> None:
    for name, number in zip(of.inputs, row, strict=True):
        unit[name] = of.value(name, number)


def _read(unit: Unit, of: Drive) -> list[float]:
    return [float(unit[name]) for name in of.outputs]


def _recorded(of: Drive, times: np.ndarray, rows: list[list[float]]) -> Loop:
    return Loop(times, dict(zip(of.outputs, np.array(rows).T, strict=True)))
