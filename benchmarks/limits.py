"""Costs of the largest allowed message of each type for the other members, over real Zenoh.

    python -m benchmarks.limits [--only NAME ...] [--repeat 3] [--json | --markdown]

A world runs 20 frames per second with a lockstep generator, a host of 200 agents, and an observer
that sends a query every 20 ms. A member that implements only the protocol joins, sends the largest
message of a type within the limits, or a flood of messages, and leaves. The metrics are relative to
the second before the message:

frame    maximum delay of a frame after the message, in ms
path     maximum CPU time of the coordinator's main thread between the beginning and the end of a
         frame, in ms: an estimate of `frame` on an idle machine, without the share of the hosts
silence  longest response time of a query, in ms

`decode` is the CPU time to decode the message on its own. All values are medians of the
repetitions, except for `frame` and `silence`, which are the lowest: other programs of the machine
only increase them. `--only` takes a part of a name; `--markdown` prints the table of
docs/performance.md. Messages are encoded before they are sent, so that their construction does not
count.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from queue import Empty, SimpleQueue
from typing import Any

import msgpack
import zenoh

from benchmarks.command import Table
from benchmarks.forked import coordinator, forked, task
from minerva_bus import Agent, Context, Event, EventType, Generator, Tick, Vocabulary, on
from minerva_bus.errors import MinervaError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.runtime.inbox import CAPACITY
from minerva_bus.runtime.member import MemberProcess
from minerva_bus.runtime.receiver import Receiver
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import open_client
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.epochs import stamped
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.limits import DEFAULT
from minerva_bus.wire.plain import pack

LOWEST = ("frame", "silence")
SHOWN = {
    "decode": "decode, ms", "path": "path, ms", "frame": "late, ms", "silence": "silence, ms",
}  # fmt: skip
NAME, RATE, AGENTS = "limits", 20.0, 200
CALM, SETTLED = 1.0, 30.0
eStep = EventType("eStep", by=float)
eNear = EventType("eNear", distance=float, text=str)
eShow = EventType("eShow", visual=True)


class Fox(Agent, symbol="AFox"):
    """An agent that processes an event in every frame."""

    x: float = 0.0
    name: str = ""

    @on("eStep")
    def step(self, step: Event, moment: Context) -> None:
        self.x += step.by


class Steps(Generator, events=("eStep",)):
    """One event per frame."""

    def generate(self, tick: Tick) -> Event:
        return eStep(1.0)


VOCABULARY = Vocabulary.of(eStep, eNear, eShow, Fox)


Flood = Callable[[zenoh.Session, Keys, bytes, float], None]
"""Sends messages of an epoch until a given time."""


@dataclass(frozen=True, slots=True)
class Message:
    """An encoded message: `head` before the number of its frame, if it has one, and `tail`."""

    head: bytes
    tail: bytes = b""
    framed: bool = False

    def of(self, frame: int) -> bytes:
        """The message of a frame."""
        return self.head + (pack(frame) if self.framed else b"") + self.tail


def framed(name: str, *items: Any) -> Message:
    """A message whose first item is the number of a frame."""
    head = bytes([0x90 | (2 + len(items))]) + pack(name)
    return Message(head, b"".join(map(pack, items)), framed=True)


def unframed(name: str, *items: Any) -> Message:
    """A message with these items."""
    return Message(pack([name, *items]))


@dataclass(frozen=True, slots=True)
class Case:
    """Input from a member: `data` once, or `flood` for some seconds."""

    hello: dict[str, Any] = field(default_factory=dict[str, Any])
    data: Callable[[], Message] | None = None
    answers: str = ""
    flood: Flood | None = None


def sent_as(name: str, events: list[Any]) -> Message:
    return unframed(name, events) if name == "emitted" else framed(name, events, None)


def single(name: str, **more: Any) -> Message:
    count = more.get("count", DEFAULT.single_events)
    receivers = more.get("receivers", lambda n: [f"f{n % AGENTS}"])
    events = [["eNear", [float(n), "x"], more.get("condition", ""), "", receivers(n)]
            for n in range(count)]  # fmt: skip
    return sent_as(name, events)


def columns(name: str) -> Message:
    rows = DEFAULT.events
    xs = msgpack.ExtType(3, b"i" + bytes(4 * rows))
    steps = [["eStep", rows, [xs], "", None, ["f", 0, rows]]]
    return sent_as(name, steps)


def values(name: str, value: Any, count: int) -> Message:
    """A message with one event that has a list of values."""
    return sent_as(name, [["eNear", [0.0, [value] * count]]])


def hello(**more: Any) -> dict[str, Any]:
    return {
        "version": PROTOCOL_VERSION, "service": "", "kinds": [], "generates": ["eNear", "eStep"],
        "lockstep": False, "orders": [], "draws": [], "coupled": False, "every": 0, "topics": [],
        "publishes": [], "pid": 0, "host": "", **more,
    }  # fmt: skip


def large_hello() -> dict[str, Any]:
    per = DEFAULT.fields // DEFAULT.kinds
    kinds = [
        [f"AX{n}", [[f"attribute{i}", "real m", "0.5"] for i in range(per)], [], [], []]
        for n in range(DEFAULT.kinds)
    ]
    return hello(kinds=kinds, generates=["eNear"] * DEFAULT.names)


def figures(name: str) -> Message:
    size = DEFAULT.small_bytes // DEFAULT.figures - 20
    return unframed(name, {f"figure{n}": "x" * size for n in range(DEFAULT.figures)})


def saved(state: Any) -> Message:
    """A reply to a tick without events."""
    return framed("ticked", [], {"x": state})


def evolved() -> Message:
    """All agents have changed, and one of them sends the largest number of events."""
    changed = {f"f{n}": [1, ["AFox", f"f{n}", [1.0, "x"], 0]] for n in range(AGENTS)}
    events = [["eNear", [float(n), "x"], "", "f0", ["f1"]] for n in range(DEFAULT.host_events)]
    return framed("evolved", 0, changed, {"f0": events}, {})


def flood_of(sender: str, message: list[Any]) -> Flood:
    """Send one message as `sender` repeatedly."""

    def flood(session: zenoh.Session, keys: Keys, epoch: bytes, until: float) -> None:
        data = epoch + pack(message)
        out = session.declare_publisher(
            keys.sent_by(sender), congestion_control=zenoh.CongestionControl.BLOCK
        )
        while time.monotonic() < until:
            out.put(data)

    return flood


def questions(session: zenoh.Session, keys: Keys, epoch: bytes, until: float) -> None:
    asked = pack({"ask": "status"})
    while time.monotonic() < until:
        session.get(keys.control, lambda reply: None, payload=asked, timeout=10.0)
        time.sleep(0.001)


LOCKSTEP = {"lockstep": True}
HOST = {
    "kinds": [["AFox", [["x", "real", "0"], ["name", "text", '""']], ["eStep"], [], []]],
    "generates": [],
    "plain": True,
}
CASES = {
    "hello": Case(hello=large_hello()),
    "ticked, single events": Case(LOCKSTEP, lambda: single("ticked"), "tick"),
    "ticked, columns": Case(LOCKSTEP, lambda: columns("ticked"), "tick"),
    "ticked, nested values": Case(
        LOCKSTEP, lambda: values("ticked", [], DEFAULT.tick_values - 20), "tick"
    ),
    "ticked, saved values": Case(
        LOCKSTEP, lambda: saved([[]] * (DEFAULT.tick_values - 10)), "tick"
    ),
    "ticked, saved bytes": Case(LOCKSTEP, lambda: saved(bytes(DEFAULT.tick_bytes - 99)), "tick"),
    "emitted, single events": Case({}, lambda: single("emitted")),
    "emitted, receivers": Case(
        {}, lambda: single("emitted", count=1,
                           receivers=lambda n: [f"r{i}" for i in range(DEFAULT.receivers)])
    ),
    "emitted, columns": Case({}, lambda: columns("emitted")),
    "emitted, text": Case(
        {}, lambda: sent_as("emitted", [["eNear", [0.0, "x" * (DEFAULT.emitted_bytes - 100)]]])
    ),
    "emitted, values": Case({}, lambda: values("emitted", 0, DEFAULT.values - 20)),
    "emitted, nested values": Case({}, lambda: values("emitted", [], DEFAULT.values - 20)),
    "evolved, events": Case(HOST, evolved, "evolve"),
    "failed": Case({}, lambda: framed("failed", "x\n" * (DEFAULT.small_bytes // 2 - 40), "")),
    "resync": Case({}, lambda: unframed("resync", "e" * (DEFAULT.small_bytes - 40))),
    "leaving": Case({}, lambda: unframed("leaving")),
    "doing": Case({}, lambda: figures("doing")),
    "report": Case({}, lambda: figures("report")),
    "over: 8 MB of events": Case({}, lambda: single("emitted", count=300_000)),
    "over: 300,000 receivers": Case(
        {}, lambda: single("emitted", count=300_000, receivers=lambda n: [f"r{n}"])
    ),
    "over: 200,000 figures": Case(
        {}, lambda: unframed("doing", {str(n): n for n in range(200_000)})
    ),
    "over: 200,000 kinds": Case(
        hello=hello(generates=[], draws=["eShow"],
                    kinds=[[f"AX{n}", [], [], [], []] for n in range(200_000)])
    ),
    "flood of hellos": Case({}, flood=flood_of("large", ["hello", hello()])),
    "flood of strangers": Case({}, flood=flood_of("stranger", ["hello", hello()])),
    "flood of events": Case({}, flood=flood_of("large", ["emitted", [["eNear", [1.0, "x"]]] * 15])),
    "flood of questions": Case({}, flood=questions),
}  # fmt: skip


# --- the world ---


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


@contextmanager
def running(host: bool) -> Iterator[tuple[str, SimpleQueue[tuple[int, float, float]], list[str]]]:
    """Run a world in separate processes; yields its endpoint, its frame ends and its log."""
    read_at, write_at = os.pipe()
    read_frames, write_frames = os.pipe()
    parts = [Member("steps", Steps())]
    parts += [Member("host", None, [Fox])] if host else []

    def listening(endpoint: str) -> None:
        os.write(write_at, (json.dumps(endpoint) + "\n").encode())

    def coordinate() -> None:
        costs = FrameCosts()

        def done(message: s.FrameDone) -> None:
            ended = [message.frame, time.monotonic(), costs.path]
            os.write(write_frames, (json.dumps(ended) + "\n").encode())

        def log(who: str, text: str, _: str) -> None:
            os.write(write_frames, (json.dumps(f"{who}: {text}"[:2000]) + "\n").encode())

        world = World(
            NAME,
            VOCABULARY.read(" · ".join(f"AFox#f{n}" for n in range(AGENTS))),
            VOCABULARY,
            dt=1 / RATE,
            expected=frozenset(member.name for member in parts),
        )
        Receiver.receive = costs.counting(Receiver.receive)
        coordinator(world, listening, done, said=log, rate=RATE, sinks=[costs]).run()

    children = [forked(coordinate)]
    endpoint = json.loads(os.fdopen(read_at, "r").readline())
    children += [
        forked(lambda member=member: MemberProcess(member, NAME, endpoint, print).run())
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
        elif name == "tick" and self.case.hello.get("lockstep"):
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


# --- measurement ---


def asking(
    session: zenoh.Session, stop: threading.Event, answers: list[tuple[float, float]]
) -> None:
    asked = pack({"ask": "vocabulary"})
    while not stop.is_set():
        began = time.monotonic()
        replies = list(session.get(Keys(NAME).control, payload=asked, timeout=30.0))
        answers.append((began, time.monotonic() - began if replies else 30.0))
        time.sleep(0.02)


def measured(case: Case) -> dict[str, float]:
    """Costs of one message in ms."""
    answers, stop = list[tuple[float, float]](), threading.Event()
    with running(host=case.answers != "evolve") as (endpoint, frames, lines):
        with open_client("asking", endpoint) as other, open_client("large", endpoint) as session:
            if case.answers != "evolve":
                frames.get(timeout=SETTLED)
            watch = threading.Thread(target=asking, args=(other, stop, answers))
            watch.start()
            lone = case.data is None and case.flood is None
            if lone:
                time.sleep(CALM)
            raw = Raw(session, case)
            (raw.refused if lone else raw.welcome).wait(SETTLED)
            at = raw.greeted_at if lone else _send(session, raw, case)
            time.sleep(2 * CALM)
            stop.set()
            watch.join()
        ends = list(_drained(frames))
    return _figures(at, ends, answers) | {"said": len(lines)}


def _send(session: zenoh.Session, raw: Raw, case: Case) -> float:
    time.sleep(CALM)
    if case.flood is not None:
        at = time.monotonic()
        case.flood(session, raw.keys, raw.epoch, at + CALM)
        return at
    if case.answers:
        raw.armed.set()
        until = time.monotonic() + SETTLED
        while not raw.sent_at and time.monotonic() < until:
            time.sleep(0.01)
        return raw.sent_at
    at = time.monotonic()
    raw.send_message(0)
    return at


def _drained(frames: SimpleQueue[tuple[int, float, float]]) -> Iterator[tuple[int, float, float]]:
    with suppress(Empty):
        while True:
            yield frames.get_nowait()


def _figures(
    at: float, ends: list[tuple[int, float, float]], answers: list[tuple[float, float]]
) -> dict[str, float]:
    gaps = [(b - a, b) for (_, a, _), (_, b, _) in pairwise(ends)]
    paths = [(path, end) for _, end, path in ends]
    usual = statistics.median([took for took, end in paths if end <= at] or [0.0])
    path = max([took for took, end in paths if end > at], default=0.0) - usual
    before = [gap for gap, end in gaps if at - CALM < end <= at]
    after = [gap for gap, end in gaps if end > at] + [max(0.0, time.monotonic() - ends[-1][1] - 3)]
    calm = max([took for begun, took in answers if begun < at - 0.1], default=0.0)
    busy = max([took for begun, took in answers if begun + took >= at], default=0.0)
    return {
        "frame": 1e3 * (max(after) - statistics.median(before or [1 / RATE])),
        "path": 1e3 * path,
        "calm": 1e3 * (max(before or [1 / RATE]) - statistics.median(before or [1 / RATE])),
        "silence": 1e3 * busy,
        "calm silence": 1e3 * calm,
    }


def encoded(case: Case) -> bytes:
    """The case's message, or its hello."""
    return pack(["hello", hello() | case.hello]) if case.data is None else case.data().of(0)


