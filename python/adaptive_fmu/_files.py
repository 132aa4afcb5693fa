"""Results as files of other tools."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd

from ._errors import Error
from ._values import PathLike

#: Longest name of a variable in MATLAB.
LONGEST = 63


def write_mat(path: PathLike, data: pd.DataFrame, units: Mapping[str, str]) -> None:
    """Write signals as MATLAB file: `time`, a struct for each component with arrays over time, `units` and `names` in the same form."""
    try:
        savemat = import_module("scipy.io").savemat
    except ImportError as error:
        raise Error("Result.to_mat() needs scipy. Install it: pip install scipy") from error
    tree: dict[str, Any] = {"time": np.asarray(data.index, dtype=float)[:, np.newaxis], "units": "", "names": ""}
    measures: dict[str, Any] = {}
    named: dict[str, Any] = {}
    for (component, variable), columns in arrays(list(data.columns)).items():
        shape = tuple(max(indices) for indices in zip(*columns.values())) if any(columns.values()) else (1,)
        values = np.full((len(data), *shape), np.nan)
        for name, indices in columns.items():
            place: Any = (slice(None), *(index - 1 for index in indices or (1,)))
            values[place] = data[name].to_numpy(dtype=float)
        key, name = place_in(tree, component, variable, values)
        # Of an array, the name of its first element.
        first = "[" + ",".join("1" for _ in shape) + "]" if any(columns.values()) else ""
        whole = f"{component}.{variable}{first}" if component else f"{variable}{first}"
        for labels, label in ((measures, measure(columns, shape, units)), (named, whole)):
            (labels.setdefault(key, {}) if key else labels)[name] = label
    savemat(path, {**tree, "units": measures, "names": named}, long_field_names=True, oned_as="column")


def measure(columns: Mapping[str, tuple[int, ...]], shape: tuple[int, ...], units: Mapping[str, str]) -> Any:
    """Return the unit of measurement of an array, or an array of them if they differ."""
    given = {units.get(name, "") for name in columns}
    if len(given) == 1:
        return given.pop()
    each = np.full(shape if len(shape) > 1 else (*shape, 1), "", dtype=object)
    for name, indices in columns.items():
        each[tuple(index - 1 for index in indices or (1,))] = units.get(name, "")
    return each


def arrays(names: list[str]) -> dict[tuple[str, str], dict[str, tuple[int, ...]]]:
    """Return the names of signals by component ("" for none) and variable, with the indices of elements."""
    found: dict[tuple[str, str], dict[str, tuple[int, ...]]] = {}
    for name in names:
        component, _, variable = name.rpartition(".") if "." in name.split("[")[0] else ("", "", name)
        element = re.fullmatch(r"(.*)\[(\d+(?:,\d+)*)\]", variable)
        base, indices = (element[1], tuple(map(int, element[2].split(",")))) if element else (variable, ())
        found.setdefault((component, base), {})[name] = indices
    return found


def place_in(tree: dict[str, Any], component: str, variable: str, value: Any) -> tuple[str, str]:
    """Put a value into the struct of its component and return their names, which become those that MATLAB allows; no two become one."""
    key = plain(component) if component else ""
    if component:
        while not isinstance(tree.setdefault(key, {}), dict):
            key = f"{key}_"
        tree = tree[key]
    name = plain(variable)
    while name in tree:
        name = f"{name}_"
    tree[name] = value
    return key, name


def plain(name: str) -> str:
    """Return a name as MATLAB allows it."""
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (text if re.match(r"[A-Za-z]", text) else f"v_{text}")[:LONGEST]
