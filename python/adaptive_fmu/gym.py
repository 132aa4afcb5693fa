"""Closed loops as Gymnasium environments, to train learned controllers and compare them with adaptive ones.

Requires gymnasium and fmpy: `pip install adaptive-fmu[gym]`.
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
from ._units import export
from ._values import PathLike, Value, elements
from ._vector import Vector

#: Values of signals by the names that the user chose.
Signals = Mapping[str, float]
#: Variables of the loop, `component.variable`, or a mapping to them from names that the user chose.
Names = Union[Sequence[str], Mapping[str, str]]
#: Fraction of a step that counts as rounding.
ROUNDING = 1e-6
#: Number of latest messages of an FMU that are stored.
MOST_MESSAGES = 20


class LoopEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Gymnasium environment of a loop as a single FMU, in which an agent replaces the components that are left out.

    loop: name of a loop of this package, or path of an SSP.
    action: variables that the agent sets ("plant.u[1]"), or a mapping to them from names of your own. They must be inputs.
    observation: variables that the agent observes ("plant.y[1]"), or a mapping to them from names of your own.
    reward: function that returns the reward of a step. It is called after each step with the values of all actions, observations
        and `signals`, by their names (your own names, if given).
    without: components to leave out, usually the controller. The inputs that they drive become inputs of the single FMU.
    signals: further variables for `reward` and `terminated`, given like `observation`. Default: none.
    step: length of a step, s. Default: 0.01.
    until: length of an episode, s. Default: 20.
    low, high: bounds of the actions; a number for all, or one number each. Default: no bounds.
    terminated: function that is called like `reward` and returns True if the episode ends. Default: None, it never ends this way.
    penalty: reward of a step in which the loop fails, which also ends the episode. Default: 0.
    values: start values by name.
    fmu: FMU for co-simulation to use instead of the loop. Default: None, the loop is exported as a single FMU.

    A reset restores a saved state and takes about as long as a step. `reset(options={"values": {...}})` initialises the loop
    again with other start values. The actions are constant during a step. Observations are float64. The observation space is
    unbounded, and the action space is bounded only by `low` and `high`.

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
                raise ArgumentError(
                    f"action {name} is not an input. Leave out the component that drives it, e.g. without=['controller']"
                )
        seen = {**self._further, **self._observed, **self._actions}
        self._names, self._references = list(seen), [self._variable(name).valueReference for name in seen.values()]
        self._places = [self._names.index(name) for name in self._observed]
        self._inputs = [self._variable(name).valueReference for name in self._actions.values()]
        self._reward, self._terminated, self._penalty = reward, terminated, float(penalty)
        self._step, self._steps = float(step), round(until / step)
        if not (step > 0 and until / step > 1 - ROUNDING):
            raise ArgumentError(
                f"step = {step}, until = {until} is not allowed: step must be above 0, and until at least one step"
            )
        self._values = dict(values or {})
        shape = (len(self._inputs),)
        lowest, highest = (np.broadcast_to(np.asarray(bound, np.float64), shape) for bound in (low, high))
        self.action_space = spaces.Box(lowest, highest, dtype=np.float64)
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(self._places),), dtype=np.float64)
        self._messages: list[str] = []
        self._callbacks = _callbacks(self._messages)
        self._unit.instantiate(callbacks=self._callbacks)
        self._is_open = True
        self._count, self._state, self._is_ready = 0, None, False

    @classmethod
    def vector(cls, count: int, *arguments: Any, processes: int | None = None, **options: Any) -> Vector:
        """Return several of these environments as one `Vector`, which steps them in parallel.

        count: number of environments.
        processes: number of processes, at most `count`. Default: number of cores.

        The other arguments are those of `LoopEnv`.

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
            # Each process has unpacked the FMU before the folder is removed.
            return Vector(partial(cls, loop, *arguments[1:], **options), count, processes)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Restore the start of the episode and return the observation and an empty dict.

        options: `{"values": {...}}` sets other start values, by name; later resets restore them too.
        """
        super().reset(seed=seed)
        anew = (options or {}).get("values")
        if self._state is None or anew is not None:
            self._start({**self._values, **(anew or {})})
        else:
            self._unit.setFMUState(self._state)
        self._count = 0
        self._messages.clear()
        return self._signals()[self._places], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, SupportsFloat, bool, bool, dict[str, Any]]:
        """Simulate one step with constant actions.

        Return the observation, the reward, True if the episode ended by `terminated` or by a failure, True if the time is over,
        and a dict, which contains `message` after a failure.
        """
        if self._state is None:
            raise gymnasium.error.ResetNeeded("step() was called before reset(). Call reset() first")
        self._unit.setReal(self._inputs, np.asarray(action, float).ravel().tolist())
        time = self._count * self._step
        self._count += 1
        try:
            self._unit.doStep(time, self._step)
        except FMICallException as error:
            message = self._messages[-1] if self._messages else str(error)
            return self._signals()[self._places], self._penalty, True, False, {"message": message}
        values = self._signals()
        seen = dict(zip(self._names, values.tolist()))
        over = bool(self._terminated is not None and self._terminated(seen))
        return values[self._places], float(self._reward(seen)), over, self._count >= self._steps, {}

    def close(self) -> None:
        """Free the FMU and remove its files."""
        if self._is_open:
            self._is_open = False
            self._forget()
            if self._is_ready:
                with suppress(FMICallException):  # The FMU may have failed before.
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
            raise ArgumentError(f"The loop has no variable `{name}`. Its inputs and outputs (at most 40 are listed): {known}")
        return self._variables[name]


class _Unpacked:
    """FMU unpacked once for all environments of this process that use it, so that its library is loaded once."""

    _known: WeakValueDictionary[bytes, _Unpacked] = WeakValueDictionary()

    def __init__(self, file: Path) -> None:
        self.folder = tempfile.mkdtemp()
        finalize(self, _remove, self.folder, os.getpid())
        self.description = read_model_description(extract(file, self.folder))
        if self.description.coSimulation is None:
            raise ArgumentError(
                f"fmu = {str(file)!r} does not support co-simulation, which LoopEnv needs. Choose an FMU for co-simulation"
            )

    @classmethod
    def of(cls, file: Path) -> _Unpacked:
        key = hashlib.sha256(file.read_bytes()).digest() + os.getpid().to_bytes(8, "big")
        found = cls._known.get(key)
        if found is None:
            found = cls._known[key] = cls(file)
        return found


def _remove(folder: str, process: int) -> None:
    # An FMU that was unpacked before a fork belongs to the parent process.
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


def _exported(loop: PathLike, without: Sequence[str], folder: str) -> Path:
    return export(composite=loop, without=without, out=folder)[0]


def _unpacked(loop: PathLike, without: Sequence[str]) -> _Unpacked:
    with tempfile.TemporaryDirectory() as folder:
        return _Unpacked.of(_exported(loop, without, folder))


def _callbacks(messages: list[str]) -> fmi2CallbackFunctions:
    """Return callbacks like those of FMPy, but store the latest messages instead of printing them.

    During training, loops fail thousands of times.
    """

    def log(_environment: Any, _instance: bytes, _status: int, _category: bytes, message: bytes, *_: Any) -> None:
        messages.append(message.decode(errors="replace"))
        del messages[:-MOST_MESSAGES]

    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(log)
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    return callbacks


def _named(names: Names) -> dict[str, str]:
    """Return the variables by the names that the user chose."""
    return dict(names) if isinstance(names, Mapping) else {name: name for name in names}
