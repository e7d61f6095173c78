"""The first difference between two runs, and their strings and events there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain, groupby, islice, zip_longest
from typing import Any, Final

import numpy as np

from minerva_analysis.places import without_agents
from minerva_bus.frame.stimuli import RecordedFrame
from minerva_bus.grammar.columns import bits
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.grammar.scene import AgentNode, Scene, Value, agents
from minerva_bus.grammar.text_and_digest import same_values, shape_text, value_text
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.record import Record
from minerva_bus.wire.strings_codec import plain_event_list
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_bus.wording import counted, short

MOST: Final = 10
"""Maximum number of differences, and of events, that are listed."""

_LONGEST: Final = 120

FEW: Final = 3
"""Maximum number of listed events that an agent may have received."""


@dataclass(frozen=True, slots=True)
class AttributeDifference:
    """An attribute that differs, with its values in A and B; empty for a whole agent.

    `events`: events of the frame that the agent may have received.
    """

    agent: str
    attribute: str
    a: str
    b: str
    events: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self) | {"events": list(self.events)}


@dataclass(frozen=True, slots=True)
class Difference:
    """The first frame in which two records differ; `frame` is None if no frame differs.

    `before`: differences before the first frame. `ended`: the record that continues after the
    end of the other. `only_a`, `only_b`: events of the frame that only one record has. `sides`:
    names of the two records. `damage`: what of them could not be compared.
    """

    frame: int | None
    frames: int
    before: tuple[str, ...] = ()
    ended: str = ""
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()
    changes: tuple[AttributeDifference, ...] = ()
    more: int = 0
    sides: tuple[str, str] = ("A", "B")
    damage: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether there are frames, all could be compared, and all are the same."""
        return self.frame is None and not self.ended and not self.damage and self.frames > 0

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return {
            "same": self.same,
            "frame": self.frame,
            "frames": self.frames,
            "before": list(self.before),
            "ended": self.ended,
            "events": {"a": list(self.only_a), "b": list(self.only_b)},
            "changes": [change.plain() for change in self.changes],
            "more": self.more,
            "damage": list(self.damage),
        }

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = [f"before the first frame: {text}" for text in self.before]
        if self.frame is None:
            return [*shown, self._ending()]
        shown.append(f"frame {self.frame} is the first that differs")
        for side, events in zip(self.sides, (self.only_a, self.only_b), strict=True):
            shown += _listed(f"events of {side} alone", events)
        for agent, changes in groupby(self.changes, lambda change: change.agent):
            shown += _agent_shown(agent, list(changes), *self.sides)
        if self.more:
            shown.append(f"  and {self.more:,} more differences")
        return shown

    def _ending(self) -> str:
        """The result if no frame differs."""
        if not self.frames:
            return self.ended or "nothing was compared: there is no frame"
        if self.damage:
            return f"the same for {counted(self.frames, 'frame')}, as far as the records are intact"
        return self.ended or f"the same: {counted(self.frames, 'frame')}"


def _listed(title: str, texts: Sequence[str]) -> list[str]:
    return [f"  {title}:", *(f"    {text}" for text in texts)] if texts else []


def _agent_shown(agent: str, changes: Sequence[AttributeDifference], a: str, b: str) -> list[str]:
    events = f", received {'; '.join(changes[0].events)}" if changes[0].events else ""
    shown = [f"  {agent}{events}"]
    for change in changes:
        what = f"{change.attribute}: " if change.attribute else ""
        shown.append(f"    {what}{change.a} in {a}, {change.b} in {b}")
    return shown


def same_events(a: Sequence[AnyEvent], b: Sequence[AnyEvent]) -> bool:
    """Whether two lists have the same events in the same order, single or in columns."""
    # Plain lists are compared fast, but equal events may be in columns in only one of the records.
    if plain_event_list(a) == plain_event_list(b):
        return True
    pairs = zip_longest(single(a), single(b))
    return all(event == counterpart for event, counterpart in pairs)


def apart(
    vocabulary: Vocabulary,
    frame: RecordedFrame,
    strings: tuple[Scene, Scene] | None,
    events: tuple[Sequence[AnyEvent], Sequence[AnyEvent]],
    sides: tuple[str, str] = ("A", "B"),
) -> Difference:
    """The difference of two runs in a frame: its events, and the strings after it."""
    changes = list(_changes(*strings, vocabulary, frame.events)) if strings is not None else []
    a, b = list(single(events[0])), list(single(events[1]))
    return Difference(
        frame.number,
        frame.number,
        only_a=_only(a, b),
        only_b=_only(b, a),
        changes=tuple(changes[:MOST]),
        more=len(changes[MOST:]),
        sides=sides,
    )


def _only(events: Sequence[Event], others: Sequence[Event]) -> tuple[str, ...]:
    known = set(others)
    return tuple(
        short(str(e), _LONGEST) for e in islice((e for e in events if e not in known), MOST)
    )


def _changes(
    a: Scene, b: Scene, vocabulary: Vocabulary, events: Sequence[AnyEvent]
) -> Iterator[AttributeDifference]:
    in_a, in_b = _by_id(a), _by_id(b)
    for name in dict.fromkeys(chain(in_a, in_b)):
        x, y = in_a.get(name), in_b.get(name)
        if x is None or y is None:
            yield AttributeDifference(_named(x or y), "", _there(x), _there(y))
        elif x.symbol != y.symbol:
            yield AttributeDifference(f"#{name}", "", f"is an {x.symbol}", f"is an {y.symbol}")
        # Not by ==, for which 0.0 equals -0.0 although their digests differ.
        elif not same_values(x.values, y.values):
            received = tuple(_received(x, vocabulary, events))
            for attribute, p, q in zip(x.names, x.values, y.values, strict=True):
                if not same_values((p,), (q,)):
                    yield AttributeDifference(_named(x), *_values(attribute, p, q), received)
    # The order of agents is part of the string; with missing agents it differs anyway.
    if list(in_a) != list(in_b) and in_a.keys() == in_b.keys():
        yield AttributeDifference(
            "the agents", "order", short(" ".join(in_a), _LONGEST), short(" ".join(in_b), _LONGEST)
        )
    x, y = without_agents(a), without_agents(b)
    if x != y:
        yield AttributeDifference(
            "outside of agents", "", short(str(x), _LONGEST), short(str(y), _LONGEST)
        )


