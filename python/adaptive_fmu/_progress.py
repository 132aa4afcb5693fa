"""Progress bars by tqdm, if it is installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ._program import Progress

#: Time before a bar appears, s; shorter runs show none.
DELAY = 1.0


@contextmanager
def shown(name: str, wanted: bool | None) -> Iterator[Progress | None]:
    """Show a bar for one run if `wanted` is True, or if it is None in notebooks and terminals."""
    bar = _bar(name, wanted)
    if bar is None:
        yield None
        return

    def show(done: float, message: str) -> None:
        bar.set_postfix_str(message, refresh=False)
        bar.update(round(done, 4) - bar.n)

    try:
        yield show
    finally:
        bar.close()


@contextmanager
def counted(name: str, runs: int, wanted: bool | None) -> Iterator[Any]:
    """Show a bar for many runs; the function that it yields must be called after each run, or with a number of runs."""
    bar = _bar(name, wanted, total=runs, unit="run", bar_format=None)
    try:
        yield (lambda runs=1: None) if bar is None else bar.update
    finally:
        if bar is not None:
            bar.close()


def _bar(name: str, wanted: bool | None, **further: Any) -> Any:
    in_notebook = _is_notebook()
    if wanted is None:
        # Without ipywidgets a bar would be text in a red box.
        wanted = find_spec("ipywidgets") is not None if in_notebook else sys.stderr is not None and sys.stderr.isatty()
    if not wanted:
        return None
    try:
        tqdm: Any = import_module("tqdm.notebook" if in_notebook else "tqdm").tqdm
    except ImportError:
        return None
    usual = {"total": 1.0, "bar_format": "{desc} {percentage:3.0f} % {bar} {postfix}", "delay": DELAY, "leave": False}
    return tqdm(desc=name, **{**usual, **further})


def _is_notebook() -> bool:
    shell = sys.modules.get("IPython")
    return shell is not None and type(shell.get_ipython()).__name__ == "ZMQInteractiveShell"
