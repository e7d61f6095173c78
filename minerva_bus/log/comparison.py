"""Where two records part: `minerva diff`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby, islice, zip_longest
from typing import Any, Final

import numpy as np

from minerva_bus.frame.inputs import RecordedFrame
from minerva_bus.grammar.batch import AnyEvent, single
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.printer import bits, shape_text, value_text
from minerva_bus.grammar.scene import AgentNode, Scene, Value, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.reader import Record
from minerva_bus.log.showing import without_agents
from minerva_bus.wire.values import plain_event
from minerva_bus.wire.vocabulary import plain_vocabulary
from minerva_bus.wording import counted

MOST: Final = 10
"""Of many differences, and of many events, so many are said one by one."""

FEW: Final = 3
"""Of the events that an agent may have had."""

_LONGEST: Final = 120


@dataclass(frozen=True, slots=True)
class Change:
    """An attribute that differs, with both its values; `attribute` is empty for a whole agent.

    `told` are the events of the frame that the agent may have had.
    """

    agent: str
    attribute: str
    one: str
    other: str
    told: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "agent": self.agent,
            "attribute": self.attribute,
            "a": self.one,
            "b": self.other,
            "events": list(self.told),
        }


@dataclass(frozen=True, slots=True)
class Difference:
    """The first frame in which two records differ, and in what; `frame` is None where in none.

    `before` says what differed before the first frame, `ended` which record goes on where the
    other ends. `one` and `other` are the events of the frame that only one of them has. `sides` are
    what the two are called.
    """

    frame: int | None
    frames: int
    before: tuple[str, ...] = ()
    ended: str = ""
    one: tuple[str, ...] = ()
    other: tuple[str, ...] = ()
    changes: tuple[Change, ...] = ()
    more: int = 0
    sides: tuple[str, str] = ("A", "B")

    @property
    def same(self) -> bool:
        """Whether the two runs are the same, frame by frame."""
        return self.frame is None and not self.ended

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "same": self.same,
            "frame": self.frame,
            "frames": self.frames,
            "before": list(self.before),
            "ended": self.ended,
            "events": {"a": list(self.one), "b": list(self.other)},
            "changes": [change.plain() for change in self.changes],
            "more": self.more,
        }

    def lines(self) -> list[str]:
        """As a person reads it."""
        shown = [f"before the first frame: {one}" for one in self.before]
        if self.frame is None:
            return [*shown, self.ended or f"the same: {counted(self.frames, 'frame')}"]
        shown.append(f"frame {self.frame} is the first that differs")
        for side, events in zip(self.sides, (self.one, self.other), strict=True):
            shown += _listed(f"events of {side} alone", events)
        for agent, changes in groupby(self.changes, lambda change: change.agent):
            shown += _agent_shown(agent, list(changes), *self.sides)
        if self.more:
            shown.append(f"  and {self.more:,} more differences")
        return shown


def _listed(title: str, texts: Sequence[str]) -> list[str]:
    return [f"  {title}:", *(f"    {text}" for text in texts)] if texts else []


def _agent_shown(agent: str, changes: Sequence[Change], a: str, b: str) -> list[str]:
    told = f", told {'; '.join(changes[0].told)}" if changes[0].told else ""
    shown = [f"  {agent}{told}"]
    for change in changes:
        what = f"{change.attribute}: " if change.attribute else ""
        shown.append(f"    {what}{change.one} in {a}, {change.other} in {b}")
    return shown


# --- comparing ---


def compare(a: Record, b: Record) -> Difference:
    """Compare two records frame by frame. Raises RecordError."""
    before = tuple(_before(a, b))
    count = 0
    for one, other in zip_longest(a.frames(), b.frames()):
        if one is None or other is None:
            return Difference(None, count, before, _ended(one, count))
        same = one.number == other.number and one.digest == other.digest
        if not same or not same_events(one.events, other.events):
            return _apart(a, b, one, other, count, before)
        count += 1
    return Difference(None, count, before)


def _before(a: Record, b: Record) -> Iterator[str]:
    one, other = a.description, b.description
    for what in ("name", "seed", "dt", "policy"):
        x, y = getattr(one.world, what), getattr(other.world, what)
        if x != y:
            yield f"{what} {x} in A, {y} in B"
    if plain_vocabulary(one.world.vocabulary) != plain_vocabulary(other.world.vocabulary):
        yield "the vocabularies differ"
    if one.world.order != other.world.order:
        yield "the order relations differ"
    if one.world.scene != other.world.scene:
        yield "the initial strings differ"
    for name in sorted({*one.versions, *other.versions}):
        x, y = one.versions.get(name, "none"), other.versions.get(name, "none")
        if x != y:
            yield f"{name} {x} in A, {y} in B"


def _ended(one: RecordedFrame | None, count: int) -> str:
    ended, longer = ("A", "B") if one is None else ("B", "A")
    return f"the same for {counted(count, 'frame')}, all that {ended} has; {longer} goes on"


def same_events(one: Sequence[AnyEvent], other: Sequence[AnyEvent]) -> bool:
    """Whether two lists are of the same events in the same order, however they are held."""
    if [plain_event(event) for event in one] == [plain_event(event) for event in other]:
        return True
    pairs = zip_longest(single(one), single(other))
    return all(event == counterpart for event, counterpart in pairs)


def _apart(
    a: Record,
    b: Record,
    one: RecordedFrame,
    other: RecordedFrame,
    count: int,
    before: tuple[str, ...],
) -> Difference:
    if one.number != other.number:
        first, missing = min((one.number, "B"), (other.number, "A"))
        return Difference(first, count, (*before, f"frame {first} is missing in {missing}"))
    strings = None
    if one.digest != other.digest:
        strings = a.string(one.number + 1), b.string(one.number + 1)
    vocabulary = a.description.world.vocabulary
    found = apart(vocabulary, one, strings, (one.events, other.events))
    return replace(found, frames=count, before=before)


def apart(
    vocabulary: Vocabulary,
    frame: RecordedFrame,
    strings: tuple[Scene, Scene] | None,
    events: tuple[Sequence[AnyEvent], Sequence[AnyEvent]],
    sides: tuple[str, str] = ("A", "B"),
) -> Difference:
    """In what two runs differ after a frame: in these strings, and in these events of it."""
    changes = list(_changes(*strings, vocabulary, frame.events)) if strings is not None else []
    mine, theirs = list(single(events[0])), list(single(events[1]))
    return Difference(
        frame.number,
        frame.number,
        one=_only(mine, theirs),
        other=_only(theirs, mine),
        changes=tuple(changes[:MOST]),
        more=len(changes[MOST:]),
        sides=sides,
    )


def _only(mine: Sequence[Event], theirs: Sequence[Event]) -> tuple[str, ...]:
    known = set(theirs)
    return tuple(_short(str(one)) for one in islice((e for e in mine if e not in known), MOST))


def _changes(
    one: Scene, other: Scene, vocabulary: Vocabulary, events: Sequence[AnyEvent]
) -> Iterator[Change]:
    mine, theirs = _by_id(one), _by_id(other)
    for name in dict.fromkeys(chain(mine, theirs)):
        x, y = mine.get(name), theirs.get(name)
        if x is None or y is None:
            yield Change(_named(x or y), "", _there(x), _there(y))
        elif x.symbol != y.symbol:
            yield Change(f"#{name}", "", f"is an {x.symbol}", f"is an {y.symbol}")
        elif not same_values(x.values, y.values):
            told = tuple(_told(x, vocabulary, events))
            for attribute, p, q in zip(x.names, x.values, y.values, strict=True):
                if not same_values((p,), (q,)):
                    yield Change(_named(x), *_values(attribute, p, q), told)
    if list(mine) != list(theirs) and mine.keys() == theirs.keys():
        yield Change("the agents", "order", _short(" ".join(mine)), _short(" ".join(theirs)))
    x, y = without_agents(one), without_agents(other)
    if x != y:
        yield Change("what is no agent", "", _short(str(x)), _short(str(y)))


def _by_id(scene: Scene) -> dict[str, AgentNode]:
    return {agent.id: agent for agent in agents(scene)}


def _named(agent: AgentNode | None) -> str:
    return f"{agent.symbol}#{agent.id}" if agent is not None else ""


def _told(agent: AgentNode, vocabulary: Vocabulary, events: Sequence[AnyEvent]) -> Iterator[str]:
    kind = vocabulary.kinds.get(agent.symbol)
    types = kind.subscribes if kind is not None else frozenset[str]()
    mine = (
        event
        for event in single(one for one in events if one.type in types)
        if not event.receivers or agent.id in event.receivers
    )
    for place, event in enumerate(mine):
        if place < FEW:
            yield _short(str(event))
        else:
            yield f"and {1 + sum(1 for _ in mine):,} more"


def _there(agent: AgentNode | None) -> str:
    return "is not there" if agent is None else "is there"


def _values(attribute: str, one: Value, other: Value) -> tuple[str, str, str]:
    """An attribute and its two values; of matrices, the first cell in which they differ."""
    if not isinstance(one, np.ndarray) or not isinstance(other, np.ndarray):
        return attribute, _short(value_text(one)), _short(value_text(other))
    if shape_text(one) != shape_text(other):
        return attribute, f"is {shape_text(one)}", f"is {shape_text(other)}"
    where = np.argwhere(bits(one) != bits(other))
    row, column = where[0].tolist()
    more = f" and {len(where) - 1:,} cells more" if len(where) > 1 else ""
    return f"{attribute}[{row}, {column}]{more}", str(one[row, column]), str(other[row, column])


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
