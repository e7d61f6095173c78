"""One agent of a world as an environment of Gymnasium."""

from __future__ import annotations

from typing import Any

import gymnasium

from minerva_bus.errors import MisuseError
from minerva_learning.parallel import WorldEnv


class AgentEnv(gymnasium.Env[Any, Any]):
    """The environment of one agent; all others follow the rules of the world. See `single_env`."""

    def __init__(self, world: WorldEnv, agent: str) -> None:
        self.agent = agent
        self.observation_space = world.observation_space(agent)
        self.action_space = world.action_space(agent)
        self.render_mode = world.render_mode
        self.metadata: dict[str, Any] = world.metadata
        self._world = world

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; returns the observation and the info. See `WorldEnv.reset`."""
        super().reset(seed=seed)
        observations, infos = self._world.reset(seed, options)
        if self.agent not in observations:
            raise MisuseError(f"the agent {self.agent} is not in the string, so it cannot act")
        return observations[self.agent], infos[self.agent]

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do an action; returns observation, reward, terminated, truncated and info."""
        if not self._world.agents:
            raise MisuseError("the episode is over, or has not begun: call reset()")
        agent = self.agent
        observations, rewards, ended, late, infos = self._world.step({agent: action})
        return observations[agent], rewards[agent], ended[agent], late[agent], infos[agent]

    @property
    def digest(self) -> str:
        """The digest of the string after the last step."""
        return self._world.digest

    def render(self) -> Any:
        """A picture in `render_mode`; see `WorldEnv.render`."""
        return self._world.render()

    def close(self) -> None:
        """End the world, unless it belongs to the caller."""
        self._world.close()
