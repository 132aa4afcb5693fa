"""Closed loops."""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from . import _pool
from ._errors import Error, Interrupted
from ._linear import Linearisation
from ._program import INTERRUPTED
from ._progress import counted, shown
from ._result import Result, result_of
from ._units import PathLike, linearise, loops
from ._values import Value, number, of_units, words

#: Values of one unit, by the names of its variables.
OfUnit = Mapping[str, Value]


class Loop:
    """A closed loop: one of this package by its name, or an SSP (a folder with a SystemStructure.ssd, an .ssd file, an .ssp).

    >>> import adaptive_fmu
    >>> loop = adaptive_fmu.Loop("3.3.1-case2")
    >>> result = loop.run(until=1, controller={"adaptation_gain": 1e4})
    >>> result.settings["values"]["controller.adaptation_gain"]
    '10000.0'
    """

    def __init__(self, name: PathLike) -> None:
        #: Its name or path.
        self.name: str = os.fspath(name)
        #: What the last run came to, also one that was interrupted or failed; None before the first.
        self.last: Result | None = None

    def __repr__(self) -> str:
        return f"Loop({self.name!r})"

    @property
    def description(self) -> str:
        """What it shows; "" of a loop that isn't of this package.

        >>> import adaptive_fmu
        >>> adaptive_fmu.Loop("3.2.1-square").description
        'L1 adaptive control of an uncertain nonlinear system, square-wave reference (example 3.2.1)'
        """
        known = loops()["description"]
        return str(known.get(self.name, ""))

    def run(
        self,
        *,
        until: float | None = None,
        step: float | None = None,
        order: str | None = None,
        composite: bool = False,
        case: PathLike | Sequence[PathLike] = (),
        values: Mapping[str, Value] | None = None,
        fmus: PathLike | None = None,
        out: PathLike | None = None,
        progress: bool | None = None,
        **units: OfUnit,
    ) -> Result:
        """Runs the loop through its units.

        until, step: stop time and communication step, s; the loop's own where they aren't given.
        order: "gauss-seidel" or "jacobi".
        composite: as one unit, integrated together.
        case: parameter sets (.ssv), the last wins.
        values: start values by name, "unit.variable"; a unit's own as `unit={"variable": value}`. An array sets each element.
        fmus: folder of FMUs to be used as they are.
        out: folder for a page with plots, CSV and metrics; nothing is written without one.
        progress: whether a bar is shown; unless that is said, in notebooks and terminals.

        Raises `ArgumentError` for arguments that can't be, `Error` for names and values that don't fit and for a unit that
        fails (`partial` has what was computed until then), and `Interrupted` (a KeyboardInterrupt, with `partial`) where the
        user stops it. A metric beyond its limit raises nothing: see `Result.holds` and `Result.check`.

        >>> import adaptive_fmu
        >>> result = adaptive_fmu.Loop("3.2.1-cosine").run(until=2, plant={"omega": 2.5, "x0": [0.1, 0]})
        >>> result.holds, float(result.data.loc[0, "plant.x[1]"])
        (True, 0.1)
        """
        request = ["run", *self._words(until, step, order, composite, case, fmus), "--json"]
        request += words("--set", of_units(values, units))
        request += [f"--out={os.fspath(out)}"] if out is not None else []
        return self._run([*request, *self._named], progress)

    @property
    def _named(self) -> list[str]:
        """The loop, behind all options: its name may begin as one does."""
        return ["--", self.name]

    @staticmethod
    def _words(
        until: float | None,
        step: float | None,
        order: str | None,
        composite: bool,
        case: PathLike | Sequence[PathLike],
        fmus: PathLike | None,
    ) -> list[str]:
        cases = [case] if isinstance(case, (str, os.PathLike)) else case
        found = [f"--case={os.fspath(file)}" for file in cases]
        for option, value in (("--until", until), ("--step", step)):
            found += [f"{option}={number(value)}"] if value is not None else []
        for option, text in (("--order", order), ("--fmus", fmus)):
            found += [f"{option}={os.fspath(text)}"] if text is not None else []
        return [*found, "--composite"] if composite else found

    def _run(self, request: Sequence[str], progress: bool | None) -> Result:
        with shown(self.name, progress) as show:
            answer = _pool.ask(request, show)
        try:
            self.last = result_of(answer)
        except (Error, Interrupted) as error:
            self.last = error.partial
            raise
        return self.last

    def sweep(
        self,
        over: Mapping[str, ArrayLike],
        *,
        workers: int | None = None,
        keep: bool = False,
        until: float | None = None,
        step: float | None = None,
        order: str | None = None,
        composite: bool = False,
        case: PathLike | Sequence[PathLike] = (),
        values: Mapping[str, Value] | None = None,
        progress: bool | None = None,
        **units: OfUnit,
    ) -> Sweep:
        """Runs the loop for all combinations of some values, on all cores.

        over: values by the names of variables, "unit.variable".
        workers: runs at a time; as many as there are cores unless given.
        keep: whether the runs themselves are kept, not only their metrics.
        The rest is as in `run`. A run that a unit ended is a row that says so; only a refused request raises.
        Interrupted, it raises `Interrupted`, and `partial` has the rows until then.

        >>> import adaptive_fmu, numpy as np
        >>> loop = adaptive_fmu.Loop("3.2.1-cosine")
        >>> swept = loop.sweep({"controller.adaptation_gain": np.logspace(3, 5, 3)}, until=6)
        >>> swept.data[["controller.adaptation_gain", "ended"]].to_dict("list")
        {'controller.adaptation_gain': [1000.0, 10000.0, 100000.0], 'ended': ['complete', 'complete', 'complete']}
        """
        names, axes = list(over), [np.asarray(of).ravel().tolist() for of in over.values()]
        points = list(itertools.product(*axes))
        fixed = ["run", *self._words(until, step, order, composite, case, None), "--json"]
        fixed += words("--set", of_units(values, units))
        requests = [[*fixed, *words("--set", dict(zip(names, point))), *self._named] for point in points]
        swept = Sweep(self.name, names, keep)
        workers = min(workers or os.cpu_count() or 1, max(len(points), 1))
        pool = ThreadPoolExecutor(workers)
        waiting: list[tuple[Any, Future[Any]]] = []
        try:
            with counted(self.name, len(points), progress) as count:
                waiting = [(point, pool.submit(_pool.ask, request)) for point, request in zip(points, requests)]
                for point, future in waiting:
                    swept.add(point, future.result())
                    count()
        except KeyboardInterrupt:
            _give_up(waiting)
            interrupted = Interrupted(f"interrupted after {len(swept.data)} of {len(points)} runs, which `partial` has")
            interrupted.partial = swept
            raise interrupted from None
        except BaseException:
            _give_up(waiting)
            raise
        finally:
            pool.shutdown(wait=True)
        return swept

    def tune(
        self,
        parameters: Mapping[str, tuple[float, float] | None] = {},
        *,
        metric: str | None = None,
        square: Sequence[str] = (),
        particles: int = 20,
        generations: int = 20,
        seed: int = 1,
        separate: bool = False,
        until: float | None = None,
        step: float | None = None,
        case: PathLike | Sequence[PathLike] = (),
        values: Mapping[str, Value] | None = None,
        out: PathLike | None = None,
        force: bool = False,
        tag: str | None = None,
        progress: bool | None = None,
        **units: OfUnit,
    ) -> Tuned:
        """Searches values of parameters by a particle swarm, on all cores.

        parameters: bounds (low, high) by the names of variables, or None for those of the FMU; those that the loop names
            where there are none.
        metric: label of the metric that is minimised; or
        square: terms "WEIGHT SIGNAL - SIGNAL", the sum of whose squares is; what the loop says where neither is given.
        particles, generations, seed: of the swarm; the same seed gives the same search.
        separate: through separate units, instead of one unit where that can be.
        out: folder for what was found as parameter sets (.ssv), and how the search went. The same search called again goes on
            with what is there; another search is refused with what differs.
        force: start anew, and replace what an earlier search left in the folder.
        tag: keep the results in a folder whose name ends with @tag, next to those of other searches.

        Raises as `run`; interrupted, it returns the best so far, which says so.

        >>> import adaptive_fmu
        >>> loop = adaptive_fmu.Loop("3.2.1-cosine")
        >>> gain = {"controller.feedback_gain[1,1]": (2.0, 40.0)}
        >>> tuned = loop.tune(gain, metric="max |u|", until=6, particles=3, generations=2)
        >>> tuned.objective <= tuned.before
        True
        """
        request = ["tune", *self._words(until, step, None, False, case, None), "--json"]
        request += words("--set", of_units(values, units))
        for name, bounds in parameters.items():
            within = "" if bounds is None else f"={number(bounds[0])}..{number(bounds[1])}"
            request += [f"--parameter={name}{within}"]
        request += [f"--metric={metric}"] if metric is not None else []
        request += [f"--square={term}" for term in square]
        request += [f"--particles={particles}", f"--generations={generations}", f"--seed={seed}"]
        request += ["--separate"] if separate else []
        request += ["--force"] if force else []
        request += [f"--tag={tag}"] if tag is not None else []
        with tempfile.TemporaryDirectory() as folder, shown(self.name, progress) as show:
            request += [f"--out={os.fspath(folder if out is None else out)}", *self._named]
            answer = _pool.ask(request, show)
            if (answer.code != INTERRUPTED or not answer.text) and (failure := answer.failure()):
                raise failure
            return Tuned(answer.json(), None if out is None else Path(out), answer.notes)

    def linearise(
        self,
        at: float | None = None,
        *,
        steady_state: bool = False,
        values: Mapping[str, Value] | None = None,
        step: float | None = None,
        **units: OfUnit,
    ) -> Linearisation:
        """The linear system that the whole loop is like about an operating point; see `adaptive_fmu.linearise`.

        >>> import adaptive_fmu
        >>> bool((adaptive_fmu.Loop("3.2.1-cosine").linearise(at=0.5).eigenvalues.real < 0).any())
        True
        """
        together = of_units(values, units)
        return linearise(self.name, at=at, steady_state=steady_state, values=together, step=step)


