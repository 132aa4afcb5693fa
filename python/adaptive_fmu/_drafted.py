"""Loops of components that a user gives, and diagrams of loops."""

from __future__ import annotations

import html
import os
import shutil
import tempfile
import weakref
from collections.abc import Sequence
from typing import Any

from ._errors import ArgumentError
from ._pool import done
from ._values import PathLike, number


class Drafted:
    """Components and connections, in a folder that ends with the loop."""

    def __init__(
        self,
        components: Sequence[PathLike | tuple[str, PathLike]],
        connections: dict[str, str],
        name: str,
        step: float | None,
        until: float | None,
    ) -> None:
        self.folder: str = tempfile.mkdtemp(prefix="adaptive_fmu_loop_")
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        self.components = components
        self.name = name
        self._words = [f"--name={name}", *(f"--units={component_text(each)}" for each in components)]
        self._words += [f"--connect={to}={source}" for to, source in connections.items()]
        for option, value in (("--step", step), ("--until", until)):
            self._words += [f"{option}={number(value)}"] if value is not None else []

    def write(self, folder: PathLike, force: bool = False) -> dict[str, Any]:
        """Write the structure and return what the program reports on it."""
        request = ["new", "loop", "--json", *self._words, f"--out={os.fspath(folder)}", *(["--force"] if force else [])]
        draft: dict[str, Any] = done(request).json()
        return draft


def component_text(component: PathLike | tuple[str, PathLike]) -> str:
    """Return a component as the option has it."""
    if isinstance(component, (str, os.PathLike)):
        return os.fspath(component)
    try:
        name, file = component
        return f"{name}={os.fspath(file)}"
    except (TypeError, ValueError):
        raise ArgumentError(f"{component!r} is not allowed. A component must be a path, a name, or a pair (name, path)") from None


#: Sizes in pixels: a block, the distance between blocks, between lanes, and of a line of text.
WIDTH, HEIGHT, GAP, LANE, LINE = 190, 46, 58, 16, 15
#: Names of signals that are shown of a bundle of connections.
MOST_NAMES = 3


class Diagram:
    """Blocks one below the other, in the order of stepping, with what goes from one to another. `str()` is the SVG."""

    def __init__(self, structure: dict[str, Any]) -> None:
        self._names = [component["name"] for component in structure["components"]]
        self._sources = [component["source"] for component in structure["components"]]
        places = {name: place for place, name in enumerate(self._names)}
        bundles: dict[tuple[int, int], list[str]] = {}
        for connection in structure["connections"]:
            (source, signal), (to, _) = (connection[end].split(".", 1) for end in ("from", "to"))
            bundles.setdefault((places[source], places[to]), []).append(signal)
        self._bundles = bundles

    def __str__(self) -> str:
        past = sorted((ends for ends in self._bundles if ends[1] != ends[0] + 1), key=lambda ends: abs(ends[1] - ends[0]))
        left = 12 + LANE * sum(to <= source for source, to in past) + 120
        right = 12 + LANE * sum(to > source for source, to in past) + 120
        width, height = left + WIDTH + right, (HEIGHT + GAP) * len(self._names) - GAP + 8
        parts = [self._wire(ends, past, left) for ends in self._bundles]
        parts += [self._block(place, left) for place in range(len(self._names))]
        style = "font: 12px system-ui, sans-serif"
        arrow = '<marker id="arrow" markerWidth="8" markerHeight="8" refX="7" refY="3.5" orient="auto"><path d="M0 0L7 3.5L0 7z"/></marker>'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" style="{style}; max-width: {width}px">'
            f"<defs>{arrow}</defs>{''.join(parts)}</svg>"
        )

    def _repr_svg_(self) -> str:
        return str(self)

    def _block(self, place: int, left: int) -> str:
        top, middle = 4 + place * (HEIGHT + GAP), left + WIDTH / 2
        source = self._sources[place].rsplit("/", 1)[-1]
        return (
            f'<rect x="{left}" y="{top}" width="{WIDTH}" height="{HEIGHT}" rx="4" fill="#eef4fa" stroke="#0072b2"/>'
            f'<text x="{middle}" y="{top + 19}" text-anchor="middle" font-weight="bold">{html.escape(self._names[place])}</text>'
            f'<text x="{middle}" y="{top + 36}" text-anchor="middle" fill="#555">{html.escape(source)}</text>'
        )

    def _wire(self, ends: tuple[int, int], past: list[tuple[int, int]], left: int) -> str:
        source, to = ends
        names = self._bundles[ends]
        more = [f"and {len(names) - MOST_NAMES} more"] if len(names) > MOST_NAMES else []
        lines = [html.escape(name) for name in names[:MOST_NAMES]] + more
        bottom, top = 4 + source * (HEIGHT + GAP) + HEIGHT, 4 + to * (HEIGHT + GAP)
        if to == source + 1:
            x = left + WIDTH / 2
            path, at, anchor, y = f"M{x} {bottom}V{top}", x + 6, "start", (bottom + top) / 2 - LINE * (len(lines) - 1) / 2 + 4
        else:
            same_side = [other for other in past if (other[1] > other[0]) == (to > source)]
            lane = 20 + LANE * same_side.index(ends)
            side = left + WIDTH + lane if to > source else left - lane
            edge = left + WIDTH if to > source else left
            start, end = bottom - HEIGHT / 2 + 6, top + HEIGHT / 2 - 6
            path, anchor = f"M{edge} {start}H{side}V{end}H{edge}", "start" if to > source else "end"
            at, y = side + (5 if to > source else -5), (start + end) / 2 - LINE * (len(lines) - 1) / 2 + 4
        words = "".join(f'<text x="{at}" y="{y + LINE * k}" text-anchor="{anchor}">{line}</text>' for k, line in enumerate(lines))
        return f'<path d="{path}" fill="none" stroke="#444" marker-end="url(#arrow)"/>{words}'
