"""What every part of the frame algorithm stands on: its state, its voice, and its end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.composition import Composition, Layout
from minerva_bus.frame.description import World
from minerva_bus.frame.distribution import Distribution
from minerva_bus.frame.enforcement import Enforcement
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.members import Members
from minerva_bus.frame.plainly import plainly
from minerva_bus.frame.showing import Showing
from minerva_bus.frame.speaking import Speaking
from minerva_bus.frame.trial import Trial
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.patch import Delta
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.world.evolution import Policy
from minerva_bus.world.norms import SOURCE


class Phase(Enum):
    """Where in a frame the world is, in words that a waiting person understands."""

    WAITING = "gathering members"
    READY = "between frames"
    TICK = "events"
    EVOLVE = "evolution"
    CLOSING = "last view"
    STOPPING = "reports"
    ENDED = "over"


SINGLE_EVENTS: Final = 2_000
"""Events, not in columns, of one free-running generator that a frame takes; others wait."""


class Core:
    """State of a world between and within frames."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.phase = Phase.WAITING
        past = world.past
        self.frame: int = past.frame
        self.members = Members(world.expected)
        literal = world.policy is Policy.LITERAL
        self.composition = Composition(world.scene, columns=not literal)
        self._distribution = Distribution(
            world.vocabulary, self.composition, world.placement.agents_per_host
        )
        self._homeless: int = 0
        self._offered: set[frozenset[str]] = set()
        self._unoffered: set[frozenset[str]] = set()
        self._rearrange = True
        self._showings = {
            one: Showing(one, past.frame, last.frame, last.scene, halted=last.halted)
            for one, last in world.shown.items()
        }
        self._saved: dict[str, Mapping[str, Any]] = dict(past.saved)
        self._sources: dict[str, tuple[str, ...]] = {}
        self._inbox: dict[str, list[AnyEvent]] = {
            source: list(events) for source, events in past.inbox.items()
        }
        self._sanctions: list[AnyEvent] = self._inbox.pop(SOURCE, [])
        self._enforcement = Enforcement(
            world.norms, self.composition, world.vocabulary, past.saved.get(SOURCE, {})
        )
        self._speaking = Speaking(world.speaks_for, self.composition)
        self._held: dict[str, int] = {}
        self._emitted: list[AnyEvent] = list(past.emitted)
        self._asked_ahead: dict[str, int] = {}
        self._early: dict[str, m.TickReply] = {}
        self._reached = past.reached
        self._reaching = past.reaching
        self._glances: tuple[str, ...] = ()
        self._departed: dict[str, bool] = {}
        self._figures: dict[str, m.Figures] = {}
        self._reason = ""
        self.failed = False
        self.strangers: int = 0
        self.most_taken: int = SINGLE_EVENTS
        self._stirred = past.frame
        """The frame that begins with what was changed last."""
        self._begin_frame_state()
        self._out: list[s.Instruction] = []

    def _begin_frame_state(self) -> None:
        self._pending: set[str] = set()
        self._ticked: dict[str, m.TickReply] = {}
        self._taken: Mapping[str, Sequence[AnyEvent]] = {}
        self._people: tuple[str, ...] = ()
        self._trial: Trial | None = None
        self._fewer: Iterator[tuple[AnyEvent, ...]] = iter(())
        self._asked_by: tuple[tuple[AnyEvent, ...], tuple[AnyEvent, ...]] | None = None
        self._answers: list[int] = []
        self._left_out: set[str] = set()
        self._halted: tuple[str, ...] = ()
        self._handed_over: tuple[AnyEvent, ...] = ()
        self._permitted: tuple[AnyEvent, ...] = ()
        self._due: tuple[str, ...] = ()
        self._logged: FrameInputs | None = None
        self._layout: Layout = ()
        self._replies: list[m.EvolveReply] = []
        self._parts: dict[tuple[str, int], tuple[str, ...]] = {}
        self._part = 0
        self._stranded: set[str] = set()
        self._events: tuple[AnyEvent, ...] = ()
        self._evolving: tuple[AnyEvent, ...] = ()
        self._visual: tuple[AnyEvent, ...] = ()
        self._changed: dict[str, Scene] = {}
        self._changed_by: dict[str, str] = {}
        self._born: dict[str, str] = {}
        self._sent: dict[str, tuple[AnyEvent, ...]] = {}
        self._views: dict[str, dict[str, Scene]] = {}
        self._view_patches: dict[str, dict[str, Delta]] = {}

    @property
    def checkpoint(self) -> Checkpoint:
        """What it needs beside its string to go on from here; to be asked for between frames."""
        return Checkpoint(
            self.frame,
            dict(self._saved),
            tuple(self._emitted),
            self._waiting(),
            self._reached,
            self._reaching,
        )

    @property
    def shown(self) -> list[m.ViewShown]:
        """What was shown last, whole, of each visual event type."""
        return [showing.key() for _, showing in sorted(self._showings.items())]

    def show_again(self, view: m.ViewShown) -> None:
        """Go on from a whole view that was shown last."""
        skeleton = view.skeleton if view.skeleton is not None else EMPTY
        self._showings[view.event_type] = Showing(
            view.event_type, view.sequence, view.frame, skeleton, dict(view.parts), view.halted
        )

    def _waiting(self) -> dict[str, tuple[AnyEvent, ...]]:
        """What waits for the next frame, by source."""
        waiting = {source: tuple(events) for source, events in self._inbox.items()}
        return {**waiting, SOURCE: tuple(self._sanctions)} if self._sanctions else waiting

    def _send(self, to: str, message: m.ToMember) -> None:
        plain = self.members.declines_columns(to)
        self._out.append(s.Send(to, plainly(message) if plain else message))

    def _say(self, member: str, text: str, details: str = "") -> None:
        self._out.append(s.Notify(member, text, details))

    # --- the end ---

    def _fail(self, reason: str) -> None:
        self.failed = True
        self._end(reason)

    def _end(self, reason: str) -> None:
        self._reason = reason
        self._stop()

    def _stop(self) -> None:
        self.phase = Phase.STOPPING
        self._parts, self._stranded = {}, set()
        self._pending = {member.name for member in self.members.active()}
        self._out.append(s.Stopping(self._reason))
        self._send(s.EVERYONE, m.Stop(self._reason))
        if not self._pending:
            self._over()

    def _count_report(self, member: str, figures: m.Figures) -> None:
        if self.phase is not Phase.STOPPING or member not in self._pending:
            return
        self._pending.discard(member)
        self._figures[member] = figures
        if not self._pending:
            self._over()

    def _miss_reports(self) -> None:
        """Count out those who went without a report: a departure may overtake last words."""
        for name, missed in sorted(self._departed.items()):
            self._departed[name] = True
            if missed:
                self._count_report(name, {})

    def _over(self) -> None:
        self.phase = Phase.ENDED
        if self._enforcement.broken:
            counts = sorted(self._enforcement.broken.items())
            self._figures[SOURCE] = {f"norm_{name}": count for name, count in counts}
        self._out.append(s.Ended(self._reason, _summed(self._figures)))


def _summed(figures: dict[str, m.Figures]) -> m.Figures:
    """All members' figures in one; numbers of one name are added."""
    total: dict[str, bool | int | float | str] = {}
    for _, mine in sorted(figures.items()):
        for name, value in mine.items():
            old = total.get(name)
            both = isinstance(old, int | float) and isinstance(value, int | float)
            total[name] = old + value if both and old is not None else value  # pyright: ignore
    return total
