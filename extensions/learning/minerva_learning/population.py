"""The agents of one world as a vector environment of Gymnasium: a row for each."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from minerva_bus.api.live import Live
from minerva_bus.errors import MisuseError
from minerva_learning.acting import AnySpace
from minerva_learning.observing import rows_of
from minerva_learning.parallel import Episodes, LearningTask
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
        self._episodes = episodes
        self._task = task
        self._live: Live | None = None
        self._began = 0
        self._states = first
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
        live = self._live = self._episodes.begin(seed)
        self._began = live.frame
        self._ends[:] = False
        self._observe(live)
        return self._observed.copy(), self._infos(live, self._active)

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Do the actions of all agents, a row for each, and run the frames of a step.

        Returns observations, rewards, terminated, truncated and infos, with a row for each agent.
        Raises MisuseError, BusError and WorldStopped as `WorldEnv.step` does.
        """
        live, active = self._live, self._active
        if live is None or not active.any():
            raise MisuseError("all episodes are over, or have not begun: call reset()")
        single = self.single_action_space
        given = checked_rows(actions, (self.num_envs, *(single.shape or ())), single.dtype)
        rows = np.flatnonzero(active)
        names = [self.ids[row] for row in rows]
        for event in self._task.acting.events(names, list(given[rows])):
            live.publish(event)
        before = self._states
        live.step(self._task.every)
        present = self._observe(live)
        gained = self._task.rewarding(before, self._states, names)
        rewards = np.zeros(self.num_envs)
        rewards[rows] = [gained[name] for name in names]
        ends = self._task.ending(self._states)
        done = np.array([name in ends for name in self.ids], np.bool_) | ~present | live.ended
        late = bool(self._task.frames) and live.frame - self._began >= self._task.frames
        # Ends remain until `reset`.
        self._ends[0] |= active & done
        self._ends[1] |= active & ~done & late
        terminated, truncated = self._ends.copy()
        return self._observed.copy(), rewards, terminated, truncated, self._infos(live, active)

    def close_extras(self, **kwargs: Any) -> None:
        """End the world, unless it belongs to the caller."""
        self._episodes.close()
        self._live = None

    def _observe(self, live: Live) -> NDArray[np.bool_]:
        """Observe the agents whose episodes continue; returns which agents are in the string."""
        states = self._states = KindStates(live.scene, self._task.kind, self._task.only)
        at = np.arange(self.num_envs)
        if states.ids != self.ids:
            at = np.array([states.row.get(name, -1) for name in self.ids])
        shown = self._active & (at >= 0)
        self._observed[shown] = rows_of(self._task.observing, states)[at[shown]]
        return at >= 0

    @property
    def _active(self) -> NDArray[np.bool_]:
        """The rows whose episodes continue."""
        return ~(self._ends[0] | self._ends[1])

    def _infos(self, live: Live, active: NDArray[np.bool_]) -> dict[str, Any]:
        digests = np.full(self.num_envs, live.digest, object)
        frames = np.full(self.num_envs, live.frame)
        return {
            "frame": frames,
            "_frame": active.copy(),
            "digest": digests,
            "_digest": active.copy(),
        }
