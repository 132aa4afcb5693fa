"""The responses of the package's loops that the pages of FMUs draw: examples/LOOP/response.txt, with few points a curve.

Each plot of a loop is a line `plot TITLE`, and each of its curves one line `curve NAME UNIT t y t y …`, or `reference …`
where others are to come to it; a unit that isn't known is `-`. Between its points a curve is straight. What oscillates
faster than a picture shows keeps its least and its largest value in each column of the picture.
"""

import re
from pathlib import Path

import numpy as np
from lxml import etree

ROOT = Path(__file__).resolve().parents[2]
# Part of a plot's range by which a curve may miss what was recorded, and columns of a picture, two of its pixels each.
MISS, COLUMNS = 0.003, 200


def structure(loop: str) -> etree._Element:
    return etree.parse(ROOT / "examples" / loop / "SystemStructure.ssd").getroot()


def elements(loop: str, name: str) -> list[etree._Element]:
    """The elements of a name in a loop's structure, in whatever namespace."""
    return structure(loop).xpath(f"//*[local-name() = '{name}']")


def plots(loop: str) -> list[tuple[str, list[str]]]:
    """Titles and signals of a loop's plots."""
    return [(plot.get("title"), plot.get("signals").split()) for plot in elements(loop, "Plot")]


def references(loop: str, title: str) -> set[str]:
    """The signals of a plot that others are to come to, as the figures of a run have them: those that it names so, ideal
    models, and what units give that take nothing from the loop."""
    (plot,) = [plot for plot in elements(loop, "Plot") if plot.get("title") == title]
    takes = {link.get("endElement") for link in elements(loop, "Connection")}
    sources = {unit.get("name") for unit in elements(loop, "Component")} - takes
    models = {model.get("name") for model in elements(loop, "IdealModel")}
    signals = plot.get("signals").split()
    given = {signal for signal in signals if signal in models or signal.split(".")[0] in sources}
    return given | set((plot.get("references") or "").split())


def is_to_fail(loop: str) -> bool:
    return bool(elements(loop, "ExpectedFailure"))


def unit(loop: str, signal: str) -> str:
    """The unit of a signal, from the description of its FMU."""
    part, _, name = signal.partition(".")
    for component in elements(loop, "Component"):
        if component.get("name") == part:
            fmu = re.sub(r".*/|\.fmu$", "", component.get("source"))
            variables = etree.parse(ROOT / "modelDescription" / f"{fmu}.xml").iter("ScalarVariable")
            return next(v[0].get("unit", "-") for v in variables if v.get("name") == name)
    return "-"


def ranges(values: list[np.ndarray]) -> float:
    """The range of some curves: that of most of the time, where a peak at the start is far above it."""
    high, low = (max(map(np.max, values)), min(map(np.min, values)))
    later = [curve[len(curve) // 20 :] for curve in values]
    rest = max(map(np.max, later)) - min(map(np.min, later))
    return rest if 0 < rest < (high - low) / 4 else max(high - low, 1e-12)


def extremes(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Places of the least and the largest value in each column of a picture, and of both ends; in their order."""
    column = np.minimum((COLUMNS * (t - t[0]) / (t[-1] - t[0])).astype(int), COLUMNS - 1)
    begins = np.flatnonzero(np.diff(column, prepend=-1))
    parts = zip(begins, np.append(begins[1:], len(t)))
    places = {a + int(find(y[a:b])) for a, b in parts for find in (np.argmin, np.argmax)}
    return np.array(sorted(places | {0, len(t) - 1}))


def corners(t: np.ndarray, y: np.ndarray, miss: float) -> list[int]:
    """Places of points, between which straight lines miss none of the others by more."""
    places, open_ = {0, len(t) - 1}, [(0, len(t) - 1)]
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        line = y[a] + (y[b] - y[a]) * (t[a + 1 : b] - t[a]) / (t[b] - t[a])
        off = np.abs(y[a + 1 : b] - line)
        worst = int(np.argmax(off))
        if off[worst] > miss:
            middle = a + 1 + worst
            places.add(middle)
            open_ += [(a, middle), (middle, b)]
    return sorted(places)


def text(loop: str, table: dict[str, np.ndarray]) -> str:
    """What response.txt is to hold, from what was recorded of a run."""
    lines = []
    for title, signals in plots(loop):
        lines.append(f"plot {title}")
        span = ranges([table[signal] for signal in signals])
        followed = references(loop, title)
        for signal in signals:
            seen = extremes(table["time"], table[signal])
            time, y = table["time"][seen], table[signal][seen]
            points = " ".join(f"{time[k]:.4g} {y[k] + 0.0:.4g}" for k in corners(time, y, MISS * span))
            lines.append(f"{'reference' if signal in followed else 'curve'} {signal} {unit(loop, signal)} {points}")
    return "\n".join(lines) + "\n"


def read(loop: str) -> dict[str, np.ndarray]:
    """The curves that response.txt holds: times and values."""
    curves = {}
    for line in (ROOT / "examples" / loop / "response.txt").read_text().splitlines():
        word, *rest = line.split(" ")
        if word in ("curve", "reference"):
            curves[rest[0]] = np.array(rest[2:], dtype=float).reshape(-1, 2).T
    return curves
