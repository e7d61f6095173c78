"""Frame algorithm for replaying a recorded run: strings are read, views are computed.

λ does not run, because the log has the string of each frame. θ runs in the coordinator, so devices
can join that did not take part in the original run. Other members can join, but receive no
requests.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import is_
from typing import Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.core import Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.hosting import Host
from minerva_bus.frame.inputs import RecordedFrame
from minerva_bus.frame.members import MemberEntry
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns, packed
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Policy
from minerva_bus.world.kinds import Kinds
from minerva_bus.world.order import collect

OVER = "the record is over"
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


class ReplayAlgorithm(FrameAlgorithm):
    """Replays a recorded run; `world` is the state before the first frame to play.

    The world ends with the recorded run. With `stay` it remains open at the end while a member is
    present, because that member may seek backwards.
    """

    def __init__(
        self, world: World, cursor: FrameCursor, kinds: Kinds, *, stay: bool = False
    ) -> None:
        super().__init__(world)
        self.cursor = cursor
        self._stay = stay
        self._host = Host(_HERE, kinds)
        self._slots = _Slots(self.composition, world.scene)
        self._do[s.Seek] = self._on_seek

    # --- a frame ---

    def _on_begin(self, told: s.Begin) -> None:
        """Play one frame. The first call only becomes ready if no member is expected."""
        if self.phase is Phase.WAITING:
            self._ready_if_all_here()
            return
        recorded = self.cursor.ahead
        if self.phase is not Phase.READY or recorded is None:
            return
        self._glances = told.due
        for member in self.members.index.joining:
            if member.hello is not None:
                self._admit(member, member.hello)
        self.frame = recorded.number
        self._begin_frame_state()
        self._sort_events(recorded.events)
        self._visual = self._to_show(closing=False)
        self.phase = Phase.EVOLVE
        self._dispatch()

    def _to_show(self, *, closing: bool) -> tuple[AnyEvent, ...]:
        """Recorded visual events, and those requested by the devices of this replay."""
        types, recorded = self.world.vocabulary.events, self.cursor.ahead
        events = recorded.events if recorded is not None else ()
        visual = [event for event in events if types[event.type].visual]
        sources = {"~record": visual, "~device": self._visual_events(self._due_views(closing))}
        return collect(self.world.order, sources)

    def _dispatch(self) -> None:
        """Run step 6 in this process, without hosts."""
        self._make_views()
        self._finish_if_done()

    def _make_views(self) -> None:
        if not self._visual:
            return
        host, fragments = self._host, self.composition.fragments
        host.take(m.Fragments({}, tuple(host.fragments.keys() - fragments.keys())))
        host.fragments = dict(fragments)
        world = self.world
        request = m.EvolveRequest(self.frame, (_HERE,), visual=self._visual)
        moment = Frame(self.frame, world.dt, world.seed)
        reply = host.answer(request, moment, Policy.SEQUENTIAL, world.vocabulary)  # π alone
        self._views = {name: dict(parts) for name, parts in reply.views.items()}
        self._view_patches = {name: dict(new) for name, new in reply.view_patches.items()}

    def _commit(self) -> None:
        self._show()
        self._changed = self._slots.become(self.cursor.advance())
        self._out.append(s.FrameDone(self.frame, self._record(self.frame), self._events))
        self.frame += 1
        self._end_or_go_on()

    def _end_or_go_on(self) -> None:
        if self.cursor.ahead is not None:
            self.phase = Phase.READY
            self._out.append(s.Ready(self.frame))
        elif self._stay and self.members.active():
            self.phase = Phase.READY
            self._say("replay", f"{OVER}; minerva seek FRAME goes back")
        else:
            self._close(OVER)

    # --- at any time ---

    def _on_seek(self, told: s.Seek) -> None:
        """Move to another frame and show its string immediately."""
        if self.phase is not Phase.READY:
            return
        self._slots.become(self.cursor.seek(told.frame))
        self.frame = told.frame
        self._look()
        self._end_or_go_on()

    def _look(self) -> None:
        """Show the current string to all devices."""
        self._begin_frame_state()
        self._visual = self._to_show(closing=True)
        self._make_views()
        self._show()

    def _admit(self, member: MemberEntry, hello: m.Hello) -> None:
        super()._admit(member, hello)
        if self.phase is Phase.READY and not self._showings.keys() >= set(hello.draws):
            self._look()

    def _go_on_without(self, member: MemberEntry) -> None:
        super()._go_on_without(member)
        rests = self.phase is Phase.READY and self.cursor.ahead is None
        if rests and not self.members.active():
            self._close(OVER)

    def _on_emitted(self, told: m.Emitted) -> None:
        """Ignore events: recorded frames cannot change."""

    def _on_order(self, order: s.Order) -> None:
        """Ignore events: recorded frames cannot change."""


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
        if all(map(is_, packed(scene).pieces, scene.pieces)):
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
    if isinstance(piece, Columns):
        return names.get(id(piece), "") if piece.ids is not None else ""
    return piece.id if isinstance(piece, AgentNode) else ""
