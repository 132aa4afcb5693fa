"""Records in memory as files for the program, and its messages in terms of the arguments."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ._errors import ArgumentError


class Given:
    """Arguments as files for the program, in a folder that the caller sees nothing of."""

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)
        self._names: dict[str, str] = {}

    def record(self, data: Any, name: str, time: str | None, wanted: Sequence[str]) -> str:
        """Return the path of a record, which is written if it is a table in memory. Columns of texts are left out."""
        if isinstance(data, (str, os.PathLike)):
            return os.fspath(data)
        table = with_time(data, name, time)
        kinds = [getattr(kind, "kind", "O") for kind in table.dtypes]
        named = [str(column) == "record" or str(column).startswith(tuple(wanted)) for column in table.columns]
        table = table.loc[:, [kind in "biuf" or is_named for kind, is_named in zip(kinds, named)]]
        # Floats are written with all their digits.
        table = table.astype({column: float for column, kind in zip(table.columns, table.dtypes) if kind == np.float32})
        # The program takes a file in place of a part by its extension.
        file = self.folder / (f"{name}.csv" if name == "hold_out" else name)
        self._names[file.name] = name
        table.to_csv(file, index=False, quoting=2)
        return os.fspath(file)

    def structure(self, structure: Any) -> str:
        """Return the path of a structure."""
        if isinstance(structure, (str, os.PathLike)):
            return os.fspath(structure)
        try:
            # Numbers and arrays of numpy are written as those of Python.
            written = json.JSONEncoder(ensure_ascii=False, default=lambda value: value.tolist()).encode
            lines = [f"{key} = {written(value)}\n" for key, value in structure.items()]
        except (AttributeError, TypeError):
            raise ArgumentError(
                f"structure = {structure!r} is not allowed. It must be a dict with A and B, lists of rows, or the path of a TOML file"
            ) from None
        file = self.folder / "structure"
        file.write_text("".join(lines), encoding="utf-8")
        return os.fspath(file)

    def reworded(self, message: str) -> str:
        """Return a message about these files in terms of the arguments: rows of a table count from 0."""
        message = message.replace(f"{self.folder}{os.sep}", "")
        for file, name in self._names.items():
            message = re.sub(rf"(?<!\w){re.escape(file)}(?![\w.])", name, message)
            # The line of names is no row.
            message = re.sub(rf"(?<!\w)({re.escape(name)}: )line 1: ", r"\1", message)
            place = rf"(?<!\w)({re.escape(name)}(?:, record [^:]*)?: (?:a gap before )?)line (\d+(?:(?:, | … )\d+)*)"
            message = re.sub(place, lambda found: found[1] + "row " + re.sub(r"\d+", row, found[2]), message)
        return message


def is_table(path: str | os.PathLike[str]) -> bool:
    """True for the name of a file that the program reads as a table."""
    return os.fspath(path).lower().endswith((".csv", ".parquet", ".mat"))


def row(line: re.Match[str]) -> str:
    """Row of a table for a line of its file, which has one line of names."""
    return str(int(line[0]) - 2)


def with_time(data: Any, name: str, time: str | None) -> pd.DataFrame:
    """Return a record as a table whose first column is the time, in s or in the unit of its name."""
    try:
        table: pd.DataFrame = data if isinstance(data, pd.DataFrame) else pd.DataFrame(data)
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            f"{name} has the type {type(data).__name__}. It must be a DataFrame, a dict of columns, a structured array, or the "
            f"path of a CSV, Parquet or MATLAB file: {error}"
        ) from None
    if not len(table):
        raise ArgumentError(f"{name} has no rows")
    wanted = time or "time"
    heads = [str(head) for head in (*table.columns, table.index.name)]
    # A unit may follow the name.
    place: Any = next((place for place, head in enumerate(heads) if re.sub(r"\s*\[.*\]$", "", head) == wanted), None)
    counts = isinstance(table.index, pd.RangeIndex)
    if place is None and (counts or time is not None):
        advice = ", and its index counts the rows. Make the time in s the index or a column" if counts else ""
        raise ArgumentError(f"{name} has no column `{wanted}` for the time{advice}")
    is_time = np.arange(len(heads) - 1) == place
    times: Any = pd.Series(table.iloc[:, place] if is_time.any() else table.index).infer_objects().reset_index(drop=True)
    head = wanted if place is None else heads[place]
    if times.dtype.kind in "mM":
        start = times.min() if times.dtype.kind == "M" else pd.Timedelta(0)
        head, times = wanted, (times - start) / pd.Timedelta(seconds=1)
    elif times.dtype.kind not in "iuf":
        raise ArgumentError(f"{name}: {head} = {times[0]!r}: must be a number, or a date: pd.to_datetime makes dates of texts")
    table = table.loc[:, ~is_time].reset_index(drop=True)
    table.insert(0, head, times.to_numpy(), allow_duplicates=True)
    return table
