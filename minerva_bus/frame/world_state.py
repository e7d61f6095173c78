"""What others read of a running world, which only the frame algorithm changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.in_flight import Phase
from minerva_bus.frame.members import Members
from minerva_bus.frame.messages import ViewShown
from minerva_bus.frame.stimuli import Checkpoint
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene


class WorldProgress(Protocol):
    """What pacing, metrics and displays read: how far a world is, and with whom."""

    @property
    def world(self) -> WorldSpec:
        """The world as declared."""
        ...

    @property
    def members(self) -> Members:
        """Its members."""
        ...

    @property
    def frame(self) -> int:
        """The number of the frame in flight, or of the next one."""
        ...

    @property
    def phase(self) -> Phase:
        """The phase of the world."""
        ...

    @property
    def in_frame(self) -> bool:
        """Whether a frame is in progress."""
        ...

    @property
    def at_rest(self) -> bool:
        """Whether the next frame would change neither the string nor any view."""
        ...


class StateToRecord(Protocol):
    """What a record, a journal or a table keeps between two frames."""

    @property
    def world(self) -> WorldSpec:
        """The world as declared."""
        ...

    @property
    def frame(self) -> int:
        """The number of the next frame."""
        ...

    @property
    def scene(self) -> Scene:
        """The string w."""
        ...

    @property
    def checkpoint(self) -> Checkpoint:
        """State besides the string from which the world can resume."""
        ...

    @property
    def shown(self) -> list[ViewShown]:
        """The latest view of each visual event type, as a keyframe."""
        ...

    @property
    def closing_events(self) -> Sequence[AnyEvent]:
        """What agents and norms sent in the last complete frame: events of the next one."""
        ...
