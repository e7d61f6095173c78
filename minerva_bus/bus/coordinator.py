"""The coordinator's process on the bus: the frame algorithm's ears, mouth and clock."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import zenoh
from zenoh.handlers import Callback as Direct

from minerva_bus.bus.control import answer
from minerva_bus.bus.inbox import KNOCK, HubInbox
from minerva_bus.bus.session import LOOPBACK, open_hub
from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm, Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.pacing import Pace
from minerva_bus.protocol.codec import Decoder, encode
from minerva_bus.protocol.keys import COORDINATOR, Keys, last_part

STATUS_EVERY = 0.1
NAP = 0.01
FEW = 3
REPORTS_WITHIN = 3.0
HURRIED_REPORTS_WITHIN = 0.5


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a frame waits for a member: seconds until it is said, and until it is given up."""

    soft: float = 1.0
    hard: float = 30.0


@dataclass(frozen=True, slots=True)
class Status:
    """How a running world is doing."""

    frame: int
    rate: float
    members: int
    phase: str
    waiting: tuple[str, ...] = ()
    waited: float = 0.0


@dataclass(slots=True)
class Watchers:
    """Whom the coordinator tells what happens; each is called in its main thread."""

    said: Callable[[str, str], None]
    status: Callable[[Status], None]
    listening: Callable[[str], None]
    stalled: Callable[[str, float], None]
    frame_done: Callable[[s.FrameDone], None] = field(default=lambda _: None)
    stopping: Callable[[], None] = field(default=lambda: None)


