"""`recorded`: the events of a record as a generator, so that an episode drives a world."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.frame.stimuli import RecordedFrame
from minerva_bus.grammar.events import AnyEvent, first_of
from minerva_bus.log.record import Record
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.options import names_in


class RecordedEvents(Generator):
    """Emits the events of a record again, in the same frames, for the same agents.

    Only events of generators, policies and people are played, not those that agents sent. The
    world may differ from the recorded one: in its code, its string, its seed or its other members.
    After the last frame of the record it emits nothing.

    Args:
        file: the record, .mcap.
        events: the event types to emit, comma-separated.
        begin: the frame of the record that is played in frame 0.

    """

    def __init__(self, file: str, events: str, begin: int = 0) -> None:
        if begin < 0:
            raise MisuseError(f"recorded: begin is {begin}; expected a frame from 0")
        self._path, self._begin = Path(file), begin
        self._types = names_in(events)
        if not self._types:
            raise MisuseError("recorded: events is empty; name event types, separated by commas")
        self._record: Record | None = None

    def generates(self) -> tuple[str, ...]:
        return self._types

    def check(self, world: WorldInfo) -> None:
        """Raises RecordError, and MisuseError if the world or the record lacks an event type."""
        known = world.vocabulary.events
        for name in self._types:
            if name not in known:
                near = nearest(name, [*known])
                raise MisuseError(f"recorded: the world has no event type {name}{near}")
        self.close()
        self._record = Record(self._path)
        if message := self._record.losses().message(self._path):
            sys.stderr.write(f"recorded: {message}\n")
        _check(self._record, self._types)
        self._frames: Iterator[RecordedFrame] = self._record.frames()
        self._ahead = next(self._frames, None)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        number = tick.number + self._begin
        # A world that is resumed begins later.
        while self._ahead is not None and self._ahead.number < number:
            self._ahead = next(self._frames, None)
        if self._ahead is None or self._ahead.number > number:
            return ()
        return [event for event in self._ahead.events if _is_played(event, self._types)]

    def save(self) -> None:
        """Nothing: the frame of the world says where it continues."""

    def close(self) -> None:
        if self._record is not None:
            self._record.close()
            self._record = None


def _is_played(event: AnyEvent, types: Iterable[str]) -> bool:
    return event.type in types and not first_of(event).sender


def _check(record: Record, types: Iterable[str]) -> None:
    """Raise MisuseError if the record has no event of a type to play."""
    counts = Counter[str]()
    for frame in record.frames():
        counts.update(event.type for event in frame.events if not first_of(event).sender)
        if all(counts[name] for name in types):
            return
    there = ", ".join(sorted(counts)) or "none"
    missing = ", ".join(name for name in types if not counts[name])
    raise MisuseError(f"recorded: {record.path} has no {missing} to play; it has {there}")
