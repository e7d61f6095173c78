"""The generators of a recorded run, as one generator that says what they have said."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from minerva_bus.errors import MinervaError
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.log.messages import Frame
from minerva_bus.log.reader import Record
from minerva_bus.world.services import Generator, Tick


class Played(Generator):
    """Emits each frame's recorded events but those of some types, and publishes its readings.

    Left out are the events of agents, who run again. Events of one type come in the order in which
    they were recorded: that of their generators' names and of their sequence (4.2.2).
    """

    def __init__(self, record: Record, without: Collection[str]) -> None:
        types = record.description.world.vocabulary.events
        self._types = tuple([name for name in types if name not in without])
        self._path = record.path
        self._frames = record.frames()
        self._readings = _by_frame(record)
        self._ahead = next(self._readings, None)
        self.publishes = topics_in(record)

    def generates(self) -> tuple[str, ...]:
        """All event types but those that are left out."""
        return self._types

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        """The recorded events of a frame. Raises RecordError where it is not in the record."""
        frame = next(self._frames, None)
        if frame is None or frame.number != tick.number:
            raise MinervaError(f"{self._path}: frame {tick.number} is not in it")
        self._publish(tick)
        return self._said(frame)

    def _said(self, frame: Frame) -> Iterator[AnyEvent]:
        for event in frame.events:
            if event.type not in self._types:
                continue
            if not isinstance(event, Events):
                if not event.sender:
                    yield event
            elif event.senders is None:
                yield event
            else:
                yield from (one for one in event if not one.sender)

    def _publish(self, tick: Tick) -> None:
        """What came on topics up to this frame, by topic and by who has published it there."""
        found: list[Readings] = []
        while self._ahead is not None and self._ahead[0] <= tick.number:
            found.append(self._ahead[1])
            self._ahead = next(self._readings, None)
        for told in sorted(found, key=lambda one: (one.topic, one.member)):
            for reading in told.readings:
                tick.publish(told.topic, reading)


def topics_in(record: Record) -> tuple[str, ...]:
    """The sensor topics that are recorded, sorted."""
    found = {told.topic for _, told in record.sensed() if isinstance(told, Readings)}
    return tuple(sorted(found))


def _by_frame(record: Record) -> Iterator[tuple[int, Readings]]:
    """What came on topics, and in which frame, in the order of frames."""
    dt = record.description.world.dt
    found = [
        (round(time / dt), place, told)
        for place, (time, told) in enumerate(record.sensed())
        if isinstance(told, Readings)
    ]
    found.sort(key=lambda one: one[:2])
    return ((frame, told) for frame, _, told in found)
