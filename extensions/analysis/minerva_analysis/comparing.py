"""Compares two records frame by frame: `minerva diff`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import zip_longest

from minerva_bus.frame.stimuli import RecordedFrame
from minerva_bus.log.comparison import Difference, apart, same_events
from minerva_bus.log.record import Record
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_bus.wording import counted


def compare(a: Record, b: Record) -> Difference:
    """Compare two records frame by frame. Raises RecordError."""
    before = tuple(_before(a, b))
    count = 0
    for in_a, in_b in zip_longest(a.frames(), b.frames()):
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


def _damage(*records: Record) -> tuple[str, ...]:
    return tuple([message for record in records if (message := record.damage())])


def _before(a: Record, b: Record) -> Iterator[str]:
    da, db = a.description, b.description
    for what in ("name", "seed", "dt", "policy"):
        x, y = getattr(da.world, what), getattr(db.world, what)
        if x != y:
            yield f"{what} {x} in A, {y} in B"
    if plain_vocabulary(da.world.vocabulary) != plain_vocabulary(db.world.vocabulary):
        yield "the vocabularies differ"
    if da.world.order != db.world.order:
        yield "the order relations differ"
    if da.world.scene != db.world.scene:
        yield "the initial strings differ"
    for name in sorted({*da.versions, *db.versions}):
        x, y = da.versions.get(name, "none"), db.versions.get(name, "none")
        if x != y:
            yield f"{name} {x} in A, {y} in B"


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
