"""The string of a world in regions, assembled from the reports of all parts."""

from __future__ import annotations

from minerva_bus.frame.inputs import RecordedFrame
from minerva_bus.grammar.scene import Scene
from minerva_bus.regions.merging import merged
from minerva_bus.regions.part import PartReceiver


class WholeString:
    """The string of all parts, as the cursor of a run whose last frame is the present one."""

    end = 0

    def __init__(self, parts: list[PartReceiver]) -> None:
        self.parts = parts
        self.ahead: RecordedFrame | None = None

    def advance(self) -> Scene:
        """The string after the frame that all regions have reported."""
        self.ahead = None
        return merged(part.units for part in self.parts).scene

    def seek(self, number: int) -> Scene:
        """The present string."""
        return merged(part.units for part in self.parts).scene
