"""Models from records of a plant."""

from __future__ import annotations

import html
import json
import math
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ._errors import ArgumentError, Error, ExperimentWarning
from ._figures import shown as drawn
from ._figures import svg
from ._pool import done
from ._program import reworded
from ._records import Given
from ._values import PathLike, joined, number, numbers, shown

if TYPE_CHECKING:
    import control
    from matplotlib.figure import Figure

#: Arguments that help where something was found.
ADVICE = {
    "delay": "`delay` gives dead times",
    **dict.fromkeys(("unseen", "short_record", "kinematics"), "`structure` gives known entries"),
}


class Identified:
    """Linear model x' = A x + B u + d, y = C x of a plant, identified from records, with the uncertainty that they leave.

    Rows and columns of entries count from 1, as in the file of the model.

    >>> import adaptive_fmu
    >>> adaptive_fmu.identify(record, inputs=["voltage"], states=["speed", "current"])
    <Identified: 2 states, 1 inputs, 2 outputs, sound>
    """

    def __init__(self, answer: dict[str, Any], text: str) -> None:
        model = answer["model"]
        #: Names of the n states.
        self.states: list[str] = model["states"]
        #: Names of the m inputs.
        self.inputs: list[str] = model["inputs"]
        #: Names of the p outputs.
        self.outputs: list[str] = model["outputs"]
        #: System matrix, n × n.
        self.A: np.ndarray = np.array(model["A"], dtype=float)
        #: Input matrix, n × m.
        self.B: np.ndarray = np.array(model["B"], dtype=float)
        #: Output matrix, p × n.
        self.C: np.ndarray = np.array(model["C"], dtype=float)
        #: Feedthrough matrix, p × m.
        self.D: np.ndarray = np.array(model.get("D") or np.zeros((len(self.outputs), len(self.inputs))), dtype=float)
        units = model.get("units") or {}
        named = (("x", self.states), ("u", self.inputs), ("y", self.outputs))
        #: Units of measurement of the model by the names of signals: base units, such as rad/s for a column in rpm.
        self.units: dict[str, str] = {name: unit for key, names in named for name, unit in zip(names, units.get(key, ()))}
        #: Dead time of each input, s.
        self.delay: pd.Series = series(model.get("delay") or 0.0, self.inputs)
        #: Commonest step of the records, s.
        self.sample_time: float = model["sample_time"]
        #: Constant d of each record, one row each, in units of the states a second.
        self.offset: np.ndarray = np.array(model["offset"], dtype=float)
        #: Entries that were estimated: matrix ("A", "B" or "d"), row and column; a column of d is a record.
        self.free: list[tuple[str, int, int]] = [(matrix, row, column) for matrix, row, column in model["free"]]
        #: Their covariance, in the order of `free`.
        self.covariance: np.ndarray = np.array(model["covariance"], dtype=float).reshape(len(self.free), len(self.free))
        names = ["{}[{},{}]".format(*entry) for entry in self.free]
        #: Estimates by entry, such as "A[1,2]": value, error (standard error), kappa (its factor for coloured residuals).
        self.entries: pd.DataFrame = pd.DataFrame(answer["entries"], index=names, columns=["value", "error", "kappa"])
        #: Standard errors by entry.
        self.errors: pd.Series = self.entries["error"]
        #: Standard deviation of the noise of each measured signal, in the signal's unit.
        self.noise: pd.Series = series(model["noise"], self.outputs)
        #: Bound of what the plant does beyond the model, as each input.
        self.disturbance: pd.Series = series(model["disturbance"], self.inputs)
        fits = {**model["fit"], "ceiling": answer["ceiling"]}
        #: Fit of the held-out part of each measured signal, % of its motion: `held_out` simulated over the whole of it, `windows`
        #: over the time scale of a controller, `ceiling` about what noise allows (estimated). NaN where there is none.
        self.fit: pd.DataFrame = pd.DataFrame({key: series(values, self.outputs) for key, values in fits.items()})
        #: Largest of 20 autocorrelations of the residuals of each measured signal, in units of 1/√N: below 3.7 of white noise.
        self.whiteness: pd.Series = series(model["whiteness"], self.outputs)
        #: Confidence level of the region, also for bounds of controllers.
        self.level: float = model["level"]
        #: Poles, the slowest first: pole (complex, rad/s), and the standard errors real_error and imaginary_error.
        self.poles: pd.DataFrame = pd.DataFrame([pole_row(pole) for pole in answer["poles"]])
        #: Method by which the model was found.
        self.method: str = model["method"]
        #: Records: file, sha256, rows, from and to (s).
        self.records: list[dict[str, Any]] = model["records"]
        #: Findings, one row each: kind, verdict ("note", "warning" or "not_sound") and text.
        self.findings: pd.DataFrame = pd.DataFrame(answer["findings"], columns=["kind", "verdict", "text"])
        #: False if a finding is that the model should not be used for a design.
        self.sound: bool = "not_sound" not in set(self.findings["verdict"])
        #: Name of its file, as descriptions name it.
        self.file: str = "model.json"
        #: Text of that file.
        self.text: str = text

    @property
    def report(self) -> str:
        """Report as text: fits, entries, poles, method and findings."""
        tables = [table.to_string(float_format=shown) for table in self._tables()]
        return "\n\n".join([*tables, "\n".join([f"method: {self.method}", *self._found()])])

    def _tables(self) -> list[pd.DataFrame]:
        noise: dict[str, Any] = {"noise": self.noise, "unit of noise": [self.units.get(name, "") for name in self.outputs]}
        return [self.fit.add_suffix(", %").assign(**noise).rename_axis("signal"), self.entries.rename_axis("entry"), self.poles]

    def _found(self) -> list[str]:
        return [finding_line(*finding) for finding in self.findings.itertuples(index=False)]

    def to_dict(self) -> dict[str, Any]:
        """Return the model with the keys of its file.

        >>> import adaptive_fmu
        >>> adaptive_fmu.identify(record, ["voltage"], ["speed", "current"]).to_dict()["free"][0]
        ['A', 1, 1]
        """
        model: dict[str, Any] = json.loads(self.text)
        return model

    def save(self, path: PathLike, *, force: bool = False) -> Path:
        """Write the model as a JSON file, as the command `identify` does, and return its path.

        path: file to write, such as "model.json". Descriptions of controllers for this model name it.
        force: True to overwrite an existing file. Default: False.

        >>> import adaptive_fmu
        >>> adaptive_fmu.identify(record, ["voltage"], ["speed", "current"]).save(folder / "motor.json").name
        'motor.json'
        """
        file = Path(path)
        try:
            with file.open("w" if force else "x", encoding="utf-8", newline="\n") as out:
                out.write(self.text)
        except FileExistsError:
            raise Error(f"{file}: the file exists. Use force=True to overwrite it") from None
        self.file = file.name
        return file

    def ss(self) -> control.StateSpace:
        """Return the model, without dead time, as a `StateSpace` of python-control, which must be installed.

        >>> import adaptive_fmu
        >>> adaptive_fmu.identify(record, ["voltage"], ["speed", "current"]).ss().nstates
        2
        """
        try:
            import control
        except ImportError as error:
            raise Error("Identified.ss() needs python-control. Install it: pip install control") from error
        # python-control does not allow a dot in the name of a signal.
        plain = [[name.replace(".", "_") for name in names] for names in (self.states, self.inputs, self.outputs)]
        return control.ss(self.A, self.B, self.C, self.D, states=plain[0], inputs=plain[1], outputs=plain[2])

    def plants(
        self, n: int = 200, seed: int = 1, *, margin: float = 1.0, level: float | None = None
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return n plants (A, B) of the confidence region, always the same ones for a seed.

        By turns they lie on its surface, and are drawn by their likelihood. Unlike `check`, which keeps what is drawn beyond the
        surface, this puts it on the surface: controllers are designed for the plants within.

        n: number of plants. Default: 200.
        seed: seed of the random numbers. Default: 1.
        margin: factor by which the region is larger. Default: 1.
        level: confidence level of the region. Default: that of the model.

        >>> import adaptive_fmu
        >>> plants = adaptive_fmu.identify(record, ["voltage"], ["speed", "current"]).plants(10)
        >>> len(plants), plants[0][1].shape
        (10, (2, 1))
        """
        for name, value in (("n", n), ("seed", seed)):
            if not isinstance(value, (int, np.integer)) or value < 0:
                raise ArgumentError(f"{name} = {value!r}: must be a whole number, at least 0")
        if not 0.0 < margin < math.inf:
            raise ArgumentError(f"margin = {margin!r}: must be a finite number above 0")
        places = [place for place, (matrix, *_) in enumerate(self.free) if matrix != "d"]
        variances, directions = np.linalg.eigh(self.covariance[np.ix_(places, places)])
        normal = np.random.default_rng(seed).standard_normal((n, len(places)))
        lengths = np.linalg.norm(normal, axis=1)
        radius = math.sqrt(quantile(self.level if level is None else level, len(places)))
        wanted = np.minimum(lengths, radius)
        wanted[::2] = radius
        points = normal * (margin * wanted / lengths)[:, np.newaxis]
        plants = []
        for change in points * np.sqrt(variances.clip(0.0)) @ directions.T:
            plant = {"A": self.A.copy(), "B": self.B.copy()}
            for place, difference in zip(places, change):
                matrix, row, column = self.free[place]
                plant[matrix][row - 1, column - 1] += difference
            plants.append((plant["A"], plant["B"]))
        return plants

    def plot(self) -> Figure:
        """Return fits, poles and relative standard errors as a figure of matplotlib's pyplot; bars at poles are standard errors.

        >>> import adaptive_fmu
        >>> figure = adaptive_fmu.identify(record, ["voltage"], ["speed", "current"]).plot()
        >>> [axes.get_title(loc="left") for axes in figure.axes]
        ['Fit of the held-out part', 'Poles', 'Standard errors']
        """
        return drawn(self._draw, "Identified.plot()")

    def _draw(self, figure: Figure) -> None:
        known = self.entries[(self.entries["value"] != 0.0) & np.isfinite(self.entries["error"])]
        figure.set_size_inches(10, max(5.6, 1.2 + 0.2 * len(known), 3.6 + 0.55 * len(self.outputs)))
        parts = figure.add_gridspec(2, 2, height_ratios=[0.8 + 0.55 * len(self.outputs), 3.0])
        fits, poles, errors = (figure.add_subplot(part) for part in (parts[0, 0], parts[1, 0], parts[:, 1]))
        self._plot_fits(fits)
        found = self.poles["pole"].to_numpy()
        along, across = self.poles["real_error"], self.poles["imaginary_error"]
        poles.errorbar(found.real, found.imag, xerr=along, yerr=across, marker="x", linestyle="", capsize=3)
        poles.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s")
        poles.margins(0.1)
        poles.locator_params(nbins=5)
        self._plot_errors(errors, 100 * known["error"] / known["value"].abs())
        for axes, title in zip(figure.axes, ("Fit of the held-out part", "Poles", "Standard errors")):
            # Above the legend.
            axes.set_title(title, fontsize="medium", loc="left", pad=22 if axes is fits else 6)
            axes.grid(alpha=0.3)
            axes.set_axisbelow(True)

    def _plot_fits(self, axes: Any) -> None:
        """Bars of the fits of each output, with their numbers."""
        places, count = np.arange(len(self.outputs)), len(self.fit.columns)
        for place, key in enumerate(self.fit):
            values = self.fit[key]
            bars = axes.barh(places + (place - (count - 1) / 2) * 0.8 / count, values.clip(0.0), 0.75 / count, label=key)
            axes.bar_label(
                bars,
                ["" if np.isnan(value) else np.format_float_positional(value, 1, unique=False) for value in values],
                padding=3,
                fontsize="small",
            )
        axes.set_yticks(places, self.outputs)
        axes.set(xlabel="part of the motion, %", xlim=(0, 115), ylim=(len(places) - 0.5, -0.5))
        axes.legend(fontsize="small", ncols=count, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderpad=0.2)

    def _plot_errors(self, axes: Any, parts: pd.Series) -> None:
        """Bars of relative standard errors, %, with their numbers."""
        bars = axes.barh(parts.index, parts)
        texts = [np.format_float_positional(part, 3, fractional=False, trim="-") for part in parts]
        axes.bar_label(bars, texts, padding=3, fontsize="small")
        axes.set(xlabel="part of the entry, %", xscale="log", ylim=(len(parts) - 0.4, -0.6))
        if len(parts):
            # The shortest bar is seen, and the longest has room for its number.
            low, high = parts.min() / 3, parts.max()
            axes.set_xlim(low, high * (high / low) ** 0.25)

    def __repr__(self) -> str:
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<Identified: {sizes}, {'sound' if self.sound else 'not sound'}>"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: tables, findings and plots."""
        parts = [f"<p><b>{html.escape(repr(self)[1:-1])}</b> ({html.escape(self.method)})</p>"]
        parts += [table.to_html(float_format=shown) for table in self._tables()]
        parts.append("<ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in self._found()) + "</ul>")
        return "\n".join([*parts, svg(self._draw)])


def series(values: Any, names: list[str]) -> pd.Series:
    """Values by the names of signals; NaN where there are none."""
    return pd.Series(np.nan if values == [] else values, index=names, dtype=float)


def pole_row(pole: dict[str, Any]) -> dict[str, Any]:
    """Row of the table for a pole. A single real pole stays real."""
    along, across, _ = (max(0.0, part or 0.0) ** 0.5 for part in pole["covariance"])
    value = complex(pole["real"], pole["imaginary"])
    return {"pole": value, "real_error": along, "imaginary_error": across if value.imag else 0.0}


def finding_line(kind: str, verdict: str, text: str) -> str:
    """Line for a finding, with the argument that helps."""
    advice = f" ({ADVICE[kind]})" if kind in ADVICE else ""
    return f"{verdict.replace('_', ' ')}: {text}{advice}"


def quantile(level: float, degrees: int) -> float:
    """Return the value that χ² with so many degrees of freedom doesn't exceed with this probability."""
    if not 0.0 < level < 1.0:
        raise ArgumentError(f"level = {level!r}: must be above 0 and below 1")
    half, tail = degrees / 2, -math.log1p(-level)

    def probability(value: float) -> float:
        # Series of the incomplete gamma function.
        term = total = math.exp(half * math.log(value) - value - math.lgamma(half + 1))
        place = half
        while term > 1e-17 * total:
            place += 1
            term *= value / place
            total += term
        return total

    # An upper bound, by Laurent and Massart.
    low, high = 0.0, half + math.sqrt(2 * half * tail) + tail
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if probability(middle) < level else (low, middle)
    return 2 * high


def identify(
    data: Any,
    inputs: str | Sequence[str],
    states: str | Sequence[str] | None = None,
    outputs: str | Sequence[str] | None = None,
    *,
    structure: Mapping[str, Any] | PathLike | None = None,
    order: int | None = None,
    hold_out: Any = 0.3,
    level: float = 0.99,
    delay: float | Sequence[float] | None = None,
    hold: str = "zero-order",
    fixed: str | Sequence[str] | None = None,
    offset: str | None = "record",
    windows: float | None = None,
    bandwidth: float | None = None,
    time: str | None = None,
    page: PathLike | None = None,
) -> Identified:
    """Identify a linear model of a plant from records, with the uncertainty that they leave, and return it.

    data: record, or a list of records of the same plant: DataFrames whose index is the time (s, Timedelta or Timestamp) or that
        have a column "time", dicts of columns and structured arrays with "time", or paths of CSV, Parquet (.parquet) or
        MATLAB files (.mat, version 5 or 7). Units may follow the names of columns and of the index, as in "speed [rad/s]" and
        "time [ms]". Empty cells and NaN are missing values. A column "record" divides a table into records.
    inputs: names of the columns that are inputs, without units.
    states: names of the columns that are the states; all of them are measured.
    outputs: names of the columns that are outputs, in place of `states`, if not all states are measured.
    structure: known entries, {"A": [["?<0", "?"], "x2' = x1"], "B": [[0], ["?"]]}, or the path of a TOML file with these keys:
        "?" is free, "?<0" negative, "?>0" positive, a number is known, and a row of A may be an equation. Default: all are free.
    order: number of states with `outputs`. Default: the order that predicts the held-out part best.
    hold_out: last part of each record that checks the model, or a record that does. Default: 0.3.
    level: confidence level that the model keeps for bounds. Default: 0.99.
    delay: dead time of the inputs, s, or of each input. Default: 0.
    hold: course of the inputs between rows: "zero-order", as a digital controller writes them (default), or "first-order".
    fixed: names of inputs that never move, to be left out. Default: none.
    offset: "record" for a constant of each record (default), or None: the records are deviations from a point of rest.
    windows: longest window that is simulated without correction, s. Default: whole records.
    bandwidth: bandwidth of the controller to be designed, rad/s. Default: from the model.
    time: name of the column, or of the index, with the time, without unit. Default: "time", or the index.
    page: folder or .html file for a page that shows all of it: measured and simulated signals, residuals, poles, frequency responses.
        Default: None, none is written.

    Warnings about the records, and findings for which the model should not be used, are given as `ExperimentWarning`.

    Raises `Error` if no model can be found.

    >>> import adaptive_fmu
    >>> motor = adaptive_fmu.identify(record, inputs=["voltage"], states=["speed", "current"])
    >>> bool(abs(motor.B[1, 0] - 83.8) < 3 * motor.errors["B[2,1]"])
    True
    >>> adaptive_fmu.new("pid", folder / "MotorPid.toml", plant=motor, outputs=["speed"], reference=50).name
    'MotorPid.toml'
    """
    records = list(data) if isinstance(data, (list, tuple)) else [data]
    if not records:
        raise ArgumentError("data = []: must be a record, or several")
    signals = {"inputs": inputs, "states": states, "outputs": outputs, "fixed": fixed or None}
    texts = {option: joined(option, given) for option, given in signals.items() if given is not None}
    wanted = [name.strip() for text in texts.values() for name in text.split(",") if name.strip()]
    with tempfile.TemporaryDirectory() as folder:
        given = Given(folder)
        with reworded(given.reworded):
            out = given.folder / "model.json"
            known = {"order": order, "delay": delay, "windows": windows, "bandwidth": bandwidth, "level": level}
            texts |= {option: numbers(value) for option, value in known.items() if value is not None}
            texts |= {"out": os.fspath(out), "hold": hold, "offset": offset or "none"} | (
                {"time": time} if time is not None else {}
            )
            texts |= {"page": os.fspath(page)} if page is not None else {}
            texts |= {"structure": given.structure(structure)} if structure is not None else {}
            is_part = isinstance(hold_out, (int, float, np.number))
            texts["hold-out"] = number(hold_out) if is_part else given.record(hold_out, "hold_out", time, wanted)
            named = ["data"] if len(records) == 1 else [f"data[{place}]" for place in range(len(records))]
            files = [given.record(one, name, time, wanted) for one, name in zip(records, named)]
            request = [f"--{option}={text}" for option, text in texts.items()]
            answer = done(["identify", "--json", *request, "--", *files]).json()
            text = out.read_text(encoding="utf-8")
    for finding in answer["findings"]:
        finding["text"] = given.reworded(finding["text"])
        if finding["verdict"] != "note":
            warnings.warn(finding_line(**finding), ExperimentWarning, stacklevel=2)
    return Identified(answer, text)
