"""Runs by an executor of the caller: threads, processes, or other machines."""

from __future__ import annotations

import hashlib
import os
import tempfile
import uuid
import warnings
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from . import _pool
from ._errors import ArgumentError, Error
from ._program import INTERRUPTED, Answer, Progress
from ._worker import Files, Task, forget, perform, same, version

#: Number of times that Dask repeats a run whose program was ended.
RETRIES = 2
#: Longest time to wait until workers have removed files, s.
PATIENCE = 5.0
#: Options whose values may be files that workers read.
READ = ("--case=", "--worst-of=", "--fmu=", "--hold-out=", "--structure=")
#: Options about files that only the process of the caller writes.
WRITTEN = ("--out=", "--force", "--resume", "--tag=", "--page=", "--worst=")

#: Function that submits a request: its words, and True to return the recorded signals, too.
Submit = Callable[[Sequence[str], bool], "Future[Answer]"]


@contextmanager
def submitting(executor: Any, workers: int, words: Sequence[str], loop: str | None = None) -> Iterator[Submit]:
    """Yield the function that submits requests; the files that words of them name are sent to workers on other machines."""
    if executor is None:
        with ThreadPoolExecutor(workers) as pool:
            yield _to(pool)
    elif is_of_dask(executor):
        with _by_dask(executor, words, loop) as submit:
            yield submit
    elif callable(getattr(executor, "submit", None)):
        yield _to(executor)
    else:
        raise ArgumentError(
            f"executor = {executor!r} is not allowed. It must have a method `submit` that returns a Future, as executors of "
            "concurrent.futures have, or be a Client of Dask"
        )


def ask(
    request: Sequence[str], executor: Any, progress: Progress | None = None, loop: str | None = None, advice: str = ""
) -> Answer:
    """Send a request whose jobs are carried out by an executor, or by the program itself if there is none.

    advice: what to do if the executor fails, for its message.
    """
    if executor is None:
        return _pool.ask(request, progress)
    place = list(request).index("--") if "--" in request else len(request)
    options = [word for word in request[:place] if not word.startswith(WRITTEN)]
    named = list(request[place:])
    with submitting(executor, 1, [*options, *named], loop) as submit:
        jobs = Jobs(lambda job: submit([*options, f"--job={job}", *named], False))
        try:
            answer = _pool.ask(request, progress, jobs=jobs)
        finally:
            jobs.cancel()
    if (failure := jobs.failure) is not None:
        if isinstance(failure, Error):
            raise failure
        raise Error(f"{reason(failure)} before all of it was done. {advice}".rstrip()) from failure
    if answer.code == INTERRUPTED and isinstance(executor, ThreadPoolExecutor):
        # Jobs in this process end at their next communication point.
        _pool.stop()
    return answer


class Jobs:
    """Jobs of one request, while the program waits for their results."""

    def __init__(self, submit: Callable[[str], Any]) -> None:
        #: First failure of a worker, after which the request is stopped.
        self.failure: BaseException | None = None
        self._submit = submit
        self._waiting: set[Any] = set()
        self._lock = Lock()

    def begin(self, number: int, job: str, send: Callable[[dict[str, Any]], None], stop: Callable[[], None]) -> None:
        """Submit a job; its result is sent as soon as it is there."""

        def done(future: Any) -> None:
            with self._lock:
                self._waiting.discard(future)
            failure: BaseException | None
            try:
                answer = future.result()
                failure = answer.failure()
            except (Exception, CancelledError) as error:
                failure = error
            if failure is None:
                send({"done": number, "result": answer.text})
            else:
                self.failure = self.failure or failure
                stop()

        if self.failure is not None:
            return
        try:
            future = self._submit(job)
        except Exception as error:
            self.failure = error
            stop()
            return
        with self._lock:
            self._waiting.add(future)
        if hasattr(future, "add_done_callback"):
            future.add_done_callback(done)
        else:
            Thread(target=done, args=(future,), daemon=True).start()

    def cancel(self) -> None:
        """Cancel the jobs that have not begun."""
        with self._lock:
            waiting = list(self._waiting)
        for future in waiting:
            with suppress(Exception):
                future.cancel()


def _to(executor: Any) -> Submit:
    folder, of = os.getcwd(), version()
    return lambda words, keep: executor.submit(perform, Task(words, folder, keep, of))


@contextmanager
def _by_dask(executor: Any, words: Sequence[str], loop: str | None) -> Iterator[Submit]:
    """Submit to Dask, whose workers may be on other machines: they get the files, each once."""
    client = executor if hasattr(executor, "get_executor") else executor._client
    executor = client.get_executor(retries=RETRIES) if executor is client else executor
    files, of = packed(loop, words), version()
    with warnings.catch_warnings():
        # Files of 10 MB and more would have one.
        warnings.filterwarnings("ignore", "Sending large graph")
        # A task: Dask repeats it if the workers that have its result are lost.
        sent = client.submit(same, files, pure=False) if files.contents else None
    try:
        yield lambda words, keep: executor.submit(perform, Task(words, None, keep, of), sent, pure=False)
    finally:
        if sent is not None:
            _forget(client, files.study)


def packed(loop: str | None, words: Sequence[str]) -> Files:
    """Read the files of a loop, and those that words of a request name. A loop of this package has none: each worker has it."""
    contents: dict[str, bytes] = {}
    named: dict[str, tuple[str, str]] = {}
    # The name of a loop of this package goes before that of a folder.
    if loop is not None and os.path.exists(loop):
        if loop not in {one["name"] for one in _pool.done(["list", "--json"]).json()["loops"]}:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(loop)
                if not loop.endswith(".ssp"):
                    _pool.done(["export", f"--ssp={loop}", f"--out={folder}"])
                    file = next(Path(folder).glob("*.ssp"))
                contents[file.name], named[loop] = file.read_bytes(), ("", file.name)
    is_named = False
    for number, word in enumerate(words, 1):
        option = next((option for option in READ if word.startswith(option)), "")
        file = Path(word.removeprefix(option))
        # A file that does not exist is refused by the program.
        if (option or is_named) and word != loop and file.is_file():
            path = os.path.join(str(number), file.name)
            contents[path], named[word] = file.read_bytes(), (option, path)
        is_named |= word == "--"
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


def reason(error: BaseException) -> str:
    """Return what went wrong with an executor, as the beginning of a sentence."""
    # Messages of loky have several paragraphs.
    shown = ": ".join([type(error).__name__, *str(error).splitlines()[:1]])
    if isinstance(error, BrokenExecutor):
        return f"A worker process ended, so that a new executor is needed ({shown}),"
    return f"The executor failed ({shown})"
