"""Frames of a recorded run: strings are read, views are computed.

λ does not run, because the log has the string of each frame. θ runs in the coordinator, so devices
can join that did not take part in the original run. A frame waits for coupled devices. Other
members can join, but receive no requests.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from operator import is_
from typing import Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.collection_step import FrameInbox, visual_events
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.evolution_step import frame_record
from minerva_bus.frame.member_side import Host
from minerva_bus.frame.member_table import MemberEntry, Members
from minerva_bus.frame.stimuli import DEVICES, Instructions, RecordedFrame
from minerva_bus.frame.world_state import (
    FrameInFlight,
    InputSteps,
    OutcomeSteps,
    Phase,
    Progress,
    WorldSpec,
)
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene
from minerva_bus.world.agent import Kinds
from minerva_bus.world.context import Frame
from minerva_bus.world.event_collection import collect
from minerva_bus.world.evolution import Policy

OVER = "the record is over"
RECORD = "~record"
"""Source of the events of a record."""
_HERE = "~replay"


class FrameCursor(Protocol):
    """A position in a recorded run: before one of its frames, or after the last one."""

    @property
    def end(self) -> int:
        """Number of the last frame plus one."""
        ...

    @property
    def ahead(self) -> RecordedFrame | None:
        """The next frame, or None at the end."""
        ...

    def advance(self) -> Scene:
        """Move past the next frame and return the string after it."""
        ...

    def seek(self, number: int) -> Scene:
        """Move before a frame and return its initial string. Raises MinervaError."""
        ...

    def closing_events(self) -> tuple[AnyEvent, ...]:
        """What agents and norms sent in the last frame of the run."""
        ...


class RecordedSource:
    """Recorded frames: strings are read, and views are computed in this process."""

    def __init__(
        self,
        cursor: FrameCursor,
        kinds: Kinds,
        world: WorldSpec,
        now: Progress,
        members: Members,
        composition: Composition,
        inbox: FrameInbox,
        out: Instructions,
    ) -> None:
        self._cursor = cursor
        self._world = world
        self._now = now
        self._members = members
        self._composition = composition
        self._inbox = inbox
        self._out = out
        self._host = Host(_HERE, kinds)
        self._slots = _Slots(composition, world.scene)

    def has_next(self) -> bool:
        """Whether a frame follows."""
        return self._cursor.ahead is not None

    def begin(self) -> None:
        """Continue with the frame after the cursor's position, once its views are shown."""
        # Frames may be missing in the record, so the number is read and not counted.
        if self._cursor.ahead is not None:
            self._now.frame = self._cursor.ahead.number
        # A coupled device, such as a film, receives every view, and answers when it has shown the
        # last one. Without this, the views of a fast replay would wait in its process.
        self._now.in_flight.pending = {
            member.name
            for member in self._members
            if member.hello is not None
            and member.hello.coupled
            and not member.hello.generates
            and (member.active or member.awaited)
        }
        for name in sorted(self._now.in_flight.pending):
            self.ask(self._members.get(name))

    def collect(self) -> None:
        """Steps 2 to 4: the recorded events, and the visual events of the devices here."""
        recorded = self._cursor.ahead.events if self._cursor.ahead is not None else ()
        self._now.in_flight.events.split(recorded, self._world.vocabulary.events)
        self._now.in_flight.events.visual = self.visual(closing=False)

    def visual(self, *, closing: bool) -> tuple[AnyEvent, ...]:
        """Recorded visual events, and those requested by the devices of this replay."""
        types = self._world.vocabulary.events
        events = self._cursor.ahead.events if self._cursor.ahead is not None else ()
        recorded = [event for event in events if types[event.type].visual]
        clock = self._now.in_flight.clock_views
        due = self._members.index.due_views(self._now.frame, clock, closing=closing)
        sources = {RECORD: recorded, DEVICES: visual_events(types, due)}
        return collect(self._world.order, sources)

    def evolve(self) -> None:
        """Step 6 in this process, without hosts; the next string is recorded."""
        in_flight = self._now.in_flight
        if not in_flight.events.visual:
            return
        host, fragments = self._host, self._composition.fragments
        # `take` drops vanished fragments with their views. The others are assigned directly, so
        # that views of unchanged fragments are not computed again.
        host.take(m.Fragments({}, tuple(host.fragments.keys() - fragments.keys())))
        host.fragments = dict(fragments)
        world = self._world
        request = m.EvolveRequest(self._now.frame, (_HERE,), visual=in_flight.events.visual)
        context = Frame(self._now.frame, world.dt, world.seed)
        reply = host.answer(request, context, Policy.SEQUENTIAL, world.vocabulary)  # π alone
        in_flight.result.merge(reply, {})

    def tick_reply(self, reply: m.TickReply) -> str:
        """Accept that a device has shown its view; the record has the events."""
        in_flight = self._now.in_flight
        if reply.frame != self._now.frame or reply.member not in in_flight.pending:
            return self._ignored(reply)
        self._members.answered(self._members.get(reply.member), reply.frame)
        in_flight.pending.discard(reply.member)
        return ""

    def emitted(self, emitted: m.Emitted) -> str:
        """Ignore the events of a generator."""
        return ""

    def order(self, order: s.Publish) -> None:
        """Ignore an event of a person."""

    def ask(self, member: MemberEntry) -> None:
        """Ask a device whether it has shown its last view."""
        if member.active:
            self._out.send(member.name, m.TickRequest(self._now.frame))

    def reply(self, reply: m.EvolveReply) -> str:
        """Ignore a reply of a host."""
        return self._ignored(reply)

    def _ignored(self, reply: m.TickReply | m.EvolveReply) -> str:
        self._members.get(reply.member).late += 1
        return ""

    def ask_again(self, fragments: list[str]) -> None:
        """No host is asked."""

    def lighten(self, host: str) -> bool:
        """No frame is repeated."""
        return False

    def settle(self) -> bool:
        """The recorded results are final."""
        return True

    def commit(self) -> None:
        """Step 8: continue with the recorded string."""
        self._now.in_flight.result.changed = self._slots.become(self._cursor.advance())
        frame, in_flight = self._now.frame, self._now.in_flight
        record = partial(frame_record, frame, in_flight, self._composition)
        self._out.pending.append(s.FrameDone(frame, record, in_flight.events.ordered))
        self._now.frame += 1
        if not self.has_next():
            self._inbox.sent = {RECORD: self._cursor.closing_events()}

    def seek(self, frame: int) -> None:
        """Continue with the string of another frame."""
        self._slots.become(self._cursor.seek(frame))


