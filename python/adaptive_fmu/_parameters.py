"""Parameters of an FMU or a loop, estimated from records."""

from __future__ import annotations

import html
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ._errors import ArgumentError, Error, ExperimentWarning
from ._executor import ask
from ._identify import series
from ._program import reworded
from ._records import Given
from ._values import PathLike, Value, joined, number, shown, words

#: Ranges of parameters.
Ranges = Mapping[str, "tuple[float, float] | None"]


class Estimated:
    """Parameters of an FMU with their uncertainty, and the linear model that follows from them.

    >>> import adaptive_fmu
    >>> motor = adaptive_fmu.identify(record, ["voltage"], ["speed", "current"])
    >>> plant = adaptive_fmu.new("state-space", folder / "Motor.toml", plant=motor)
    >>> adaptive_fmu.estimate(plant, record, ["voltage"], ["speed", "current"], free=["B[2,1]"])
    <Estimated: B[2,1] = 83.7572 ± 0.0288831, sound>
    """

    def __init__(self, answer: dict[str, Any], text: str, parameter_set: str) -> None:
        rows, outputs = answer["parameters"], answer["outputs"]
        #: Estimates by name: value, error (standard error), unit, and record, from 1, of an initial state.
        self.parameters: pd.DataFrame = pd.DataFrame(rows, columns=["name", "value", "error", "unit", "record"]).set_index("name")
        #: Values of the parameters that all records have, as `values` of `simulate` and `Loop.run` takes them.
        self.values: dict[str, float] = {row["name"]: row["value"] for row in rows if row["record"] is None}
        #: Covariance of the estimates, in their order.
        self.covariance: np.ndarray = np.array(answer["covariance"], dtype=float).reshape(len(rows), len(rows))
        #: Standard deviation of the noise of each output, in the output's unit.
        self.noise: pd.Series = series(answer["noise"], outputs)
        #: Fit of the held-out part of each output, % of its motion: `held_out`, and `ceiling`, about what noise allows.
        self.fit: pd.DataFrame = pd.DataFrame({key: series(answer[name], outputs) for key, name in FITS.items()})
        #: Findings for which the model should not be used for a design.
        self.findings: list[str] = answer["findings"]
        #: False if there is such a finding.
        self.sound: bool = answer["sound"]
        #: The linear model, as its file has it; None if there is none.
        self.model: dict[str, Any] | None = answer["model"]
        #: Name of that file, as descriptions name it.
        self.file: str = "model.json"
        #: Text of that file; empty if there is no linear model.
        self.text: str = text
        #: The parameters as a parameter set of SSP (.ssv).
        self.parameter_set: str = parameter_set

    def save(self, path: PathLike, *, force: bool = False) -> Path:
        """Write the linear model as a JSON file and the parameters as a parameter set (.ssv) and return the path of the model.

        path: file to write, such as "model.json".
        force: True to overwrite existing files. Default: False.

        >>> import adaptive_fmu
        >>> motor = adaptive_fmu.identify(record, ["voltage"], ["speed", "current"])
        >>> plant = adaptive_fmu.new("state-space", folder / "Plant.toml", plant=motor)
        >>> found = adaptive_fmu.estimate(plant, record, ["voltage"], ["speed", "current"], free=["B[2,1]"])
        >>> found.save(folder / "fitted.json").name
        'fitted.json'
        """
        file = Path(path)
        texts = {file.with_suffix(".ssv"): self.parameter_set, **({file: self.text} if self.text else {})}
        there = next((one for one in texts if one.exists() and not force), None)
        if there is not None:
            raise Error(f"{there}: the file exists. Use force=True to overwrite it")
        for one, text in texts.items():
            one.write_text(text, encoding="utf-8", newline="\n")
        self.file = file.name
        return file

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {shown(row.value)} ± {shown(row.error)}" for name, row in self.parameters.iterrows())
        return f"<Estimated: {values}, {'sound' if self.sound else 'not sound'}>"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: tables and findings."""
        fit = self.fit.add_suffix(", %").assign(noise=self.noise).rename_axis("output")
        tables = [table.to_html(float_format=shown, na_rep="") for table in (self.parameters, fit)]
        return "\n".join([*tables, "<ul>", *(f"<li>{html.escape(text)}</li>" for text in self.findings), "</ul>"])


#: Columns of fits, and their names in the answer.
FITS = {"held_out": "fit", "ceiling": "ceiling"}


def ranges(argument: str, given: str | Sequence[str] | Ranges) -> str:
    """Return names with their ranges as the option has them."""
    if not isinstance(given, Mapping):
        return joined(argument, given)
    parts = []
    for name, both in given.items():
        try:
            parts.append(name if both is None else f"{name}={number(both[0])}:{number(both[1])}")
        except (TypeError, IndexError):
            raise ArgumentError(f"{argument}[{name!r}] = {both!r}: must be (smallest, largest) or None") from None
    return ",".join(parts)


def estimate(
    fmu: PathLike,
    data: Any,
    inputs: str | Sequence[str] | None,
    outputs: str | Sequence[str],
    *,
    free: str | Sequence[str] | Ranges,
    initial: str | Sequence[str] | Ranges | None = None,
    values: Mapping[str, Value] | None = None,
    hold_out: float = 0.3,
    level: float = 0.99,
    hold: str = "zero-order",
    offset: str | None = "record",
    time: str | None = None,
    executor: Any = None,
) -> Estimated:
    """Estimate parameters of an FMU or a loop from records and return them with their uncertainty.

    fmu: FMU archive (NAME.fmu) of any tool, FMU of this package, description file (NAME.toml), or loop.
    data: record, or a list of records, as `identify` takes them.
    inputs: names of the columns that are inputs of the FMU; None if it has none.
    outputs: names of the columns that are outputs of the FMU and were measured.
    free: names of the parameters to estimate; as a dict with their smallest and largest values, or None: {"mass": (0.1, 3)}.
    initial: names of start values to estimate for each record, as initial states. Default: none.
    values: start values of parameters, where the search begins, or constant values of inputs, by name.
    hold_out: last part of each record that checks the result. Default: 0.3.
    level: confidence level that the linear model keeps for bounds. Default: 0.99.
    hold: course of the inputs between rows: "zero-order", as a digital controller writes them (default), or "first-order".
    offset: "record" for a constant error of each output in each record (default), or None.
    time: name of the column, or of the index, with the time, without unit. Default: "time", or the index.
    executor: where the records are simulated, as for `Loop.sweep`; a job is one record with one set of values. Default: None, this
        process.

    The result is a plant for `new` and `design`: linear about its start, with the uncertainty that the parameters leave. Findings
    for which it should not be used are given as `ExperimentWarning`.

    Raises `Error` if the FMU fails or the records can't show the parameters.

    >>> import adaptive_fmu
    >>> motor = adaptive_fmu.identify(record, ["voltage"], ["speed", "current"])
    >>> plant = adaptive_fmu.new("state-space", folder / "Own.toml", plant=motor)
    >>> found = adaptive_fmu.estimate(plant, record, ["voltage"], ["speed", "current"], free={"A[2,1]": (-10, 0)})
    >>> bool(abs(found.values["A[2,1]"] - motor.A[1, 0]) < 3 * motor.errors["A[2,1]"])
    True
    """
    records = list(data) if isinstance(data, (list, tuple)) else [data]
    if not records:
        raise ArgumentError("data = []: must be a record, or several")
    signals = {"inputs": inputs, "outputs": outputs}
    texts = {option: joined(option, given) for option, given in signals.items() if given is not None}
    wanted = [name.strip() for text in texts.values() for name in text.split(",") if name.strip()]
    sought = {"free": free, "initial": initial}
    texts |= {option: ranges(option, given) for option, given in sought.items() if given is not None}
    texts |= {"hold-out": number(hold_out), "level": number(level), "hold": hold, "offset": offset or "none"}
    texts |= {"time": time} if time is not None else {}
    with tempfile.TemporaryDirectory() as folder:
        given = Given(folder)
        with reworded(given.reworded):
            out = given.folder / "model.json"
            named = ["data"] if len(records) == 1 else [f"data[{place}]" for place in range(len(records))]
            files = [given.record(one, name, time, wanted) for one, name in zip(records, named)]
            request = [f"--{option}={text}" for option, text in (texts | {"fmu": os.fspath(fmu), "out": os.fspath(out)}).items()]
            made = ask(["identify", "--json", *request, *words("--set", values or {}), "--", *files], executor)
            if failure := made.failure():
                raise failure
            answer = made.json()
            text = out.read_text(encoding="utf-8") if answer["model"] else ""
            parameter_set = out.with_suffix(".ssv").read_text(encoding="utf-8")
    answer["findings"] = [given.reworded(finding) for finding in answer["findings"]]
    for finding in answer["findings"]:
        warnings.warn(f"not sound: {finding}", ExperimentWarning, stacklevel=2)
    return Estimated(answer, text, parameter_set)
