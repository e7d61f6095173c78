"""A run that is played again: its frames come from a film, and only its views are made anew.

λ does not run: the strings are the film's. θ does, in here, so that devices may join that were not
there when it happened. Members other than devices may join, but nobody asks them for anything.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.core import Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.hosting import Host
from minerva_bus.frame.membership import Member
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns, packed
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene
from minerva_bus.world.evolution import Policy
from minerva_bus.world.kinds import Kinds
from minerva_bus.world.moment import Frame
from minerva_bus.world.order import collect

OVER = "the record is over"
_HERE = "~replay"


@dataclass(frozen=True, slots=True)
class Shot:
    """A frame of a film: its number, its events in order, and the string after it."""

    number: int
    events: tuple[AnyEvent, ...]
    after: Scene


class Film(Protocol):
    """What was recorded of a run; it stands before one of its frames, or behind the last."""

    end: int
    """The number after that of the last frame."""

    @property
    def ahead(self) -> Shot | None:
        """The frame that it stands before; None at its end."""
        ...

    def advance(self) -> None:
        """Go on to the next frame."""

    def wind(self, frame: int) -> Scene:
        """Stand before a frame; the string with which it begins. Raises MinervaError."""
        ...


class ReplayAlgorithm(FrameAlgorithm):
    """Plays a film; `world` is as it stands before the first frame that is played.

    At the end of the film the world ends, or, where it shall `stay`, rests for as long as somebody
    is there, who may wind it back.
    """

    def __init__(self, world: World, film: Film, kinds: Kinds, *, stay: bool = False) -> None:
        super().__init__(world)
        self.film = film
        self._stay = stay
        self._host = Host(_HERE, kinds)
        self._slots = _Slots(self.composition, world.scene)
        self._do[s.Seek] = self._on_seek

    # --- a frame ---

    def _on_begin(self, told: s.Begin) -> None:
        """Play a frame; the first time, where nobody is waited for, get ready to."""
        if self.phase is Phase.WAITING:
            self._ready_if_all_here()
            return
        shot = self.film.ahead
        if self.phase is not Phase.READY or shot is None:
            return
        self._glances = told.due
        for member in self.roster.attending.joining:
            if member.hello is not None:
                self._admit(member, member.hello)
        self.frame = shot.number
        self._begin_frame_state()
        self._sort_events(shot.events)
        self._visual = self._to_show(closing=False)
        self.phase = Phase.EVOLVE
        self._dispatch()

    def _to_show(self, *, closing: bool) -> tuple[AnyEvent, ...]:
        """The visual events of the film, and those that devices here want."""
        types, shot = self.world.vocabulary.events, self.film.ahead
        filmed = [one for one in shot.events if types[one.type].visual] if shot is not None else []
        sources = {"~film": filmed, "~device": self._visual_events(self._due_views(closing))}
        return collect(self.world.order, sources)

    def _dispatch(self) -> None:
        """Step 6, in here: nobody else is asked."""
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
        self._views = {one: dict(parts) for one, parts in reply.views.items()}
        self._view_patches = {one: dict(some) for one, some in reply.view_patches.items()}

    def _commit(self) -> None:
        shot = self.film.ahead
        assert shot is not None
        self._show()
        self._changed = self._slots.become(shot.after)
        self._out.append(s.FrameDone(self.frame, self._record(self.frame), self._events))
        self.film.advance()
        self.frame += 1
        self._end_or_go_on()

    def _end_or_go_on(self) -> None:
        if self.film.ahead is not None:
            self.phase = Phase.READY
            self._out.append(s.Ready(self.frame))
        elif self._stay and self.roster.here():
            self.phase = Phase.READY
            self._say("replay", f"{OVER}; minerva seek FRAME goes back")
        else:
            self._close(OVER)

    # --- at any time ---

    def _on_seek(self, told: s.Seek) -> None:
        """Go elsewhere in the film, and show at once what is there."""
        if self.phase is not Phase.READY:
            return
        self._slots.become(self.film.wind(told.frame))
        self.frame = told.frame
        self._look()
        self._end_or_go_on()

    def _look(self) -> None:
        """Show the string as it stands, to whoever is there."""
        self._begin_frame_state()
        self._visual = self._to_show(closing=True)
        self._make_views()
        self._show()

    def _admit(self, member: Member, hello: m.Hello) -> None:
        super()._admit(member, hello)
        if self.phase is Phase.READY and not self._showings.keys() >= set(hello.draws):
            self._look()

    def _go_on_without(self, member: Member) -> None:
        super()._go_on_without(member)
        rests = self.phase is Phase.READY and self.film.ahead is None
        if rests and not self.roster.here():
            self._close(OVER)

    def _on_emitted(self, told: m.Emitted) -> None:
        """What has happened takes no more events."""

    def _on_order(self, order: s.Order) -> None:
        """What has happened takes no more events."""


class _Slots:
    """Which fragment each piece of a film's strings is, so that a frame costs what it changes."""

    def __init__(self, composition: Composition, scene: Scene) -> None:
        self._composition = composition
        self._note(scene)

    def become(self, scene: Scene) -> dict[str, Scene]:
        """Let the composition hold another string; what became of its fragments."""
        before = dict(self._composition.fragments)
        changed = self._changed(scene.pieces)
        if changed is None:
            self._composition.become(scene)
            after = self._composition.fragments
            changed = dict.fromkeys(before.keys() - after.keys(), EMPTY)
            changed |= {n: Scene((one,)) for n, one in after.items() if before.get(n) is not one}
            self._note(scene)
        else:
            self._composition.replace(changed)
        self._pieces = scene.pieces
        return changed

    def _note(self, scene: Scene) -> None:
        self._pieces = scene.pieces
        names = {id(part): name for name, part in self._composition.parts.items()}
        self._names: list[str] = []
        if all(one is two for one, two in zip(packed(scene).pieces, scene.pieces, strict=False)):
            self._names = [_name(piece, names) for piece in scene.pieces]

    def _changed(self, pieces: Iterable[Piece]) -> dict[str, Scene] | None:
        """The fragments that are other pieces now; None where more than fragments has changed."""
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
    """The name of the fragment that a piece is; empty where it is none."""
    if isinstance(piece, Columns):
        return names.get(id(piece), "") if piece.ids is not None else ""
    return piece.id if isinstance(piece, AgentNode) else ""