def _by_id(scene: Scene) -> dict[str, AgentNode]:
    return {agent.id: agent for agent in agents(scene)}


def _named(agent: AgentNode | None) -> str:
    return f"{agent.symbol}#{agent.id}" if agent is not None else ""


def _received(
    agent: AgentNode, vocabulary: Vocabulary, events: Sequence[AnyEvent]
) -> Iterator[str]:
    kind = vocabulary.kinds.get(agent.symbol)
    types = kind.subscribes if kind is not None else frozenset[str]()
    received = (
        event
        for event in single(batch for batch in events if batch.type in types)
        if not event.receivers or agent.id in event.receivers
    )
    for place, event in enumerate(received):
        if place < FEW:
            yield short(str(event), _LONGEST)
        else:
            yield f"and {1 + sum(1 for _ in received):,} more"


def _there(agent: AgentNode | None) -> str:
    return "is not there" if agent is None else "is there"


def _values(attribute: str, a: Value, b: Value) -> tuple[str, str, str]:
    """An attribute and its two values; for matrices, the first cell that differs."""
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray):
        return attribute, short(value_text(a), _LONGEST), short(value_text(b), _LONGEST)
    if shape_text(a) != shape_text(b):
        return attribute, f"is {shape_text(a)}", f"is {shape_text(b)}"
    where = np.argwhere(bits(a) != bits(b))
    row, column = where[0].tolist()
    more = f" and {len(where) - 1:,} cells more" if len(where) > 1 else ""
    return f"{attribute}[{row}, {column}]{more}", str(a[row, column]), str(b[row, column])


def compare(a: Record, b: Record) -> Difference:
    """Compare two records frame by frame. Raises RecordError."""
    before = tuple(_before(a, b))
    count = 0
    for in_a, in_b in zip_longest(_frames(a), _frames(b)):
        if in_a is None or in_b is None:
            ended = _ended(in_a, count)
            return Difference(None, count, before, ended, damage=_damage(a, b))
        same = in_a.number == in_b.number and in_a.digest == in_b.digest
        # Digests are first, because they are compared without decoding strings. Events are
        # compared as well: different events may lead to the same string.
        if not same or not same_events(in_a.events, in_b.events):
            return _apart(a, b, in_a, in_b, count, before)
        count += 1
    return Difference(None, count, before, damage=_damage(a, b))


def _frames(record: Record) -> Iterator[RecordedFrame]:
    vocabulary = record.description.world.vocabulary
    return (without_views(frame, vocabulary) for frame in record.frames())


def without_views(frame: RecordedFrame, vocabulary: Vocabulary) -> RecordedFrame:
    """A frame without visual events, which change no string.

    Observers cause them, many by the clock, so that no two runs with a page have the same ones.
    """
    types = vocabulary.events
    return replace(frame, events=tuple(e for e in frame.events if not types[e.type].visual))


def _damage(*records: Record) -> tuple[str, ...]:
    return tuple([message for record in records if (message := record.damage())])


def starts_apart(a: Record, b: Record) -> Iterator[str]:
    """In what two runs differ before their first frame, apart from code and versions."""
    da, db = a.description, b.description
    for what in ("name", "seed", "dt", "policy"):
        x, y = getattr(da.world, what), getattr(db.world, what)
        if x != y:
            yield f"{what} {x} in A, {y} in B"
    yield from _unequal("option ", da.options, db.options)
    if da.world.order != db.world.order:
        yield "the order relations differ"
    if da.world.scene != db.world.scene:
        yield "the initial strings differ"


def _before(a: Record, b: Record) -> Iterator[str]:
    yield from starts_apart(a, b)
    da, db = a.description, b.description
    if plain_vocabulary(da.world.vocabulary) != plain_vocabulary(db.world.vocabulary):
        yield "the vocabularies differ"
    yield from _unequal("", da.versions, db.versions)


def _unequal(what: str, a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    for name in sorted({*a, *b}):
        x, y = a.get(name, "none"), b.get(name, "none")
        if x != y:
            yield f"{what}{name} {short(str(x))} in A, {short(str(y))} in B"


def _ended(in_a: RecordedFrame | None, count: int) -> str:
    ended, longer = ("A", "B") if in_a is None else ("B", "A")
    return f"the same for {counted(count, 'frame')}, all frames of {ended}; {longer} continues"


def _apart(
    a: Record,
    b: Record,
    in_a: RecordedFrame,
    in_b: RecordedFrame,
    count: int,
    before: tuple[str, ...],
) -> Difference:
    if in_a.number != in_b.number:
        first, missing = min((in_a.number, "B"), (in_b.number, "A"))
        return Difference(first, count, (*before, f"frame {first} is missing in {missing}"))
    strings = None
    if in_a.digest != in_b.digest:
        # Strings are decoded only here, for the one frame that differs.
        strings = a.string(in_a.number + 1), b.string(in_a.number + 1)
    vocabulary = a.description.world.vocabulary
    difference = apart(vocabulary, in_a, strings, (in_a.events, in_b.events))
    return replace(difference, frames=count, before=before)
