"""The agents of one world as a vector environment of Gymnasium: a row for each."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_learning.acting import AnySpace
from minerva_learning.parallel import Episodes, LearningTask, RunningEpisode
from minerva_learning.shared import checked_rows
from minerva_learning.states import KindStates


class PopulationEnv(VectorEnv[Any, Any, Any]):
    """Agents of one world that are stepped together; see `population_env`.

    All rows begin together. A row whose episode has ended keeps its last observation, has the
    reward 0 and ignores its action until `reset`: `AutoresetMode.DISABLED`.
    """

    def __init__(self, episodes: Episodes, task: LearningTask, first: KindStates) -> None:
        first.check_some()
        single = task.observing.space
        for given in (single, task.acting.space):
            if isinstance(given, spaces.Dict):
                raise MisuseError(
                    "population_env: an observation or action has several arrays; expected one:"
                    " numbers only, or one matrix"
                )
        self.ids = list(first.ids)
        self.num_envs = len(self.ids)
        self.metadata: dict[str, Any] = {
            "name": episodes.name,
            "autoreset_mode": AutoresetMode.DISABLED,
        }
        self.single_observation_space: AnySpace = single
        self.single_action_space: AnySpace = task.acting.space
        self.observation_space = batch_space(single, self.num_envs)
        self.action_space = batch_space(task.acting.space, self.num_envs)
        self._episode = RunningEpisode(episodes, task, first)
        shape = (self.num_envs, *(single.shape or ()))
        self._observed: NDArray[Any] = np.zeros(shape, single.dtype)
        self._ends: NDArray[np.bool_] = np.ones((2, self.num_envs), np.bool_)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of all agents, with one seed for the world; see `WorldEnv.reset`.

        Raises MisuseError for options, MinervaError if the world cannot start.
        """
        if options:
            raise MisuseError(f"reset: there is no option {min(options)}; there are none")
        self._episode.begin(seed)
        self._ends[:] = False
        self._observe(self._episode.states.rows_of(self.ids))
        return self._observed.copy(), self._infos(self._active)

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Do the actions of all agents, a row for each, and run the frames of a step.

        Returns observations, rewards, terminated, truncated and infos, with a row for each agent.
        Raises MisuseError, BusError and WorldStopped as `WorldEnv.step` does.
        """
        episode, active = self._episode, self._active
        if not active.any():
            raise MisuseError("all episodes are over, or have not begun: call reset()")
        single = self.single_action_space
        given = checked_rows(actions, (self.num_envs, *(single.shape or ())), single.dtype)
        places = np.flatnonzero(active)
        names = [self.ids[place] for place in places]
        before = episode.step(names, given[places])
        rows = episode.states.rows_of(self.ids)
        rewards = np.zeros(self.num_envs)
        rewards[places] = episode.task.rewarding(before, episode.states, names)
        self._observe(rows)
        # Ends remain until `reset`.
        self._ends |= active & np.array(episode.ends(rows))
        terminated, truncated = self._ends.copy()
        return self._observed.copy(), rewards, terminated, truncated, self._infos(active)

    def close_extras(self, **kwargs: Any) -> None:
        """End the world, unless it belongs to the caller."""
        self._episode.close()

    def _observe(self, rows: NDArray[np.intp]) -> None:
        """Observe the agents whose episodes continue; `rows` are those of all agents."""
        shown = self._active & (rows >= 0)
        seen: Any = self._episode.task.observing.rows(self._episode.states)
        self._observed[shown] = seen[rows[shown]]

    @property
    def _active(self) -> NDArray[np.bool_]:
        """The rows whose episodes continue."""
        return ~(self._ends[0] | self._ends[1])

    def _infos(self, active: NDArray[np.bool_]) -> dict[str, Any]:
        frame = np.full(self.num_envs, self._episode.live.frame)
        return {"frame": frame, "_frame": active.copy()}

    @property
    def digest(self) -> str:
        """The digest of the string after the last step."""
        return self._episode.digest
