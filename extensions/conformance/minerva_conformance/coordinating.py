"""Checks a coordinator: starts one with the world of the suite, and plays its members."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from typing import Any, Final, Self

from minerva_bus.errors import BusError
from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import encode, stamp, stamped
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.plain import pack, unpack
from minerva_conformance.case import Case, CaseOutcome, CaseResult, CoordinatorRole
from minerva_conformance.launching import RunningMember, StartMember
from minerva_conformance.link import CaseFailure, NotJoined
from minerva_conformance.scripted_member import ScriptedMember
from minerva_conformance.world import MemberRole, reference

START_SECONDS: Final = 60.0
ANSWER_SECONDS: Final = 10.0
QUIET_SECONDS: Final = 0.5
"""Seconds without a message that must not come."""


class PlayedMember:
    """A member of the suite in the coordinator's world, and what both have sent."""

    def __init__(self, bus: ScriptedMember, sent: list[str]) -> None:
        self.bus = bus
        self.epoch = -1
        self.tokens: set[str] = set()
        self.asked = -1
        self.records: dict[int, list[Any]] = {}
        self._sent = sent

    def send(self, *message: object, later: int = 0) -> None:
        """Send a message; `later` is added to the epoch."""
        self.send_bytes(stamp(self.epoch + later) + pack(list(message)))

    def send_bytes(self, data: bytes) -> None:
        """Send bytes in place of a message."""
        self._sent.append(f"{self.bus.name}: {data.hex()[:200]}")
        self.bus.put(f"from/{self.bus.name}", data)

    def next(self, seconds: float = ANSWER_SECONDS) -> list[Any] | None:
        """The next message of the coordinator; None after so many seconds."""
        until = time.monotonic() + seconds
        while (sample := self.bus.next(until)) is not None:
            kind = self.bus.keys.kind(sample.key)
            if kind in ("alive", "epoch"):
                self._note(sample.key, sample.there)
            elif kind == "record":
                _, frame, *items = unpack(sample.data)
                self.records[frame] = items
            else:
                self.epoch, body = stamped(sample.data)
                return unpack(body)
        return None

    def _note(self, key: str, there: bool) -> None:
        if there:
            self.tokens.add(key)
        else:
            self.tokens.discard(key)

    def receive(self, name: str) -> list[Any]:
        """The items of the next message of this name, after any others but `refused` and `stop`."""
        until = time.monotonic() + ANSWER_SECONDS
        while (message := self.next(until - time.monotonic())) is not None:
            if message[0] == name:
                return message[1:]
            if message[0] in ("refused", "stop"):
                raise CaseFailure("another answer than expected", [name], [str(message)])
        raise CaseFailure(f"no {name} within {ANSWER_SECONDS:g} s", [name])

    def record(self, frame: int) -> list[Any]:
        """Events, changed fragments and digest of the record of a frame."""
        until = time.monotonic() + ANSWER_SECONDS
        while frame not in self.records:
            if time.monotonic() > until:
                raise CaseFailure(f"no record of frame {frame} within {ANSWER_SECONDS:g} s")
            self.next(0.05)
        return self.records[frame]

    def receive_none(self, *names: str) -> None:
        """Check that no message of these names follows."""
        until = time.monotonic() + QUIET_SECONDS
        while (message := self.next(until - time.monotonic())) is not None:
            if message[0] in names:
                raise CaseFailure("it sent a message that was not due", (), [str(message)])

    def greeted(self) -> Self:
        """Declare the token and wait for the greeting."""
        self.bus.appear()
        self.receive("greet")
        return self

    def join(self, role: MemberRole = MemberRole.GENERATOR, **changed: object) -> list[Any]:
        """Join with the hello of a role, changed in some keys; returns the items of the welcome."""
        self.greeted()
        self.send("hello", hello(role, **changed))
        return self.receive("welcome")

    def tick(self) -> int:
        """The frame of the next tick."""
        self.asked = int(self.receive("tick")[0])
        return self.asked

    def answer_due(self) -> None:
        """Answer the next tick, if one has arrived."""
        message = self.next(0.0)
        if message is not None and message[0] == "tick":
            self.asked = message[1]
            self.answer(self.asked)

    def answer(self, frame: int, *amounts: float, saved: object = None) -> None:
        """Answer a tick by events eAdd."""
        self.send("ticked", frame, [["eAdd", [amount]] for amount in amounts], saved)

    def leave(self) -> None:
        """Leave the world."""
        self.send("leaving")
        self.bus.vanish()