def _give_up(waiting: Sequence[tuple[Any, Future[Any]]]) -> None:
    """Runs that haven't begun don't; those that have stop at the next communication point."""
    for _, future in waiting:
        future.cancel()
    _pool.stop()


class Sweep:
    """Runs for all combinations of some values.

    >>> import adaptive_fmu
    >>> swept = adaptive_fmu.Loop("3.2.1-cosine").sweep({"plant.omega": [1.0, 2.0]}, until=6)
    >>> list(swept.data.columns[:2]), len(swept)
    (['plant.omega', 'ended'], 2)
    """

    def __init__(self, name: str, names: Sequence[str], keep: bool) -> None:
        #: Name of the loop.
        self.name = name
        #: The runs, in the order of the rows; empty unless they were to be kept.
        self.results: list[Result] = []
        self._names, self._keep = list(names), keep
        self._rows: list[dict[str, Any]] = []

    def add(self, point: Sequence[Any], answer: Any) -> None:
        """Takes the answer of one run."""
        row: dict[str, Any] = dict(zip(self._names, point))
        if answer.table is None:
            raise answer.failure() or Error("the program gave no result")
        if answer.code == INTERRUPTED:
            raise KeyboardInterrupt
        failure = answer.failure()
        result = Result(answer)
        row["ended"] = result.ended
        row.update(result.metrics["value"])
        row["message"] = "" if failure is None else str(failure)
        self._rows.append(row)
        if self._keep:
            self.results.append(result)

    @property
    def data(self) -> pd.DataFrame:
        """A row a combination: its values, how the run ended, the metrics by their labels, and why a run failed.

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


class Tuned:
    """What a search found.

    >>> import adaptive_fmu
    >>> loop = adaptive_fmu.Loop("3.2.1-cosine")
    >>> tuned = loop.tune({"controller.feedback_gain[1,1]": (5.0, 40.0)}, metric="max |u|", until=6, particles=2, generations=1)
    >>> result = loop.run(until=6, values=tuned.values)
    """

    def __init__(self, told: dict[str, Any], folder: Path | None, notes: Sequence[str]) -> None:
        #: Name of the loop.
        self.name: str = told["loop"]
        #: The best values, by the names of the parameters.
        self.values: dict[str, float] = told["parameters"]
        #: What they come to, and what the loop did before; None where that run failed.
        self.objective: float = told["objective"]["best"]
        self.before: float | None = told["objective"]["start"]
        #: The same through separate units, as `Loop.run` runs them; None where the search went through these, or they fail.
        self.verified: float | None = told["objective"].get("verified")
        #: "complete" or "interrupted".
        self.ended: str = told["ended"]
        #: Runs in all, and those that failed.
        self.runs: int = told["runs"]
        self.failed: int = told["failed"]
        #: Folder of the parameter sets; None where none was asked for.
        self.folder = folder
        #: What the program had to say.
        self.notes: list[str] = list(notes)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {value:.6g}" for name, value in self.values.items())
        return f"<{self.name} tuned: {values}; objective {self.objective:.6g} in {self.runs} runs>"
