"""Makes environments from worlds: checks the arguments, and finds kind, events and attributes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from minerva_bus.api.live import Live
from minerva_bus.api.pictures import WorldViews
from minerva_bus.api.world import World, own_options, world_of
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.frame.collection_step import OrderRules
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.member_table import Members, MemberState
from minerva_bus.frame.world_state import Phase, Progress
from minerva_bus.grammar.scene import EMPTY, Scene, agents
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.world.agent import Agent
from minerva_learning.acting import Act, acting_of
from minerva_learning.observing import Observe, observing_of
from minerva_learning.parallel import AttachedEpisodes, LearningTask, OwnEpisodes, WorldEnv
from minerva_learning.population import PopulationEnv
from minerva_learning.scoring import Done, Reward, ending_of, rewarding_of
from minerva_learning.single import AgentEnv
from minerva_learning.states import KindStates
from minerva_learning.vector import WorldVectorEnv

BIRTHS = "births"
"""The attribute that a kind needs to give birth; see `Agent.child`."""


def parallel_env(
    world: World | Live | str | Path,
    agents: str | type[Agent],
    act: Act,
    observe: Observe = None,
    reward: Reward = None,
    done: Done = None,
    *,
    frames: int | None = None,
    every: int = 1,
    births: bool | None = None,
    render_mode: str | None = None,
    **settings: Any,
) -> WorldEnv:
    """A world as an environment of PettingZoo's parallel API.

    Args:
        world: a `World`, a world file, the name of an installed world, or a live world, such as
            that of `connect`: episodes then begin where it is, and it stays with the caller.
        agents: the kind that policies control, such as "ARabbit" or its class, or "#ID" for one.
        act: the event type whose data are the action; or a list of events of which the action
            chooses one, in which None sends none.
        observe: attributes, a visual event type (the parameters of the agent's view), or a function
            of the string and the agent that returns an array. None: all attributes that are
            numbers, bools or words.
        reward: an attribute whose increase counts, or a function of the agent before and after a
            step, where None is a dead agent. None: 1 for each step survived.
        done: a condition about attributes, such as "energy > 30", or a function of the agent. Its
            episode ends where this is true; the agent stays in the world. None: only with death.
        frames: after this number, episodes are truncated; 0: never. Default: the world's own.
        every: frames per step; actions are events of the first one.
        births: whether newborn agents take part; default: whether the kind can have children.
        render_mode: "rgb_array", "svg", "ansi" or None.
        settings: as for `World.start`: `bus`, `processes`, and the world's own options; `seed` is
            that of the first episode, unless `reset` has one.

    Raises:
        MisuseError: an argument does not fit the world, or a library is missing.
        WorldFileError, SceneError, VocabularyError: the world or a condition is wrong.

    Example:
        >>> env = parallel_env("meadow", agents="ARabbit", act="eAlarm", frames=500)
        >>> observations, infos = env.reset(seed=7)

    """
    return WorldEnv(
        *_parts(world, agents, act, observe, reward, done, frames, every, births, settings),
        render_mode,
    )


def population_env(
    world: World | Live | str | Path,
    agents: str | type[Agent],
    act: Act,
    observe: Observe = None,
    reward: Reward = None,
    done: Done = None,
    *,
    frames: int | None = None,
    every: int = 1,
    **settings: Any,
) -> PopulationEnv:
    """The agents of one world as a vector environment of Gymnasium, a row for each.

    Agents that do not affect each other are copies of a world with one agent. Others learn
    together, with one policy. Rows are those of the initial string; newborn agents have none.

    Args:
        world: as for `parallel_env`.
        agents: the kind of the agents; its methods should be those of a population.
        act: as for `parallel_env`.
        observe: as for `parallel_env`, with one array for each agent.
        reward: as for `parallel_env`.
        done: as for `parallel_env`.
        frames: as for `parallel_env`.
        every: as for `parallel_env`.
        settings: as for `parallel_env`.

    Raises MisuseError as `parallel_env` does, and if there is no agent.

    Example:
        >>> envs = population_env("flock", "ABird", "eTurn", frames=500, birds=1000)
        >>> observations, infos = envs.reset(seed=7)

    """
    return PopulationEnv(
        *_parts(world, agents, act, observe, reward, done, frames, every, False, settings)
    )


def _parts(
    world: World | Live | str | Path,
    agents: str | type[Agent],
    act: Act,
    observe: Observe,
    reward: Reward,
    done: Done,
    frames: int | None,
    every: int,
    births: bool | None,
    settings: dict[str, Any],
) -> tuple[OwnEpisodes | AttachedEpisodes, LearningTask, KindStates]:
    """Where episodes take place, what agents learn, and the initial string."""
    seed = settings.pop("seed", None)
    if isinstance(world, Live):
        if settings or seed is not None:
            raise MisuseError(f"{min(['seed', *settings])}: the world is running already")
        views, limit = world.views, 0
        episodes, vocabulary, scene = AttachedEpisodes(world), world.vocabulary, world.scene
        file = None if world.world is None else world.world.read()
    else:
        own = world_of(world, {})
        known = own.file.options
        # The initial string may depend on them, and with it the agents.
        options = {name: value for name, value in settings.items() if name in known}
        file = own.read(Overrides(own_options(own, options)))
        declared = file.world
        vocabulary, scene, limit = declared.vocabulary, declared.scene, declared.frames
        views = WorldViews(own.name, vocabulary, own.agents)
        episodes = OwnEpisodes(own, seed, settings)
    kind, only = _kind_of(agents, vocabulary, scene)
    first = KindStates(scene, kind, only)
    if every < 1 or (frames is not None and frames < 0):
        raise MisuseError(f"every={every}, frames={frames}: expected numbers of frames")
    task = LearningTask(
        kind,
        only,
        acting_of(act, kind, vocabulary.events, _permission(file)),
        observing_of(observe, first, lambda string, event: views.view(string, event, 0)),
        rewarding_of(reward, kind),
        ending_of(done, kind),
        limit if frames is None else frames,
        every,
        births=not only and (BIRTHS in kind.fields.names if births is None else births),
    )
    return episodes, task, first


def single_env(
    world: World | Live | str | Path,
    agent: str | type[Agent],
    act: Act,
    observe: Observe = None,
    reward: Reward = None,
    done: Done = None,
    **settings: Any,
) -> AgentEnv:
    """One agent of a world as an environment of Gymnasium.

    Args:
        world: as for `parallel_env`.
        agent: "#ID", or the kind of which the world has exactly one agent.
        act: as for `parallel_env`.
        observe: as for `parallel_env`.
        reward: as for `parallel_env`.
        done: as for `parallel_env`.
        settings: all others of `parallel_env`: `frames`, `every`, `render_mode`, options, ...

    Raises MisuseError also if several agents could be meant.

    Example:
        >>> env = single_env("robot", agent="ARobot", act="eSpeed", observe=["row", "column"])
        >>> observation, info = env.reset(seed=7)

    """
    more: dict[str, Any] = {"births": False, **settings}
    env = parallel_env(world, agent, act, observe, reward, done, **more)
    ids = env.possible_agents
    if len(ids) != 1:
        shown = ", ".join(f"#{name}" for name in ids[:5]) or "none"
        raise MisuseError(f"agent {agent}: expected one agent, there are {shown}")
    return AgentEnv(env, ids[0])


def vector_env(
    world: World | str | Path,
    agent: str | type[Agent],
    act: Act,
    observe: Observe = None,
    reward: Reward = None,
    done: Done = None,
    *,
    worlds: int,
    processes: int = 1,
    seed: int | None = None,
    **settings: Any,
) -> WorldVectorEnv:
    """Several worlds with one agent each, as a vector environment of Gymnasium.

    Observations are the same bits as those of `single_env` with the seed of the world, in any
    number of processes.

    Args:
        world: as for `parallel_env`, without live worlds.
        agent: as for `single_env`.
        act: as for `parallel_env`.
        observe: as for `parallel_env`.
        reward: as for `parallel_env`.
        done: as for `parallel_env`.
        worlds: their number.
        processes: number of processes, forked from this one, that step the worlds; 1: all worlds
            are in this process.
        seed: of the first world in the first episode, unless `reset` has one; the others count on.
        settings: all others of `single_env`, without `render_mode`, `bus` and `processes`.

    Raises MisuseError as `single_env` does, and for a wrong number of worlds or processes.

    Example:
        >>> envs = vector_env("robot", "ARobot", "eSpeed", ["row", "angle"], worlds=16, processes=2)
        >>> observations, infos = envs.reset(seed=7)

    """
    own = world_of(world, {})
    for name in ("bus", "render_mode"):
        if settings.get(name):
            raise MisuseError(f"vector_env: {name} is for single_env: several worlds are stepped")
    if not 1 <= processes <= worlds:
        raise MisuseError(
            f"worlds={worlds}, processes={processes}: expected at least 1 process, and a world for"
            " each"
        )

    def make(number: int) -> AgentEnv:
        return single_env(own, agent, act, observe, reward, done, **settings)

    seed = own.file.world.seed if seed is None else seed
    return WorldVectorEnv(own.name, make, make(0), worlds, processes, seed)


def _permission(file: WorldFile | None) -> Callable[[str], str]:
    """Why people may not send events of a type, as far as a world file shows; "": they may."""
    if file is None:
        return lambda _: ""
    members, now = Members(file.world.expected, file.world.shares.values()), Progress(0)
    for process in file.processes:
        # What a program in another language makes is known only when it joins.
        if not process.command:
            entry = members.get(process.name)
            entry.hello, entry.state = process.make_member().hello(), MemberState.PRESENT
    now.phase = Phase.READY
    return OrderRules(file.world, now, members, Composition(EMPTY)).refusal_of_order


def _kind_of(
    given: str | type[Agent], vocabulary: Vocabulary, scene: Scene
) -> tuple[AgentKind, str]:
    """The kind of the agents, and the id of the only one or ""."""
    name = given if isinstance(given, str) else given.kind.name
    only = name[1:] if name.startswith("#") else ""
    if only:
        known = {node.id: node.symbol for node in agents(scene)}
        if only not in known:
            raise MisuseError(f"the string has no agent #{only}{nearest(only, [*known])}")
        name = known[only]
    if name not in vocabulary.kinds:
        kinds = [*vocabulary.kinds]
        listed = f"there are {', '.join(kinds)}"
        raise MisuseError(f"the world has no agent kind {name}{nearest(name, kinds, listed)}")
    return vocabulary.kinds[name], only
