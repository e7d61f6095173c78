"""Views on their way to devices: a stream of deltas per visual event type, and keyframes."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Final

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.composition import Composition, applied, check_deltas
from minerva_bus.frame.member_table import Members
from minerva_bus.frame.messages import Changes, ViewShown
from minerva_bus.frame.stimuli import Instructions, plain_form
from minerva_bus.frame.world_state import FrameInFlight, WorldSpec
from minerva_bus.grammar.scene import EMPTY, Scene

_TYPE: Final = attrgetter("type")


@dataclass(slots=True)
class ViewStream:
    """The views of one visual event type, in sequence."""

    event_type: str
    sequence: int = 0
    frame: int = -1
    skeleton: Scene = EMPTY
    parts: dict[str, Scene] = field(default_factory=dict[str, Scene])
    halted: tuple[str, ...] = ()

    def next(
        self,
        frame: int,
        skeleton: Scene,
        changed: Changes,
        alive: Container[str],
        halted: tuple[str, ...] = (),
    ) -> ViewShown:
        """The view of a frame: a keyframe if the skeleton has changed, otherwise a delta.

        Devices must not execute actions of the agents `halted`.
        """
        self.halted = halted
        self.parts.update(applied(self.parts, changed))
        self.sequence += 1
        self.frame = frame
        # The composition makes a new skeleton whenever fragments change: identity is sufficient.
        if skeleton is not self.skeleton:
            self.skeleton = skeleton
            # Views of fragments that are gone must not appear in the keyframe.
            self.parts = {name: view for name, view in self.parts.items() if name in alive}
            return self.keyframe()
        return ViewShown(self.event_type, frame, self.sequence, dict(changed), None, halted)

    def whole(self, view: ViewShown) -> ViewShown:
        """The latest view with whole parts instead of deltas."""
        return replace(view, parts={name: self.parts[name] for name in view.parts})

    def keyframe(self) -> ViewShown:
        """The latest view as a whole."""
        return ViewShown(
            self.event_type, self.frame, self.sequence, dict(self.parts), self.skeleton,
            halted=self.halted,
        )  # fmt: skip


class Views:
    """The view streams of a world; the frame `last_change` began with the latest change."""

    def __init__(self, world: WorldSpec) -> None:
        self._streams = {
            view.event_type: ViewStream(
                # A resumed world continues the sequence, because its
                # devices may still hold these views.
                view.event_type, view.sequence, view.frame, view.skeleton or EMPTY,
                applied({}, view.parts), view.halted,
            )
            for view in world.shown
        }  # fmt: skip
        self.last_change = world.past.frame

    @property
    def event_types(self) -> Iterable[str]:
        """The visual event types that have had a view."""
        return self._streams.keys()

    def keyframes(self) -> list[ViewShown]:
        """The latest view of each visual event type, as a whole."""
        return [stream.keyframe() for _, stream in sorted(self._streams.items())]

    def keyframe(self, event_type: str) -> ViewShown | None:
        """The latest view of a visual event type, or None if there is none."""
        stream = self._streams.get(event_type)
        return None if stream is None else stream.keyframe()

    def check(self, event_type: str, changes: Changes) -> None:
        """Raise Unfit if deltas do not fit the latest view of an event type."""
        stream = self._streams.get(event_type)
        check_deltas({} if stream is None else stream.parts, changes)

    def show(
        self,
        frame: int,
        in_flight: FrameInFlight,
        composition: Composition,
        members: Members,
        out: Instructions,
        *,
        last: bool = False,
    ) -> None:
        """Step 7 of Table 2: send v = π(w, e^v) to the devices, which interpret it."""
        result = in_flight.result
        for event_type in sorted(set(map(_TYPE, in_flight.events.visual))):
            stream = self._streams.setdefault(event_type, ViewStream(event_type))
            view = stream.next(
                frame,
                composition.skeleton,
                result.views.get(event_type, {}),
                composition.fragments,
                result.halted,
            )
            _send(view, stream, members, out, last=last)


def _send(
    view: ViewShown, stream: ViewStream, members: Members, out: Instructions, *, last: bool
) -> None:
    devices = members.devices(view.event_type)
    for member, hello in devices:
        # A member that declines columns cannot apply deltas to them.
        shown = stream.whole(view) if hello.plain else view
        if hello.coupled:
            out.send(member.name, shown)
        elif last:  # No later view would let an observer notice that it missed this one.
            out.send(member.name, stream.keyframe())
        elif hello.plain:
            out.pending.append(s.Show(view.event_type, plain_form(shown), member.name))
    # One publication for any number of observers.
    if not last and any(not (hello.coupled or hello.plain) for _, hello in devices):
        out.pending.append(s.Show(view.event_type, view))
