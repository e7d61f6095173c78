"""Sources of frames: they provide the events and results of a frame, from members or a record."""

from __future__ import annotations

from collections.abc import Iterable
from operator import is_
from typing import TYPE_CHECKING, Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import CollectionStep, visual_events
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.evolution import EvolutionStep, frame_record
from minerva_bus.frame.host_side import Host
from minerva_bus.frame.in_flight import FrameInFlight, Phase
from minerva_bus.frame.inputs import DEVICES, RecordedFrame
from minerva_bus.frame.members import MemberEntry
from minerva_bus.frame.views import due_views
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene
from minerva_bus.world.agent import Kinds
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Policy
from minerva_bus.world.priority import collect

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class FrameSource:
    """The steps of Table 2 whose inputs are from members or from a record.

    This base class is a source without members: it ignores their messages.
    """

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm

    # --- a frame ---

    def has_next(self) -> bool:
        """Whether a frame can begin."""
        return True

    def begin(self) -> None:
        """Request the events of the frame that begins."""

    def collect(self) -> None:
        """Steps 2 to 4: the events of the frame."""

    def evolve(self) -> None:
        """Steps 5 and 6: request the next string and the views."""

    def settle(self) -> bool:
        """Whether the results are final, with norms applied; otherwise more are requested."""
        return True

    def commit(self) -> None:
        """Step 8: w = w_next and t = t + 1."""

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        return ""

    def announce(self) -> None:
        """Step 10: announce that the next frame may begin."""
        self._algorithm.out.add(s.Ready(self._algorithm.frame))

    # --- stimuli ---

    def tick_reply(self, reply: m.TickReply) -> None:
        """Accept the events of a member in step."""
        self._algorithm.members.get(reply.member).late += 1

    def evolve_reply(self, reply: m.EvolveReply) -> None:
        """Accept a host's results for its fragments."""
        self._algorithm.members.get(reply.member).late += 1

    def emitted(self, emitted: m.Emitted) -> None:
        """Accept events of a free-running generator."""

    def order(self, order: s.Publish) -> None:
        """Accept an event from a person."""

    def seek(self, frame: int) -> None:
        """Continue with another frame, if the source can."""

    def ask(self, member: MemberEntry) -> None:
        """Repeat the request to a member that has returned while the frame waits for it."""

    def ask_again(self, fragments: list[str]) -> None:
        """Request fragments once more: their host is gone, or one has returned."""

    def lighten(self, host: str) -> bool:
        """Repeat a frame that has ended a host twice by fewer events, if the source can."""
        return False

    def members_changed(self, hello: m.Hello | None) -> None:
        """Process a change: a member has joined with this hello, or, for None, has left."""


