"""Whole loops as one unit, against the same equations in C: by a Runge-Kutta method, and by CVODE."""

import math
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from loops import ALLOWED, Native, difference, tightly
from machine import Workshop
from table import Row, alternately

LOOPS = ["3.3.1-case1", "3.3.1-case2", "3.3.2-case1", "3.3.3", "3.4.2", "4-case1", "7.5.3-case1"]
SAMPLE = 1e-2  # s, at which they are compared
EQUATIONS = [f"loops/{name}.c" for name in ("loop", "robot", "quadrotor", "vehicle", "twin_rotor", "actuated")]
SUNDIALS = [f"-lsundials_{name}" for name in ("cvode", "nvecserial", "sunmatrixdense", "sunlinsoldense")]
# Steps a sample of the Runge-Kutta method, and tolerances of CVODE, from coarse to fine.
SUBSTEPS = [round(10 * 2 ** (k / 4)) for k in range(32)]
TOLERANCES = [10 ** (-k / 2) for k in range(6, 25)]
# Highest orders of CVODE's methods: 0 are Adams', the others backward differentiation.
ORDERS = {2: "BDF to order 2", 3: "BDF to order 3", 5: "BDF to order 5", 0: "Adams"}
PATIENCE = 12.0  # times our own time (and 5 s), after which a method isn't the one to compare with
RATIO, AGAINST_CVODE = 2, 10  # goals


@dataclass
class InC:
    """A loop in a program that prints seconds and states."""

    program: Path
    loop: str
    samples: int
    words: tuple[str, ...]

    def run(self, patience: float | None = None) -> tuple[float, np.ndarray]:
        """How long it takes, and the plant's states at the samples; none where it fails or takes too long."""
        command = [self.program, self.loop, str(self.samples), str(SAMPLE), *self.words]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=patience)
        except subprocess.CalledProcessError:
            return math.inf, np.empty(0)
        seconds, *rows = done.stdout.split()
        return float(seconds), np.array([row.split(",") for row in rows], float)

    def seconds(self) -> float:
        return self.run()[0]


@dataclass
class Peer:
    """What is as accurate as ours, and how."""

    how: str
    program: InC
    seconds: float
    error: float


@dataclass
class Loop:
    """A loop in the program, and its solution."""

    workshop: Workshop
    name: str

    def __post_init__(self) -> None:
        whole = ["--composite", "--step", SAMPLE]
        self.own = Native(self.workshop, self.name, *whole)
        self.own.settle()
        self.expected = Native(self.workshop, self.name, *whole, *tightly("")).states()[1:]
        self.error = difference(self.own.states()[1:], self.expected)

    def peer(self, program: Path, *words: float) -> InC:
        return InC(program, self.name, round(self.workshop.stop / SAMPLE), tuple(map(str, words)))

    def row(self, goal: float, peer: Peer, own: list[float], theirs: list[float]) -> Row:
        what = f"{self.name}, {self.workshop.stop:g} s as a single FMU"
        return Row(what, own, goal, f"all of it in C, {peer.how}", theirs, (self.error, peer.error), (ALLOWED, ALLOWED))


Way = Callable[[Loop], Peer]


def runge_kutta(loop: Loop, program: Path) -> Peer:
    """With the longest steps as accurate as ours, or the shortest."""
    for n in SUBSTEPS:
        peer = loop.peer(program, n)
        seconds, states = peer.run()
        found = Peer(f"{n} RK4 steps every {SAMPLE * 1e3:g} ms", peer, seconds, difference(states, loop.expected))
        if found.error <= loop.error:
            break
    return found


def cvode(loop: Loop, program: Path, version: str) -> Peer:
    """With the loosest tolerance as accurate as ours, by the fastest of its methods."""
    patience, tried = PATIENCE * loop.own.seconds() + 5.0, list[Peer]()
    for order in [0] if loop.workshop.quick else ORDERS:
        how = f"CVODE {version}, {ORDERS[order]}, tolerance {{:.1e}}"
        tried += loosest(loop, lambda t, how=how, order=order: (how.format(t), loop.peer(program, order, t)), patience)
        # A method that is slower than what is known already needn't be waited for.
        reached = [peer for peer in tried if peer.error <= loop.error]
        patience = min([patience, *(2 * peer.seconds + 0.5 for peer in reached)])
    closest = min((peer for peer in tried if math.isfinite(peer.error)), key=lambda peer: peer.error)
    return min(reached or [closest], key=lambda peer: peer.seconds)


def loosest(loop: Loop, make: Callable[[float], tuple[str, InC]], patience: float) -> list[Peer]:
    """All that were tried on the way to the loosest tolerance as accurate as ours, by bisection."""
    low, high, tried = 0, len(TOLERANCES), list[Peer]()
    while low < high:
        middle = (low + high) // 2
        how, program = make(TOLERANCES[middle])
        try:
            seconds, states = program.run(patience)
        except subprocess.TimeoutExpired:
            high = middle
            continue
        tried.append(Peer(how, program, seconds, difference(states, loop.expected)))
        low, high = (low, middle) if tried[-1].error <= loop.error else (middle + 1, high)
    return tried


def sundials() -> str | None:
    """The version that this compiler finds, if it is one whose functions these are."""
    headers = ["-include", "cvode/cvode.h", "-include", "sundials/sundials_config.h"]
    command = ["cc", "-dM", "-E", *headers, "-xc", "/dev/null"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    version = re.search(r'SUNDIALS_VERSION "(6[.].*)"', done.stdout)
    return version[1] if version else None


def against_c(workshop: Workshop) -> list[Row]:
    """All loops; where an integrator isn't installed, its rows are left out."""
    compile_ = partial(workshop.compile, others=EQUATIONS)
    # What is fastest for these equations, measured.
    native, version = "-march=native", sundials()
    ways: list[tuple[float, Way]] = [
        (RATIO, partial(runge_kutta, program=compile_("loops/runge_kutta.c", native, "-lm")))
    ]
    if version:
        solver = compile_("loops/cvode.c", native, *SUNDIALS, "-lm")
        ways.append((AGAINST_CVODE, partial(cvode, program=solver, version=version)))
    else:
        print("rows against CVODE are left out: it takes SUNDIALS 6 (apt-get install libsundials-dev)", file=sys.stderr)
    return [row for name in LOOPS for row in rows(Loop(workshop, name), ways)]


def rows(loop: Loop, ways: list[tuple[float, Way]]) -> list[Row]:
    """Of one loop: all peers take turns."""
    peers = [(goal, way(loop)) for goal, way in ways]
    runs = [peer.program.seconds for _, peer in peers]
    own, *theirs = alternately(loop.workshop.repeats, loop.own.seconds, *runs)
    return [loop.row(goal, peer, own, times) for (goal, peer), times in zip(peers, theirs, strict=True)]
