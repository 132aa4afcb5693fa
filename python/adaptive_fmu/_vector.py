"""Environments side by side, in as many processes as there are cores, some in each: what goes to and fro is an array a process."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import CloudpickleWrapper, batch_space

Environment = gymnasium.Env[np.ndarray, np.ndarray]
#: Observations, rewards, terminated, truncated, and messages by the places of environments.
Stepped = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[int, dict[str, Any]]]


class Vector(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """So many environments of one kind. One that has ended is reset by the next step, whose action it doesn't take."""

    def __init__(self, make: Callable[[], Environment], count: int, processes: int | None = None) -> None:
        processes = max(1, min(count, processes or os.cpu_count() or 1))
        self.num_envs = count
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        sizes = [count // processes + (k < count % processes) for k in range(processes)]
        self._cuts = np.cumsum(sizes)[:-1]
        self._pipes: list[Connection] = []
        self._processes: list[Any] = []
        for size in sizes:
            ours, theirs = multiprocessing.Pipe()
            process = multiprocessing.Process(target=_serve, args=(theirs, CloudpickleWrapper(make), size), daemon=True)
            process.start()
            theirs.close()
            self._pipes.append(ours)
            self._processes.append(process)
        spaces = self._all([("spaces", None)] * processes)
        self.single_observation_space, self.single_action_space = spaces[0]
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """All of them; a seed counts up from one to the next."""
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else list(seed or [None] * self.num_envs)
        parts = [list(part) for part in np.split(np.array(seeds, dtype=object), self._cuts)]
        return np.concatenate(self._all([("reset", (part, options)) for part in parts])), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One step of each: observations, rewards, and whether they are terminated and truncated, a row each."""
        parts: list[Stepped] = self._all([("step", part) for part in np.split(np.asarray(actions), self._cuts)])
        observations, rewards, terminated, truncated = (np.concatenate([part[k] for part in parts]) for k in range(4))
        messages = np.full(self.num_envs, None, dtype=object)
        for first, part in zip([0, *self._cuts], parts):
            for place, told in part[4].items():
                messages[first + place] = told.get("message")
        return observations, rewards, terminated, truncated, {"message": messages}

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the processes."""
        for pipe in self._pipes:
            try:
                pipe.send(("close", None))
            except OSError:
                pass  # It has ended.
        for process in self._processes:
            process.join()

    def _all(self, requests: Sequence[tuple[str, Any]]) -> list[Any]:
        for pipe, request in zip(self._pipes, requests, strict=True):
            pipe.send(request)
        answers = [pipe.recv() for pipe in self._pipes]
        for answer in answers:
            if isinstance(answer, BaseException):
                raise answer
        return answers


def _serve(pipe: Connection, make: Any, count: int) -> None:
    """Some environments, in a process of their own."""
    environments: list[Environment] = []
    ended = np.zeros(count, bool)
    try:
        while True:
            what, value = pipe.recv()
            if what == "close":
                break
            try:
                environments = environments or [make() for _ in range(count)]
                if what == "spaces":
                    pipe.send((environments[0].observation_space, environments[0].action_space))
                elif what == "reset":
                    ended[:] = False
                    seeds, options = value
                    pipe.send(np.stack([env.reset(seed=seed, options=options)[0] for env, seed in zip(environments, seeds)]))
                else:
                    pipe.send(_step(environments, value, ended))
            except Exception as error:  # It is raised where it was asked.
                pipe.send(error)
    except (EOFError, KeyboardInterrupt):
        pass
    finally:
        for env in environments:
            env.close()


def _step(environments: Sequence[Environment], actions: np.ndarray, ended: np.ndarray) -> Stepped:
    count = len(environments)
    observations, told = [], {}
    rewards, terminated, truncated = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
    for k, env in enumerate(environments):
        if ended[k]:
            observations.append(env.reset()[0])
            continue
        observation, reward, terminated[k], truncated[k], about = env.step(actions[k])
        observations.append(observation)
        rewards[k] = cast("float", reward)
        if about:
            told[k] = about
    ended[:] = terminated | truncated
    return np.stack(observations), rewards, terminated, truncated, told
