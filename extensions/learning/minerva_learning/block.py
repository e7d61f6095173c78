"""Some worlds of a vector environment, stepped one after the other in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from minerva_bus.errors import MinervaError, WorldStopped
from minerva_learning.shared import SharedArrays, put, taken
from minerva_learning.single import AgentEnv

MakeEnv = Callable[[int], AgentEnv]
"""Makes the environment of the world with this number."""


class WorldBlock:
    """Consecutive worlds, with their observations and results in shared arrays.

    Args:
        make: makes the environment of a world.
        numbers: of the worlds, which are their rows in the arrays.
        arrays: those of all worlds.

    """

    def __init__(self, make: MakeEnv, numbers: Sequence[int], arrays: SharedArrays) -> None:
        self._envs = {number: make(number) for number in numbers}
        self._arrays = arrays

    def reset(self, seeds: Sequence[int | None]) -> None:
        """Begin an episode in each world; `seeds` are of all worlds. Raises MinervaError."""
        for number, env in self._envs.items():
            self._begin(number, env, seeds[number])

    def step(self) -> None:
        """Do the actions in the arrays. A world whose episode has ended begins the next one.

        Raises MinervaError, which names the world.
        """
        for number, env in self._envs.items():
            if self._arrays.ends[number].any():
                self._begin(number, env, None)
            else:
                self._act(number, env)

    def put_digests(self) -> None:
        """Write the digest of each world into the arrays."""
        for number, env in self._envs.items():
            self._arrays.digest[number] = np.frombuffer(bytes.fromhex(env.digest), np.uint8)

    def close(self) -> None:
        """End all worlds."""
        for env in self._envs.values():
            env.close()

    # No process of its own is to be killed.
    kill = close

    def _begin(self, number: int, env: AgentEnv, seed: int | None) -> None:
        try:
            observation, info = env.reset(seed=seed)
        except MinervaError as error:
            raise _named(number, error) from error
        self._arrays.reward[number] = 0.0
        self._arrays.ends[number] = False
        self._show(number, observation, info)

    def _act(self, number: int, env: AgentEnv) -> None:
        try:
            observation, reward, *ends, info = env.step(taken(self._arrays.action, number))
        except MinervaError as error:
            raise _named(number, error) from error
        self._arrays.reward[number] = reward
        self._arrays.ends[number] = ends
        self._show(number, observation, info)

    def _show(self, number: int, observation: object, info: dict[str, Any]) -> None:
        put(self._arrays.observation, number, observation)
        self._arrays.frame[number] = info["frame"]


def _named(number: int, error: MinervaError) -> WorldStopped:
    return WorldStopped(f"world {number}: {error}")
