"""Closed loops."""

from __future__ import annotations

import html
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from numpy.typing import ArrayLike

from . import _pool
from ._drafted import Diagram, Drafted
from ._errors import ArgumentError, Error, Interrupted
from ._executor import ask
from ._linear import Linearisation
from ._program import INTERRUPTED
from ._progress import shown
from ._result import Result, result_of
from ._study import Study, combined
from ._sweep import Sweep
from ._units import linearise
from ._values import Events, PathLike, Value, alias, event_words, number, of_units, texts, words
from ._values import shown as shown_number

#: Values for one component, by the names of its variables.
OfUnit = Mapping[str, Value]


class Loop:
    """A closed loop: a loop of this package, an SSP, or components that `connect` connects.

    name: name of the loop, or path of the SSP: a folder with SystemStructure.ssd, an .ssd file, or an .ssp archive.

    >>> import adaptive_fmu
    >>> loop = adaptive_fmu.Loop("3.3.1-case2")
    >>> result = loop.run(until=1, controller={"adaptation_gain": 1e4})
    >>> result.settings["values"]["controller.adaptation_gain"]
    '10000.0'
    """

    def __init__(self, name: PathLike) -> None:
        #: Name or path of the loop.
        self.name: str = os.fspath(name)
        #: Result of the last run, even if it was interrupted or failed; None before the first run.
        self.last: Result | None = None
        self._drafted: Drafted | None = None
        self._structure()

    @classmethod
    def connect(
        cls,
        *components: PathLike | tuple[str, PathLike],
        connect: Mapping[str, str] | None = None,
        name: str | None = None,
        step: float | None = None,
        until: float | None = None,
    ) -> Loop:
        """Connect components by the names of their signals and return the loop, which `save` stores as an SSP.

        components: FMUs of any tool, description files (NAME.toml), or names of FMUs of this package; a pair (name, component) sets
            its name in the loop. By default it is named by its role (such as reference, plant or controller) if no other component has
            that role, else by its file.
        connect: outputs by the inputs that they go to, where names differ: {"plant.u": "controller.voltage"}. Arrays of equal length
            are connected element by element.
        name: name of the loop and of its results. Default: "loop".
        step: communication step, s. Default: the shortest that an FMU proposes, or 0.001.
        until: stop time, s. Default: the latest that an FMU proposes, or 10.

        Inputs that remain unconnected are listed in a warning. They keep their start values.

        Raises `ArgumentError` if a component or signal does not exist or a connection does not fit.

        >>> import adaptive_fmu
        >>> parts = ["ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso"]
        >>> loop = adaptive_fmu.Loop.connect(*parts, connect={"plant.u": "controller.u"}, step=0.001, until=5)
        >>> [len(loop.run().data), loop.save(folder / "own").name]
        [5001, 'own']
        """
        drafted = Drafted(components, dict(connect or {}), name or "loop", step, until)
        draft = drafted.write(drafted.folder)
        if draft["open"]:
            lines = "; ".join(f"{each['input']} ({each['reason']})" for each in draft["open"])
            warnings.warn(f"inputs that are not connected keep their start values: {lines}", stacklevel=2)
        for warning in draft["warnings"]:
            warnings.warn(warning.removeprefix("warning: "), stacklevel=2)
        loop = cls(drafted.folder)
        loop._drafted = drafted
        return loop

    def save(self, folder: PathLike, *, force: bool = False) -> Path:
        """Write a loop of `connect` as an SSP into a folder, SystemStructure.ssd, and return the folder. The loop stays where it is.

        folder: folder to write into, created if it does not exist. Other files in it stay as they are.
        force: True to overwrite an existing SystemStructure.ssd. Default: False.

        Raises `Error` if the loop is not one of `connect`, which is in a folder already.

        >>> import adaptive_fmu
        >>> loop = adaptive_fmu.Loop.connect("ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso")
        >>> (loop.save(folder / "saved") / "SystemStructure.ssd").is_file()
        True
        """
        if self._drafted is None:
            raise Error(f"{self.name} is stored already. Only loops of Loop.connect are saved")
        self._drafted.write(folder, force=force)
        return Path(folder)

    def diagram(self) -> Diagram:
        """Return a diagram of components and connections, which notebooks show; its text is SVG.

        >>> import adaptive_fmu
        >>> str(adaptive_fmu.Loop("3.2.1-cosine").diagram())[:4]
        '<svg'
        """
        return Diagram(self._structure())

    def _structure(self) -> dict[str, Any]:
        if self.name.endswith(".fmu"):
            raise ArgumentError(
                f"{self.name} is an FMU, not a loop: `adaptive_fmu.simulate` simulates it, `adaptive_fmu.Loop.connect` connects it with others"
            )
        structure: dict[str, Any] = _pool.done(["info", "--json", *self._named]).json()
        return structure

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the diagram."""
        return f"<p><b>{html.escape(self._structure()['name'])}</b>: {html.escape(self.description)}</p>{self.diagram()}"

    def __repr__(self) -> str:
        if self._drafted is not None:
            return f"Loop.connect({', '.join(map(repr, self._drafted.components))})"
        return f"Loop({self.name!r})"

    @property
    def description(self) -> str:
        """Description of what the loop shows; "" if it has none.

        >>> import adaptive_fmu
        >>> adaptive_fmu.Loop("3.2.1-square").description
        'L1 adaptive control of an uncertain nonlinear system, square-wave reference (example 3.2.1)'
        """
        return str(self._structure()["description"])

    def run(
        self,
        *,
        until: float | None = None,
        step: float | None = None,
        order: str | None = None,
        composite: bool = False,
        case: PathLike | Sequence[PathLike] = (),
        values: Mapping[str, Value] | None = None,
        events: Events = (),
        start_values: Mapping[str, Value] | None = None,
        stop_time: float | None = None,
        output_interval: float | None = None,
        fmus: PathLike | None = None,
        out: PathLike | None = None,
        progress: bool | None = None,
        **units: OfUnit,
    ) -> Result:
        """Run the loop and return its `Result`.

        until: stop time, s. Default: the loop's own. `stop_time` is the same.
        step: communication step, s. Default: the loop's own. `output_interval` is the same.
        order: order of stepping, "gauss-seidel" or "jacobi". Default: the loop's own.
        composite: True to simulate the loop as one continuous system, with `step` as the output interval. It excludes `order` and
            `fmus`. Default: False, each component is simulated separately.
        case: parameter set (.ssv) to apply, or several. If several sets give a variable a value, the last one counts.
        values: start values by name, "component.variable". They override those of `case`. An array sets each element. `start_values` is
            the same.
        **units: start values of one component by the names of its variables, e.g. `plant={"omega": 2.5}`. They override `values`.
        events: values that tunable parameters and open inputs get during the run, (time in s, "component.variable", value), at the
            first communication point that is not before that time.
        fmus: folder with FMUs to use as they are. Default: those that come with the loop; others are generated from descriptions.
        out: folder for a page with plots, CSV and metrics. Default: None, nothing is written.
        progress: True to show a progress bar, False to show none. Default: a bar in notebooks and terminals.

        Raises `ArgumentError` if an argument is not allowed. Raises `Error` if a name or value does not fit the loop, or if an
        FMU fails; `partial` then contains the results until the failure. Raises `Interrupted` (a KeyboardInterrupt, with
        `partial`) if the user interrupts the run. A metric beyond its limit raises nothing: see `Result.holds` and
        `Result.check`.

        >>> import adaptive_fmu
        >>> result = adaptive_fmu.Loop("3.2.1-cosine").run(until=2, plant={"omega": 2.5, "x0": [0.1, 0]})
        >>> result.holds, float(result.data.loc[0, "plant.x[1]"])
        (True, 0.1)
        """
        until, step = alias("until", until, "stop_time", stop_time), alias("step", step, "output_interval", output_interval)
        values = alias("values", values, "start_values", start_values)
        request = ["run", *self._words(until, step, order, composite, case, fmus), "--json"]
        request += [*words("--set", of_units(values, units)), *event_words(events)]
        request += [f"--out={os.fspath(out)}"] if out is not None else []
        return self._run([*request, *self._named], progress)

    @property
    def _named(self) -> list[str]:
        """Words for the loop, after all options: its name may begin with a dash, as an option does."""
        return ["--", self.name]

    @staticmethod
    def _cases(case: PathLike | Sequence[PathLike]) -> Sequence[PathLike]:
        return [case] if isinstance(case, (str, os.PathLike)) else case

    @staticmethod
    def _words(
        until: float | None,
        step: float | None,
        order: str | None,
        composite: bool,
        case: PathLike | Sequence[PathLike],
        fmus: PathLike | None,
    ) -> list[str]:
        found = [f"--case={os.fspath(file)}" for file in Loop._cases(case)]
        for option, value in (("--until", until), ("--step", step)):
            found += [f"{option}={number(value)}"] if value is not None else []
        for option, text in (("--order", order), ("--fmus", fmus)):
            found += [f"{option}={os.fspath(text)}"] if text is not None else []
        return [*found, "--composite"] if composite else found

    @property
    def _shown(self) -> str:
        """Name in progress bars and tables."""
        return self.name if self._drafted is None else self._drafted.name

    def _run(self, request: Sequence[str], progress: bool | None) -> Result:
        with shown(self._shown, progress) as show:
            answer = _pool.ask(request, show)
        try:
            self.last = result_of(answer)
        except (Error, Interrupted) as error:
            self.last = error.partial
            raise
        return self.last

    def sweep(
        self,
        over: Mapping[str, ArrayLike] | pd.DataFrame,
        *,
        workers: int | None = None,
        executor: Any = None,
        keep: bool = False,
        until: float | None = None,
        step: float | None = None,
        order: str | None = None,
        composite: bool = False,
        case: PathLike | Sequence[PathLike] = (),
        values: Mapping[str, Value] | None = None,
        events: Events = (),
        out: PathLike | None = None,
        force: bool = False,
        progress: bool | None = None,
        **units: OfUnit,
    ) -> Sweep:
        """Run the loop with all combinations of some values, or with the rows of a table, in parallel, and return a `Sweep`.

        over: values to combine, by the names of variables, "component.variable"; or a DataFrame with one row per run, whose columns
            have these names.
        workers: number of parallel runs. Default: number of cores. It excludes `executor`.
        executor: where the runs are carried out: an executor of concurrent.futures or loky, a `Client` of Dask or its
            `get_executor()`, or any object whose `submit(function, …)` returns a Future. Each worker needs this package in the same
            version. Dask gets the files of the loop and of `case` from here; for other executors their paths must exist on the
            machines of the workers. The results are the same to the bit on machines of the same platform. Default: None, threads of
            this process.
        keep: True to store each run in `Sweep.results`. Default: False, only the metrics are stored.
        out: folder in which each run is stored as soon as it is done. A call with the same arguments continues the sweep that is
            stored there, also with further values in `over`; a call with other arguments is refused, and the message lists the
            differences. Default: None, nothing is stored.
        force: True to start again and replace an earlier sweep in the folder. Default: False.

        The other arguments are those of `run`. If an FMU fails, the row of that run shows the reason; only a refused request
        raises an exception. If the user interrupts the sweep, it raises `Interrupted`, if workers are lost, `Error`, whose `partial`
        contains the rows until then. Dask repeats the runs of lost workers.

        >>> import adaptive_fmu, numpy as np
        >>> loop = adaptive_fmu.Loop("3.2.1-cosine")
        >>> swept = loop.sweep({"controller.adaptation_gain": np.logspace(3, 5, 3)}, until=6)
        >>> swept.data[["controller.adaptation_gain", "ended"]].to_dict("list")
        {'controller.adaptation_gain': [1000.0, 10000.0, 100000.0], 'ended': ['complete', 'complete', 'complete']}
        """
        if workers is not None and executor is not None:
            raise ArgumentError("workers and executor exclude each other: the executor has its own number of workers")
        cases = [os.fspath(file) for file in self._cases(case)]
        together = of_units(values, units)
        fixed = ["run", *self._words(until, step, order, composite, cases, None), "--json", *words("--set", together)]
        fixed += event_words(events)
        names, points = combined(over)
        study = Study(self.name, self._shown, names, points, fixed, keep)
        if out is not None:
            times = {name: None if time is None else float(time) for name, time in (("until", until), ("step", step))}
            further = {"order": order, "composite": composite, "values": texts(together), "events": event_words(events)}
            study.store(out, {"loop": self._structure()["name"], **times, **further}, force)
        return study.carry_out(executor, workers, progress)

    def tune(
        self,
        parameters: Mapping[str, tuple[float, float] | None] = {},
        *,
        metric: str | None = None,
        square: Sequence[str] = (),
        worst_of: Sequence[PathLike] = (),
        particles: int = 20,
        generations: int = 20,
        seed: int = 1,
        separate: bool = False,
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
    ) -> Tuned:
        """Tune parameters of the loop by a particle swarm, on all cores, and return the best values as a `Tuned`.

        parameters: bounds (low, high) by the names of variables, or None for the bounds of the FMU. Default: the parameters that
            the loop names.
        metric: label of the metric to minimise. It excludes `square`.
        square: terms "WEIGHT SIGNAL - SIGNAL", of whose squares the sum over sampled points is minimised. Default, if neither
            `metric` nor `square` is given: the loop's own objective.
        worst_of: parameter sets (.ssv), such as corners of the plant: the largest objective of the loop as it is and with each of them is
            minimised. Default: none.
        particles: number of particles in the swarm. Default: 20.
        generations: number of generations, each with one run per particle. Default: 20.
        seed: seed of the random numbers; the same seed gives the same search. Default: 1.
        separate: True to simulate the components separately, as `run` does. Default: False, the loop is one continuous system if
            possible, and the best values are run once more with separate components.
        executor: where the runs are carried out, as for `sweep`: each particle of a generation is one job. The result is the same to
            the bit on machines of the same platform. If workers are lost, it raises `Error`, and with `out` the same call continues.
            Default: None, threads of this process.
        until: stop time, s. Default: the loop's own for tuning, or else its own for runs.
        out: folder for the best values as parameter sets (.ssv), and for the course of the search. A call with the same arguments
            continues the search that is stored there; a call with other arguments is refused, and the message lists the
            differences. Default: None, nothing is stored.
        force: True to start again and replace the results of an earlier search in the folder. Default: False.
        tag: store the results in a folder whose name ends with @tag, next to those of other searches. Default: no tag.

        The other arguments, and the exceptions, are those of `run`. If the user interrupts the search, it returns the best values
        so far, and `Tuned.ended` is "interrupted".

        >>> import adaptive_fmu
        >>> loop = adaptive_fmu.Loop("3.2.1-cosine")
        >>> gain = {"controller.feedback_gain[1,1]": (2.0, 40.0)}
        >>> tuned = loop.tune(gain, metric="max |u|", until=6, particles=3, generations=2)
        >>> tuned.objective <= tuned.before
        True
        """
        request = ["tune", *self._words(until, step, None, False, case, None), "--json"]
        request += [*words("--set", of_units(values, units)), *event_words(events)]
        for name, bounds in parameters.items():
            within = "" if bounds is None else f"={number(bounds[0])}..{number(bounds[1])}"
            request += [f"--parameter={name}{within}"]
        request += [f"--metric={metric}"] if metric is not None else []
        request += [f"--square={term}" for term in square]
        request += [f"--worst-of={os.fspath(file)}" for file in worst_of]
        request += [f"--particles={particles}", f"--generations={generations}", f"--seed={seed}"]
        request += ["--separate"] if separate else []
        request += ["--force"] if force else []
        request += [f"--tag={tag}"] if tag is not None else []
        with tempfile.TemporaryDirectory() as folder, shown(self._shown, progress) as show:
            request += [f"--out={os.fspath(folder if out is None else out)}", *self._named]
            answer = ask(request, executor, show, self.name, "The same call continues it if `out` is given")
            if (answer.code != INTERRUPTED or not answer.text) and (failure := answer.failure()):
                raise failure
            return Tuned(answer.json(), None if out is None else Path(out), answer.notes)

    def linearise(
        self,
        at: float | None = None,
        *,
        steady_state: bool = False,
        free: Sequence[str] = (),
        want: Mapping[str, Value] | None = None,
        hold: Sequence[str] = (),
        values: Mapping[str, Value] | None = None,
        step: float | None = None,
        **units: OfUnit,
    ) -> Linearisation:
        """Linearise the loop at an operating point; see `adaptive_fmu.linearise` for the arguments.

        **units: values of one component by the names of its variables, e.g. `plant={"omega": 2.5}`. They override `values`.

        >>> import adaptive_fmu
        >>> bool((adaptive_fmu.Loop("3.2.1-cosine").linearise(at=0.5).eigenvalues.real < 0).any())
        True
        """
        together = of_units(values, units)
        return linearise(self.name, at=at, steady_state=steady_state, free=free, want=want, hold=hold, values=together, step=step)


class Tuned:
    """Best values that a search found.

    >>> import adaptive_fmu
    >>> loop = adaptive_fmu.Loop("3.2.1-cosine")
    >>> tuned = loop.tune({"controller.feedback_gain[1,1]": (5.0, 40.0)}, metric="max |u|", until=6, particles=2, generations=1)
    >>> result = loop.run(until=6, values=tuned.values)
    """

    def __init__(self, output: dict[str, Any], folder: Path | None, notes: Sequence[str]) -> None:
        #: Name of the loop.
        self.name: str = output["loop"]
        #: Best values, by the names of the parameters.
        self.values: dict[str, float] = output["parameters"]
        #: Objective with the best values.
        self.objective: float = output["objective"]["best"]
        #: Objective before the search; None if that run failed.
        self.before: float | None = output["objective"]["start"]
        #: Objective with the best values and separate components, as `Loop.run` simulates them. None if the search itself used
        #: separate components, or if that run failed.
        self.verified: float | None = output["objective"].get("verified")
        #: "complete" or "interrupted".
        self.ended: str = output["ended"]
        #: Number of runs.
        self.runs: int = output["runs"]
        #: Number of runs that failed.
        self.failed: int = output["failed"]
        #: The folder given as `out`; None if none was given.
        self.folder = folder
        #: Notes and warnings that the program printed.
        self.notes: list[str] = list(notes)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: values, objective, and notes."""
        values = pd.DataFrame({"value": self.values}).rename_axis("parameter")
        objective = f"objective {shown_number(self.objective)}"
        objective += "" if self.before is None else f", before the search {shown_number(self.before)}"
        notes = "".join(f"<li>{html.escape(note)}</li>" for note in self.notes)
        head = f"<p><b>{html.escape(self.name)}</b>: {objective}; {self.runs} runs, {self.failed} failed, {self.ended}</p>"
        return f"{head}{values.to_html(float_format=shown_number)}<ul>{notes}</ul>"

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {value:.6g}" for name, value in self.values.items())
        return f"<{self.name} tuned: {values}; objective {self.objective:.6g} in {self.runs} runs>"