class BusCoordinator:
    """Runs a world's frame algorithm over Zenoh."""

    def __init__(
        self,
        world: World,
        watchers: Watchers,
        *,
        rate: float = 0.0,
        listen: str = LOOPBACK,
        patience: Patience = Patience(),
    ) -> None:
        self.algorithm = FrameAlgorithm(world)
        self.keys = Keys(world.name)
        self.inbox = HubInbox(STATUS_EVERY)
        self._watch = watchers
        self._pace = Pace(rate)
        self._listen = listen
        self._patience = patience
        self._decoder = Decoder(world.vocabulary)
        self._groups = {
            s.EVERYONE: self.keys.all,
            s.TICKED: self.keys.tick,
            s.HOSTS: self.keys.evolve,
        }
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._begin_at: float | None = None
        self._alarm = 0.0
        self._waiting_since: float | None = None
        self._told_at = 0.0
        self._given_up: set[str] = set()
        self._status_at = 0.0
        self._status_frame: int = 0
        self._recorded = False
        self._reports_within = REPORTS_WITHIN
        self.last_frame_at = 0.0
        self.most_members = 0
        self.ended: s.Ended | None = None

    def run(self) -> s.Ended:
        """Run the world to its end. Raises BusError where the bus cannot be set up."""
        session, endpoint = open_hub(COORDINATOR, self._listen)
        with session:
            self._session = session
            declared = self._declare(session)
            self._watch.listening(endpoint)
            self._status_at = self._alarm = time.monotonic()
            while self.ended is None:
                self._step()
            self.inbox.close()
            for one in declared:
                one.undeclare()
        return self.ended

    def _declare(self, session: zenoh.Session) -> list[Any]:
        handler, keys = self.inbox.handler, self.keys
        liveliness = session.liveliness()
        record = session.declare_publisher(
            keys.record, congestion_control=zenoh.CongestionControl.DROP
        )
        self._publishers[keys.record] = record
        return [
            record.declare_matching_listener(Direct(self._on_watchers, indirect=False)),
            *self.inbox.open(session, keys.sent_by("*"), keys.sent_by(COORDINATOR)),
            session.declare_queryable(keys.control, handler()),
            liveliness.declare_token(keys.alive(COORDINATOR)),
            liveliness.declare_subscriber(keys.alive("*"), handler(), history=True),
        ]

    def _on_watchers(self, status: zenoh.MatchingStatus) -> None:
        self._recorded = status.matching

    # --- one turn of the loop ---

    def _step(self) -> None:
        if self._begin_at is None:
            self._take(self.inbox.wait())
        else:
            self._take_all_until(self._begin_at)
            self._begin_if_due()
        now = time.monotonic()
        if now >= self._status_at + STATUS_EVERY:
            self._look_at_the_clock(now)

    def _begin_if_due(self) -> None:
        if self._begin_at is not None and time.monotonic() >= self._begin_at:
            self._begin_at = None
            self.tell(s.Begin())

    def _take_all_until(self, due: float) -> None:
        """Take what there is; what is still to come may take a nap's time to be heard."""
        while (sample := self.inbox.ready()) is not None:
            self._take(sample)
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, NAP))

    def _take(self, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes()
        if data == KNOCK and last_part(str(sample.key_expr)) == COORDINATOR:
            item = self.inbox.aside()
            if item is not None:
                self._take_aside(item)
        elif data:
            self._heard(last_part(str(sample.key_expr)), data)

    def _take_aside(self, item: Any) -> None:
        if isinstance(item, zenoh.Sample):
            self._presence(last_part(str(item.key_expr)), item.kind)
        elif isinstance(item, zenoh.Query):
            with item:
                answer(item, self)
        else:
            self.tell(item)

    def _heard(self, member: str, data: bytes) -> None:
        try:
            message = self._decoder.from_member(member, data)
        except (ProtocolError, SceneError) as error:
            self.tell(s.Violation(member, str(error)))
            return
        self.tell(message)

    def _presence(self, member: str, kind: zenoh.SampleKind) -> None:
        if member == COORDINATOR:
            return
        there = kind == zenoh.SampleKind.PUT
        self.tell(s.Appeared(member) if there else s.Vanished(member))

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and do what it says."""
        if isinstance(stimulus, s.End):
            self._reports_within = HURRIED_REPORTS_WITHIN
        for instruction in self.algorithm.receive(stimulus):
            self._do(instruction)

    def _do(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            key = self._groups.get(instruction.to) or self.keys.to(instruction.to)
            self._put(key, instruction.message)
        elif isinstance(instruction, s.FrameDone):
            self._waiting_since = None
            self.last_frame_at = time.monotonic()
            self._watch.frame_done(instruction)
            if self._recorded:
                self._put(self.keys.record, instruction.record, drop=True)
        elif isinstance(instruction, s.Ready):
            self._begin_at = self._pace.due(time.monotonic())
            if instruction.frame == 0:
                self.most_members = len(self.algorithm.roster.here())
        elif isinstance(instruction, s.Show):
            self._put(self.keys.view(instruction.event_type), instruction.message, drop=True)
        elif isinstance(instruction, s.Stopping):
            self._watch.stopping()
        elif isinstance(instruction, s.Say):
            self._watch.said(instruction.member, instruction.text)
        else:
            self.ended = instruction

    def _put(self, key: str, message: m.ToMember | m.FrameRecord, *, drop: bool = False) -> None:
        publisher = self._publishers.get(key)
        if publisher is None:
            control = zenoh.CongestionControl
            publisher = self._session.declare_publisher(
                key, congestion_control=control.DROP if drop else control.BLOCK
            )
            self._publishers[key] = publisher
        publisher.put(encode(message))

    # --- the clock ---

    def _look_at_the_clock(self, now: float) -> None:
        waiting = self.algorithm.waiting_for()
        if not waiting:
            self._waiting_since = None
        elif self._waiting_since is None:
            self._waiting_since, self._told_at = now, 0.0
        waited = now - self._waiting_since if self._waiting_since is not None else 0.0
        self._watch.status(self._status(now, tuple(waiting), waited))
        if waited:
            self._wait_aloud(waiting, waited)

    def _status(self, now: float, waiting: tuple[str, ...], waited: float) -> Status:
        frame = self.algorithm.frame
        rate = (frame - self._status_frame) / max(now - self._status_at, 1e-9)
        self._status_at, self._status_frame = now, frame
        here = len(self.algorithm.roster.here())
        self.most_members = max(self.most_members, here)
        return Status(frame, rate, here, self.algorithm.phase.value, waiting, waited)

    def _say_for_whom(self, waiting: list[str], waited: float) -> None:
        frame = f"frame {self.algorithm.frame} ({self.algorithm.phase.value}) has been waiting"
        left = f"given up in {max(0.0, self._patience.hard - waited):.0f} s"
        if len(waiting) <= FEW:
            for name in waiting:
                self._watch.said(name, f"{frame} for it for {waited:.1f} s; it is {left}")
        else:
            names = f"{', '.join(waiting[:FEW])} and {len(waiting) - FEW} more"
            self._watch.said(COORDINATOR, f"{frame} for {names} for {waited:.1f} s; {left}")

    def _wait_aloud(self, waiting: list[str], waited: float) -> None:
        """Say for whom the world waits, ever more seldom; then give them up."""
        if self.algorithm.phase is Phase.STOPPING:
            self.tell(s.Silent())
            if waited >= self._reports_within:
                self.tell(s.End("no report in time"))
            return
        if waited >= self._patience.soft and waited >= 2 * self._told_at:
            self._told_at = waited
            self.tell(s.Silent())
            self._say_for_whom(waiting, waited)
        if waited >= self._patience.hard:
            self._waiting_since = None
            for name in waiting:
                self._watch.stalled(name, waited)
                if not self.algorithm.roster.get(name).expected:
                    self.tell(s.Violation(name, f"it did not answer for {waited:.0f} s"))
