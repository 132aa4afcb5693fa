"""A closed loop as a Gymnasium environment: learned controllers beside adaptive ones.

Needs gymnasium and fmpy: `pip install adaptive-fmu[gym]`.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, SupportsFloat, Union
from weakref import WeakValueDictionary, finalize

import gymnasium
import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from gymnasium import spaces
from numpy.typing import ArrayLike

from ._errors import ArgumentError
from ._units import PathLike, export
from ._values import Value, elements
from ._vector import Vector

#: Signals by one's own names.
Signals = Mapping[str, float]
#: Variables of the loop, `unit.variable`, or such by one's own names.
Names = Union[Sequence[str], Mapping[str, str]]
#: A part of a step that is rounding.
ROUNDING = 1e-6
#: So many messages of a unit are kept.
MOST_SAID = 20


class LoopEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A loop as one unit, integrated together; what an agent does takes the place of the units that are left out.

    loop: a loop of this package by its name, or an SSP.
    without: units that are left out, whose signals are inputs then: usually the controller.
    action, observation: variables of the loop ("plant.u[1]"), or a mapping to them from names of one's own. Actions are inputs.
    reward: called with all these signals by their names (one's own, where there are such), after each step.
    signals: further variables that `reward` and `terminated` see, likewise.
    step, until: length of a step and of an episode, s.
    low, high: of the actions; numbers, or one each.
    terminated: called with the signals; whether the episode ends there. It also ends where the loop fails, with `penalty`.
    values: start values by name.
    fmu: an FMU for co-simulation to be run instead of the loop's.

    A reset goes back to a saved state, and costs about as much as a step; `reset(options={"values": {...}})` starts anew with
    other values. Observations are float64; spaces are unbounded where FMUs tell no bounds.

    >>> from adaptive_fmu.gym import LoopEnv
    >>> env = LoopEnv("3.2.1-cosine", without=["controller"], action=["plant.u[1]"],
    ...               observation={"y": "plant.y[1]", "r": "reference.r[1]"}, reward=lambda s: -((s["y"] - s["r"]) ** 2),
    ...               step=0.01, until=1, low=-5, high=5)
    >>> observation, _ = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    >>> observation.shape, terminated, truncated
    ((2,), False, False)
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        loop: PathLike,
        *,
        action: Names,
        observation: Names,
        reward: Callable[[Signals], float],
        without: Sequence[str] = (),
        signals: Names = (),
        step: float = 0.01,
        until: float = 20.0,
        low: ArrayLike = -np.inf,
        high: ArrayLike = np.inf,
        terminated: Callable[[Signals], bool] | None = None,
        penalty: float = 0.0,
        values: Mapping[str, Value] | None = None,
        fmu: PathLike | None = None,
    ) -> None:
        self._unpacked: _Unpacked | None = _unpacked(loop, without) if fmu is None else _Unpacked.of(Path(fmu))
        self._description = self._unpacked.description
        self._variables = {variable.name: variable for variable in self._description.modelVariables}
        self._unit = FMU2Slave(
            guid=self._description.guid,
            unzipDirectory=self._unpacked.folder,
            modelIdentifier=self._description.coSimulation.modelIdentifier,
            instanceName=Path(str(loop)).stem,
        )
        self._actions, self._observed, self._further = (_named(names) for names in (action, observation, signals))
        for name in self._actions.values():
            if self._variable(name).causality != "input":
                raise ArgumentError(f"action {name}: is no input; `without` leaves out the unit that it is connected to")
        seen = {**self._further, **self._observed, **self._actions}
        self._names, self._references = list(seen), [self._variable(name).valueReference for name in seen.values()]
        self._places = [self._names.index(name) for name in self._observed]
        self._inputs = [self._variable(name).valueReference for name in self._actions.values()]
        self._reward, self._terminated, self._penalty = reward, terminated, float(penalty)
        self._step, self._steps = float(step), round(until / step)
        if not (step > 0 and until / step > 1 - ROUNDING):
            raise ArgumentError(f"step = {step}, until = {until}: must be above 0, and an episode at least a step")
        self._values = dict(values or {})
        shape = (len(self._inputs),)
        lowest, highest = (np.broadcast_to(np.asarray(bound, np.float64), shape) for bound in (low, high))
        self.action_space = spaces.Box(lowest, highest, dtype=np.float64)
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(self._places),), dtype=np.float64)
        self._said: list[str] = []
        self._callbacks = _callbacks(self._said)
        self._unit.instantiate(callbacks=self._callbacks)
        self._is_open = True
        self._count, self._state, self._is_ready = 0, None, False

    @classmethod
    def vector(cls, count: int, *arguments: Any, processes: int | None = None, **options: Any) -> Vector:
        """So many of these environments side by side, over so many processes: as many as there are cores, unless given.

        >>> from adaptive_fmu.gym import LoopEnv
        >>> envs = LoopEnv.vector(4, "3.2.1-cosine", without=["controller"], action=["plant.u[1]"], observation=["plant.x[1]"],
        ...                       reward=lambda s: -s["plant.x[1]"] ** 2, step=0.01, until=1, low=-5, high=5)
        >>> observations, _ = envs.reset(seed=1)
        >>> observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
        >>> observations.shape, rewards.shape
        ((4, 1), (4,))
        >>> envs.close()
        """
        with tempfile.TemporaryDirectory() as folder:
            loop = options.pop("loop") if "loop" in options else arguments[0]
            if options.get("fmu") is None:
                options["fmu"] = _exported(loop, options.get("without", ()), folder)
            # By then each process has what it needs of the folder.
            return Vector(partial(cls, loop, *arguments[1:], **options), count, processes)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Back to the start; with `options={"values": {...}}` from other start values, to which later resets go back."""
        super().reset(seed=seed)
        anew = (options or {}).get("values")
        if self._state is None or anew is not None:
            self._start({**self._values, **(anew or {})})
        else:
            self._unit.setFMUState(self._state)
        self._count = 0
        self._said.clear()
        return self._signals()[self._places], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, SupportsFloat, bool, bool, dict[str, Any]]:
        """Holds the actions for a step; observation, reward, whether the loop ended or failed, whether the time is over."""
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        self._unit.setReal(self._inputs, np.asarray(action, float).ravel().tolist())
        time = self._count * self._step
        self._count += 1
        try:
            self._unit.doStep(time, self._step)
        except FMICallException as error:
            message = self._said[-1] if self._said else str(error)
            return self._signals()[self._places], self._penalty, True, False, {"message": message}
        values = self._signals()
        seen = dict(zip(self._names, values.tolist()))
        over = bool(self._terminated is not None and self._terminated(seen))
        return values[self._places], float(self._reward(seen)), over, self._count >= self._steps, {}

    def close(self) -> None:
        """Frees the unit, and removes its files."""
        if self._is_open:
            self._is_open = False
            self._forget()
            if self._is_ready:
                with suppress(FMICallException):  # It may have failed.
                    self._unit.terminate()
            self._unit.freeInstance()
            self._unpacked = None

    def _start(self, values: Mapping[str, Value]) -> None:
        self._forget()
        if self._is_ready:
            self._unit.reset()
        for name, value in values.items():
            for place, text in elements(name, value):
                variable = self._variable(place)
                if variable.type == "Real":
                    self._unit.setReal([variable.valueReference], [float(text)])
                elif variable.type == "Boolean":
                    self._unit.setBoolean([variable.valueReference], [text in ("true", "1")])
                else:
                    self._unit.setInteger([variable.valueReference], [int(text)])
        self._unit.setupExperiment(startTime=0.0)
        self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()
        self._is_ready = True
        self._state = self._unit.getFMUState()

    def _forget(self) -> None:
        if self._state is not None:
            self._unit.freeFMUState(self._state)
            self._state = None

    def _signals(self) -> np.ndarray:
        return np.array(self._unit.getReal(self._references))

    def _variable(self, name: str) -> Any:
        if name not in self._variables:
            known = ", ".join(sorted(name for name, it in self._variables.items() if it.causality in ("input", "output"))[:40])
            raise ArgumentError(f"the loop has no variable `{name}`; its inputs and outputs are {known} …")
        return self._variables[name]


