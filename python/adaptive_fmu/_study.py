"""Many runs of a loop, by threads of this process or by an executor of the caller."""

from __future__ import annotations

import itertools
import os
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from . import _pool
from ._errors import Error, Interrupted
from ._executor import Submit, checksums, packed, reason, submitting
from ._program import Answer
from ._progress import counted
from ._stored import Stored
from ._sweep import Run, Sweep
from ._values import PathLike, words
from ._worker import version


@dataclass
class Study:
    """Runs of one loop: what they need, and those that are done."""

    #: Name or path of the loop.
    loop: str
    #: What it is called in the results.
    title: str
    #: Names of the values that differ.
    names: list[str]
    #: Values of each run.
    points: list[dict[str, Any]]
    #: Words of each request, before the values of the run.
    fixed: list[str]
    #: True to store the recorded signals.
    keep: bool
    #: Folder with runs that are done; None if nothing is stored.
    stored: Stored | None = None
    #: Runs that are done, by their places.
    done: dict[int, Run] = field(default_factory=dict)

    def store(self, folder: PathLike, arguments: Mapping[str, Any], force: bool) -> None:
        """Take the runs that are done from a folder, and store further ones in it."""
        files = {"files": checksums(packed(self.loop, self.fixed))}
        self.stored = Stored(folder, {"version": version(), **arguments, **files, "over": self.names}, force)
        for place, point in enumerate(self.points):
            if run := self.stored.get(point, self.keep):
                self.done[place] = run

    def carry_out(self, executor: Any, workers: int | None, progress: bool | None) -> Sweep:
        """Carry out the runs that remain and return all."""
        remaining = [place for place in range(len(self.points)) if place not in self.done]
        with counted(self.title, len(self.points), progress) as count:
            count(len(self.done))
            if remaining:
                threads = min(workers or os.cpu_count() or 1, len(remaining))
                with submitting(executor, threads, self.fixed, self.loop) as submit:
                    self._wait(remaining, submit, count, executor is None or isinstance(executor, ThreadPoolExecutor))
        return self._sweep()

    def _wait(self, places: Sequence[int], submit: Submit, count: Callable[[], Any], here: bool) -> None:
        waiting: dict[Future[Answer], int] = {}
        try:
            for place in places:
                waiting[submit(self._request(place), self.keep)] = place
            for future in _completed(list(waiting)):
                self._accept(waiting.pop(future), future.result())
                count()
        except KeyboardInterrupt:
            self._give_up(waiting, here)
            interrupted = Interrupted(f"Interrupted {self._so_far()}")
            interrupted.partial = self._sweep()
            raise interrupted from None
        except Error as error:
            self._give_up(waiting, here)
            error.partial = self._sweep() if self.done else None
            raise
        except (Exception, CancelledError) as error:
            self._give_up(waiting, here)
            failed = Error(f"{reason(error)} {self._so_far()}")
            failed.partial = self._sweep() if self.done else None
            raise failed from error

    def _accept(self, place: int, answer: Answer) -> None:
        run = Run.of(self.points[place], answer, self.keep)
        try:
            if self.stored is not None:
                self.stored.add(run)
        finally:
            # Also if an interrupt comes while the disk is written.
            self.done[place] = run

    def _give_up(self, waiting: Mapping[Future[Answer], int], here: bool) -> None:
        """Cancel runs that have not begun, stop those of this process at their next communication point, and accept what is done."""
        for future in waiting:
            with suppress(Exception):
                future.cancel()
        if here:
            _pool.stop()
        for future, place in waiting.items():
            with suppress(Exception, CancelledError, KeyboardInterrupt):
                if future.done() and not future.cancelled():
                    self._accept(place, future.result())

    def _sweep(self) -> Sweep:
        return Sweep(self.title, self.names, [self.done[place] for place in sorted(self.done)])

    def _so_far(self) -> str:
        further = "Give `out` a folder in which runs are stored, so that a later call continues"
        if self.stored is not None:
            further = "The same call continues"
        return f"after {len(self.done)} of {len(self.points)} runs. The attribute `partial` contains them. {further}"

    def _request(self, place: int) -> list[str]:
        return [*self.fixed, *words("--set", self.points[place]), "--", self.loop]


def combined(over: Any) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the names of values, and the values of each run: all combinations, or the rows of a table."""
    if isinstance(over, pd.DataFrame):
        names = [str(name) for name in over.columns]
        rows: Iterator[tuple[Any, ...]] = zip(*(over.iloc[:, column].tolist() for column in range(len(names))))
    else:
        names = list(over)
        rows = itertools.product(*(np.asarray(of).ravel().tolist() for of in over.values()))
    return names, [dict(zip(names, row)) for row in rows]


def _completed(futures: Sequence[Future[Answer]]) -> Iterator[Future[Answer]]:
    """Yield futures as they complete; those of other classes in their order."""
    if all(isinstance(future, Future) for future in futures):
        yield from as_completed(futures)
    else:
        yield from futures
