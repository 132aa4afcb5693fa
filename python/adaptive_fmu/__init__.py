"""Adaptive controllers and their plants as FMI 2.0 FMUs, for use from Python.

>>> import adaptive_fmu
>>> loop = adaptive_fmu.Loop("3.2.1-cosine")
>>> result = loop.run(until=5, controller={"adaptation_gain": 1e4})
>>> result.data.shape
(5001, 11)

The program `adaptive-fmu`, which is installed with this package, does the work. It is started once, answers requests, and ends
with Python. No shell is involved.
"""

from __future__ import annotations

from importlib import metadata

from ._checked import Checked, check
from ._design import Designed, design
from ._errors import ArgumentError, Error, ExperimentWarning, Interrupted, LimitExceeded
from ._identify import Identified, identify
from ._linear import Linearisation
from ._loop import Loop, Tuned
from ._parameters import Estimated, estimate
from ._program import program
from ._result import Result
from ._studies import Explored, compare, explore, league, playground, report, validate
from ._sweep import Sweep
from ._units import export, firmware, fmus, kinds, linearise, loops, new, simulate
from ._verify import Verified, verify

__all__ = [
    "ArgumentError",
    "Checked",
    "Designed",
    "Error",
    "Estimated",
    "ExperimentWarning",
    "Explored",
    "Identified",
    "Interrupted",
    "LimitExceeded",
    "Linearisation",
    "Loop",
    "Result",
    "Sweep",
    "Tuned",
    "Verified",
    "check",
    "compare",
    "design",
    "estimate",
    "explore",
    "export",
    "firmware",
    "fmus",
    "identify",
    "kinds",
    "league",
    "linearise",
    "loops",
    "new",
    "playground",
    "program",
    "report",
    "simulate",
    "validate",
    "verify",
]

try:
    #: Version of the package, which is also the version of the program.
    __version__ = metadata.version("adaptive-fmu")
except metadata.PackageNotFoundError:  # The sources are used without an installation.
    __version__ = "0"
