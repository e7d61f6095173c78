"""A world as an environment of PettingZoo's parallel API, on the interface of live worlds."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from operator import index
from typing import Any, Final, Protocol

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import ParallelEnv  # pyright: ignore[reportMissingTypeStubs]

from minerva_bus.api.live import Live
from minerva_bus.api.world import World
from minerva_bus.collect.data_tables import needed
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_learning.acting import Acting
from minerva_learning.observing import Observations, Observing
from minerva_learning.scoring import Ending, Rewarding
from minerva_learning.states import KindStates

RENDER_MODES: Final = ("rgb_array", "svg", "ansi")
SEEDS: Final = 1 << 31
"""Seeds of episodes after the first are whole numbers below this."""


@dataclass(frozen=True, slots=True)
class LearningTask:
    """Observations, actions and rewards of the agents of a task.

    `only` is the id of the only agent, "": all of the kind. An episode has at most `frames` frames
    (0: no limit), and a step `every` frames. With `births`, newborn agents take part.
    """

    kind: AgentKind
    only: str
    acting: Acting
    observing: Observing
    rewarding: Rewarding
    ending: Ending
    frames: int
    every: int
    births: bool


class Episodes(Protocol):
    """Where episodes take place; `frames_per_second` are frames per second of world time."""

    name: str
    frames_per_second: float

    def begin(self, seed: int | None) -> Live:
        """A world at the beginning of an episode. Raises MinervaError."""
        ...

    def close(self) -> None: ...


def whole_seed(seed: Any) -> int | None:
    """A seed of `reset`, also a NumPy int, as an int. Raises MisuseError for other values."""
    try:
        return None if seed is None else index(seed)
    except TypeError:
        raise MisuseError(f"reset(seed={seed!r:.40}): expected a whole number") from None


class OwnEpisodes:
    """Episodes in worlds that are started here, one after the other."""

    def __init__(self, world: World, seed: int | None, settings: Mapping[str, Any]) -> None:
        self.name = world.name
        self.frames_per_second = 1 / world.file.world.dt
        self._world = world
        self._seed = seed
        self._settings = settings
        self._random: np.random.Generator | None = None
        self._live: Live | None = None

    def begin(self, seed: int | None) -> Live:
        """Start the world: with this seed, or first its own, then one drawn after the last."""
        self.close()
        seed = whole_seed(seed)
        if seed is not None or self._random is None:
            own = self._world.file.world.seed if self._seed is None else self._seed
            seed = own if seed is None else seed
            self._random = np.random.default_rng(abs(seed))
        else:
            seed = int(self._random.integers(SEEDS))
        settings: dict[str, Any] = {"rate": 0.0, **self._settings, "seed": seed}
        self._live = self._world.start(**settings)
        return self._live

    def close(self) -> None:
        """End the world."""
        if self._live is not None:
            self._live.close()
            self._live = None


class AttachedEpisodes:
    """A world that runs elsewhere or belongs to the caller: an episode begins where it is."""

    def __init__(self, live: Live) -> None:
        self.name = live.views.name
        self.frames_per_second = 1 / live.status.dt
        self._live = live

    def begin(self, seed: int | None) -> Live:
        """The world as it is. Raises MisuseError for a seed."""
        if seed is not None:
            raise MisuseError(
                f"reset(seed={seed}): the world {self.name} is running, and keeps its seed; give"
                " parallel_env a World to begin again"
            )
        return self._live

    def close(self) -> None:
        """Leave the world to the caller."""


class WorldEnv(ParallelEnv[str, Any, Any]):
    """A world whose agents of one kind are controlled by policies; see `parallel_env`.

    `agents` are the ids of those that take part now. `possible_agents` exists if no newborn agents
    take part: the ids of the initial string.
    """

    def __init__(
        self, episodes: Episodes, task: LearningTask, first: KindStates, render_mode: str | None
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise MisuseError(
                f"render_mode {render_mode!r}{nearest(render_mode, [*RENDER_MODES])}; expected one"
                f" of {', '.join(RENDER_MODES)}"
            )
        self.metadata: dict[str, Any] = {
            "name": episodes.name,
            "render_modes": list(RENDER_MODES),
            "render_fps": episodes.frames_per_second / task.every,
        }
        self.render_mode = render_mode
        self.agents: list[str] = []
        if not task.births:
            self.possible_agents = list(first.ids)
        self._episodes = episodes
        self._task = task
        self._live: Live | None = None
        self._began = 0
        self._states = first
        self._observations: Observations = {}
        self._ended: set[str] = set()
        self._spaces: dict[str, tuple[Space[Any], Space[Any]]] = {}

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Begin an episode; returns observations and infos by agent.

        Without a seed, the first episode uses that of the world, each further one a new seed.
        Raises MinervaError if the world cannot start.
        """
        live = self._live = self._episodes.begin(seed)
        self._began = live.frame
        self._ended = set()
        self._observe(live)
        self.agents = list(self._states.ids)
        return {agent: self._observations[agent] for agent in self.agents}, self._infos(
            live, self.agents
        )

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[
        Observations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Send the actions as events of the next frame, and run the frames of a step.

        Args:
            actions: by agent; one without an action receives no event.

        Returns:
            Observations, rewards, terminations, truncations and infos of the agents that took part,
            and of newborn ones. An agent that has died has its last observation.

        Raises:
            MisuseError: an action does not fit, or is of an agent that takes no part.
            BusError: people may not send these events; see docs/worlds.md, `people`.
            WorldStopped: code of the world failed.

        """
        live = self._running
        self._send(live, actions)
        before, last, living = self._states, self._observations, self.agents
        live.step(self._task.every)
        self._observe(live)
        newborn = [agent for agent in self._states.ids if self._joins(agent, before)]
        present = self._states.row
        ends = self._task.ending(self._states)
        terminations = {
            agent: agent not in present or agent in ends or live.ended
            for agent in (*living, *newborn)
        }
        late = bool(self._task.frames) and live.frame - self._began >= self._task.frames
        truncations = {agent: late and not ended for agent, ended in terminations.items()}
        rewards = self._task.rewarding(before, self._states, living)
        rewards |= dict.fromkeys(newborn, 0.0)
        seen = {
            agent: self._observations[agent] if agent in present else last[agent]
            for agent in terminations
        }
        over = {agent for agent in terminations if terminations[agent] or truncations[agent]}
        self._ended |= over
        self.agents = [agent for agent in terminations if agent not in over]
        return seen, rewards, terminations, truncations, self._infos(live, terminations)

    @property
    def _running(self) -> Live:
        if self._live is None:
            raise MisuseError("the episode has not begun: call reset() first")
        return self._live

    def _send(self, live: Live, actions: Mapping[str, Any]) -> None:
        for agent in actions:
            if agent not in self.agents:
                known = ", ".join(self.agents[:5]) or "none; call reset()"
                raise MisuseError(f"there is no agent {agent} to act; there are {known}")
        # In one order, whatever the order of the actions is.
        acting = [agent for agent in self.agents if agent in actions]
        for event in self._task.acting.events(acting, [actions[agent] for agent in acting]):
            live.publish(event)

    def _joins(self, agent: str, before: KindStates) -> bool:
        return self._task.births and agent not in before.row and agent not in self._ended

    def _observe(self, live: Live) -> None:
        self._states = KindStates(live.scene, self._task.kind, self._task.only)
        self._observations = self._task.observing.observations(self._states)

    def _infos(self, live: Live, ids: Iterable[str]) -> dict[str, dict[str, Any]]:
        frame, digest = live.frame, self._states.scene.digest.hex()
        return {agent: {"frame": frame, "digest": digest} for agent in ids}

    def observation_space(self, agent: str) -> Space[Any]:
        """The space of an agent's observations."""
        return self._own_spaces(agent)[0]

    def action_space(self, agent: str) -> Space[Any]:
        """The space of an agent's actions."""
        return self._own_spaces(agent)[1]

    def _own_spaces(self, agent: str) -> tuple[Space[Any], Space[Any]]:
        """Spaces of its own, because each has its own random numbers."""
        if agent not in self._spaces:
            task = self._task
            self._spaces[agent] = deepcopy(task.observing.space), deepcopy(task.acting.space)
        return self._spaces[agent]

    def render(self) -> Any:
        """A picture of the string in `render_mode`, drawn by the view `svg`; None without a mode.

        "rgb_array": an array of shape (height, width, 3), which needs minerva-bus[picture]; "svg":
        a document; "ansi": the text of the string. Raises MisuseError without pictures.
        """
        if self.render_mode is None:
            return None
        if self.render_mode == "ansi":
            return str(self._running.scene)
        document = self._running.picture().svg
        return document if self.render_mode == "svg" else _pixels(document)

    def close(self) -> None:
        """End the world, unless it belongs to the caller."""
        self._episodes.close()
        self._live, self.agents = None, []


def _pixels(document: str) -> Any:
    needed("resvg_py", "picture")
    image: Any = needed("PIL.Image", "picture")
    # Found by its name, because services import this package.
    rendering: Any = needed("minerva_services.views.svg.rendering", "picture")
    with image.open(io.BytesIO(rendering.png(document))) as picture:
        return np.asarray(picture.convert("RGB"))