def alone(case: Case) -> float:
    """Milliseconds to decode the message on its own."""
    data = encoded(case)
    began = time.thread_time()
    with suppress(MinervaError):
        Decoder(VOCABULARY).from_member("large", data)
    return 1e3 * (time.thread_time() - began)


def row(name: str, repeat: int) -> dict[str, Any]:
    """One row of the table."""
    case, rows = CASES[name], list[dict[str, float]]()
    for _ in range(repeat):  # Zenoh's threads do not survive a fork: use new processes.
        rows.append(task("benchmarks.limits", name))
    lowest = {key: min(row[key] for row in rows) for key in LOWEST}
    figures = {key: statistics.median(row[key] for row in rows) for key in rows[0]} | lowest
    flood = case.flood is not None
    decode = 0.0 if flood else min(alone(case) for _ in range(repeat))
    own = {"case": name, "bytes": 0 if flood else len(encoded(case)), "decode": round(decode, 1)}
    return own | {key: round(figure, 1) for key, figure in figures.items()}


def markdown(figures: dict[str, Any]) -> str:
    """A row of the table in docs/performance.md."""
    size = f"{figures['bytes']:,}" if figures["bytes"] else ""
    cells = [f"`{figures['case']}`", size, *(f"{max(0.0, figures[key]):.0f}" for key in SHOWN)]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true")
    parser.add_argument("--task", choices=sorted(CASES), help="one case, in this process")
    options = parser.parse_args()
    if options.task:
        print(json.dumps(measured(CASES[options.task])))
        return
    names = [name for name in CASES if any(part in name for part in options.only)]
    if options.markdown:
        print(f"| message | bytes | {' | '.join(SHOWN.values())} |\n|---|---|---|---|---|---|")
        for name in names:
            print(markdown(row(name, options.repeat)), flush=True)
        return
    keys = ("bytes", "decode", "frame", "path", "calm", "silence", "calm silence")
    table = Table({"ms": "<26"} | dict.fromkeys(keys, ">13,"), as_json=options.json)
    for name in names:
        figures = row(name, options.repeat)
        table.row(figures, name, *(figures[key] for key in keys))


if __name__ == "__main__":
    main()
