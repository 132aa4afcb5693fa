"""What came of a run."""

from __future__ import annotations

import html
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ._errors import Error, LimitExceeded
from ._program import Answer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: As many points of a curve as a picture can show.
MOST_POINTS = 5000
#: As many names as a legend can show.
MOST_NAMES = 16


class Result:
    """A run: what was recorded, measured and told.

    >>> import adaptive_fmu
    >>> result = adaptive_fmu.Loop("3.2.1-cosine").run(until=6)
    >>> result
    <3.2.1-cosine: 6001 points of 11 signals until t = 6 s; all metrics within their limits>
    >>> bool(result.data["plant.y[1]"].abs().max() < 2)
    True
    """

    def __init__(self, answer: Answer) -> None:
        about, table = answer.about, answer.table
        assert table is not None
        #: Name of the loop or unit.
        self.name: str = about["name"]
        #: What it shows.
        self.description: str = about["description"]
        #: "complete", "interrupted" or "failed".
        self.ended: str = about["ended"]
        #: Unit of measurement of each signal, by its name; "" where none is told.
        self.units: dict[str, str] = dict(zip(about["names"], about["units"]))
        #: What the loop may lack, and warnings of its units.
        self.warnings: list[str] = about["warnings"]
        #: What the program had to say beside that: that the cache can't be used, say.
        self.notes: list[str] = answer.notes
        #: start_time, stop_time and step (s), order ("gauss-seidel" or "jacobi"; None for one unit), composite, values.
        self.settings: dict[str, Any] = about["settings"]
        #: The diagrams as the program decided them: title, signals, words at the axes (x, y), decades of a logarithmic axis, a
        #: peak, parts (times that are drawn side by side), and curves with colour, dashes, and what they show.
        self.plots: list[dict[str, Any]] = about["plots"]
        #: Folder of the files that were written; None where none were asked for.
        self.folder: Path | None = Path(about["results"]) if about.get("results") else None
        self._table = table
        self._names: list[str] = about["names"]
        self._measured: list[dict[str, Any]] = about["metrics"]

    @cached_property
    def data(self) -> pd.DataFrame:
        """The signals, a column each, over time in s.

        >>> import adaptive_fmu
        >>> data = adaptive_fmu.Loop("3.2.1-cosine").run(until=0.1).data
        >>> data.index.name, len(data)
        ('time', 101)
        >>> float(data.loc[0, "reference.r[1]"])
        1.0
        """
        index = pd.Index(self._table[0], name="time")
        return pd.DataFrame(self._table[1:].T, index=index, columns=self._names)

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """The loop's metrics by their labels: value, limit, and whether it holds (missing where there is no limit or value).

        >>> import adaptive_fmu
        >>> metrics = adaptive_fmu.Loop("3.2.1-cosine").run(until=6).metrics
        >>> bool(metrics.loc["max |u|", "holds"])
        True
        """
        rows = self._measured
        table = pd.DataFrame(
            {
                "value": pd.Series([row["value"] for row in rows], dtype=float),
                "limit": pd.Series([row["limit"] for row in rows], dtype=float),
            }
        )
        holds = (table["value"] <= table["limit"]).astype("boolean")
        table["holds"] = holds.mask(table["value"].isna() | table["limit"].isna())
        table.index = pd.Index([row["label"] for row in rows], name="metric")
        return table

    @property
    def holds(self) -> bool:
        """Whether the run came to its end, and no metric is beyond its limit."""
        return self.ended == "complete" and bool(self.metrics["holds"].fillna(True).all())

    def check(self) -> Result:
        """Raises `LimitExceeded` where the run doesn't hold; else the result itself, to go on with.

        >>> import adaptive_fmu
        >>> adaptive_fmu.Loop("3.2.1-cosine").run(until=6).check().ended
        'complete'
        """
        if self.ended != "complete":
            raise LimitExceeded(f"{self.name}: the run was {self.ended} at t = {self.end:g} s")
        beyond = self.metrics[~self.metrics["holds"].fillna(True)]
        if len(beyond):
            told = [f"{label} = {row['value']:.4g} is beyond its limit {row['limit']:g}" for label, row in beyond.iterrows()]
            raise LimitExceeded(f"{self.name}: " + ", ".join(told))
        return self

    @property
    def end(self) -> float:
        """Time of the last point, s."""
        return float(self._table[0, -1]) if self._table.shape[1] else float("nan")

    def plot(self) -> Figure:
        """The loop's own plots, one below the other, by matplotlib: axes with units, legends beside them.

        >>> import adaptive_fmu
        >>> figure = adaptive_fmu.Loop("3.2.1-cosine").run(until=1).plot()
        >>> figure.axes[0].get_ylabel() != "", figure.axes[-1].get_xlabel()
        (True, 'time (s)')
        """
        try:
            # No state of pyplot: a figure shows itself in a notebook, and is gone with its name.
            from matplotlib.figure import Figure
        except ImportError as error:
            raise Error("plots need matplotlib: pip install matplotlib") from error
        plots = self.plots
        figure = Figure(figsize=(9, 2.6 * max(1, len(plots)) + 0.6), layout="constrained")
        grid = figure.add_gridspec(max(1, len(plots)), 1)
        for row, plot in enumerate(plots):
            parts = plot["parts"]
            # A peak, in whose range the rest would be flat, has axes of its own.
            widths = [1.0] if len(parts) == 1 else [1.0, 2.6] if plot["peak"]["from"] <= parts[0][0] else [2.6, 1.0]
            cells = grid[row].subgridspec(1, len(parts), width_ratios=widths)
            axes = [figure.add_subplot(cells[place]) for place in range(len(parts))]
            for axis, part in zip(axes, parts):
                self._draw(axis, plot, part)
            axes[0].set_title(plot["title"], fontsize="medium", loc="left")
            axes[0].set_ylabel(plot["y"])
            if 0 < len(plot["curves"]) <= MOST_NAMES:
                axes[-1].legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small", frameon=False)
            if row + 1 == len(plots):
                for axis in axes:
                    axis.set_xlabel(plot["x"])
        figure.suptitle(f"{self.name}: {self.description}" if self.description else self.name, fontsize="medium", wrap=True)
        return figure

    def _draw(self, axis: Any, plot: dict[str, Any], part: list[float]) -> None:
        """Draws what happens from one time to another, as the program decided it."""
        times = self._table[0]
        first, last = np.searchsorted(times, part[0]), np.searchsorted(times, part[1], side="right")
        for curve in plot["curves"]:
            # A reference lies beneath what follows it, broad and pale: it is seen where both are the same.
            beneath = curve["beneath"]
            width, alpha, order = (2.6, 0.55, 1.5) if beneath else (1.2, 1.0, 2.0)
            style = {"label": curve["name"], "color": curve["colour"], "linewidth": width, "alpha": alpha, "zorder": order}
            values = self._shown(curve)[first:last]
            places = seen(values)
            (line,) = axis.plot(times[first:last][places], values[places], **style)
            if curve["dashes"]:
                # They are told in pixels, and matplotlib takes them in widths of the line.
                line.set_linestyle((0, tuple(length / width for length in curve["dashes"])))
        if plot["decades"]:
            axis.set_yscale("log")
            axis.set_ylim(*plot["decades"])
        axis.grid(alpha=0.3)

    def _shown(self, curve: dict[str, Any]) -> Any:
        """The values of a curve: a signal, the difference of two, or a funnel."""
        if "funnel" in curve:
            start, end, rate = curve["funnel"]
            return (start - end) * np.exp(-rate * (self._table[0] - self._table[0, 0])) + end
        values = self._signal(curve["of"])
        if "minus" in curve:
            values = values - self._signal(curve["minus"])
        return np.abs(values) if curve["magnitude"] else values

    def _signal(self, name: str) -> Any:
        return self._table[1 + self._names.index(name)]

    def __repr__(self) -> str:
        rows, columns = self._table.shape[1], len(self._names)
        beyond = int((~self.metrics["holds"].fillna(True)).sum())
        verdict = f"{beyond} of {len(self.metrics)} metrics beyond their limits" if beyond else "all metrics within their limits"
        told = f"; {verdict}" if len(self.metrics) else ""
        how = told if self.ended == "complete" else f", {self.ended}"
        return f"<{self.name}: {rows} points of {columns} signals until t = {self.end:g} s{how}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: metrics, warnings and plots."""
        parts = [f"<p><b>{html.escape(self.name)}</b> {html.escape(self.description)}</p>"]
        if self.ended != "complete":
            parts.append(f"<p><b>The run was {self.ended} at t = {self.end:g} s.</b></p>")
        if len(self.metrics):
            parts.append(self.metrics.to_html(na_rep="", float_format=lambda value: f"{value:.4g}"))
        if self.warnings:
            parts.append("<ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in self.warnings) + "</ul>")
        parts.append(self._picture())
        return "\n".join(parts)

    def _picture(self) -> str:
        try:
            from io import StringIO

            text = StringIO()
            self.plot().savefig(text, format="svg")
        except (Error, ImportError):
            return ""
        return text.getvalue()[text.getvalue().find("<svg") :]


def seen(values: Any) -> Any:
    """Places of as many values as a picture can show: of each group of neighbours the smallest and the largest, so that no
    peak is lost, and all of a short curve."""
    size = 2 * len(values) // MOST_POINTS
    if size <= 2:
        return np.arange(len(values))
    begins = np.arange(0, len(values) // size * size, size)
    groups = values[: len(begins) * size].reshape(-1, size)
    rest = np.arange(len(begins) * size, len(values))
    ends = [0, len(values) - 1]
    return np.unique(np.concatenate([ends, begins + groups.argmin(axis=1), begins + groups.argmax(axis=1), rest]))


def result_of(answer: Answer) -> Result:
    """The result that an answer holds, or the exception that it means, with what was computed until then."""
    result = Result(answer) if answer.table is not None else None
    failure = answer.failure()
    if failure is None:
        if result is None:
            raise Error("the program gave no result: it is of another version than this package")
        return result
    if hasattr(failure, "partial"):
        failure.partial = result
    raise failure
