"""Values of variables, as the program's command line has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike

from ._errors import ArgumentError

#: A number, a truth, the name of an enumeration's item, or an array of numbers for a variable that is one.
Value = Union[bool, float, str, ArrayLike]


def words(option: str, values: Mapping[str, Value]) -> list[str]:
    """Values as options: `--set=name=value` each."""
    return [f"{option}={place}={text}" for name, value in values.items() for place, text in elements(name, value)]


def elements(name: str, value: Value) -> Iterator[tuple[str, str]]:
    """A value by the names of its elements: `x0` of two numbers is `x0[1]` and `x0[2]`, a matrix has `A[1,1]` …"""
    if isinstance(value, str):
        yield name, value
        return
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise ArgumentError(f"{name} = {value!r}: must be a number, a bool, a text, or an array of numbers")
    for indices in np.ndindex(array.shape):
        inner = ",".join(str(index + 1) for index in indices)
        yield f"{name}[{inner}]" if indices else name, number(array[indices].item())


def number(value: Any) -> str:
    """A number so that the program reads the same one."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    raise ArgumentError(f"{value!r}: must be a number")


def of_units(values: Mapping[str, Value] | None, units: Mapping[str, Mapping[str, Value]]) -> dict[str, Value]:
    """Values by their names in a loop, `unit.variable`."""
    together: dict[str, Value] = dict(values or {})
    for unit, of_unit in units.items():
        if not isinstance(of_unit, Mapping):
            raise ArgumentError(f"{unit} = {of_unit!r}: must be values by the names of the unit's variables, {{'…': …}}")
        together.update({f"{unit}.{name}": value for name, value in of_unit.items()})
    return together
