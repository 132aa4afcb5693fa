"""Results of many runs of a loop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from ._errors import Error
from ._program import INTERRUPTED, Answer
from ._result import Result


@dataclass
class Run:
    """One run of a sweep."""

    #: Values by the names of variables.
    point: dict[str, Any]
    #: "complete" or "failed".
    ended: str
    #: Metrics by their labels; NaN if a metric has no value.
    metrics: dict[str, float]
    #: Reason of a failure, or "".
    message: str
    #: Answer with the recorded signals; None if they are not stored.
    answer: Answer | None = None

    @classmethod
    def of(cls, point: dict[str, Any], answer: Answer, keep: bool) -> Run:
        """Return the run of an answer. Raise its exception if it has no result, and KeyboardInterrupt if it was interrupted."""
        failure = answer.failure()
        if answer.table is None:
            raise failure or Error(
                "The program returned no result, because its version differs from that of this package. `adaptive_fmu.program()` "
                "returns its file. Install this package again with pip, which also installs the program"
            )
        if answer.code == INTERRUPTED:
            raise KeyboardInterrupt
        result = Result(answer)
        metrics = {str(label): float(value) for label, value in result.metrics["value"].items()}
        return cls(point, result.ended, metrics, "" if failure is None else str(failure), answer if keep else None)

    def row(self) -> dict[str, Any]:
        """Return the row of the run in a table."""
        return {**self.point, "ended": self.ended, **self.metrics, "message": self.message}


class Sweep:
    """Runs of a loop with different values.

    >>> import adaptive_fmu
    >>> swept = adaptive_fmu.Loop("3.2.1-cosine").sweep({"plant.omega": [1.0, 2.0]}, until=6)
    >>> list(swept.data.columns[:2]), len(swept)
    (['plant.omega', 'ended'], 2)
    """

    def __init__(self, name: str, names: Sequence[str], runs: Sequence[Run]) -> None:
        #: Name of the loop.
        self.name = name
        #: Results of the runs, in the order of the rows; empty unless `sweep` was called with keep=True.
        self.results: list[Result] = [Result(run.answer) for run in runs if run.answer is not None]
        self._names = list(names)
        self._rows = [run.row() for run in runs]

    @property
    def data(self) -> pd.DataFrame:
        """Table with one row per run.

        Its columns are the values, `ended` ("complete" or "failed"), the metrics by their labels, and `message` (the reason of a
        failure, or "").

        >>> import adaptive_fmu
        >>> data = adaptive_fmu.Loop("3.2.1-cosine").sweep({"plant.omega": [1.0, 2.0]}, until=6).data
        >>> bool((data["max |u|"] > 0).all())
        True
        """
        return pd.DataFrame(self._rows, columns=None if self._rows else [*self._names, "ended", "message"])

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results)

    def __repr__(self) -> str:
        return f"<{self.name} over {', '.join(self._names)}: {len(self)} runs>"

    def _repr_html_(self) -> str:
        return str(self.data.to_html(index=False, na_rep=""))
