"""The program that does the work: where it is, and a connection to it."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any, Protocol, cast

import numpy as np

from ._errors import ArgumentError, Error, Interrupted

NAME = "adaptive-fmu.exe" if os.name == "nt" else "adaptive-fmu"
#: Environment variable with the path of another program, used instead of the one installed with this package.
VARIABLE = "ADAPTIVE_FMU_PROGRAM"
INTERRUPTED = 130
#: First byte of each message of the program.
RECORD_SEPARATOR = b"\x1e"

#: Function that is called with the progress of a run: a fraction from 0 to 1, and a line to show.
Progress = Callable[[float, str], None]


def program() -> Path:
    """Return the file of the program.

    It is the file in the environment variable `ADAPTIVE_FMU_PROGRAM`, else the one installed with this package, else the first
    on PATH.

    >>> import adaptive_fmu
    >>> adaptive_fmu.program().stem
    'adaptive-fmu'
    """
    if named := os.environ.get(VARIABLE):
        return Path(named)
    # Folders where pip installs programs: of this environment, of the user, or next to the packages (`pip install --target`).
    user = sysconfig.get_path("scripts", f"{os.name}_user") if f"{os.name}_user" in sysconfig.get_scheme_names() else ""
    folders = [sysconfig.get_path("scripts"), user, str(Path(__file__).parents[1] / "bin")]
    for folder in filter(None, folders):
        if (file := Path(folder) / NAME).is_file():
            return file
    if found := shutil.which(NAME):
        return Path(found)
    raise Error(
        f"The program {NAME} was not found in the folders where pip installs programs, nor on PATH. Install this package with "
        f"pip, or set the environment variable {VARIABLE} to the file of the program"
    )


def require_unicode(*words: str) -> None:
    """Raise `ArgumentError` for a text that can't be sent: names of files may be any bytes, but requests are Unicode."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            shown = word.encode(errors="backslashreplace").decode()
            raise ArgumentError(
                f"`{shown}` is not UTF-8, as names of files and folders must be. Rename the file or folder, or give the path of "
                "a link to it whose name is UTF-8"
            ) from None


# Keyword arguments whose names differ from those of the options that they become.
KEYWORDS = {"event": "events", "parameter": "parameters", "set": "values"}
OPTION = re.compile(
    r"--(amplitude|at|at-most|bandwidth|case|compile|composite|confidence|delay|event|fixed|fmus|force|free|generations|hold|hold-out|"
    r"input|inputs|interface|kinds|level|margin|measured|metric|noise|offset|operating-point|order|out|output|"
    r"outputs|parameter|particles|plant|platforms|rare|record|reference|require|runs|seed|separate|set|settling-time|signal|"
    r"source|square|ssp|states|steady-state|step|structure|tag|terminals|time|uncertainty|until|up-to|values|vary|vary-from|"
    r"want|windows|without)\b(?![\w-])(?: <[^>]+>| (NAME)\b)?"
)

# Commands that messages name, and the calls that do the same.
COMMANDS = {
    r"`adaptive-fmu simulate ([^`]*)`": r"`adaptive_fmu.simulate('\1')`",
    r"`adaptive-fmu new loop --units ([^`]*) …`": r"`adaptive_fmu.Loop.connect('\1', …)`",
    r"--units": "component",
    r"--connect": "connect",
}


def in_keywords(message: str) -> str:
    """Return a message of the program with keyword arguments in place of the options that they became."""

    def keyword(option: re.Match[str]) -> str:
        return KEYWORDS.get(option[1], option[1].replace("-", "_")) + (f"={option[2]}" if option[2] else "")

    for command, call in COMMANDS.items():
        message = re.sub(command, call, message)
    return OPTION.sub(keyword, message)


@contextmanager
def reworded(change: Callable[[str], str]) -> Iterator[None]:
    """Change the messages of errors, such as those that name a file of which the caller knows nothing."""
    try:
        yield
    except Error as error:
        raise type(error)(change(str(error))) from None


@dataclass
class Answer:
    """Answer of the program to a request."""

    code: int = 0
    text: str = ""
    notes: list[str] = field(default_factory=list)
    #: Recorded time and signals, one row each; `about` has their names and the settings of the run.
    table: np.ndarray | None = None
    about: dict[str, Any] = field(default_factory=dict)

    def json(self) -> Any:
        """Return the printed JSON text as Python values."""
        return json.loads(self.text)

    def failure(self) -> BaseException | None:
        """Return the exception for the exit code, or None on success. A metric beyond its limit counts as success."""
        if self.code in (0, 3):
            return None
        if self.code == INTERRUPTED:
            return Interrupted("The run was interrupted. The attribute `partial` contains the results until then")
        errors = [note.removeprefix("error: ") for note in self.notes if note.startswith("error: ")]
        message = errors[-1] if errors else "\n".join(self.notes).strip() or f"The request failed with exit code {self.code}"
        # The rest describes the usage of the command line, which does not concern a caller from Python.
        message = in_keywords(message.split("\n\n")[0].strip())
        return ArgumentError(message) if self.code == 2 else Error(message)


class Jobs(Protocol):
    """What carries out jobs of a request."""

    def begin(self, number: int, job: str, send: Callable[[dict[str, Any]], None], stop: Callable[[], None]) -> None:
        """Begin a job, whose result is sent, or stop the request."""


