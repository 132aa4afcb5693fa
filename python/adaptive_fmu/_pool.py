"""Running programs that wait for requests: as many as are asked at a time."""

from __future__ import annotations

import atexit
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock

from ._program import Answer, Conversation, Progress

_idle: list[Conversation] = []
_busy: set[Conversation] = set()
_lock = Lock()


def ask(words: Sequence[str], progress: Progress | None = None) -> Answer:
    """Asks a program that waits, or a new one; the exception that its answer means is the caller's to raise."""
    with _conversation() as conversation:
        return conversation.ask(words, progress)


def done(words: Sequence[str]) -> Answer:
    """Asks, and raises what the answer means."""
    answer = ask(words)
    if failure := answer.failure():
        raise failure
    return answer


def stop() -> None:
    """Asks all programs that work to stop what they do."""
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
        # Nobody knows what it would say next.
        conversation.end(kill=True)
        raise
    else:
        with _lock:
            _idle.append(conversation)
    finally:
        with _lock:
            _busy.discard(conversation)


def _forget() -> None:
    """In a process that was forked: the programs are its parent's."""
    global _lock
    _lock = Lock()
    _idle.clear()
    _busy.clear()


@atexit.register
def _end() -> None:
    with _lock:
        while _idle:
            _idle.pop().end()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
