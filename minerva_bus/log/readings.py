"""Recorded readings as a generator, for members of a recomputed run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.log.reader import Record
from minerva_bus.world.services import Generator, Tick


class RecordedReadings(Generator):
    """Publishes the recorded readings of each frame, by topic and member; makes no events."""

    def __init__(self, record: Record) -> None:
        self._readings = _by_frame(record)
        self._ahead = next(self._readings, None)
        sensed = (message for _, message in record.sensed())
        self.publishes = tuple(sorted({m.topic for m in sensed if isinstance(m, Readings)}))

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        """Publish the readings up to this frame."""
        due: list[Readings] = []
        while self._ahead is not None and self._ahead[0] <= tick.number:
            due.append(self._ahead[1])
            self._ahead = next(self._readings, None)
        # By topic and publisher, the order in which members process
        # readings (PROTOCOL.md, section 11).
        for message in sorted(due, key=lambda message: (message.topic, message.member)):
            for reading in message.readings:
                tick.publish(message.topic, reading)
        return ()


def _by_frame(record: Record) -> Iterator[tuple[int, Readings]]:
    """Recorded readings with their frames, in the order of frames."""
    dt = record.description.world.dt
    sensed = [
        (round(time / dt), place, message)
        for place, (time, message) in enumerate(record.sensed())
        if isinstance(message, Readings)
    ]
    sensed.sort(key=lambda item: item[:2])
    return ((frame, message) for frame, _, message in sensed)
