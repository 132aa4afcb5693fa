"""Exceptions: one class for each exit code of the program, with the message of the program."""

from __future__ import annotations

from typing import Any


class Error(Exception):
    """A request failed (exit code 1). The message of the program states what is wrong and what to do.

    >>> import adaptive_fmu
    >>> try:
    ...     adaptive_fmu.Loop("3.2.1-cosin").run()
    ... except adaptive_fmu.Error as error:
    ...     print(str(error)[:45])
    there is no loop named `3.2.1-cosin`; did you
    """

    #: `Result` with the points computed until an FMU failed, or `Sweep` with the runs until workers were lost; None if there are none.
    partial: Any = None


class ArgumentError(Error, ValueError):
    """An argument is wrong (exit code 2).

    >>> import adaptive_fmu
    >>> try:
    ...     adaptive_fmu.Loop("3.2.1-cosine").run(step=-1)
    ... except ValueError as error:
    ...     print(error)
    invalid value '-1' for 'step': must be a finite number above 0
    """


class LimitExceeded(Error):
    """A run is not complete, a metric is beyond its limit, or a design is not sound (exit code 3).

    Only `Result.check` and `Checked.check` raise it.

    >>> import adaptive_fmu
    >>> result = adaptive_fmu.Loop("3.2.1-cosine").run(until=6, plant={"x0": [0, 0.5]})
    >>> try:
    ...     result.check()
    ... except adaptive_fmu.LimitExceeded as error:
    ...     print(str(error).split(",")[0])
    3.2.1-cosine: rms (y - y_m)
    """


class ExperimentWarning(UserWarning):
    """A record has or would have a fault, or the model identified from it, or a design for that model, should not be used.

    >>> import adaptive_fmu
    >>> issubclass(adaptive_fmu.ExperimentWarning, UserWarning)
    True
    """


class Interrupted(KeyboardInterrupt):
    """The user interrupted a run (exit code 130). `partial` contains the results until then.

    A script that does not catch it ends, as with any KeyboardInterrupt.

    >>> import adaptive_fmu
    >>> issubclass(adaptive_fmu.Interrupted, KeyboardInterrupt)
    True
    """

    #: Results until the interrupt: a `Result`, or a `Sweep` from `Loop.sweep`; None if there are none.
    partial: Any = None
