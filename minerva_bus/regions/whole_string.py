"""The string of a world in regions, assembled from the reports of all parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from minerva_bus.frame.inputs import RecordedFrame
from minerva_bus.grammar.scene import Scene
from minerva_bus.regions.dividing import NOTHING
from minerva_bus.regions.merging import Merger
from minerva_bus.regions.part import PartCodec, PartReceiver, PartSender
from minerva_bus.regions.progress import NO_PROGRESS


class WholeString:
    """The string of all parts, as the cursor of a run whose last frame is the present one."""

    end = 0

    def __init__(self, parts: Iterable[PartReceiver]) -> None:
        self.parts = [*parts]
        self._merger = Merger()
        self.ahead: RecordedFrame | None = None

    def advance(self) -> Scene:
        """The string after the frame that all regions have reported."""
        self.ahead = None
        return self._merger.merge(part.units for part in self.parts).scene

    def seek(self, number: int) -> Scene:
        """The present string."""
        return self._merger.merge(part.units for part in self.parts).scene

    def saved(self, frame: int, names: Sequence[str], codec: PartCodec) -> dict[str, bytes]:
        """The parts by region, as reports of regions that had nothing before."""
        messages = [
            PartSender().message(
                frame,
                part.units,
                part.unjudged,
                NO_PROGRESS,
                part.targets,
                b"",
                part.norms,
                for_all=part.for_all,
            )
            for part in self.parts
        ]
        return dict(zip(names, map(codec.encode, messages), strict=True))


def saved_parts(
    saved: Mapping[str, Any], names: Sequence[str], codec: PartCodec
) -> list[PartReceiver]:
    """The parts that `WholeString.saved` has returned. Raises ProtocolError."""
    receivers = [PartReceiver(NOTHING) for _ in names]
    for name, receiver in zip(names, receivers, strict=True):
        receiver.apply(codec.saved(saved[name]))
    return receivers
