"""Pool of running programs that wait for requests: one program per simultaneous request."""

from __future__ import annotations

import atexit
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock

from ._program import Answer, Conversation, Jobs, Progress

_idle: list[Conversation] = []
_busy: set[Conversation] = set()
_lock = Lock()


def ask(words: Sequence[str], progress: Progress | None = None, folder: str | None = None, jobs: Jobs | None = None) -> Answer:
    """Send a request to a waiting program, or to a new one. The caller raises the exception of the answer, if any.

    folder: working folder of the request. Default: that of this process.
    jobs: what carries out jobs of the request. Default: the program itself.
    """
    with _conversation() as conversation:
        return conversation.ask(words, progress, folder, jobs)


def done(words: Sequence[str]) -> Answer:
    """Send a request, and raise the exception of the answer, if any."""
    answer = ask(words)
    if failure := answer.failure():
        raise failure
    return answer


def stop() -> None:
    """Ask all busy programs to stop their request."""
    with _lock:
        for conversation in _busy:
            conversation.stop()


@contextmanager
def _conversation() -> Iterator[Conversation]:
    with _lock:
        conversation = _idle.pop() if _idle else None
    if conversation is None or not conversation.is_alive:
        conversation = Conversation()
    with _lock:
        _busy.add(conversation)
    try:
        yield conversation
    except BaseException:
        # The rest of the answer may still be in the stream.
        conversation.end(kill=True)
        raise
    else:
        with _lock:
            _idle.append(conversation)
    finally:
        with _lock:
            _busy.discard(conversation)


def _forget() -> None:
    """Clear the pool in a forked process: the programs belong to its parent."""
    global _lock
    _lock = Lock()
    for conversation in [*_idle, *_busy]:
        conversation.abandon()
    _idle.clear()
    _busy.clear()


@atexit.register
def _end() -> None:
    with _lock:
        while _idle:
            _idle.pop().end()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