def hello(role: MemberRole, **changed: object) -> Mapping[str, Any]:
    """The hello of a member in this role, without topics and orders."""
    (message,) = reference(role).receive(m.Greet())
    plain = unpack(encode(message))[1]
    return {**plain, "topics": [], "publishes": [], "orders": [], "plain": True, **changed}


class Stage:
    """A coordinator that runs, and members that the suite plays in its world; a context manager."""

    def __init__(self, start: StartMember) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self.world = f"conformance-{port}"
        self.sent: list[str] = []
        self._names = count(1)
        self._members = ExitStack()
        self._start = start

    def __enter__(self) -> Self:
        environment = {"MINERVA_WORLD": self.world, "MINERVA_LISTEN": self.endpoint}
        self.process: RunningMember = self._start(environment)
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()
        self.process.kill()

    def await_start(self) -> None:
        """Wait until the coordinator's token is there. Raises NotJoined."""
        until = time.monotonic() + START_SECONDS
        while time.monotonic() < until and self.process.code(0.1) is None:
            try:
                member = self.member()
            except BusError:
                continue
            member.receive_none()
            if any(key.endswith(f"/{COORDINATOR}") for key in member.tokens):
                self.clear()
                return
            self.clear()
        raise NotJoined(f"no coordinator of {self.world} at {self.endpoint}")

    def member(self, name: str = "") -> PlayedMember:
        """A member without a token, under a new name by default."""
        name = name or f"member-{next(self._names)}"
        bus = self._members.enter_context(ScriptedMember(self.endpoint, self.world, name))
        return PlayedMember(bus, self.sent)

    def clear(self) -> None:
        """End all members."""
        self._members.close()
        self.sent.clear()

    def ask(self, question: Mapping[str, object]) -> Mapping[str, Any]:
        """The answer to a question of people."""
        member = self.member()
        answer = member.bus.ask(pack(dict(question)))
        if not answer:
            raise CaseFailure(f"no answer to {question}")
        return unpack(answer)


def join_both(stage: Stage) -> tuple[PlayedMember, PlayedMember, int]:
    """Two generators, and a frame that both have been asked for and the second has to answer."""
    first, second = stage.member(), stage.member()
    first.join()
    second.greeted()
    second.send("hello", hello(MemberRole.GENERATOR))
    until = time.monotonic() + ANSWER_SECONDS
    # A hello during a frame is answered when the next one begins (P6.6).
    while (message := second.next(0.1)) is None or message[0] != "welcome":
        if time.monotonic() > until:
            raise CaseFailure(f"no welcome within {ANSWER_SECONDS:g} s", ["welcome"])
        first.answer_due()
    frame = second.tick()
    while first.asked < frame:
        first.tick()
    return first, second, frame


@dataclass(frozen=True, slots=True)
class Script:
    """A case of a coordinator with the function that plays it; `ends`: the coordinator ends."""

    case: Case
    play: Callable[[Stage], None]
    ends: bool = False


def play_scripts(start: StartMember, scripts: Collection[Script]) -> Sequence[CaseResult]:
    """Play scripts one after another; a coordinator that has ended is started again."""
    results: list[CaseResult] = []
    waiting = list(scripts)
    while waiting:
        with Stage(start) as stage:
            try:
                stage.await_start()
            except NotJoined as reason:
                problem = f"{reason}\n{stage.process.output()}".strip()
                return [*results, *(_result(s, CaseOutcome.BLOCKED, problem) for s in waiting)]
            while waiting and stage.process.code(0.0) is None:
                results.append(play_on(stage, waiting.pop(0)))
    return results


def _result(script: Script, outcome: CaseOutcome, problem: str = "") -> CaseResult:
    return CaseResult(script.case, CoordinatorRole.COORDINATOR, outcome, problem)


def play_on(stage: Stage, script: Script) -> CaseResult:
    """Play a script with the coordinator of a stage, and end its members."""
    role = CoordinatorRole.COORDINATOR
    try:
        script.play(stage)
        if not script.ends and stage.process.code(0.0) is not None:
            raise CaseFailure("the coordinator has ended")
    except (CaseFailure, BusError) as failure:
        expected, received = getattr(failure, "expected", ()), getattr(failure, "received", ())
        problem = f"{failure}\n{stage.process.output()}".strip()
        sent = tuple(stage.sent)
        return CaseResult(script.case, role, CaseOutcome.FAILED, problem, sent, expected, received)
    finally:
        stage.clear()
    return CaseResult(script.case, role, CaseOutcome.PASSED, sent=())
