"""The coordinator's process on the bus: the frame algorithm's ears, mouth and clock."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

import zenoh
from zenoh.handlers import Callback as Direct

from minerva_bus.bus.control import answer
from minerva_bus.bus.inbox import HubInbox, Tick
from minerva_bus.bus.session import LOOPBACK, open_hub
from minerva_bus.bus.shortcut import nothing_to
from minerva_bus.errors import MinervaError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm, Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.diary import Diary
from minerva_bus.frame.pacing import Glances, Pace
from minerva_bus.protocol.codec import Decoder, encode
from minerva_bus.protocol.keys import COORDINATOR, Keys, last_part
from minerva_bus.protocol.plain import mapped, pack, unpack

STATUS_EVERY = 0.1
NAP = 0.01
WATCHED_FOR = 5.0
SMOOTHING = 0.3
FEW = 3
REPORTS_WITHIN = 3.0
HURRIED_REPORTS_WITHIN = 0.5
_BEGIN = s.Begin()


def _presence(sample: zenoh.Sample) -> s.Appeared | s.Vanished | None:
    """What a token's sample says of a member; nothing of the coordinator's own."""
    member = last_part(str(sample.key_expr))
    if member == COORDINATOR:
        return None
    there = sample.kind == zenoh.SampleKind.PUT
    return s.Appeared(member) if there else s.Vanished(member)


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
    paused: bool = False
    waiting: tuple[str, ...] = ()
    waited: float = 0.0


@dataclass(frozen=True, slots=True)
class Printed:
    """A line that a member's process has printed."""

    member: str
    line: str


