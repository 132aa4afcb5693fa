"""Records in memory as files for the program, and its messages in terms of the arguments."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
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
        if not isinstance(structure, Mapping):
            raise ArgumentError(
                f"structure = {structure!r} is not allowed. It must be a dict with A and B, or the path of a TOML file"
            )
        lists = {str(key): value.tolist() if isinstance(value, np.ndarray) else value for key, value in structure.items()}
        try:
            lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in lists.items()]
        except TypeError as error:
            raise ArgumentError(f"structure: {error}. A and B must be lists of rows") from None
        file = self.folder / "structure"
        file.write_text("".join(lines), encoding="utf-8")
        return os.fspath(file)

    def retold(self, message: str) -> str:
        """Return a message about these files in terms of the arguments: rows of a table count from 0."""
        message = message.replace(f"{self.folder}{os.sep}", "")
        for file, name in self._names.items():
            message = re.sub(rf"(?<!\w){re.escape(file)}(?![\w.])", name, message)
            place = rf"(?<!\w)({re.escape(name)}(?:, record [^:]*)?: (?:a gap before )?)line (\d+(?:(?:, | … )\d+)*)"
            message = re.sub(place, lambda found: f"{found[1]}row {from_zero(found[2])}", message)
        return message


def from_zero(lines: str) -> str:
    """Lines of a file with one line of names as rows of its table."""
    return re.sub(r"\d+", lambda line: str(int(line[0]) - 2), lines)


def with_time(data: Any, name: str, time: str | None) -> pd.DataFrame:
    """Return a record as a table whose first column is the time in s."""
    try:
        table = data if isinstance(data, pd.DataFrame) else pd.DataFrame(data)
    except (TypeError, ValueError):
        raise ArgumentError(
            f"{name} has the type {type(data).__name__}. It must be a DataFrame, a dict of columns, a structured array, or the "
            "path of a CSV file"
        ) from None
    column = time or "time"
    times: Any = table.index
    if column in table.columns:
        times, table = table[column], table.drop(columns=column)
    elif time is not None:
        raise ArgumentError(f"{name} has no column `{time}` for the time")
    elif isinstance(times, pd.RangeIndex):
        raise ArgumentError(
            f"{name} has no column `time`, and its index counts the rows. Make the time in s the index or a column"
        )
    times = pd.Series(np.asarray(times) if times.dtype.kind != "M" else times - times.min())
    if times.dtype.kind == "m":
        times = times / pd.Timedelta(seconds=1)
    table = table.reset_index(drop=True)
    table.insert(0, column, times.to_numpy())
    return table
