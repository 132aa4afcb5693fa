"""Figures of results: of pyplot for callers, and as SVG for notebooks."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from io import BytesIO, StringIO
from typing import TYPE_CHECKING, Any

from ._errors import Error

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def shown(draw: Callable[[Figure], None], what: str) -> Figure:
    """Return a figure of pyplot, which `pyplot.show()` shows and a notebook displays once, at the end of the cell."""
    try:
        import matplotlib
        from matplotlib import pyplot
        from matplotlib.figure import Figure
    except ImportError as error:
        raise Error(f"{what} needs matplotlib. Install it: pip install matplotlib") from error

    class Shown(Figure):
        """Figure that is not displayed a second time as the value of a cell."""

        def _ipython_display_(self) -> None:
            # The value of a cell comes before the open figures of pyplot, which closing takes it out of.
            if "inline" in matplotlib.get_backend() or not pyplot.fignum_exists(self.number):
                pyplot.close(self)
                notebook: Any = importlib.import_module("IPython.display")
                picture = BytesIO()
                self.savefig(picture, format="png")
                notebook.display(notebook.Image(picture.getvalue()))

    figure = pyplot.figure(FigureClass=Shown, layout="constrained")
    draw(figure)
    return figure


def svg(draw: Callable[[Figure], None]) -> str:
    """Return a figure as SVG; "" without matplotlib. No figure of pyplot is involved."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ""
    figure, text = Figure(layout="constrained"), StringIO()
    draw(figure)
    figure.savefig(text, format="svg")
    return text.getvalue()[text.getvalue().find("<svg") :]