class _Unpacked:
    """An FMU that is unpacked once for all that run it in this process: its library is loaded once."""

    _known: WeakValueDictionary[bytes, _Unpacked] = WeakValueDictionary()

    def __init__(self, file: Path) -> None:
        self.folder = tempfile.mkdtemp()
        finalize(self, _remove, self.folder, os.getpid())
        self.description = read_model_description(extract(file, self.folder))
        if self.description.coSimulation is None:
            raise ArgumentError(f"{file}: it isn't for co-simulation")

    @classmethod
    def of(cls, file: Path) -> _Unpacked:
        key = hashlib.sha256(file.read_bytes()).digest() + os.getpid().to_bytes(8, "big")
        found = cls._known.get(key)
        if found is None:
            found = cls._known[key] = cls(file)
        return found


def _remove(folder: str, process: int) -> None:
    # What was unpacked before a process was forked is its parent's.
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


def _exported(loop: PathLike, without: Sequence[str], folder: str) -> Path:
    return export(composite=loop, without=without, out=folder)[0]


def _unpacked(loop: PathLike, without: Sequence[str]) -> _Unpacked:
    with tempfile.TemporaryDirectory() as folder:
        return _Unpacked.of(_exported(loop, without, folder))


def _callbacks(said: list[str]) -> fmi2CallbackFunctions:
    """As FMPy's own, but messages are kept for whoever asks: an agent makes a loop fail thousands of times."""

    def log(_environment: Any, _instance: bytes, _status: int, _category: bytes, message: bytes, *_: Any) -> None:
        said.append(message.decode(errors="replace"))
        del said[:-MOST_SAID]

    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(log)
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    return callbacks


def _named(names: Names) -> dict[str, str]:
    """Variables by the names that the user gives them."""
    return dict(names) if isinstance(names, Mapping) else {name: name for name in names}
