"""Design reports."""

from __future__ import annotations

import html
import os
from typing import TYPE_CHECKING, Any

import pandas as pd

from ._errors import LimitExceeded
from ._executor import ask
from ._figures import shown, svg
from ._values import PathLike, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: How curves of a picture are drawn, by what they are of.
STYLES: dict[str, dict[str, Any]] = {
    "nominal": {},
    "worst": {"alpha": 0.4, "linewidth": 0.8},
    "bound": {"color": "0.3", "linestyle": "--", "linewidth": 0.8},
    "marks": {"marker": "x", "linestyle": ""},
    "worst_marks": {"marker": "x", "linestyle": "", "alpha": 0.4},
}


class Checked:
    """Report on the design of an FMU.

    >>> import adaptive_fmu
    >>> adaptive_fmu.check("L1CoupledMimo")
    <L1CoupledMimo: sound>
    """

    def __init__(self, report: dict[str, Any]) -> None:
        #: Name of the FMU.
        self.name: str = report["name"]
        #: True if the design satisfies all its conditions; warnings are allowed.
        self.sound: bool = report["sound"]
        #: Verdict of the worst finding: "ok", "warning" or "not_sound".
        self.verdict: str = report["verdict"]
        #: What the loop with the nominal plant does, in a line; None if the description has no nominal plant.
        self.summary: str | None = report.get("summary")
        #: Report as the program prints it.
        self.text: str = report["text"]
        #: Findings, one row each: section, name, value, unit (of measurement), verdict and note.
        self.findings: pd.DataFrame = pd.DataFrame(
            report["findings"], columns=["section", "name", "value", "unit", "verdict", "note"]
        )
        #: Findings about the plants within the uncertainty by their names, such as "plants tried" and "stable up to"; for an
        #: identified plant they are those of its region. Empty without a nominal plant.
        self.region: dict[str, Any] = {
            finding["name"]: finding["value"] for finding in report["findings"] if finding["section"] == "Uncertain plants"
        }
        #: Plants within the uncertainty with which the loop is worst: `respects` (names of findings), A and B.
        self.worst: list[dict[str, Any]] = report.get("worst") or []
        #: Pictures of the loop with the nominal plant: title, x, y, logarithmic, curves (name, of, points). Empty without such a plant.
        self.pictures: list[dict[str, Any]] = report.get("pictures") or []
        #: Worst plant that `worst_case` found: A, B, settling_time, overshoot, peaks, failure, tried. None if it isn't searched for.
        self.worst_case: dict[str, Any] | None = report.get("worst_case")

    def check(self) -> Checked:
        """Return the report itself, or raise `LimitExceeded` if the design is not sound.

        >>> import adaptive_fmu
        >>> adaptive_fmu.check("L1CoupledMimo").check().sound
        True
        """
        if not self.sound:
            raise LimitExceeded(self.text)
        return self

    def plot(self) -> Figure:
        """Return the pictures, one below the other, as a figure of matplotlib's pyplot.

        >>> import adaptive_fmu
        >>> plant = [[-1.0]], [[2.0]], [[1.0]], [[0.0]]
        >>> file = adaptive_fmu.new("pid", folder / "Plotted.toml", plant=plant, bandwidth=3, uncertainty=0.2)
        >>> [axes.get_title(loc="left") for axes in adaptive_fmu.check(file).plot().axes][:2]
        ['Step of the reference', 'Step of the reference: controls']
        """
        return shown(self._draw, "Checked.plot()")

    def _draw(self, figure: Figure) -> None:
        count = max(1, len(self.pictures))
        figure.set_size_inches(8, 2.4 * count)
        for place, picture in enumerate(self.pictures):
            axes = figure.add_subplot(count, 1, place + 1)
            colours: dict[str, str] = {}
            for curve in picture["curves"]:
                colour = colours.setdefault(curve["name"], f"C{len(colours)}")
                x, y = zip(*curve["points"])
                axes.plot(x, y, **STYLES[curve["of"]] | ({"color": colour} if curve["of"] != "bound" else {}))
            axes.set_title(picture["title"], fontsize="medium", loc="left")
            axes.set(xlabel=picture["x"], ylabel=picture["y"], xscale="log" if picture["logarithmic"] else "linear")
            axes.grid(alpha=0.3)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the report and its pictures."""
        head = f"<p><b>{html.escape(self.name)}</b>: {'sound' if self.sound else html.escape(self.verdict)}</p>"
        return f"{head}<pre>{html.escape(self.text)}</pre>{svg(self._draw) if self.pictures else ''}"

    def __repr__(self) -> str:
        return f"<{self.name}: {'sound' if self.sound else self.verdict}>"


def check(
    description: PathLike,
    *,
    plants: int | None = None,
    seed: int | None = None,
    worst_case: float | None = None,
    worst: PathLike | None = None,
    page: PathLike | None = None,
    executor: Any = None,
) -> Checked:
    """Check the design of an FMU: the loop with the nominal plant, poles, margins, and the conditions of its method.

    description: description file (NAME.toml), or FMU of this package.
    plants: number of plants within the uncertainty to try. Default: 200.
    seed: seed of the random ones among them, and of `worst_case`. Default: 1.
    worst_case: time of a search for the worst plant within the uncertainty, with runs of the FMUs, s. Default: None, no search.
    worst: file for the worst plant as a parameter set (.ssv). Default: None, nothing is written.
    page: file for the report as a page with pictures (.html). Default: None, nothing is written.
    executor: where the runs of `worst_case` are carried out, as for `Loop.sweep`; how many plants are tried in its time depends on
        it. Default: None, threads of this process.

    Raises `Error` if the description is refused, or has no nominal plant for these options.

    >>> import adaptive_fmu
    >>> adaptive_fmu.check("L1CoupledMimo").sound
    True
    """
    request = ["check", "--json"]
    for option, value in (("--plants", plants), ("--seed", seed)):
        request += [f"{option}={value}"] if value is not None else []
    request += [f"--worst-case={number(worst_case)}"] if worst_case is not None else []
    for option, file in (("--worst", worst), ("--page", page)):
        request += [f"{option}={os.fspath(file)}"] if file is not None else []
    answer = ask([*request, "--", os.fspath(description)], executor)
    if failure := answer.failure():
        raise failure
    return Checked(answer.json())
