"""Linear systems at operating points."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ._errors import Error
from ._values import shown

if TYPE_CHECKING:
    import control


class Linearisation:
    """Linear system x' = A x + B u, y = C x + D u at an operating point.

    >>> import adaptive_fmu
    >>> linear = adaptive_fmu.linearise("NonlinearSiso", at=0.5)
    >>> linear.A.shape, linear.inputs
    ((2, 2), ['u[1]'])
    """

    def __init__(self, output: dict[str, Any]) -> None:
        states, inputs, outputs = output["states"], output["inputs"], output["outputs"]
        shapes = {"A": (states, states), "B": (states, inputs), "C": (outputs, states), "D": (outputs, inputs)}
        matrices = {
            name: np.array(output[name], dtype=float).reshape(len(rows), len(columns)) for name, (rows, columns) in shapes.items()
        }
        #: Name of the FMU.
        self.name: str = output["fmu"]
        #: Time of the operating point, s.
        self.time: float = output["time"]
        #: System matrix, n × n. Its entries are in 1/s if all states have the same unit of measurement.
        self.A: np.ndarray = matrices["A"]
        #: Input matrix, n × m.
        self.B: np.ndarray = matrices["B"]
        #: Output matrix, p × n.
        self.C: np.ndarray = matrices["C"]
        #: Feedthrough matrix, p × m.
        self.D: np.ndarray = matrices["D"]
        #: Names of the n states.
        self.states: list[str] = [quantity["name"] for quantity in states]
        #: Names of the m inputs.
        self.inputs: list[str] = [quantity["name"] for quantity in inputs]
        #: Names of the p outputs.
        self.outputs: list[str] = [quantity["name"] for quantity in outputs]
        #: Method by which the matrices were computed, and its settings; the key `by` has its name.
        self.method: Any = output["method"]
        #: Search for the operating point, if there was one, else None: `wanted`, `steps`, number of `equations` and `unknowns`,
        #: `rank`, `can_move` (states and inputs that can change, so that the operating point is one of many), `at_bound`.
        self.trim: dict[str, Any] | None = output["trim"]
        self._output = output

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, rad/s.

        >>> import adaptive_fmu
        >>> bool(adaptive_fmu.linearise("TwinRotor").eigenvalues.real.max() < 1)
        True
        """
        return np.array([complex(value["real"], value["imaginary"]) for value in self._output["eigenvalues"]])

    @property
    def operating_point(self) -> pd.DataFrame:
        """Values of the states, inputs and outputs at the operating point, with their units of measurement.

        >>> import adaptive_fmu
        >>> float(adaptive_fmu.linearise("NonlinearSiso", values={"u[1]": 0.5}).operating_point.loc["u[1]", "value"])
        0.5
        """
        rows = [
            {"name": quantity["name"], "what": what, "value": quantity["value"], "unit": quantity["unit"] or ""}
            for what, kind in (("state", "states"), ("input", "inputs"), ("output", "outputs"))
            for quantity in self._output[kind]
        ]
        return pd.DataFrame(rows, columns=["name", "what", "value", "unit"]).set_index("name")

    def ss(self) -> control.StateSpace:
        """Return the linear system as a `StateSpace` of python-control, which must be installed.

        >>> import adaptive_fmu
        >>> adaptive_fmu.linearise("NonlinearSiso").ss().nstates
        2
        """
        try:
            import control
        except ImportError as error:
            raise Error("Linearisation.ss() needs python-control. Install it: pip install control") from error
        # python-control does not allow a dot in the name of a signal.
        plain = [[name.replace(".", "_") for name in names] for names in (self.states, self.inputs, self.outputs)]
        return control.ss(self.A, self.B, self.C, self.D, states=plain[0], inputs=plain[1], outputs=plain[2], name=self.name)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the matrices with the names of signals, eigenvalues, and the operating point."""
        named = {"A": (self.states, self.states), "B": (self.states, self.inputs), "C": (self.outputs, self.states)}
        named |= {"D": (self.outputs, self.inputs)}
        parts = [f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>"]
        for name, (rows, columns) in named.items():
            table = pd.DataFrame(getattr(self, name), index=rows, columns=columns).rename_axis(name)
            parts.append(table.to_html(float_format=shown) if table.size else "")
        eigenvalues = ", ".join(
            f"{shown(value.real)} {'-' if value.imag < 0 else '+'} {shown(abs(value.imag))}j" for value in self.eigenvalues
        )
        parts += [f"<p>eigenvalues, rad/s: {eigenvalues}</p>", self.operating_point.to_html(float_format=shown)]
        return "\n".join(parts)

    def __repr__(self) -> str:
        return (
            f"<{self.name} about t = {self.time:g} s: {len(self.states)} states, {len(self.inputs)} inputs, "
            f"{len(self.outputs)} outputs>"
        )
