"""Verification of a loop by random samples."""

from __future__ import annotations

import html
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import pandas as pd

from ._executor import ask
from ._figures import shown as drawn
from ._figures import svg
from ._loop import Loop, OfUnit
from ._program import INTERRUPTED
from ._progress import shown
from ._values import Events, PathLike, Value, event_words, number, of_units, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A distribution as a text, such as "±30%" or "normal(0, 0.1)", or bounds (low, high) of a uniform one.
Distribution = Union[str, "tuple[float, float]"]
#: Groups of runs over which the share of failures is drawn.
GROUPS = 12


class Verified:
    """Result of a verification.

    >>> import adaptive_fmu
    >>> verified = adaptive_fmu.verify("3.2.1-cosine", {"plant.omega": "±30%"}, ["max |u| <= 1000"], runs=20, until=2)
    >>> verified.runs, verified.failures
    (20, 0)
    """

    def __init__(self, answer: dict[str, Any], samples: pd.DataFrame, folder: Path | None, notes: Sequence[str]) -> None:
        #: Name of the loop.
        self.name: str = answer["loop"]
        #: "passed", "failed" or "undecided"; None without `at_most`, or if the user interrupted the study.
        self.verdict: str | None = answer["verdict"]
        #: The verdict as a sentence, with the confidence.
        self.sentence: str = answer["sentence"]
        #: Number of runs.
        self.runs: int = answer["runs"]
        #: Number of runs that failed.
        self.failures: int = answer["failures"]
        #: The failure rate: of the runs, or estimated with `rare`; None if the user interrupted the latter.
        self.rate: float | None = answer["share"]
        #: Levels of a subset simulation (`rare`), one row each: margin, samples, within, accepted; None without.
        self.levels: pd.DataFrame | None = pd.DataFrame(answer["rare"]["levels"]) if answer["rare"] else None
        #: Interval of the failure rate with the confidence that was asked for.
        self.interval: tuple[float, float] = (answer["interval"][0], answer["interval"][1])
        #: The confidence.
        self.confidence: float = answer["confidence"]
        #: Runs among the failures that did not reach their end.
        self.not_ended: int = answer["not_ended"]
        #: Runs among the failures in which a required metric has no value.
        self.without_value: int = answer["without_value"]
        #: Samples that a component refused; they are not runs.
        self.refused: int = answer["refused"]
        #: Requirements, one row each: label, side ("<=" or ">="), value, violated (number of runs).
        self.requirements: pd.DataFrame = pd.DataFrame(answer["requirements"], columns=["label", "side", "value", "violated"])
        varied = pd.DataFrame(answer["varied"], columns=["name", "distribution", "index_of_failing", "index_of_distance"])
        #: What was varied, by name, with the first-order indices of failing and of the distance to the nearest limit.
        self.varied: pd.DataFrame = varied.set_index("name")
        #: True if each run was one continuous system, False if it went through separate FMUs.
        self.one_system: bool = answer["one_system"]
        #: "complete" or "interrupted".
        self.ended: str = answer["ended"]
        #: All samples, one row each: its number (index), values, result, metrics and message.
        self.samples: pd.DataFrame = samples
        #: Folder with the results; None if no `out` was given.
        self.folder = folder
        #: Notes and warnings that the program printed.
        self.notes: list[str] = list(notes)

    def plot(self) -> Figure:
        """Return a figure of the share of failing runs over each parameter; with `rare`, of the values in failing runs.

        >>> import adaptive_fmu
        >>> verified = adaptive_fmu.verify("3.2.1-cosine", {"plant.omega": "±30%"}, ["max |u| <= 1.28"], runs=20, until=2)
        >>> len(verified.plot().axes)
        1
        """
        return drawn(self._draw, "plot()")

    def _draw(self, figure: Figure) -> None:
        runs = self.samples[self.samples["result"] != "refused"]
        failing = 100.0 * (runs["result"] != "passed")
        names = list(self.varied.index)
        figure.set_size_inches(7.0, 2.2 * len(names))
        plots: Any = figure.subplots(len(names), squeeze=False)
        for axes, name in zip(plots[:, 0], names):
            if self.levels is None:
                _draw_rate(axes, name, runs[name], failing)
            else:
                axes.hist(runs[name][failing > 0], bins=GROUPS)
                axes.set_xlabel(name)
                axes.set_ylabel("failing runs")
        figure.suptitle(self.sentence, fontsize="medium", wrap=True)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the verdict, what drives failures, and notes."""
        notes = "".join(f"<li>{html.escape(note)}</li>" for note in self.notes)
        head = f"<p><b>{html.escape(self.name)}</b>: {html.escape(self.sentence)}</p>"
        return f"{head}{self.varied.to_html()}{svg(self._draw) if self.runs else ''}<ul>{notes}</ul>"

    def __repr__(self) -> str:
        return f"<{self.name} verified: {self.sentence}>"


def _draw_rate(axes: Axes, name: str, values: pd.Series, failing: pd.Series) -> None:
    """Draw the share of failing runs over groups of equal numbers of runs."""
    groups = pd.qcut(values, max(1, min(GROUPS, len(values) // 20)), duplicates="drop")
    means = pd.DataFrame({"value": values, "failing": failing}).groupby(groups, observed=True).mean()
    axes.plot(means["value"], means["failing"], marker="o")
    axes.set_xlabel(name)
    axes.set_ylabel("failing runs in %")
    axes.grid(alpha=0.3)


def verify(
    loop: Loop | PathLike,
    vary: Mapping[str, Distribution] = {},
    require: str | Sequence[str] = (),
    *,
    vary_from: Mapping[str, PathLike] = {},
    at_most: float | None = None,
    rare: bool = False,
    confidence: float = 0.95,
    runs: int | None = None,
    seed: int = 1,
    same_noise: bool = False,
    separate: bool = False,
    backend: str = "auto",
    executor: Any = None,
    until: float | None = None,
    step: float | None = None,
    case: PathLike | Sequence[PathLike] = (),
    values: Mapping[str, Value] | None = None,
    events: Events = (),
    out: PathLike | None = None,
    force: bool = False,
    tag: str | None = None,
    progress: bool | None = None,
    **units: OfUnit,
) -> Verified:
    """Run a loop with random parameters, count the runs that fail, and return a `Verified` with the verdict.

    loop: `Loop`, name of a loop of this package, or path of one.
    vary: distributions by the names of parameters and initial states, "component.variable": "±30%" of the present value, a pair
        (low, high) or "LOW..HIGH" for a uniform one, "LOW..HIGH/log", or "normal(MEAN,DEVIATION)". "event[1].time" is the time of
        the first of `events`.
    require: requirements such as "max |u| <= 118", "overshoot y[1] <= 10%", "settling y[1] <= 0.5" or "funnel". Default: the limits
        that the loop's metrics have.
    vary_from: files by the names of state-space components, whose A and B are drawn: a model.json of `identify`, or a controller's
        description with the uncertainty in its [nominal].
    at_most: largest failure rate that is allowed; the study ends as soon as it is decided. Default: None, the rate is estimated.
    rare: True to estimate a small failure rate by subset simulation. Default: False.
    confidence: confidence of the verdict and of the interval. Default: 0.95.
    runs: largest number of runs. Default: 100 / at_most, 20000 with `rare`, or 10000.
    seed: seed of the random numbers; the same seed gives the same samples. Default: 1.
    same_noise: True to use the same sensor noise in all runs. Default: False.
    separate: True to simulate the components separately, as `Loop.run` does. Default: False, the loop is one continuous system if
        possible.
    backend: "gpu" for a graphics card, "cpu" for none. Default: "auto", one is used if it is faster.
    executor: where the runs are carried out, as for `Loop.sweep`; files of `vary_from` must exist on the machines of the workers.
        Default: None, threads of this process.
    out: folder for the results. A call with the same arguments continues the study that is stored there. Default: None, nothing is
        stored.
    force: True to start again and replace the results of an earlier study in the folder. Default: False.
    tag: store the results in a folder whose name ends with @tag, next to those of other studies. Default: no tag.

    The other arguments, and the exceptions, are those of `Loop.run`. If the user interrupts the study, it returns what there is, and
    `Verified.ended` is "interrupted".

    >>> import adaptive_fmu
    >>> vary = {"plant.omega": "±30%", "controller.adaptation_gain": "1e4..1e5/log"}
    >>> verified = adaptive_fmu.verify("3.2.1-cosine", vary, ["max |u| <= 1000"], at_most=0.5, until=2)
    >>> verified.verdict
    'passed'
    """
    loop = loop if isinstance(loop, Loop) else Loop(loop)
    request = ["verify", *loop._words(until, step, None, False, case, None), "--json"]
    request += [*words("--set", of_units(values, units)), *event_words(events)]
    for name, distribution in vary.items():
        text = distribution if isinstance(distribution, str) else "..".join(number(end) for end in distribution)
        request += [f"--vary={name}={text}"]
    request += [f"--require={text}" for text in ([require] if isinstance(require, str) else require)]
    request += [f"--vary-from={name}={os.fspath(file)}" for name, file in vary_from.items()]
    request += [f"--at-most={number(at_most)}"] if at_most is not None else []
    request += [f"--runs={runs}"] if runs is not None else []
    request += [f"--backend={backend}"] if backend != "auto" else []
    request += [f"--confidence={number(confidence)}", f"--seed={seed}"]
    for option, is_given in (("--rare", rare), ("--same-noise", same_noise), ("--separate", separate), ("--force", force)):
        request += [option] if is_given else []
    request += [f"--tag={tag}"] if tag is not None else []
    with tempfile.TemporaryDirectory() as folder, shown(loop._shown, progress) as show:
        request += [f"--out={os.fspath(folder if out is None else out)}", *loop._named]
        answer = ask(request, executor, show, loop.name, "The same call continues it if `out` is given")
        if (answer.code != INTERRUPTED or not answer.text) and (failure := answer.failure()):
            raise failure
        result = answer.json()
        file = Path(result["results"]) / "samples.csv"
        samples = pd.read_csv(file, index_col="sample", dtype={"message": object}).fillna({"message": ""})
        return Verified(result, samples, None if out is None else Path(result["results"]), answer.notes)
