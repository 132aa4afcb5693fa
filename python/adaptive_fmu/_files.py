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
    """Write signals as MATLAB file: `time`, a struct for each component with arrays over time, and `units` in the same form."""
    try:
        savemat = import_module("scipy.io").savemat
    except ImportError as error:
        raise Error("Result.to_mat() needs scipy. Install it: pip install scipy") from error
    tree: dict[str, Any] = {"time": np.asarray(data.index, dtype=float)[:, np.newaxis], "units": ""}
    named: dict[str, Any] = {}
    for (component, variable), columns in arrays(list(data.columns)).items():
        shape = tuple(max(indices) for indices in zip(*columns.values())) if any(columns.values()) else (1,)
        values = np.full((len(data), *shape), np.nan)
        for name, indices in columns.items():
            place: Any = (slice(None), *(index - 1 for index in indices or (1,)))
            values[place] = data[name].to_numpy(dtype=float)
        place_in(tree, component, variable, values)
        place_in(named, component, variable, units.get(next(iter(columns)), ""))
    savemat(path, {**tree, "units": named}, long_field_names=True, oned_as="column")


def arrays(names: list[str]) -> dict[tuple[str, str], dict[str, tuple[int, ...]]]:
    """Return the names of signals by component ("" for none) and variable, with the indices of elements."""
    found: dict[tuple[str, str], dict[str, tuple[int, ...]]] = {}
    for name in names:
        component, _, variable = name.rpartition(".") if "." in name.split("[")[0] else ("", "", name)
        element = re.fullmatch(r"(.*)\[(\d+(?:,\d+)*)\]", variable)
        base, indices = (element[1], tuple(map(int, element[2].split(",")))) if element else (variable, ())
        found.setdefault((component, base), {})[name] = indices
    return found


def place_in(tree: dict[str, Any], component: str, variable: str, value: Any) -> None:
    """Put a value into the struct of its component. Names become those that MATLAB allows; no two become one."""
    if component:
        key = plain(component)
        while not isinstance(tree.setdefault(key, {}), dict):
            key = f"{key}_"
        tree = tree[key]
    name = plain(variable)
    while name in tree:
        name = f"{name}_"
    tree[name] = value


def plain(name: str) -> str:
    """Return a name as MATLAB allows it."""
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (text if re.match(r"[A-Za-z]", text) else f"v_{text}")[:LONGEST]
