"""The tables [world] and [placement]: the world, and the placement rules of its agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from minerva_bus.errors import MisuseError, WorldFileError, nearest
from minerva_bus.frame.constraints import PlacementRules, Rule
from minerva_bus.frame.description import World
from minerva_bus.frame.senders import ID
from minerva_bus.grammar.assignment import assigned
from minerva_bus.grammar.scene import AGENT_ID, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.specs import called, load
from minerva_bus.launch.table import Table
from minerva_bus.launch.typed import of_nodes
from minerva_bus.launch.worldfile import Process
from minerva_bus.settings.kinds import TEXT, TEXTS, number
from minerva_bus.settings.tables import PlacementSettings, WorldSettings
from minerva_bus.world.order import Order
from minerva_bus.world.policy import Policy


def read_description(
    top: Table,
    settings: WorldSettings,
    path: Path,
    options: Mapping[str, Any],
    processes: Sequence[Process],
) -> World:
    """The world, without its norms.

    The world waits for the `processes`; `options` are the arguments of a function that makes the
    scene. Raises WorldFileError and SceneError.
    """
    table = top.table("world")
    vocabulary = _vocabulary(table, settings, path)
    # Before the string is read, because a missing class would be reported as an unknown symbol.
    _check_kinds(processes, vocabulary, path, ", ".join(settings.vocabulary))
    _check_speakers(processes, vocabulary, path)
    # `dt` follows the file's rate only: `--rate` changes the pace of a run, but must not change the
    # string.
    own_rate: float = table.get("rate", number(), 0.0)
    world = World(
        name=table.named(settings.name or path.stem, "a world"),
        scene=assigned(
            _scene(table, settings, vocabulary, path, options),
            vocabulary,
            tuple(filter(of_nodes, top.overrides.settings)),
        ),
        vocabulary=vocabulary,
        seed=settings.seed,
        dt=settings.dt if "dt" in table else 1.0 / own_rate if own_rate else settings.dt,
        order=Order(_event_types(table, "order", settings.order, vocabulary)),
        people=_event_types(table, "people", settings.people, vocabulary),
        speaks_for={each.name: each.speaks_for for each in processes if each.speaks_for},
        policy=Policy(settings.policy),
        frames=settings.frames,
        until=_sent(top, "until", settings.until, vocabulary),
        give_up=_sent(top, "give_up", settings.give_up, vocabulary),
        expected=frozenset(process.name for process in processes),
        real_time=settings.real_time,
        placement=_placement(top.table("placement"), vocabulary),
    )
    if not processes:
        raise WorldFileError(f"{path}: no [process.NAME]: no process would run this world")
    return world


def _check_kinds(
    processes: Sequence[Process], vocabulary: Vocabulary, path: Path, spec: str
) -> None:
    """Check that the vocabulary has all agents of the processes, before it reads the string."""
    for process in processes:
        for cls in process.agents:
            if cls.kind.name not in vocabulary.kinds:
                raise WorldFileError(
                    f"{path}: [process.{process.name}]: the vocabulary {spec} has no"
                    f" {cls.kind.name}: add its class, {cls.__name__} of {cls.__module__}, to"
                    " Vocabulary.of(...)"
                )


def _check_speakers(processes: Sequence[Process], vocabulary: Vocabulary, path: Path) -> None:
    """Check that generators represent kinds of the vocabulary, or valid ids."""
    for process in processes:
        for agent in process.speaks_for:
            known = list(vocabulary.kinds)
            if agent.startswith(ID):
                valid = AGENT_ID.fullmatch(agent[1:])
                wrong = "" if valid else f"{agent!r} is not a valid agent id"
            else:
                unknown = f"the vocabulary has no agents {agent}{nearest(agent, known)}"
                wrong = "" if agent in known else f'{unknown} (an id is "#{agent}")'
            if wrong:
                raise WorldFileError(f"{path}: [process.{process.name}]: speaks_for: {wrong}")


def _vocabulary(table: Table, settings: WorldSettings, path: Path) -> Vocabulary:
    specs = settings.vocabulary
    if not specs:
        raise WorldFileError(f'{path}: [world] needs vocabulary = "module:attribute"')
    with table.loading("vocabulary"):
        loaded = [load(spec, path.parent) for spec in specs]
    if len(loaded) == 1 and isinstance(loaded[0], Vocabulary):
        return loaded[0]
    if len(loaded) == 1:
        kind = type(loaded[0]).__name__
        table.wrong("vocabulary", f"must name a Vocabulary; {specs[0]} is of type {kind}")
    try:
        return Vocabulary.of(*loaded)
    except MisuseError as error:
        table.wrong("vocabulary", f"lists no vocabulary: {error}")


def _scene(
    table: Table,
    settings: WorldSettings,
    vocabulary: Vocabulary,
    path: Path,
    options: Mapping[str, Any],
) -> Scene:
    text, maker = settings.string, settings.scene
    if bool(text) == bool(maker):
        raise WorldFileError(f"{path}: [world] needs exactly one of string and scene")
    if text:
        return vocabulary.read(text, f"{path}: world.string")
    if any(sign in maker for sign in "#<(·"):
        table.wrong("scene", 'must name a function, "module:function"; write string = "..."')
    made = called(maker, options, path, table, "scene")
    if isinstance(made, str):
        return vocabulary.read(made, maker)
    if not isinstance(made, Scene):
        kind = type(made).__name__
        raise WorldFileError(f"{path}: {maker} must return a string, not {kind}")
    # No reader has checked the symbols and values of a Scene that code has built.
    return vocabulary.check(made, maker)


def _event_types(
    table: Table, key: str, types: tuple[str, ...], vocabulary: Vocabulary
) -> tuple[str, ...]:
    for name in types:
        if name not in vocabulary.events:
            close = nearest(name, list(vocabulary.events))
            table.wrong(key, f"has the unknown event type {name}{close}")
        if types.count(name) > 1:
            table.wrong(key, f"has {name} twice")
    return types


def _sent(top: Table, key: str, name: str, vocabulary: Vocabulary) -> str:
    """An event type, or "", if agents can send it."""
    if not name:
        return ""
    if name not in vocabulary.events:
        close = nearest(name, list(vocabulary.events))
        top.wrong_setting(WorldSettings, key, f"has the unknown event type {name}{close}")
    if vocabulary.events[name].visual:
        problem = f"must be an event that agents send; {name} is visual"
        top.wrong_setting(WorldSettings, key, problem)
    return name


def _placement(table: Table, vocabulary: Vocabulary) -> PlacementRules:
    """The placement rules of a world file. Raises WorldFileError."""
    limit = table.read(PlacementSettings).agents_per_host
    rules: dict[str, Rule] = {}
    for kind, hosts in table.rest().items():
        if kind not in vocabulary.kinds:
            known = list(vocabulary.kinds)
            listed = f"it has {', '.join(known) or 'none'}"
            hint = nearest(kind, [*known, "agents_per_host"], listed)
            table.wrong(kind, f"is not an agent kind of this world{hint}")
        rules[kind] = _rule(table, kind, hosts)
    return PlacementRules(rules, limit)


def _rule(table: Table, kind: str, hosts: Any) -> Rule:
    if isinstance(hosts, dict):
        inner = table.table(kind)
        rule = Rule(inner.get("only", TEXTS, ()), inner.get("near", TEXT, ""))
        inner.done()
    else:
        names = cast("list[Any]", hosts if isinstance(hosts, list) else [hosts])
        if not all(isinstance(name, str) for name in names):
            table.wrong(kind, 'must be a list of hosts, or { only = ["HOST"], near = "MEMBER" }')
        rule = Rule(tuple(names))
    if rule == Rule():
        table.wrong(kind, 'allows nothing; name hosts, or near = "MEMBER"')
    return rule
