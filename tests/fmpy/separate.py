"""A loop of separate units with anything between controller and plant, and before each step of the controller."""

from collections.abc import Callable
from typing import Any

import numpy as np
from master import Values, Unit

UNITS = {
    "robot": ("ReferenceTwoLinkRobot", "TwoLinkRobot", "L1TwoLinkRobot"),
    "actuated": ("ReferenceActuatedSiso", "ActuatedSiso", "L1ActuatedSiso"),
}
Run = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def elements(name: str, count: int) -> list[str]:
    """Names of a vector's elements."""
    return [f"{name}[{i + 1}]" for i in range(count)]


class Separate:
    """Reference, plant and controller of a kind, each with start values, stepped one after the other."""

    def __init__(self, unit: Callable[..., Unit], kind: str, plant: dict[str, Any], controller: dict[str, Any]) -> None:
        values = zip(UNITS[kind], ({}, plant, controller), strict=True)
        self.reference, self.plant, self.controller = (unit(name, **of_unit) for name, of_unit in values)
        m = len([name for name in self.plant.fmu.variables if name.startswith("y[")])
        self.r, self.x = Values(self.reference, elements("r", m)), Values(self.plant, elements("x", 2 * m))
        self.u, self.by_hand = (Values(self.controller, elements(name, m)) for name in ("u", "u_manual"))
        self._inputs = Values(self.controller, [*elements("r", m), *elements("x", 2 * m)])
        self._applied, self._count = Values(self.plant, elements("u", m)), 0
        self.reference.start()
        self.plant.start()
        self.r.get()
        self.x.get()
        start = zip([*elements("r", m), *elements("x", 2 * m)], [*self.r.values, *self.x.values], strict=True)
        self.controller.start(**dict(start))
        self.u.get()

    def run(
        self,
        count: int,
        step: float,
        applied: Callable[[np.ndarray], np.ndarray] = lambda u: u,
        before: Callable[[], None] = lambda: None,
        after: Callable[[], None] = lambda: None,
    ) -> Run:
        """So many steps more; the time, reference, state and control after each."""
        rows = []
        for k in range(self._count, self._count + count):
            time = k * step
            self.reference.step(time, step)
            self.r.get()
            self._applied.values[:] = applied(self.u.values)
            self._applied.set()
            self.plant.step(time, step)
            self.x.get()
            self._inputs.values[:] = [*self.r.values, *self.x.values]
            self._inputs.set()
            before()
            self.controller.step(time, step)
            self.u.get()
            after()
            rows.append([time + step, *self.r.values, *self.x.values, *self.u.values])
        self._count += count
        m = len(self.u.values)
        time, *signals = np.split(np.array(rows), np.cumsum([1, m, 2 * m]), axis=1)
        return time[:, 0], *signals
