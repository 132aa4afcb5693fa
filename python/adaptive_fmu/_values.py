"""Values of variables in the format of the program's command line."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from numbers import Real
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike

from ._errors import ArgumentError

#: Path of a file or folder.
PathLike = Union[str, "os.PathLike[str]"]

#: A number, a bool, the name of an item of an enumeration, or an array of numbers for an array variable.
Value = Union[bool, float, str, ArrayLike]


#: Significant digits of numbers in tables.
DIGITS = 6


def words(option: str, values: Mapping[str, Value]) -> list[str]:
    """Return the values as options, e.g. `--set=name=value`, one per value."""
    return [f"{option}={place}={text}" for name, value in values.items() for place, text in elements(name, value)]


def texts(values: Mapping[str, Value]) -> dict[str, str]:
    """Return the text of each element by its name."""
    return {place: text for name, value in values.items() for place, text in elements(name, value)}


def elements(name: str, value: Value) -> Iterator[tuple[str, str]]:
    """Yield the name and text of each element: `x0[1]` and `x0[2]` for `x0` with two numbers, `A[1,1]` … for a matrix."""
    if isinstance(value, str):
        yield name, value
        return
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise ArgumentError(f"{name} = {value!r} is not allowed. It must be a number, a bool, a str, or an array of numbers")
    for indices in np.ndindex(array.shape):
        inner = ",".join(str(index + 1) for index in indices)
        yield f"{name}[{inner}]" if indices else name, number(array[indices].item())


#: Events of a run: time in s, name of a variable, and the value that it gets then.
Events = Sequence["tuple[float, str, Value]"]


def event_words(events: Events) -> list[str]:
    """Return the events as options."""
    try:
        triples = [(time, name, value) for time, name, value in events]
    except (TypeError, ValueError):
        raise ArgumentError(f"events = {events!r} is not allowed. It must be a list of (time in s, name, value)") from None
    return [f"--event={number(time)}: {place}={text}" for time, name, value in triples for place, text in elements(name, value)]


def number(value: Any) -> str:
    """Return the text of a number, with all digits, so that the program reads exactly the same number."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    raise ArgumentError(f"{value!r} is not allowed. It must be a number, e.g. 0.5")


def numbers(values: Any) -> str:
    """Return the texts of one number or several, with commas between them."""
    if isinstance(values, (Sequence, np.ndarray)) and not isinstance(values, str):
        return ",".join(number(value) for value in values)
    return number(values)


def joined(argument: str, names: str | Sequence[str]) -> str:
    """Return the names that an argument has, with commas between them."""
    try:
        return names if isinstance(names, str) else ",".join(names)
    except TypeError:
        raise ArgumentError(f"{argument} = {names!r} is not allowed. It must be a name, or a list of names") from None


def alias(name: str, value: Any, other: str, fmpy: Any) -> Any:
    """Return the argument that is given by its own name or by FMPy's."""
    if value is not None and fmpy is not None:
        raise ArgumentError(f"{name} and {other} are the same argument: give one of them")
    return value if fmpy is None else fmpy


def trim(free: Sequence[str], want: Mapping[str, Value] | None, hold: Sequence[str]) -> list[str]:
    """Return an operating point to search for as options."""
    request = words("--want", want or {})
    for option, names in (("--free", free), ("--hold", hold)):
        if isinstance(names, str):
            raise ArgumentError(f"{option[2:]} = {names!r} is not allowed. It must be a list of names, e.g. [{names!r}]")
        request += [f"{option}={name}" for name in names]
    return request


def of_units(values: Mapping[str, Value] | None, units: Mapping[str, Mapping[str, Value]]) -> dict[str, Value]:
    """Return all values by their names in a loop, `component.variable`; values of `units` override those of `values`."""
    together: dict[str, Value] = dict(values or {})
    for unit, of_unit in units.items():
        if not isinstance(of_unit, Mapping):
            raise ArgumentError(
                f"{unit} = {of_unit!r} is not allowed. This method has no argument named {unit}, so {unit} is taken as a "
                f"component of the loop. It must be a dict with the values of its variables, e.g. {unit}={{'x0': 0.5}}"
            )
        together.update({f"{unit}.{name}": value for name, value in of_unit.items()})
    return together


def shown(value: float) -> str:
    """Text of a number in tables."""
    return f"{value:.{DIGITS}g}"
