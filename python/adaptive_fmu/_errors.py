"""What goes wrong, as exceptions: one class for each exit code of the program, with the program's own message."""

from __future__ import annotations

from typing import Any


class Error(Exception):
    """It could not be done (exit code 1). The message is the program's: what is wrong, and what to do.

    >>> import adaptive_fmu
    >>> try:
    ...     adaptive_fmu.Loop("3.2.1-cosin").run()
    ... except adaptive_fmu.Error as error:
    ...     print(str(error)[:45])
    there is no loop named `3.2.1-cosin`; did you
    """

    #: What was computed until a unit failed, as a `Result`; None where nothing was.
    partial: Any = None


class ArgumentError(Error, ValueError):
    """The arguments are wrong (exit code 2).

    >>> import adaptive_fmu
    >>> try:
    ...     adaptive_fmu.Loop("3.2.1-cosine").run(step=-1)
    ... except ValueError as error:
    ...     print(error)
    invalid value '-1' for '--step <STEP>': must be a finite number above 0
    """


class LimitExceeded(Error):
    """A metric is beyond its limit, or a design isn't sound (exit code 3); raised by `Result.check` and `Checked.check` alone.

    >>> import adaptive_fmu
    >>> result = adaptive_fmu.Loop("3.2.1-cosine").run(until=6, plant={"x0": [0, 0.5]})
    >>> try:
    ...     result.check()
    ... except adaptive_fmu.LimitExceeded as error:
    ...     print(str(error).split(",")[0])
    3.2.1-cosine: rms (y - y_m)
    """


class Interrupted(KeyboardInterrupt):
    """A run was interrupted (exit code 130): `partial` holds what was computed until then.

    A script that doesn't catch it ends, as by any KeyboardInterrupt.

    >>> import adaptive_fmu
    >>> issubclass(adaptive_fmu.Interrupted, KeyboardInterrupt)
    True
    """

    #: What was computed until then: a `Result`, of `Loop.sweep` a `Sweep`; None where nothing was.
    partial: Any = None
