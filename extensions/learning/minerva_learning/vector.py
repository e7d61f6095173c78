"""Several worlds as a vector environment of Gymnasium, in this process or in several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast
from weakref import finalize

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, WorldStopped
from minerva_learning.block import MakeEnv, WorldBlock
from minerva_learning.parallel import whole_seed
from minerva_learning.shared import SharedArrays, copied
from minerva_learning.single import AgentEnv
from minerva_learning.workers import WorldWorkers


class WorldVectorEnv(VectorEnv[Any, Any, Any]):
    """Worlds that are stepped together; see `vector_env`.

    A world whose episode has ended begins the next one in the next step, which ignores its action
    and has the reward 0: `AutoresetMode.NEXT_STEP`.
    """

    def __init__(
        self, name: str, make: MakeEnv, first: AgentEnv, worlds: int, processes: int, seed: int
    ) -> None:
        self.num_envs = worlds
        self.metadata: dict[str, Any] = {
            **first.metadata,
            "autoreset_mode": AutoresetMode.NEXT_STEP,
        }
        self.single_observation_space = first.observation_space
        self.single_action_space = first.action_space
        self.observation_space = batch_space(first.observation_space, worlds)
        self.action_space = batch_space(first.action_space, worlds)
        self._name = name
        self._seed: int | None = seed
        self._begun = False
        self._arrays = SharedArrays(first.observation_space, first.action_space, worlds)
        blocks = [range(part[0], part[-1] + 1) for part in np.array_split(range(worlds), processes)]
        self._worlds = (
            WorldBlock(make, blocks[0], self._arrays)
            if processes == 1
            else WorldWorkers(make, blocks, self._arrays)
        )
        # Processes end with the environment, also if nobody closes it.
        self._end = finalize(self, self._worlds.close)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in each world; returns observations and infos.

        Args:
            seed: of the first world, which the others count on from; or one for each. None: first
                that of the world file, later the next ones of each world.
            options: none.

        Raises:
            MisuseError: a wrong number of seeds, or options.
            WorldStopped: a world or a worker failed, as its message says.

        """
        if options:
            raise MisuseError(f"reset: there is no option {min(options)}; there are none")
        seed = self._seed if seed is None else seed
        self._seed = None
        seeds = self._seeds(seed)
        if len(seeds) != self.num_envs:
            raise MisuseError(f"reset: {len(seeds)} seeds; expected {self.num_envs}, one per world")
        self._do(lambda: self._worlds.reset(seeds))
        self._begun = True
        return copied(self._arrays.observation), self._arrays.infos()

    def _seeds(self, seed: Any) -> list[int | None]:
        """The seed of each world. Raises MisuseError."""
        if isinstance(seed, Iterable) and not isinstance(seed, str):
            return [whole_seed(each) for each in cast("Iterable[Any]", seed)]
        first = whole_seed(seed)
        numbers = range(self.num_envs)
        return [None if first is None else first + number for number in numbers]

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Do an action in each world, a row for each.

        Returns:
            Observations, rewards, terminated, truncated and infos, with a row for each world.

        Raises:
            MisuseError: the actions have another shape or type, or no episode has begun.
            WorldStopped: a world or a worker failed, as its message says.

        """
        self._require_episodes()
        self._arrays.put_actions(actions)
        self._do(self._worlds.step)
        ends = self._arrays.ends.astype(np.bool_)
        return (
            copied(self._arrays.observation),
            self._arrays.reward.copy(),
            ends[:, 0],
            ends[:, 1],
            self._arrays.infos(),
        )

    @property
    def digests(self) -> list[str]:
        """The digest of each world after the last step.

        Raises MisuseError if no episode has begun, WorldStopped if a worker failed.
        """
        self._require_episodes()
        self._do(self._worlds.put_digests)
        return [row.tobytes().hex() for row in self._arrays.digest]

    def _require_episodes(self) -> None:
        if not self._begun:
            raise MisuseError("the episodes have not begun: call reset() first")

    def _do(self, command: Callable[[], None]) -> None:
        """Carry out a command. After an error or Ctrl-C all worlds end."""
        if self.closed:
            raise MisuseError(f"{self._name}: the vector environment is closed; make another one")
        try:
            command()
        except BaseException as error:
            self.closed = True
            self._end.detach()
            self._worlds.kill()
            if isinstance(error, WorldStopped):
                raise WorldStopped(f"{self._name}: {error}; all its worlds have ended") from error
            raise

    def close_extras(self, **kwargs: Any) -> None:
        """End the worlds and their processes."""
        self._end()
