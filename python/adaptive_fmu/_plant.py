"""Plants as a user has them: linear systems of other packages, matrices, files."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import ArgumentError
from ._identify import Identified
from ._parameters import Estimated
from ._program import reworded
from ._records import is_table


@contextmanager
def plant_file(plant: Any) -> Iterator[str]:
    """Path of a file with the plant, as the program reads it, for as long as it is needed."""
    if isinstance(plant, (str, os.PathLike)):
        yield os.fspath(plant)
        return
    with tempfile.TemporaryDirectory() as folder:
        if isinstance(plant, (Identified, Estimated)):
            if not plant.text:
                raise ArgumentError("plant has no linear model: its FMU can't be linearised at its start")
            file = Path(folder) / plant.file
            file.write_bytes(plant.text.encode())
        else:
            file = Path(folder) / "plant.json"
            file.write_text(json.dumps(_matrices(plant)))
        with reworded(lambda message: message.replace(os.fspath(file), "plant")):
            yield os.fspath(file)


def is_record(plant: Any) -> bool:
    """True for a table of signals over time, or a file of one, or several of them."""
    if isinstance(plant, (list, tuple)):
        return bool(plant) and all(map(is_record, plant))
    if isinstance(plant, (str, os.PathLike)):
        return is_table(plant)
    return hasattr(plant, "columns") or isinstance(plant, dict) and "A" not in plant


def is_of_records(file: str) -> bool:
    """True for a file of a model with the covariance that its records leave, as `identify` writes it."""
    if not file.endswith(".json"):
        return False
    try:
        model = json.loads(Path(file).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(model, dict) and model.get("covariance") is not None


def _matrices(plant: Any) -> dict[str, Any]:
    """Return the matrices of a plant by their names, as the program reads them."""
    if hasattr(plant, "to_ss"):  # A system of scipy.signal.
        plant = plant.to_ss()
    elif hasattr(plant, "num") and hasattr(plant, "den") and not hasattr(plant, "A"):
        try:
            import control
        except ImportError:
            raise ArgumentError(
                f"plant has the type {type(plant).__name__}, whose conversion needs python-control. Install it (pip install "
                "control), or give matrices (A, B, C, D)"
            ) from None
        plant = control.ss(plant)
    dt = getattr(plant, "dt", None) or 0.0
    if dt is True:
        raise ArgumentError("plant is in discrete time, but its sample time is unknown. Give dt in s")
    parts = plant if isinstance(plant, (tuple, list)) else [getattr(plant, name, None) for name in "ABCD"]
    if len(parts) != 4 or any(part is None for part in parts):
        raise ArgumentError(
            f"plant has the type {type(plant).__name__}. It must be a linear system of python-control or scipy.signal, matrices "
            "(A, B, C, D), a Linearisation, an Identified, an Estimated, or the path of a JSON file or an FMU"
        )
    matrices = {name: np.atleast_2d(np.asarray(part, dtype=float)).tolist() for name, part in zip("ABCD", parts)}
    return matrices | ({"dt": float(dt)} if dt else {})
