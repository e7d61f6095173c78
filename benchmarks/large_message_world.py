"""The world in which the costs of messages are measured, and a member with only the protocol."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

import msgpack
import zenoh

from benchmarks.forked import coordinator, forked
from benchmarks.large_message_cases import STRING, VOCABULARY, Case, Fox, Steps, hello
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.runtime.receiver import Receiver
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import open_client
from minerva_bus.runtime.session_inbox import CAPACITY
from minerva_bus.wire.codec import stamped
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.plain import name_in, pack

NAME, RATE = "large-messages", 20.0


class FrameCosts(Sink):
    """The coordinator's CPU time since the current frame began, and the messages since then."""

    def __init__(self) -> None:
        self._began = 0.0
        self._messages = 0

    def received(self, stimulus: s.Stimulus) -> None:
        if isinstance(stimulus, s.Begin):
            self._began, self._messages = time.thread_time(), 0

    def counting(
        self, receive: Callable[[Receiver, tuple[str, bytes]], None]
    ) -> Callable[[Receiver, tuple[str, bytes]], None]:
        """The receiver's method, with each call counted."""

        def counted(receiver: Receiver, message: tuple[str, bytes]) -> None:
            self._messages += 1
            receive(receiver, message)

        return counted

    @property
    def path(self) -> float:
        """Seconds of CPU time for what can delay the frame.

        While the members compute, the coordinator handles whatever arrives. A reply waits only for
        the messages that are in the queue when it arrives, and a frame has two of them.
        """
        spent = time.thread_time() - self._began
        return spent * min(1.0, 2 * CAPACITY / max(1, self._messages))


def coordinate(
    expected: frozenset[str],
    listening: Callable[[str], None],
    write: Callable[[object], None],
) -> None:
    """Coordinate the world of the members `expected`.

    `listening` gets the endpoint, and `write` the end of each frame and the lines of the log.
    """
    costs = FrameCosts()

    def done(message: s.FrameDone) -> None:
        write([message.frame, time.monotonic(), costs.path])

    def log(who: str, text: str, _: str) -> None:
        write(f"{who}: {text}"[:2000])

    world = WorldSpec(
        NAME,
        STRING,
        VOCABULARY,
        dt=1 / RATE,
        expected=expected,
    )
    Receiver.receive = costs.counting(Receiver.receive)  # pyright: ignore[reportAttributeAccessIssue]
    coordinator(world, listening, done, said=log, rate=RATE, sinks=[costs]).run()


@contextmanager
def running(host: bool) -> Iterator[tuple[str, SimpleQueue[tuple[int, float, float]], list[str]]]:
    """Run a world in separate processes; yields its endpoint, its frame ends and its log."""
    read_at, write_at = os.pipe()
    read_frames, write_frames = os.pipe()
    parts = [Member("steps", Steps())]
    parts += [Member("host", None, [Fox])] if host else []

    def writer(descriptor: int) -> Callable[[object], None]:
        def write(item: object) -> None:
            os.write(descriptor, (json.dumps(item) + "\n").encode())

        return write

    names = frozenset(member.name for member in parts)
    children = [forked(lambda: coordinate(names, writer(write_at), writer(write_frames)))]
    endpoint = json.loads(os.fdopen(read_at, "r").readline())
    children += [
        forked(lambda member=member: MemberProcess([member], NAME, endpoint, print).run())
        for member in parts
    ]
    frames: SimpleQueue[tuple[int, float, float]] = SimpleQueue()
    printed: list[str] = []

    def read() -> None:
        with os.fdopen(read_frames, "r") as lines:
            for line in lines:
                item = json.loads(line)
                printed.append(item) if isinstance(item, str) else frames.put(tuple(item))

    threading.Thread(target=read, daemon=True).start()
    try:
        yield endpoint, frames, printed
    finally:
        os.close(write_frames)
        with open_client("stopping", endpoint) as session:
            list(session.get(Keys(NAME).control, payload=pack({"ask": "stop"}), timeout=5.0))
        for child in children:
            os.waitpid(child, 0)


class Raw:
    """A member that implements only the protocol and replies at once."""

    def __init__(self, session: zenoh.Session, case: Case) -> None:
        self.keys, self.case = Keys(NAME), case
        self._message = None if case.data is None else case.data()
        self.epoch = b""
        self.welcome, self.refused = threading.Event(), threading.Event()
        self.sent_at = 0.0
        self.armed = threading.Event()
        self.greeted_at = 0.0
        handler = zenoh.handlers.Callback(self._hear, indirect=True)
        listens = [self.keys.to("large"), self.keys.all, self.keys.tick, self.keys.evolve]
        self.out = session.declare_publisher(
            self.keys.sent_by("large"), congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._kept: list[Any] = [session.declare_subscriber(key, handler) for key in listens]
        self._kept.append(session.liveliness().declare_token(self.keys.alive("large")))

    def send(self, data: bytes) -> None:
        self.out.put(self.epoch + data)

    def send_message(self, frame: int) -> None:
        """Send the message of the case."""
        self.send(b"" if self._message is None else self._message.of(frame))

    def _hear(self, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes()
        name = name_in(stamped(data)[1])
        # What others have to decode because of the large message must not delay this process, which
        # answers the frame and measures the silence.
        if name not in ("greet", "welcome", "refused", self.case.answers or "tick"):
            return
        name, *items = msgpack.unpackb(stamped(data)[1], ext_hook=msgpack.ExtType)
        if name == "greet":
            self.epoch = data[: len(data) - len(stamped(data)[1])]
            greeting = pack(["hello", hello() | self.case.hello])
            self.greeted_at = time.monotonic()
            self.send(greeting)
        elif name == "welcome":
            self.welcome.set()
        elif name == "refused":
            self.refused.set()
        elif name == "tick" and self.epoch and self.case.hello["when"] == "in step":
            self._answer("tick", items[0], lambda: pack(["ticked", items[0], [], None]))
        elif name == "evolve" and "large" in items[1]:
            self._answer(
                "evolve", items[0], lambda: pack(["evolved", items[0], items[4], {}, {}, {}])
            )

    def _answer(self, what: str, frame: int, usual: Callable[[], bytes]) -> None:
        if self.case.answers == what and self.armed.is_set() and not self.sent_at:
            self.send_message(frame)
            self.sent_at = time.monotonic()
        else:
            self.send(usual())
