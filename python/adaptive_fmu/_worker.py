"""Requests that are carried out by workers: threads, processes, or other machines."""

from __future__ import annotations

import atexit
import os
import shutil
import socket
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock

from . import _pool
from ._errors import Error
from ._program import Answer


@dataclass(frozen=True)
class Files:
    """Files that requests name, for workers on other machines."""

    #: Name of the study, which is unique.
    study: str
    #: Contents by paths in the folder that a worker unpacks them into.
    contents: Mapping[str, bytes]
    #: Words that name a file: the word as the program has it, the option before the path, and the path in that folder.
    words: Mapping[str, tuple[str, str]]


@dataclass(frozen=True)
class Task:
    """One run."""

    #: Words of the request.
    words: Sequence[str]
    #: Working folder; None where the files are sent along.
    folder: str | None
    #: True to return the recorded signals, too.
    keep: bool
    #: Version of the program that the results must be of.
    version: str


_folders: dict[str, str] = {}
_lock = Lock()


def perform(task: Task, files: Files | None = None) -> Answer:
    """Carry out a run in the process of a worker, by the program that is installed there."""
    if (installed := version()) != task.version:
        raise Error(
            f"{socket.gethostname()} has {installed}, but {task.version} is required, because results of other versions may "
            "differ. Install the same version of this package on all machines"
        )
    if files is None:
        answer = _pool.ask(task.words, folder=task.folder)
    else:
        answer = _with_files(task, files)
    if not task.keep and answer.table is not None:
        # A copy, because a view would keep all signals in memory.
        answer.table = answer.table[:, :0].copy()
    return answer


@lru_cache(maxsize=1)
def version() -> str:
    """Return the name and version of the program in this process."""
    return " ".join(_pool.done(["--version"]).notes)


def same(files: Files) -> Files:
    """Return the files. As the result of a task they are sent to each worker once."""
    return files


def forget(study: str) -> None:
    """Remove the files of a study."""
    with _lock:
        folder = _folders.pop(study, None)
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)


def _with_files(task: Task, files: Files) -> Answer:
    folder = _unpacked(files)
    here = {word: (option, os.path.join(folder, path)) for word, (option, path) in files.words.items()}
    answer = _pool.ask(["".join(here.get(word, (word,))) for word in task.words], folder=folder)
    for word, (option, path) in here.items():
        # Messages name the file that the user gave.
        answer.notes = [note.replace(path, word.removeprefix(option)) for note in answer.notes]
    return answer


def _unpacked(files: Files) -> str:
    with _lock:
        if files.study not in _folders:
            folder = tempfile.mkdtemp(prefix="adaptive_fmu_study_")
            for path, content in files.contents.items():
                file = os.path.join(folder, path)
                os.makedirs(os.path.dirname(file), exist_ok=True)
                with open(file, "wb") as opened:
                    opened.write(content)
            _folders[files.study] = folder
        return _folders[files.study]


def _forget_all() -> None:
    for study in list(_folders):
        forget(study)


def _in_child() -> None:
    """Leave the folders to the parent of a forked process."""
    global _lock
    _lock = Lock()
    _folders.clear()


atexit.register(_forget_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
