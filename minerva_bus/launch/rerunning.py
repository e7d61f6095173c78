"""Recomputes a recorded run: `minerva replay FILE --recompute` and `--swap MEMBER=SPEC`.

A frame algorithm is fed with the logged inputs of each frame, except those of members that take
part here; the hosts here compute the evolution. Each frame is compared with the recorded one.
Time is simulated, and everything runs in this process.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from typing import Final

from minerva_bus.errors import MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.event_sources import AGENTS
from minerva_bus.frame.inputs import FrameInputs, RecordedFrame
from minerva_bus.frame.member import Member
from minerva_bus.grammar.events import AnyEvent, Events
from minerva_bus.log.comparison import Difference, apart, same_events
from minerva_bus.log.cursor import Cursor
from minerva_bus.log.errors import RecordError
from minerva_bus.log.reader import Record
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.runner import Notice
from minerva_bus.world.kinds import Kinds
from minerva_bus.world.order import collect

SIDES: Final = ("the record", "this run")
RECORDED: Final = "~record"
"""Source of recorded events if the record does not have the inputs of each member."""

_HOST: Final = "~host"


@dataclass(frozen=True, slots=True)
class Without:
    """The inputs that are not fed: those of `members`, and views that only they request.

    A record without inputs does not name the sender of an event, so `types` are left out.
    """

    members: frozenset[str] = frozenset()
    draws: frozenset[str] = frozenset()
    types: frozenset[str] = frozenset()

    def inputs(self, frame: RecordedFrame) -> FrameInputs:
        """The inputs of the algorithm for a recorded frame."""
        inputs = frame.inputs
        if inputs is None:
            sent = [rest for event in frame.events for rest in self._of_members(event)]
            return FrameInputs(frame.number, (), {}, {RECORDED: sent} if sent else {}, (), (), {})
        return replace(
            inputs,
            due=tuple(name for name in inputs.due if name not in self.draws),
            ticked={k: reply for k, reply in inputs.ticked.items() if k not in self.members},
            taken={k: events for k, events in inputs.taken.items() if k not in self.members},
        )

    def _of_members(self, event: AnyEvent) -> Collection[AnyEvent]:
        """The part of an event, or batch, that no agent sent: agents run again."""
        if event.type in self.types:
            return ()
        if not isinstance(event, Events):
            return () if event.sender else (event,)
        if event.senders is None:
            return (event,)
        return [row for row in event if not row.sender]


class Rerun:
    """A recorded run that is computed again, frame by frame, from its beginning.

    `compare` is a sink of the runner that runs `algorithm`. `difference` describes the first frame
    that differs. Raises RecordError if a frame is missing.
    """

    def __init__(
        self,
        record: Record,
        algorithm: FrameAlgorithm,
        without: Without | None = None,
    ) -> None:
        self.algorithm = algorithm
        self.difference: Difference | None = None
        self._record = record
        self._cursor = Cursor(record, state=True, inputs=True)
        self._without = without or Without()

    def step(self, runner: InProcessRunner) -> bool:
        """Compute one frame; False if the run is over. Raises any exception of user code."""
        algorithm, frame = self.algorithm, self._cursor.ahead
        if runner.ended is not None or frame is None:
            return False
        if frame.number != algorithm.frame:
            raise RecordError(
                f"{self._record.path}: frame {algorithm.frame} is not in the record, so the run"
                " cannot be computed beyond it"
            )
        runner.handle(s.Begin(inputs=self._without.inputs(frame)))
        # All members reply within `handle`, so a frame that is incomplete now stays incomplete.
        if algorithm.frame == frame.number and runner.ended is None:
            awaited = ", ".join(algorithm.waiting_for()) or "agents that no process here runs"
            raise MinervaError(f"it waits for {awaited}")
        return True

    def result(self) -> Difference:
        """The first difference; if there is none, what of the record could not be compared."""
        damage = self._record.damage()
        frames = self.algorithm.frame
        return self.difference or Difference(None, frames, damage=(damage,) if damage else ())

    def compare(self, notice: Notice) -> None:
        """Compare digest, events, and the events that agents sent for the next frame."""
        frame, cursor = self._cursor.ahead, self._cursor
        if frame is None or not isinstance(notice, s.FrameDone):
            return
        # Also after a difference, because `step` takes the inputs of the next frame from the
        # cursor.
        recorded, scene = cursor.advance(), self.algorithm.scene
        if self.difference is not None:
            return
        events = frame.events, notice.events
        if same_events(*events) and cursor.checkpoint is not None:
            sent = cursor.checkpoint.emitted, self.algorithm.checkpoint.emitted
            # In the order of a frame's collection: a difference in the order before it has no
            # effect, and records of earlier versions may have one.
            order = self._record.description.world.order
            first, second = (collect(order, {AGENTS: each}) for each in sent)
            events = first, second
        # Events that agents emit reach the string in the next frame only; comparing them finds the
        # cause a frame earlier.
        same = scene.digest == frame.digest
        if not same or not same_events(*events):
            strings = None if same else (recorded, scene)
            vocabulary = self._record.description.world.vocabulary
            self.difference = apart(vocabulary, frame, strings, events, SIDES)


def recompute(record: Record, kinds: Kinds, progress: Callable[[int], None]) -> Difference:
    """Run λ again on the recorded inputs, up to the first frame that differs.

    `progress` receives the number of frames done. Raises RecordError, and ActivityError if user
    code fails.
    """
    world = record.description.world
    world = replace(world, frames=record.last()[0], expected=frozenset((_HOST,)))
    algorithm = FrameAlgorithm(world)
    rerun = Rerun(record, algorithm)
    host = Member(_HOST, None, kinds.values())
    runner = InProcessRunner(algorithm, [host], rerun.compare, deliver=_deliver_without_views)
    runner.start()
    while rerun.difference is None and rerun.step(runner):
        progress(algorithm.frame)
    return rerun.result()


def _deliver_without_views(
    member: Member, message: m.ToMember | m.Readings
) -> Iterable[m.FromMember | m.Readings]:
    """Let a host evolve its agents without views, because there is no device."""
    if isinstance(message, m.EvolveRequest):
        message = replace(message, visual=())
    return member.receive(message)