class LiveSource(FrameSource):
    """Frames with events from generators and results from hosts."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        super().__init__(algorithm)
        self.collection = collection = CollectionStep(algorithm)
        self.evolution = evolution = EvolutionStep(algorithm)
        # Bound methods save a call per step and message in each frame.
        self.begin, self.collect = collection.begin, collection.collect
        self.tick_reply, self.emitted = collection.tick_reply, collection.emitted
        self.order, self.ask = collection.order, collection.ask
        self.settle, self.commit = evolution.settle, evolution.commit
        self.evolve_reply, self.ask_again = evolution.reply, evolution.ask_again
        self.evolve, self.lighten = evolution.request, evolution.lighten

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        algorithm = self._algorithm
        if algorithm.composition.empty:
            return "the string is empty"
        if finished := algorithm.goal.finished:
            return finished
        # Last, because an empty string or a reached goal is the more specific reason.
        if algorithm.world.frames and algorithm.frame >= algorithm.world.frames:
            return "the frames are over"
        return ""


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


class RecordedSource(FrameSource):
    """Frames of a recorded run: strings are read, and views are computed in this process.

    The world ends with the recorded run. With `stay` it remains open at the end while a member is
    present, because that member may seek backwards.
    """

    def __init__(
        self, algorithm: FrameAlgorithm, *, cursor: FrameCursor, kinds: Kinds, stay: bool = False
    ) -> None:
        super().__init__(algorithm)
        self._cursor = cursor
        self._stay = stay
        self._host = Host(_HERE, kinds)
        self._slots = _Slots(algorithm.composition, algorithm.world.scene)

    # --- a frame ---

    def has_next(self) -> bool:
        """Whether a frame follows."""
        return self._cursor.ahead is not None

    def begin(self) -> None:
        """Continue with the frame after the cursor's position."""
        # Frames may be missing in the record, so the number is read and not counted.
        if self._cursor.ahead is not None:
            self._algorithm.frame = self._cursor.ahead.number

    def collect(self) -> None:
        """Steps 2 to 4: the recorded events, and the visual events of the devices here."""
        algorithm = self._algorithm
        recorded = self._cursor.ahead.events if self._cursor.ahead is not None else ()
        algorithm.in_flight.events.split(recorded, algorithm.world.vocabulary.events)
        algorithm.in_flight.events.visual = self._visual(closing=False)

    def _visual(self, *, closing: bool) -> tuple[AnyEvent, ...]:
        """Recorded visual events, and those requested by the devices of this replay."""
        algorithm, types = self._algorithm, self._algorithm.world.vocabulary.events
        events = self._cursor.ahead.events if self._cursor.ahead is not None else ()
        recorded = [event for event in events if types[event.type].visual]
        clock = algorithm.in_flight.clock_views
        due = due_views(algorithm.members.index, algorithm.frame, clock, closing=closing)
        sources = {RECORD: recorded, DEVICES: visual_events(algorithm, due)}
        return collect(algorithm.world.order, sources)

    def evolve(self) -> None:
        """Step 6 in this process, without hosts; the next string is recorded."""
        algorithm, in_flight = self._algorithm, self._algorithm.in_flight
        if not in_flight.events.visual:
            return
        host, fragments = self._host, algorithm.composition.fragments
        # `take` drops vanished fragments with their views. The others are assigned directly, so
        # that views of unchanged fragments are not computed again.
        host.take(m.Fragments({}, tuple(host.fragments.keys() - fragments.keys())))
        host.fragments = dict(fragments)
        world = algorithm.world
        request = m.EvolveRequest(algorithm.frame, (_HERE,), visual=in_flight.events.visual)
        context = Frame(algorithm.frame, world.dt, world.seed)
        reply = host.answer(request, context, Policy.SEQUENTIAL, world.vocabulary)  # π alone
        in_flight.result.merge(reply, {})

    def commit(self) -> None:
        """Step 8: continue with the recorded string."""
        algorithm = self._algorithm
        algorithm.in_flight.result.changed = self._slots.become(self._cursor.advance())
        events = algorithm.in_flight.events.ordered
        algorithm.out.add(s.FrameDone(algorithm.frame, frame_record(algorithm), events))
        algorithm.frame += 1
        if not self.has_next():
            algorithm.inbox.sent = {RECORD: self._cursor.closing_events()}

    def why_over(self) -> str:
        """Step 9: reason for the end if the recorded run is over and no member is present."""
        stays = self._stay and self._algorithm.members.active()
        return "" if self.has_next() or stays else OVER

    def announce(self) -> None:
        """Step 10: announce the next frame, or log that the record is over."""
        if self.has_next():
            super().announce()
        else:
            self._algorithm.out.log("replay", f"{OVER}; minerva seek FRAME goes back")

    # --- at any time ---

    def seek(self, frame: int) -> None:
        """Move to another frame and show its string immediately."""
        algorithm = self._algorithm
        if algorithm.phase is not Phase.READY:
            return
        self._slots.become(self._cursor.seek(frame))
        algorithm.frame = frame
        self._look()
        # A seek to the end may close the replay; one away from it begins frames again.
        algorithm.continue_or_close()

    def _look(self) -> None:
        """Show the current string to all devices."""
        algorithm = self._algorithm
        algorithm.in_flight = FrameInFlight()
        # As at the end of a world, all devices get a view, regardless of their rate.
        algorithm.in_flight.events.visual = self._visual(closing=True)
        self.evolve()
        algorithm.show()

    def members_changed(self, hello: m.Hello | None) -> None:
        """Show a newcomer the current string; end the replay when the last viewer leaves."""
        algorithm = self._algorithm
        if algorithm.phase is not Phase.READY:
            return
        if hello is not None:
            if not set(algorithm.views.event_types) >= set(hello.draws):
                self._look()
        elif not self.has_next() and not algorithm.members.active():
            algorithm.close(OVER)


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
