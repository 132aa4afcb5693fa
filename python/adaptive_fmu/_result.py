"""Results of a run."""

from __future__ import annotations

import html
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ._errors import Error, LimitExceeded
from ._figures import shown, svg
from ._files import write_mat
from ._program import Answer
from ._values import PathLike

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Number of points of a curve above which a plot shows only some of them.
MOST_POINTS = 5000
#: Largest number of names in a legend; with more, a plot has none.
MOST_NAMES = 16


class Result:
    """Result of a run: recorded signals, metrics, warnings and settings.

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
        #: Name of the loop or FMU.
        self.name: str = about["name"]
        #: Description of what the loop shows.
        self.description: str = about["description"]
        #: "complete", "interrupted" or "failed".
        self.ended: str = about["ended"]
        #: Unit of measurement of each signal, by its name; "" if none is declared.
        self.units: dict[str, str] = dict(zip(about["names"], about["units"]))
        #: Warnings about what may be missing in the loop, and warnings of its FMUs.
        self.warnings: list[str] = about["warnings"]
        #: Other notes of the program, e.g. that the cache can't be used.
        self.notes: list[str] = answer.notes
        #: start_time, stop_time and step (s), order ("gauss-seidel" or "jacobi"; None for a single FMU), composite (True for a
        #: single FMU), values (start values by name).
        self.settings: dict[str, Any] = about["settings"]
        #: Plots of the loop: title, signals, axis labels (x, y), decades (range of a logarithmic axis, or None), peak (or None),
        #: parts (time ranges that are drawn next to each other), and curves with colour, dashes, and the signals they show.
        self.plots: list[dict[str, Any]] = about["plots"]
        #: Folder of the files that were written; None if `out` was not given.
        self.folder: Path | None = Path(about["results"]) if about.get("results") else None
        self._table = table
        self._names: list[str] = about["names"]
        self._measured: list[dict[str, Any]] = about["metrics"]

    @cached_property
    def data(self) -> pd.DataFrame:
        """Recorded signals, one column each; the index is the time in s.

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
        """Metrics of the loop by their labels: value, limit, and `holds`.

        `holds` is True if the value is within its limit, and missing if there is no limit or no value.

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
        """True if the run is complete and no metric is beyond its limit."""
        return self.ended == "complete" and bool(self.metrics["holds"].fillna(True).all())

    def check(self) -> Result:
        """Return the result itself, or raise `LimitExceeded` if the run is not complete or a metric is beyond its limit.

        >>> import adaptive_fmu
        >>> adaptive_fmu.Loop("3.2.1-cosine").run(until=6).check().ended
        'complete'
        """
        if self.ended != "complete":
            raise LimitExceeded(f"{self.name}: the run is not complete ({self.ended} at t = {self.end:g} s)")
        beyond = self.metrics[~self.metrics["holds"].fillna(True)]
        if len(beyond):
            causes = [f"{label} = {row['value']:.4g} is beyond its limit {row['limit']:g}" for label, row in beyond.iterrows()]
            raise LimitExceeded(f"{self.name}: " + ", ".join(causes))
        return self

    def to_mat(self, path: PathLike) -> Path:
        """Write the signals as a MATLAB file (version 5) and return its path; it needs scipy.

        It has `time`, a struct for each component, such as `plant.x` with one row per point and one column per element, and in the
        same form the units of measurement in `units` (a cell array if they differ between elements) and the original names in `names`, since characters that MATLAB does not allow
        in names become "_". `identify` and `simulate` read such files.

        >>> import adaptive_fmu, scipy.io
        >>> file = adaptive_fmu.Loop("3.2.1-cosine").run(until=1).to_mat(folder / "result.mat")
        >>> scipy.io.loadmat(file)["plant"]["x"][0, 0].shape
        (1001, 2)
        """
        write_mat(path, self.data, self.units)
        return Path(path)

    def to_parquet(self, path: PathLike) -> Path:
        """Write the signals as an Apache Parquet file, with the time as its first column, and return its path; it needs pyarrow.

        >>> import adaptive_fmu, pandas
        >>> file = adaptive_fmu.Loop("3.2.1-cosine").run(until=1).to_parquet(folder / "result.parquet")
        >>> pandas.read_parquet(file).columns[0]
        'time'
        """
        try:
            self.data.rename_axis("time").reset_index().to_parquet(path, index=False)
        except ImportError as error:
            raise Error("Result.to_parquet() needs pyarrow. Install it: pip install pyarrow") from error
        return Path(path)

    @property
    def end(self) -> float:
        """Time of the last point, s; NaN if there are no points."""
        return float(self._table[0, -1]) if self._table.shape[1] else float("nan")

    def plot(self) -> Figure:
        """Return the plots of the loop, one below the other, as a figure of matplotlib's pyplot.

        The axis labels contain the units of measurement; the legends are to the right of the axes.

        >>> import adaptive_fmu
        >>> figure = adaptive_fmu.Loop("3.2.1-cosine").run(until=1).plot()
        >>> figure.axes[0].get_ylabel() != "", figure.axes[-1].get_xlabel()
        (True, 'time (s)')
        """
        return shown(self._draw, "Result.plot()")

    def _draw(self, figure: Figure) -> None:
        plots = self.plots
        figure.set_size_inches(9, 2.6 * max(1, len(plots)) + 0.6)
        grid = figure.add_gridspec(max(1, len(plots)), 1)
        for row, plot in enumerate(plots):
            parts = plot["parts"]
            # A peak is drawn on separate axes, because the other values would look flat in its range.
            widths = [1.0] if len(parts) == 1 else [1.0, 2.6] if plot["peak"]["from"] <= parts[0][0] else [2.6, 1.0]
            cells = grid[row].subgridspec(1, len(parts), width_ratios=widths)
            axes = [figure.add_subplot(cells[place]) for place in range(len(parts))]
            for axis, part in zip(axes, parts):
                self._draw_curves(axis, plot, part)
            marks = [
                (axis, mark["time"])
                for mark in plot.get("marks", [])
                for axis, part in zip(axes, parts)
                if part[0] <= mark["time"] <= part[1]
            ]
            for axis, time in marks:
                axis.axvline(time, color="#b00020", linestyle=":", linewidth=1)
            axes[0].set_title(plot["title"], fontsize="medium", loc="left")
            axes[0].set_ylabel(plot["y"])
            if 0 < len(plot["curves"]) <= MOST_NAMES:
                axes[-1].legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small", frameon=False)
            if row + 1 == len(plots):
                for axis in axes:
                    axis.set_xlabel(plot["x"])
        figure.suptitle(f"{self.name}: {self.description}" if self.description else self.name, fontsize="medium", wrap=True)

    def _draw_curves(self, axis: Any, plot: dict[str, Any], part: list[float]) -> None:
        """Draw the curves of a plot in one time range, in the style that the program selected."""
        times = self._table[0]
        first, last = np.searchsorted(times, part[0]), np.searchsorted(times, part[1], side="right")
        for curve in plot["curves"]:
            # A reference is drawn below the signal that tracks it, wide and pale, so that it is visible where both are equal.
            beneath = curve["beneath"]
            width, alpha, order = (2.6, 0.55, 1.5) if beneath else (1.2, 1.0, 2.0)
            style = {"label": curve["name"], "color": curve["colour"], "linewidth": width, "alpha": alpha, "zorder": order}
            values = self._shown(curve)[first:last]
            places = seen(values)
            (line,) = axis.plot(times[first:last][places], values[places], **style)
            if curve["dashes"]:
                # The program gives lengths in pixels; matplotlib expects multiples of the line width.
                line.set_linestyle((0, tuple(length / width for length in curve["dashes"])))
        if plot["decades"]:
            axis.set_yscale("log")
            axis.set_ylim(*plot["decades"])
        axis.grid(alpha=0.3)

    def _shown(self, curve: dict[str, Any]) -> Any:
        """Return the values of a curve: a signal, the difference of two signals, or a funnel."""
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
        ending = f"; {verdict}" if len(self.metrics) else ""
        how = ending if self.ended == "complete" else f", {self.ended}"
        return f"<{self.name}: {rows} points of {columns} signals until t = {self.end:g} s{how}>"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: metrics, warnings and plots."""
        parts = [f"<p><b>{html.escape(self.name)}</b> {html.escape(self.description)}</p>"]
        if self.ended != "complete":
            parts.append(f"<p><b>The run is not complete ({self.ended} at t = {self.end:g} s).</b></p>")
        if len(self.metrics):
            parts.append(self.metrics.to_html(na_rep="", float_format=lambda value: f"{value:.4g}"))
        if self.warnings:
            parts.append("<ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in self.warnings) + "</ul>")
        return "\n".join([*parts, svg(self._draw)])


def seen(values: Any) -> Any:
    """Return the indices of the values to draw.

    For a long curve they are those of the smallest and the largest value of each group of neighbours, so that no peak is lost.
    For a short curve they are all.
    """
    size = 2 * len(values) // MOST_POINTS
    if size <= 2:
        return np.arange(len(values))
    begins = np.arange(0, len(values) // size * size, size)
    groups = values[: len(begins) * size].reshape(-1, size)
    rest = np.arange(len(begins) * size, len(values))
    ends = [0, len(values) - 1]
    return np.unique(np.concatenate([ends, begins + groups.argmin(axis=1), begins + groups.argmax(axis=1), rest]))


def result_of(answer: Answer) -> Result:
    """Return the result in an answer, or raise the exception of the answer, with the results until then in `partial`."""
    result = Result(answer) if answer.table is not None else None
    failure = answer.failure()
    if failure is None:
        if result is None:
            raise Error(
                "The program returned no result, because its version differs from that of this package. `adaptive_fmu.program()` "
                "returns its file. Install this package again with pip, which also installs the program"
            )
        return result
    if hasattr(failure, "partial"):
        failure.partial = result
    raise failure
