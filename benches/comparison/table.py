"""Rows of figures, and how they are measured and printed."""

from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median


@dataclass
class Row:
    """A figure against a peer, or alone; times in s, one a repeat."""

    what: str
    ours: list[float]
    goal: float
    # How many times as long the peer takes is to be at least this; without a peer, our time is to be at most this.
    peer: str = "–"
    theirs: list[float] = field(default_factory=list)
    # The largest error of each, and what it may be at most.
    errors: tuple[float, ...] = ()
    allowed: tuple[float, ...] = ()
    # How our figures are shown.
    show: Callable[[float], str] | None = None

    @property
    def ratios(self) -> list[float]:
        """How many times as long the peer takes, repeat by repeat."""
        return [peer / own for own, peer in zip(self.ours, self.theirs, strict=True)]

    @property
    def accurate(self) -> bool:
        """Whether the figures count; a value that is no number is no accurate one."""
        return all(error <= allowed for error, allowed in zip(self.errors, self.allowed, strict=True))

    @property
    def reached(self) -> bool:
        """Whether the goal is reached by the median."""
        return self.accurate and (median(self.ratios) >= self.goal if self.theirs else median(self.ours) <= self.goal)

    def as_dict(self) -> dict:
        """For a script."""
        names = "what", "peer", "goal", "ours", "theirs", "errors", "accurate", "reached"
        return {name: getattr(self, name) for name in names}

    def cells(self) -> list[str]:
        """As the table shows it."""
        show, theirs = self.show or duration, duration(median(self.theirs)) if self.theirs else "–"
        figure, goal = spread(self.ours, show), f"≤ {show(self.goal)}"
        if self.theirs:
            figure, goal = spread(self.ratios, "{:.3g}".format), f"≥ {self.goal:.3g}"
        errors = " / ".join(f"{error:.0e}" for error in self.errors) or "–"
        reached = "yes" if self.reached else "no" if self.accurate else "not accurate enough"
        return [self.what, show(median(self.ours)), self.peer, theirs, figure, goal, errors, reached]


HEADER = ["what", "ours", "peer", "its time", "times as long", "goal", "errors, ours / peer", "reached"]


def duration(seconds: float) -> str:
    """With the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def spread(values: list[float], show: Callable[[float], str]) -> str:
    """Median, least and greatest."""
    return f"{show(median(values))} [{show(min(values))} … {show(max(values))}]"


def table(rows: list[Row]) -> str:
    """In Markdown."""
    lines = [HEADER, ["---"] * len(HEADER), *(row.cells() for row in rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def alternately(repeats: int, *runs: Callable[[], float]) -> list[list[float]]:
    """The times of runs that take turns, so that a busy machine is one for all of them."""
    times = [[run() for run in runs] for _ in range(repeats)]
    return [list(column) for column in zip(*times, strict=True)]