@dataclass(slots=True)
class Watchers:
    """Whom the coordinator tells what happens; each is called in its main thread."""

    said: Callable[[str, str], None]
    status: Callable[[Status], None]
    listening: Callable[[str], None]
    stalled: Callable[[str, float], None]
    frame_done: Callable[[s.FrameDone], None] = field(default=lambda _: None)
    stopping: Callable[[], None] = field(default=lambda: None)
    restart: Callable[[str], str] = field(default=lambda _: "its processes are not ours to restart")


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
        shared: bool = False,
    ) -> None:
        self.algorithm = FrameAlgorithm(world)
        self.keys = Keys(world.name)
        self.inbox = HubInbox(STATUS_EVERY)
        self._watch = watchers
        self.pace = Pace(rate)
        self.diary = Diary()
        self.hz = 0.0
        self.waited = 0.0
        self._glances = Glances()
        self._ready = False
        self._watched_until = 0.0
        self._listen = listen
        self._shared = shared
        self._patience = patience
        self._decoder: Decoder = Decoder(world.vocabulary)
        self._keys_to = {
            s.EVERYONE: self.keys.all,
            s.TICKED: self.keys.tick,
            s.HOSTS: self.keys.evolve,
        }
        self._asked: int = -1
        self._nothing = b""
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._begin_at: float | None = None
        self._evolving_since = 0.0
        self._waiting_since: float | None = None
        self._told_at = 0.0
        self._status_at = 0.0
        self._status_frame: int = 0
        self._recorded = False
        self._reports_within = REPORTS_WITHIN
        self.last_frame_at = 0.0
        self.most_members = 0
        self.ended: s.Ended | None = None

    def run(self) -> s.Ended:
        """Run the world to its end. Raises BusError where the bus cannot be set up."""
        session, endpoint = open_hub(COORDINATOR, self._listen, shared=self._shared)
        with session:
            self._session = session
            declared = self._declare(session)
            self._watch.listening(endpoint)
            self._status_at = time.monotonic()
            while self.ended is None:
                self._step()
            self.inbox.close()
            for one in declared:
                one.undeclare()
        return self.ended

    def profile(self) -> Mapping[str, Mapping[str, float]]:
        """What was measured of the frames: nothing, here."""
        return {}

    def measured(self) -> Mapping[str, float]:
        """What was measured of the last frames: nothing, here."""
        self._watched_until = time.monotonic() + WATCHED_FOR
        return {}

    @property
    def watched(self) -> bool:
        """Whether somebody has asked how the world is doing lately."""
        return self.last_frame_at < self._watched_until

    def repace(self) -> None:
        """The pace has changed: the next frame may begin now, later, or not at all."""
        if self._ready:
            self._begin_at = self.pace.due(time.monotonic())

    def restart(self, member: str) -> str:
        """Ask for a process to be started anew; why that cannot be, or the empty text."""
        return self._watch.restart(member)

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
            liveliness.declare_subscriber(keys.alive("*"), handler(_presence), history=True),
        ]

    def _on_watchers(self, status: zenoh.MatchingStatus) -> None:
        self._recorded = status.matching

    # --- one turn of the loop ---

    def _step(self) -> None:
        due = self._begin_at
        if due is None:
            self._take(self.inbox.wait())
            return
        self._take_all_until(due)
        if self._begin_at is not None and time.monotonic() >= self._begin_at:
            self._begin_at, self._ready = None, False
            self.pace.began()
            self.tell(self._begin())

    def _begin(self) -> s.Begin:
        rates = self.algorithm.roster.attending.rates
        if not rates:
            return _BEGIN
        return s.Begin(self._glances.due(time.monotonic(), rates))

    def _take_all_until(self, due: float) -> None:
        """Take what there is; what is still to come may take a nap's time to be heard."""
        while (item := self.inbox.ready()) is not None:
            self._take(item)
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, NAP))

    def _take(self, item: Any) -> None:
        if isinstance(item, tuple):
            self._heard(*cast("tuple[str, bytes]", item))
        elif isinstance(item, Tick):
            self._look_at_the_clock()
        elif isinstance(item, Printed):
            self._log(item.member, item.line)
        elif isinstance(item, zenoh.Query):
            with item:
                self._answer(item)
        elif item is not None:
            self.tell(item)

    def _answer(self, query: zenoh.Query) -> None:
        try:
            asked = mapped(unpack(query.payload.to_bytes() if query.payload else b""), "a question")
            found = self._answered(asked)
        except MinervaError as error:
            found = {"error": str(error)}
        query.reply(self.keys.control, pack(found))

    def _answered(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a question. Raises MinervaError where there is none."""
        return answer(asked, self)

    def _log(self, member: str, text: str) -> None:
        self.diary.said(time.time(), member, text)

    def _say(self, member: str, text: str) -> None:
        self._log(member, text)
        self._watch.said(member, text)

    def _heard(self, member: str, data: bytes) -> None:
        if data == self._nothing:  # Most answers to a tick: no need to read each.
            self.tell(m.TickReply(member, self._asked))
            return
        if not data:
            return
        try:
            message = self._decoder.from_member(member, data)
        except (ProtocolError, SceneError) as error:
            self.tell(s.Violation(member, str(error)))
            return
        if isinstance(message, m.EvolveReply):
            message = replace(message, took=time.monotonic() - self._evolving_since)
        self.tell(message)

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and do what it says."""
        if isinstance(stimulus, s.End):
            self._hurry()
        for instruction in self.algorithm.receive(stimulus):
            self._do(instruction)

    def _hurry(self) -> None:
        self._reports_within = HURRIED_REPORTS_WITHIN

    def _do(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            self._send(instruction)
        elif isinstance(instruction, s.FrameDone):
            self._waiting_since = None
            self.last_frame_at = time.monotonic()
            if self.watched:
                self.diary.frame(instruction.frame, instruction.events)
            self._watch.frame_done(instruction)
            if self._recorded:
                self._put(self.keys.record, self._encode(instruction.record), drop=True)
        elif isinstance(instruction, s.Ready):
            self._ready = True
            self._begin_at = self.pace.due(time.monotonic())
            if instruction.frame == 0:
                self.most_members = len(self.algorithm.roster.here())
        elif isinstance(instruction, s.Show):
            key = self.keys.view(instruction.event_type)
            self._put(key, self._encode(instruction.message), drop=True)
        elif isinstance(instruction, s.Stopping):
            self._watch.stopping()
        elif isinstance(instruction, s.Say):
            self._say(instruction.member, instruction.text)
        else:
            self.ended = instruction

    def _send(self, instruction: s.Send) -> None:
        data = self._encode(instruction.message)
        if instruction.to == s.TICKED:
            self._asked, self._nothing = self.algorithm.frame, nothing_to(data)
        elif instruction.to == s.HOSTS:
            self._evolving_since = time.monotonic()
        self._put(self._key_to(instruction.to), data)

    def _encode(self, message: m.ToMember | m.FrameRecord) -> bytes:
        return encode(message)

    def _key_to(self, to: str) -> str:
        key = self._keys_to.get(to)
        if key is None:
            key = self._keys_to[to] = self.keys.to(to)
        return key

    def _put(self, key: str, data: bytes, *, drop: bool = False) -> None:
        publisher = self._publishers.get(key)
        if publisher is None:
            control = zenoh.CongestionControl
            publisher = self._session.declare_publisher(
                key, congestion_control=control.DROP if drop else control.BLOCK
            )
            self._publishers[key] = publisher
        publisher.put(data)

    # --- the clock ---

    def _look_at_the_clock(self) -> None:
        now = time.monotonic()
        if now < self._status_at + STATUS_EVERY / 2:
            return  # After a long frame the clock has knocked several times.
        waiting = self.algorithm.waiting_for()
        if not waiting:
            self._waiting_since = None
        elif self._waiting_since is None:
            self._waiting_since, self._told_at = now, 0.0
        waited = now - self._waiting_since if self._waiting_since is not None else 0.0
        self.waited = waited
        self._watch.status(self._status(now, tuple(waiting), waited))
        if waited:
            self._wait_aloud(waiting, waited)

    def _status(self, now: float, waiting: tuple[str, ...], waited: float) -> Status:
        frame = self.algorithm.frame
        rate = (frame - self._status_frame) / max(now - self._status_at, 1e-9)
        self.hz = rate if self.pace.paused else self.hz + SMOOTHING * (rate - self.hz)
        self._status_at, self._status_frame = now, frame
        here = len(self.algorithm.roster.here())
        self.most_members = max(self.most_members, here)
        return Status(
            frame, rate, here, self.algorithm.phase.value, self.pace.paused, waiting, waited
        )

    def _say_for_whom(self, waiting: list[str], waited: float) -> None:
        frame = f"frame {self.algorithm.frame} ({self.algorithm.phase.value}) has been waiting"
        left = f"given up in {max(0.0, self._patience.hard - waited):.0f} s"
        if len(waiting) <= FEW:
            for name in waiting:
                self._say(name, f"{frame} for it for {waited:.1f} s; it is {left}")
        else:
            names = f"{', '.join(waiting[:FEW])} and {len(waiting) - FEW} more"
            self._say(COORDINATOR, f"{frame} for {names} for {waited:.1f} s; {left}")

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