class Conversation:
    """Connection to one running program, which answers one request at a time. The program ends when its input is closed."""

    def __init__(self) -> None:
        # An interrupt from the terminal goes to Python only, which asks the program to stop.
        apart: dict[str, Any] = (
            {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
            if sys.platform == "win32"
            else {"start_new_session": True}
        )
        self._request = 0
        #: Lines to send while the program carries out a request that has jobs; None otherwise.
        self._lines: SimpleQueue[dict[str, Any] | None] | None = None
        file = program()
        # Compilers installed as Python packages (ziglang) are taken from this Python environment.
        apart["env"] = {**os.environ, "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])}
        try:
            self.process = subprocess.Popen([file, "serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart)
        except OSError as error:
            raise Error(
                f"The program {file} can't be started: {error}. Install this package with pip, or set the environment variable "
                f"{VARIABLE} to the file of the program"
            ) from error

    @property
    def is_alive(self) -> bool:
        return self.process.poll() is None

    def ask(
        self,
        words: Sequence[str],
        progress: Progress | None = None,
        folder: str | None = None,
        jobs: Jobs | None = None,
    ) -> Answer:
        """Send one command, as words of the command line, and return its answer."""
        self._request += 1
        folder = os.getcwd() if folder is None else folder
        require_unicode(*words, folder)
        self._send({"request": self._request, "arguments": list(words), "folder": folder, "workers": jobs is not None})
        answer = Answer()
        with self._sending_results(jobs), self._listening_to_interrupts() as heard:
            while not self._receive(answer, progress, jobs):
                pass
        if heard:
            # The request may have completed before the program received the stop.
            answer.code = INTERRUPTED
        return answer

    def stop(self) -> None:
        """Ask the program to stop its request at the next communication point. May be called from any thread."""
        if (lines := self._lines) is not None:
            lines.put({"stop": self._request})
            return
        stream = cast("IO[bytes]", self.process.stdin)
        try:
            # Bypass the buffer of the stream, to which another thread may be writing. A line this short is written in one piece.
            os.write(stream.fileno(), json.dumps({"stop": self._request}).encode() + b"\n")
        except OSError:
            pass  # The program has ended; the thread that waits for its answer raises the error.

    @contextmanager
    def _sending_results(self, jobs: Jobs | None) -> Iterator[None]:
        """Send results of jobs from a thread of its own: they come in any thread, and while the program sends jobs."""
        if jobs is None:
            yield
            return
        lines: SimpleQueue[dict[str, Any] | None] = SimpleQueue()

        def send() -> None:
            while (line := lines.get()) is not None:
                with suppress(Error):
                    self._send(line)

        thread = threading.Thread(target=send, daemon=True)
        self._lines = lines
        thread.start()
        try:
            yield
        finally:
            self._lines = None
            lines.put(None)
            thread.join()

    @contextmanager
    def _listening_to_interrupts(self) -> Iterator[list[int]]:
        """Handle interrupts: the first asks the program to stop and return its results so far, the second kills it."""
        heard: list[int] = []
        before = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is not threading.main_thread() or not callable(before):
            yield heard
            return

        def hear(number: int, _: object) -> None:
            heard.append(number)
            if len(heard) == 1:
                self.stop()
            else:
                self.process.kill()

        signal.signal(signal.SIGINT, hear)
        try:
            yield heard
        except Error:
            if len(heard) > 1:
                raise KeyboardInterrupt from None
            raise
        finally:
            signal.signal(signal.SIGINT, before)

    def end(self, kill: bool = False) -> None:
        """End the program and close its streams. True for `kill` ends it immediately."""
        if kill:
            self.process.kill()
        for stream in (self.process.stdin, self.process.stdout):
            try:
                cast("IO[bytes]", stream).close()
            except OSError:
                pass
        self.process.wait()

    def abandon(self) -> None:
        """Close the streams in a forked process: the program belongs to the parent, and ends when no process has its input open."""
        for stream in (self.process.stdin, self.process.stdout):
            # Not the buffers, which a thread of the parent may have locked.
            cast("Any", stream).raw.close()
        self.process.returncode = 0

    def _send(self, request: dict[str, Any]) -> None:
        stream = cast("IO[bytes]", self.process.stdin)
        try:
            stream.write(json.dumps(request).encode() + b"\n")
            stream.flush()
        except OSError:
            raise self._gone() from None

    def _receive(self, answer: Answer, progress: Progress | None, jobs: Jobs | None) -> bool:
        """Read one message into the answer. Return True if it was the last."""
        stream = cast("IO[bytes]", self.process.stdout)
        line = stream.readline()
        if not line.endswith(b"\n"):
            raise self._gone()
        # Text that an FMU wrote to standard output comes before a message, or on a line of its own.
        written, _, message = line.rpartition(RECORD_SEPARATOR)
        if written:
            answer.notes.append(written.decode(errors="replace"))
        if not line.startswith(RECORD_SEPARATOR) and not written:
            answer.notes.append(message.decode(errors="replace").rstrip())
            return False
        kind, value = next(iter(json.loads(message).items()))
        if kind == "end":
            answer.code = value
        elif kind == "text":
            answer.text += value
        elif kind == "note":
            answer.notes.append(value)
        elif kind == "progress" and progress is not None:
            progress(value["done"], value["told"])
        elif kind == "job" and jobs is not None and (lines := self._lines) is not None:
            jobs.begin(value["number"], value["job"], lines.put, self.stop)
        elif kind == "recording":
            answer.about = value
            rows, columns = value["rows"], 1 + len(value["names"])
            data = stream.read(8 * rows * columns)
            if len(data) < 8 * rows * columns:
                raise self._gone()
            answer.table = np.frombuffer(data, "<f8").reshape(columns, rows)
        return bool(kind == "end")

    def _gone(self) -> Error:
        code = self.process.wait()
        how = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
        return Error(f"The program {how} during the request. Its last output is shown above. The next call starts it again")
