"""Parallel environments in several processes, which exchange one array per process and step with the main process."""

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
#: Observations, rewards, terminated, truncated, and information dicts by the indices of environments.
Stepped = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[int, dict[str, Any]]]


class Vector(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Vector of parallel environments of one kind.

    The step after the end of an episode resets that environment and ignores its action.

    make: function that makes one environment.
    count: number of environments.
    processes: number of processes, at most `count`. Default: number of cores.
    """

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
        """Reset all environments and return their observations, one row each. An int as `seed` increases by 1 per environment."""
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else list(seed or [None] * self.num_envs)
        parts = [list(part) for part in np.split(np.array(seeds, dtype=object), self._cuts)]
        return np.concatenate(self._all([("reset", (part, options)) for part in parts])), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step each environment once.

        Return observations, rewards, `terminated` and `truncated` with one row per environment, and a dict with `message`: for
        each environment why its loop failed, or None.
        """
        parts: list[Stepped] = self._all([("step", part) for part in np.split(np.asarray(actions), self._cuts)])
        observations, rewards, terminated, truncated = (np.concatenate([part[k] for part in parts]) for k in range(4))
        messages = np.full(self.num_envs, None, dtype=object)
        for first, part in zip([0, *self._cuts], parts):
            for place, info in part[4].items():
                messages[first + place] = info.get("message")
        return observations, rewards, terminated, truncated, {"message": messages}

    def close_extras(self, **kwargs: Any) -> None:
        """End the processes."""
        for pipe in self._pipes:
            try:
                pipe.send(("close", None))
            except OSError:
                pass  # The process has ended.
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
    """Run some of the environments in a separate process: answer requests until the process is closed."""
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
            except Exception as error:  # The main process raises it.
                pipe.send(error)
    except (EOFError, KeyboardInterrupt):
        pass
    finally:
        for env in environments:
            env.close()


def _step(environments: Sequence[Environment], actions: np.ndarray, ended: np.ndarray) -> Stepped:
    count = len(environments)
    observations, infos = [], {}
    rewards, terminated, truncated = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
    for k, env in enumerate(environments):
        if ended[k]:
            observations.append(env.reset()[0])
            continue
        observation, reward, terminated[k], truncated[k], about = env.step(actions[k])
        observations.append(observation)
        rewards[k] = cast("float", reward)
        if about:
            infos[k] = about
    ended[:] = terminated | truncated
    return np.stack(observations), rewards, terminated, truncated, infos
