"""Many runs of a loop, by threads of this process or by an executor of the caller."""

from __future__ import annotations

import hashlib
import itertools
import os
import tempfile
import uuid
import warnings
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pandas as pd

from . import _pool
from ._errors import ArgumentError, Error, Interrupted
from ._program import Answer
from ._progress import counted
from ._stored import Stored
from ._sweep import Run, Sweep
from ._values import PathLike, words
from ._worker import Files, Task, forget, perform, same, version

#: Number of times that Dask repeats a run whose program was ended.
RETRIES = 2
#: Longest time to wait until workers have removed files, s.
PATIENCE = 5.0

Submit = Callable[..., "Future[Answer]"]


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
    #: Parameter sets that the requests name.
    cases: list[str]
    #: True to store the recorded signals.
    keep: bool
    #: Folder with runs that are done; None if nothing is stored.
    stored: Stored | None = None
    #: Runs that are done, by their places.
    done: dict[int, Run] = field(default_factory=dict)

    def store(self, folder: PathLike, arguments: Mapping[str, Any], force: bool) -> None:
        """Take the runs that are done from a folder, and store further ones in it."""
        files = {"files": checksums(packed(self.loop, self.cases))}
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
                with self._submitting(executor, min(workers or os.cpu_count() or 1, len(remaining))) as submit:
                    self._wait(remaining, submit, count, executor is None or isinstance(executor, ThreadPoolExecutor))
        return self._sweep()

    def _wait(self, places: Sequence[int], submit: Submit, count: Callable[[], Any], here: bool) -> None:
        waiting: dict[Future[Answer], int] = {}
        try:
            for place in places:
                waiting[submit(place)] = place
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
            failed = Error(f"{_reason(error)} {self._so_far()}")
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

    @contextmanager
    def _submitting(self, executor: Any, workers: int) -> Iterator[Submit]:
        """Yield the function that submits the run at a place."""
        if executor is None:
            with ThreadPoolExecutor(workers) as pool:
                yield self._to(pool)
        elif is_of_dask(executor):
            with self._by_dask(executor) as submit:
                yield submit
        elif callable(getattr(executor, "submit", None)):
            yield self._to(executor)
        else:
            raise ArgumentError(
                f"executor = {executor!r} is not allowed. It must have a method `submit` that returns a Future, as executors of "
                "concurrent.futures have, or be a Client of Dask"
            )

    def _to(self, executor: Any) -> Submit:
        folder, of = os.getcwd(), version()
        return lambda place: executor.submit(perform, Task(self._request(place), folder, self.keep, of))

    @contextmanager
    def _by_dask(self, executor: Any) -> Iterator[Submit]:
        """Submit to Dask, whose workers may be on other machines: they get the loop's files, each once."""
        client = executor if hasattr(executor, "get_executor") else executor._client
        executor = client.get_executor(retries=RETRIES) if executor is client else executor
        files, of = packed(self.loop, self.cases), version()
        with warnings.catch_warnings():
            # Files of 10 MB and more would have one.
            warnings.filterwarnings("ignore", "Sending large graph")
            # A task: Dask repeats it if the workers that have its result are lost.
            sent = client.submit(same, files, pure=False) if files.contents else None
        try:
            yield lambda place: executor.submit(perform, Task(self._request(place), None, self.keep, of), sent, pure=False)
        finally:
            if sent is not None:
                _forget(client, files.study)

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


def packed(loop: str, cases: Sequence[str]) -> Files:
    """Read the files of a loop and its parameter sets. A loop of this package has none: each worker has it."""
    contents: dict[str, bytes] = {}
    named: dict[str, tuple[str, str]] = {}
    # The name of a loop of this package goes before that of a folder.
    if os.path.exists(loop) and loop not in {one["name"] for one in _pool.done(["list", "--json"]).json()["loops"]}:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(loop)
            if not loop.endswith(".ssp"):
                _pool.done(["export", f"--ssp={loop}", f"--out={folder}"])
                file = next(Path(folder).glob("*.ssp"))
            contents[file.name], named[loop] = file.read_bytes(), ("", file.name)
    for number, case in enumerate(cases, 1):
        # A set that does not exist is refused by the program.
        if os.path.isfile(case):
            path = os.path.join(f"case{number}", os.path.basename(case))
            contents[path], named[f"--case={case}"] = Path(case).read_bytes(), ("--case=", path)
    return Files(uuid.uuid4().hex, contents, named)


def checksums(files: Files) -> dict[str, str]:
    """Return the checksum of each file."""
    return {path: hashlib.sha256(content).hexdigest()[:16] for path, content in files.contents.items()}


def is_of_dask(executor: Any) -> bool:
    """Return True for a Client of Dask, and for the executor of one."""
    return any(of.__module__.partition(".")[0] == "distributed" for of in type(executor).__mro__)


def _forget(client: Any, study: str) -> None:
    """Remove the files of a study from all workers, without waiting for machines that no longer answer."""

    def run() -> None:
        with suppress(Exception):
            client.run(forget, study)

    thread = Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE)


def _reason(error: BaseException) -> str:
    # Messages of loky have several paragraphs.
    shown = ": ".join([type(error).__name__, *str(error).splitlines()[:1]])
    if isinstance(error, BrokenExecutor):
        return f"A worker process ended, so that a new executor is needed ({shown}),"
    return f"The executor failed ({shown})"


def _completed(futures: Sequence[Future[Answer]]) -> Iterator[Future[Answer]]:
    """Yield futures as they complete; those of other classes in their order."""
    if all(isinstance(future, Future) for future in futures):
        yield from as_completed(futures)
    else:
        yield from futures