class ReplayAlgorithm(FrameAlgorithm):
    """Runs the frames of a record.

    The world ends with the recorded run. With `stay` it remains open at the end while a member is
    present, because that member may seek backwards.
    """

    def __init__(
        self, world: WorldSpec, cursor: FrameCursor, kinds: Kinds, *, stay: bool = False
    ) -> None:
        self._cursor = cursor
        self._kinds = kinds
        self._stay = stay
        super().__init__(world)

    def make_steps(self) -> tuple[InputSteps, OutcomeSteps]:
        """The steps that take the events and the strings of the record."""
        self._source = source = RecordedSource(
            self._cursor, self._kinds, self.world, self.now, self.members, self.composition,
            self.inbox, self.out,
        )  # fmt: skip
        return source, source

    def has_next(self) -> bool:
        """Whether a frame follows in the record."""
        return self._source.has_next()

    def why_over(self) -> str:
        """Step 9: reason for the end if the recorded run is over and no member is present."""
        stays = self._stay and self.members.index.active
        return "" if self.has_next() or stays else OVER

    def announce(self) -> None:
        """Step 10: announce the next frame, or log that the record is over."""
        if self.has_next():
            super().announce()
        else:
            self.out.log("replay", f"{OVER}; minerva seek FRAME goes back")

    def on_seek(self, seek: s.Seek) -> None:
        """Move to another frame and show its string immediately."""
        if self.phase is not Phase.READY:
            return
        self._source.seek(seek.frame)
        self.now.frame = seek.frame
        self._look()
        # A seek to the end may close the replay; one away from it begins frames again.
        self.continue_or_close()

    def _look(self) -> None:
        """Show the current string to all devices."""
        self.now.in_flight = FrameInFlight()
        # As at the end of a world, all devices get a view, regardless of their rate.
        self.now.in_flight.events.visual = self._source.visual(closing=True)
        self._source.evolve()
        self.show()

    def members_changed(self, hello: m.Hello | None) -> None:
        """Show a newcomer the current string; end the replay when the last viewer leaves."""
        if self.phase is not Phase.READY:
            return
        if hello is not None:
            if not set(self.views.event_types) >= set(hello.draws):
                self._look()
        elif not self.has_next() and not self.members.index.active:
            self.close(OVER)


class _Slots:
    """Maps pieces of recorded strings to fragments, so that a frame costs only its changes."""

    def __init__(self, composition: Composition, scene: Scene) -> None:
        self._composition = composition
        self._note(scene)

    def become(self, scene: Scene) -> dict[str, Scene]:
        """Replace the string of the composition; returns the changed fragments."""
        before = dict(self._composition.fragments)
        changed = self._changed(scene.pieces)
        if changed is None:
            self._composition.become(scene)
            after = self._composition.fragments
            changed = dict.fromkeys(before.keys() - after.keys(), EMPTY)
            changed |= {n: Scene((new,)) for n, new in after.items() if before.get(n) is not new}
            self._note(scene)
        else:
            self._composition.replace(changed)
        self._pieces = scene.pieces
        return changed

    def _note(self, scene: Scene) -> None:
        self._pieces = scene.pieces
        names = {id(part): name for name, part in self._composition.parts.items()}
        self._names: list[str] = []
        # The composition holds the packed string. If packing makes other pieces, they do not
        # correspond to fragments one to one, and each frame replaces the whole string.
        if all(map(is_, self._composition.scene.pieces, scene.pieces)):
            self._names = [_name(piece, names) for piece in scene.pieces]

    def _changed(self, pieces: Iterable[Piece]) -> dict[str, Scene] | None:
        """Fragments whose piece changed, or None if the string changed in other places too."""
        after = tuple(pieces)
        if len(after) != len(self._names):
            return None
        changed: dict[str, Scene] = {}
        for name, old, new in zip(self._names, self._pieces, after, strict=True):
            if old is new:
                continue
            if not name or type(old) is not type(new) or _name(new, {id(new): name}) != name:
                return None
            changed[name] = Scene((new,))
        return changed


def _name(piece: Piece, names: dict[int, str]) -> str:
    """Name of the fragment that a piece is, or an empty string."""
    if piece.ids is not None:
        return names.get(id(piece), "")
    return piece.id if isinstance(piece, AgentNode) else ""
