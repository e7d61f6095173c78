"""A world as an environment of PettingZoo's parallel API, on the interface of live worlds."""

from __future__ import annotations

import io
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from operator import index
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv  # pyright: ignore[reportMissingTypeStubs]

from minerva_bus.api.live import Live
from minerva_bus.api.world import World
from minerva_bus.collect.data_tables import needed
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_learning.acting import Acting, Rows
from minerva_learning.observing import Observing
from minerva_learning.scoring import Ending, Rewarding
from minerva_learning.shared import each
from minerva_learning.states import KindStates

RENDER_MODES: Final = ("rgb_array", "svg", "ansi")
SEEDS: Final = 1 << 31
"""Seeds of episodes after the first are whole numbers below this."""

_DEAD: Final = np.ones(1, np.bool_)


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


Episodes: TypeAlias = OwnEpisodes | AttachedEpisodes
"""Where episodes take place."""


class RunningEpisode:
    """The episodes of a task, one after the other; `states` are those of its agents now."""

    def __init__(self, episodes: Episodes, task: LearningTask, first: KindStates) -> None:
        self.task = task
        self.states = first
        self._episodes = episodes
        self._live: Live | None = None
        self._began = 0
        self._acting: list[str] = []
        self._receivers = Ids.of(self._acting)

    @property
    def live(self) -> Live:
        """The world. Raises MisuseError before the first episode."""
        if self._live is None:
            raise MisuseError("the episode has not begun: call reset() first")
        return self._live

    def begin(self, seed: int | None) -> None:
        """Begin the next episode. Raises MinervaError if the world cannot start."""
        live = self._live = self._episodes.begin(seed)
        self._began = live.frame
        self._acting = []
        self._observe(live)

    def step(self, agents: list[str], actions: Rows) -> KindStates:
        """Send an action of each of these agents, and run the frames of a step.

        Returns the states before it. Raises MisuseError, BusError and WorldStopped.
        """
        live, before = self.live, self.states
        if agents != self._acting:
            self._acting, self._receivers = agents, before.ids_of(agents)
        for event in self.task.acting.events(self._receivers, actions):
            live.publish(event)
        live.step(self.task.every)
        self._observe(live)
        return before

    def _observe(self, live: Live) -> None:
        task = self.task
        self.states = KindStates(live.scene, task.kind, task.only, self.states)

    def ends(self, rows: NDArray[np.intp]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which episodes are terminated and truncated, of agents in rows of `states`; -1: dead."""
        # The last element is that of the dead.
        terminated = np.concatenate((self.task.ending(self.states), _DEAD))[rows] | self.live.ended
        late = bool(self.task.frames) and self.live.frame - self._began >= self.task.frames
        return terminated, ~terminated & late

    @property
    def digest(self) -> str:
        """The digest of the string that the agents see now."""
        return self.states.scene.digest.hex()

    def close(self) -> None:
        """End the world, unless it belongs to the caller."""
        self._episodes.close()
        self._live = None


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
        self._episode = RunningEpisode(episodes, task, first)
        self._observations: dict[str, Any] = {}
        self._ended: set[str] = set()
        self._spaces: dict[str, tuple[Space[Any], Space[Any]]] = {}

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode; returns observations and infos by agent.

        Without a seed, the first episode uses that of the world, each further one a new seed.
        Raises MinervaError if the world cannot start.
        """
        self._episode.begin(seed)
        self._ended = set()
        states = self._episode.states
        self.agents = list(states.ids)
        return self._observe(self.agents, states.rows_of(self.agents)), self._infos(self.agents)

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Any]]:
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
        living, episode = self.agents, self._episode
        # In one order, whatever the order of the actions is.
        acting = [agent for agent in living if agent in actions]
        if len(acting) < len(actions):
            unknown = next(agent for agent in actions if agent not in living)
            known = ", ".join(living[:5]) or "none; call reset()"
            raise MisuseError(f"there is no agent {unknown} to act; there are {known}")
        before = episode.step(acting, [actions[agent] for agent in acting])
        agents = living + self._newborn(before)
        rows = episode.states.rows_of(agents)
        terminated, truncated = (ends.tolist() for ends in episode.ends(rows))
        rewards = episode.task.rewarding(before, episode.states, living).tolist()
        rewards += [0.0] * (len(agents) - len(living))
        ends = zip(agents, terminated, truncated, strict=True)
        over = {agent for agent, died, late in ends if died or late}
        self.agents = [agent for agent in agents if agent not in over]
        self._ended |= over
        return (
            self._observe(agents, rows),
            dict(zip(agents, rewards, strict=True)),
            dict(zip(agents, terminated, strict=True)),
            dict(zip(agents, truncated, strict=True)),
            self._infos(agents),
        )

    def _newborn(self, before: KindStates) -> list[str]:
        """The agents that join after a step."""
        ids = self._episode.states.ids
        if not self._episode.task.births or ids is before.ids:
            return []
        return [agent for agent in ids if agent not in before.row and agent not in self._ended]

    def _observe(self, agents: list[str], rows: NDArray[np.intp]) -> dict[str, Any]:
        """The observation of each agent; of a dead one (-1) the last one."""
        seen, last = self._episode.task.observing.rows(self._episode.states), self._observations
        values = each(seen)
        self._observations = {
            agent: values[row] if row >= 0 else last[agent]
            for agent, row in zip(agents, rows.tolist(), strict=True)
        }
        return dict(self._observations)

    def _infos(self, agents: list[str]) -> dict[str, dict[str, Any]]:
        frame = self._episode.live.frame
        return {agent: {"frame": frame} for agent in agents}

    @property
    def digest(self) -> str:
        """The digest of the string after the last step.

        It is no part of the infos, because in a small world it takes a fifth of a step.
        """
        return self._episode.digest

    def observation_space(self, agent: str) -> Space[Any]:
        """The space of an agent's observations."""
        return self._own_spaces(agent)[0]

    def action_space(self, agent: str) -> Space[Any]:
        """The space of an agent's actions."""
        return self._own_spaces(agent)[1]

    def _own_spaces(self, agent: str) -> tuple[Space[Any], Space[Any]]:
        """Spaces of its own, because each has its own random numbers."""
        if agent not in self._spaces:
            task = self._episode.task
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
            return str(self._episode.live.scene)
        document = self._episode.live.picture().svg
        return document if self.render_mode == "svg" else _pixels(document)

    def close(self) -> None:
        """End the world, unless it belongs to the caller."""
        self._episode.close()
        self.agents = []


def _pixels(document: str) -> Any:
    needed("resvg_py", "picture")
    image: Any = needed("PIL.Image", "picture")
    # Found by its name, because services import this package.
    rendering: Any = needed("minerva_services.views.svg.rendering", "picture")
    with image.open(io.BytesIO(rendering.png(document))) as picture:
        return np.asarray(picture.convert("RGB"))
