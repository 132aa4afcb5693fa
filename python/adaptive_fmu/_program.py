"""The program that this package talks to: where it is, and one conversation with it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from ._errors import ArgumentError, Error, Interrupted

NAME = "adaptive-fmu.exe" if os.name == "nt" else "adaptive-fmu"
#: Names another program in place of the one that was installed with this package.
VARIABLE = "ADAPTIVE_FMU_PROGRAM"
INTERRUPTED = 130
#: Stands before each message of the program.
RECORD_SEPARATOR = b"\x1e"

#: Hears how far a run is: a part of 1, and a line to show.
Progress = Callable[[float, str], None]


def program() -> Path:
    """The program's file: that of `ADAPTIVE_FMU_PROGRAM`, else the one installed with this package, else the first on PATH.

    >>> import adaptive_fmu
    >>> adaptive_fmu.program().stem
    'adaptive-fmu'
    """
    if named := os.environ.get(VARIABLE):
        return Path(named)
    # Where pip puts programs: of this environment, of a user's own packages, or beside them (`pip install --target`).
    user = sysconfig.get_path("scripts", f"{os.name}_user") if f"{os.name}_user" in sysconfig.get_scheme_names() else ""
    folders = [sysconfig.get_path("scripts"), user, str(Path(__file__).parents[1] / "bin")]
    for folder in filter(None, folders):
        if (file := Path(folder) / NAME).is_file():
            return file
    if found := shutil.which(NAME):
        return Path(found)
    raise Error(f"the program {NAME} isn't found: install this package by pip, or name the program's file in {VARIABLE}")


def require_unicode(*words: str) -> None:
    """Refuses what can't be handed over: the names of files may be any bytes, the conversation is Unicode."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            shown = word.encode(errors="backslashreplace").decode()
            raise ArgumentError(f"`{shown}` is not UTF-8: rename the file or folder, or name it by a link that is") from None


@dataclass
class Answer:
    """What the program answered to a request."""

    code: int = 0
    text: str = ""
    notes: list[str] = field(default_factory=list)
    #: Recorded signals, a column each, with what the program tells of them.
    table: np.ndarray | None = None
    about: dict[str, Any] = field(default_factory=dict)

    def json(self) -> Any:
        """What it printed, which is JSON."""
        return json.loads(self.text)

    def failure(self) -> BaseException | None:
        """The exception that its exit code means; None where it was done. Beyond a limit counts as done."""
        if self.code in (0, 3):
            return None
        if self.code == INTERRUPTED:
            return Interrupted("the run was interrupted; `partial` holds what was computed until then")
        told = [note.removeprefix("error: ") for note in self.notes if note.startswith("error: ")]
        message = told[-1] if told else "\n".join(self.notes).strip() or f"the program ended with code {self.code}"
        # How the command line is written is not what a caller of Python asks.
        message = message.split("\n\n")[0].strip()
        return ArgumentError(message) if self.code == 2 else Error(message)


class Conversation:
    """One running program, which answers one request at a time. It ends when its input does."""

    def __init__(self) -> None:
        # An interrupt from the terminal is Python's to answer, which asks the program to stop.
        apart: dict[str, Any] = (
            {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
            if sys.platform == "win32"
            else {"start_new_session": True}
        )
        self._request = 0
        file = program()
        # Compilers that are installed as Python packages (ziglang) are those of this Python.
        apart["env"] = {**os.environ, "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])}
        try:
            self.process = subprocess.Popen([file, "serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart)
        except OSError as error:
            raise Error(f"{file} can't be started: {error}") from error

    @property
    def is_alive(self) -> bool:
        return self.process.poll() is None

    def ask(self, words: Sequence[str], progress: Progress | None = None) -> Answer:
        """One command, as words of the command line."""
        self._request += 1
        folder = os.getcwd()
        require_unicode(*words, folder)
        self._send({"request": self._request, "arguments": list(words), "folder": folder})
        answer = Answer()
        with self._listening_to_interrupts() as heard:
            while not self._receive(answer, progress):
                pass
        if heard:
            # It may have been done before it heard.
            answer.code = INTERRUPTED
        return answer

    def stop(self) -> None:
        """Asks the program to stop what it does, at the next communication point. May be called from any thread."""
        stream = cast("IO[bytes]", self.process.stdin)
        try:
            # Past the stream's buffer, which another thread may be writing: a line this short goes whole.
            os.write(stream.fileno(), json.dumps({"stop": self._request}).encode() + b"\n")
        except OSError:
            pass  # It has ended, which the one who waits for its answer hears.

    @contextmanager
    def _listening_to_interrupts(self) -> Iterator[list[int]]:
        """The first interrupt asks the program to stop, which keeps what was computed; the second one ends it."""
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
        """Ends the program."""
        if kill:
            self.process.kill()
        for stream in (self.process.stdin, self.process.stdout):
            try:
                cast("IO[bytes]", stream).close()
            except OSError:
                pass
        self.process.wait()

    def _send(self, request: dict[str, Any]) -> None:
        stream = cast("IO[bytes]", self.process.stdin)
        try:
            stream.write(json.dumps(request).encode() + b"\n")
            stream.flush()
        except OSError:
            raise self._gone() from None

    def _receive(self, answer: Answer, progress: Progress | None) -> bool:
        """Takes one message; whether it was the last."""
        stream = cast("IO[bytes]", self.process.stdout)
        line = stream.readline()
        if not line.endswith(b"\n"):
            raise self._gone()
        # What a unit wrote to its standard output stands before a message, or in a line of its own.
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
        return Error(f"the program {how} while it was asked; what it wrote last stands above, and the next call starts it anew")
