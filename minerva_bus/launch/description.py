"""The table [world] of a world file: what the world is, whoever runs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.frame.description import World
from minerva_bus.frame.speaking import ID
from minerva_bus.grammar.scene import AGENT_ID, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.overrides import Overrides
from minerva_bus.launch.specs import called, load
from minerva_bus.launch.table import Table
from minerva_bus.launch.watching import read_placement
from minerva_bus.launch.worldfile import Process
from minerva_bus.world.evolution import Policy
from minerva_bus.world.order import Order


def read_description(
    table: Table,
    placement: Table,
    path: Path,
    given: Overrides,
    options: Mapping[str, Any],
    processes: Sequence[Process],
) -> tuple[World, float]:
    """The world, without its norms, and its rate: frames a second, 0: as fast as it goes.

    The `processes` are waited for; `options` are what a scene is made with. Raises WorldFileError
    and SceneError.
    """
    table.text("defaults")
    table.text("notes")
    own_name, own_rate = table.text("name", path.stem), table.number("rate", 0.0)
    own_seed, own_frames = table.whole("seed", 0, -(1 << 63)), table.whole("frames", 0)
    vocabulary = _vocabulary(table, path)
    _check_kinds(processes, vocabulary, path, table.text("vocabulary"))
    _check_speakers(processes, vocabulary, path)
    world = World(
        name=table.named(given.name or own_name, "a world"),
        scene=_scene(table, vocabulary, path, options),
        vocabulary=vocabulary,
        seed=_seed(own_seed if given.seed is None else given.seed, path),
        dt=table.number("dt", 1.0 / own_rate if own_rate else 0.1, 1e-9),
        order=Order(_event_types(table, "order", vocabulary)),
        people=_event_types(table, "people", vocabulary),
        speaks_for={one.name: one.speaks_for for one in processes if one.speaks_for},
        policy=Policy(table.choice("policy", ("sequential", "literal"))),
        frames=own_frames if given.frames is None else given.frames,
        until=_until(table, vocabulary, given.until),
        give_up=_one_sent(table, "give_up", vocabulary, _event_types(table, "give_up", vocabulary)),
        expected=frozenset(process.name for process in processes),
        real_time=table.truth("real_time", False),
        placement=read_placement(placement, vocabulary),
    )
    table.done()
    if not processes:
        raise WorldFileError(f"{path}: no [process.NAME]: nobody would run this world")
    return world, own_rate if given.rate is None else given.rate


def _check_kinds(
    processes: Sequence[Process], vocabulary: Vocabulary, path: Path, spec: str
) -> None:
    """Whether the vocabulary has all agents of the processes, before it reads a string of them."""
    for process in processes:
        for cls in process.agents:
            if cls.kind.name not in vocabulary.kinds:
                raise WorldFileError(
                    f"{path}: [process.{process.name}]: the vocabulary {spec} has no"
                    f" {cls.kind.name}: add its class, {cls.__name__} of {cls.__module__}, to"
                    " Vocabulary.of(...)"
                )


def _check_speakers(processes: Sequence[Process], vocabulary: Vocabulary, path: Path) -> None:
    """Whether those for whom generators speak are kinds of the vocabulary, or can be ids."""
    for process in processes:
        for one in process.speaks_for:
            known = list(vocabulary.kinds)
            if one.startswith(ID):
                wrong = "" if AGENT_ID.fullmatch(one[1:]) else f"{one!r} is no id of an agent"
            else:
                unknown = f"the vocabulary has no agents {one}{nearest(one, known)}"
                wrong = "" if one in known else f'{unknown} (an id is "#{one}")'
            if wrong:
                raise WorldFileError(f"{path}: [process.{process.name}]: speaks_for: {wrong}")


def _seed(seed: int, path: Path) -> int:
    if not -(1 << 63) <= seed < 1 << 63:
        raise WorldFileError(f"{path}: the seed must be a whole number of 64 bits")
    return seed


def _vocabulary(table: Table, path: Path) -> Vocabulary:
    spec = table.text("vocabulary")
    if not spec:
        raise WorldFileError(f'{path}: [world] needs vocabulary = "module:attribute"')
    with table.loading("vocabulary"):
        found = load(spec, path.parent)
    if not isinstance(found, Vocabulary):
        kind = type(found).__name__
        table.wrong("vocabulary", f"must name a Vocabulary; {spec} is of type {kind}")
    return found


def _scene(table: Table, vocabulary: Vocabulary, path: Path, options: Mapping[str, Any]) -> Scene:
    text, maker = table.text("string"), table.text("scene")
    if bool(text) == bool(maker):
        raise WorldFileError(f"{path}: [world] needs exactly one of string and scene")
    if text:
        return vocabulary.read(text, f"{path}: world.string")
    made = called(maker, options, path)
    if isinstance(made, str):
        return vocabulary.read(made, maker)
    if not isinstance(made, Scene):
        kind = type(made).__name__
        raise WorldFileError(f"{path}: {maker} must return a string, not {kind}")
    return vocabulary.check(made, maker)


def _event_types(table: Table, key: str, vocabulary: Vocabulary) -> tuple[str, ...]:
    types = table.texts(key)
    for one in types:
        if one not in vocabulary.events:
            known = list(vocabulary.events)
            table.wrong(key, f"has the unknown event type {one}{nearest(one, known)}")
    return types


def _until(table: Table, vocabulary: Vocabulary, given: str | None) -> str:
    types = _event_types(table, "until", vocabulary)
    if given is not None:
        if given and given not in vocabulary.events:
            known = nearest(given, list(vocabulary.events))
            raise WorldFileError(f"--until: there is no event type {given}{known}")
        types = (given,) if given else ()
    return _one_sent(table, "until", vocabulary, types)


def _one_sent(table: Table, key: str, vocabulary: Vocabulary, types: tuple[str, ...]) -> str:
    """The one event type of some, if agents can send it; or none."""
    if len(types) > 1:
        table.wrong(key, "must be one event type")
    for one in types:
        if vocabulary.events[one].visual:
            table.wrong(key, f"must be an event that agents send; {one} is visual")
    return "".join(types)
