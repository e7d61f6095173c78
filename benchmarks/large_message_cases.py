"""The largest allowed messages of each type, messages over the limits, and floods of messages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
import zenoh

from minerva_bus import (
    Agent,
    Context,
    Event,
    EventType,
    Generator,
    Primitive,
    Tick,
    Vocabulary,
    on,
)
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.grammar.ids import Ids
from minerva_bus.runtime.questions import MAX_VALUES
from minerva_bus.wire.columns_codec import plain_ids
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.plain import DEFAULT, pack

AGENTS = 200
FRAGMENT = "~AFox.1"
"""The fragment of a host of all these agents, which are neighbours of one kind."""

eStep = EventType("eStep", by=float)
eNear = EventType("eNear", distance=float, text=str)
eBare = EventType("eBare")
eList = EventType("eList", items=tuple[float, ...])
eLists = EventType("eLists", items=tuple[tuple[float, ...], ...])
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


PDot = Primitive("PDot", x=float, y=float)
VOCABULARY = Vocabulary.of(eStep, eNear, eBare, eList, eLists, eShow, Fox, PDot)


STRING = VOCABULARY.read(" · ".join(f"AFox#f{n}" for n in range(AGENTS)))
"""The string of the world."""

BATCH = ["eBare", DEFAULT.events, [], "", None, ["f", 0, DEFAULT.events]]
"""The most events in the fewest bytes."""

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
    """Input from a member: `data` once, or `flood` for some seconds; or a `question` of a person.

    `answers` is the request that the message answers; `refused`: it is over a limit.
    """

    hello: dict[str, Any] = field(default_factory=dict[str, Any])
    data: Callable[[], Message] | None = None
    answers: str = ""
    flood: Flood | None = None
    refused: bool = False
    question: Callable[[], dict[str, Any]] | None = None


def sent_as(name: str, events: list[Any]) -> Message:
    return unframed(name, events) if name == "emitted" else framed(name, events, None)


def single(name: str, **more: Any) -> Message:
    count = more.get("count", DEFAULT.single_events)
    receivers = more.get("receivers", lambda n: [f"f{n % AGENTS}"])
    events = [["eNear", [float(n), "x"], more.get("condition", ""), "", receivers(n)]
            for n in range(count)]  # fmt: skip
    return sent_as(name, events)


def columns(name: str) -> Message:
    most = DEFAULT.tick_bytes if name == "ticked" else DEFAULT.emitted_bytes
    rows = min(DEFAULT.events, (most - 100) // 8)
    steps = [["eStep", rows, [reals(rows)], "", None, ["f", 0, rows]]]
    return sent_as(name, steps)


def values(name: str, value: Any, count: int) -> Message:
    """A message with one event that has a list of values."""
    kind = "eLists" if isinstance(value, list) else "eList"
    return sent_as(name, [[kind, [[value] * count]]])


def hello(**more: Any) -> dict[str, Any]:
    return {
        "version": PROTOCOL_VERSION, "kinds": [],
        "generates": ["eBare", "eList", "eLists", "eNear", "eStep"], "when": "freely",
        "orders": [], "draws": [], "coupled": False, "topics": [], "publishes": [], "about": {},
        **more,
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


MOST_VALUES = DEFAULT.answer_values - 20
MOST_AGENTS = MOST_VALUES // 7
MOST_EVENTS = min(DEFAULT.host_events, (MOST_VALUES - 7 * AGENTS) // 9)
MOST_FIGURES = MOST_VALUES // 5
"""Agents, events and figures, of seven, nine and five values each, in the largest `evolved`."""

MOST_ROWS = DEFAULT.message_bytes // 24
"""Rows with two numbers, or with a number and two ids."""


def foxes(agents: int, name: str = "x") -> list[Any]:
    """A string of agents, the first of which has a name."""
    names = [name, *["x"] * agents]
    return [agents, *(["AFox", f"f{n}", [1.0, names[n]], 0] for n in range(agents))]


def evolved(changed: list[Any], sent: dict[str, Any] | None = None, view: Any = None) -> Message:
    """All agents have changed, or some were born; they send events, and are shown."""
    views = {} if view is None else {"eShow": {FRAGMENT: view}}
    return framed("evolved", 0, {FRAGMENT: changed}, sent or {}, views)


def reals(rows: int) -> msgpack.ExtType:
    """A column of numbers."""
    return msgpack.ExtType(3, b"d" + bytes(8 * rows))


def evolved_single(events: int) -> Message:
    """One of the agents sends events."""
    sent = [["eNear", [float(n), "x"], "", "f0", ["f1"]] for n in range(events)]
    return evolved(foxes(AGENTS), {"f0": sent})


def evolved_batch() -> Message:
    """All agents send each other events, in columns."""
    ids = plain_ids(Ids.numbered("f", np.arange(MOST_ROWS) % AGENTS))
    sent = [["eStep", MOST_ROWS, [reals(MOST_ROWS)], "", ids, ids]]
    return evolved(foxes(AGENTS), {FRAGMENT: sent})


def newborn_columns() -> list[Any]:
    """Agents in columns."""
    columns = [reals(MOST_ROWS), ["n", 0, MOST_ROWS]]
    return [1, [MOST_ROWS, ["f", 0, MOST_ROWS], [["AFox", columns]]]]


def figures_shown() -> list[Any]:
    """Figures outside columns."""
    return [MOST_FIGURES, *[["PDot", [1.0, 2.0]]] * MOST_FIGURES]


def figures_in_columns() -> list[Any]:
    """Figures in columns."""
    return [1, [MOST_ROWS, None, [["PDot", [reals(MOST_ROWS)] * 2]]]]


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


IN_STEP = {"when": "in step"}
HOST = {
    "kinds": [["AFox", [["x", "real", "0"], ["name", "text", '""']], ["eStep"], [], []]],
    "generates": [],
    "plain": True,
}
SHOWN = HOST | {"draws": ["eShow"]}
CASES = {
    "hello": Case(hello=large_hello()),
    "ticked, single events": Case(IN_STEP, lambda: single("ticked"), "tick"),
    "ticked, columns": Case(IN_STEP, lambda: columns("ticked"), "tick"),
    "ticked, nested values": Case(
        IN_STEP, lambda: values("ticked", [], DEFAULT.tick_values - 20), "tick"
    ),
    "ticked, saved values": Case(
        IN_STEP, lambda: saved([[]] * (DEFAULT.tick_values - 10)), "tick"
    ),
    "ticked, saved bytes": Case(IN_STEP, lambda: saved(bytes(DEFAULT.tick_bytes - 99)), "tick"),
    "emitted, single events": Case({}, lambda: single("emitted")),
    "emitted, receivers": Case(
        {}, lambda: single("emitted", count=1,
                           receivers=lambda n: [f"r{i}" for i in range(DEFAULT.receivers)])
    ),
    "emitted, columns": Case({}, lambda: columns("emitted")),
    "emitted, text": Case(
        {}, lambda: sent_as("emitted", [["eNear", [0.0, "x" * (DEFAULT.emitted_bytes - 100)]]])
    ),
    "emitted, values": Case({}, lambda: values("emitted", 0.0, DEFAULT.values - 20)),
    "emitted, nested values": Case({}, lambda: values("emitted", [], DEFAULT.values - 20)),
    "evolved, events": Case(HOST, lambda: evolved_single(MOST_EVENTS), "evolve"),
    "evolved, events in columns": Case(HOST, evolved_batch, "evolve"),
    "evolved, newborn agents": Case(HOST, lambda: evolved(foxes(MOST_AGENTS)), "evolve"),
    "evolved, newborn in columns": Case(HOST, lambda: evolved(newborn_columns()), "evolve"),
    "evolved, text": Case(
        HOST, lambda: evolved(foxes(AGENTS, "x" * (DEFAULT.message_bytes - 9_000))), "evolve"
    ),
    "evolved, view": Case(
        SHOWN, lambda: evolved([0], view=figures_shown()), "evolve"
    ),
    "evolved, view in columns": Case(
        SHOWN, lambda: evolved([0], view=figures_in_columns()), "evolve"
    ),
    "failed": Case({}, lambda: framed("failed", "x\n" * (DEFAULT.small_bytes // 2 - 40), "")),
    "resync": Case({}, lambda: unframed("resync", "e" * (DEFAULT.small_bytes - 40))),
    "leaving": Case({}, lambda: unframed("leaving")),
    "doing": Case({}, lambda: figures("doing")),
    "report": Case({}, lambda: figures("report")),
    "over: 8 MB of events": Case({}, lambda: single("emitted", count=300_000), refused=True),
    "over: 300,000 receivers": Case(
        {}, lambda: single("emitted", count=300_000, receivers=lambda n: [f"r{n}"]), refused=True
    ),
    "over: 200,000 agents": Case(HOST, lambda: evolved(foxes(200_000)), "evolve", refused=True),
    "over: 200,000 figures": Case(
        {}, lambda: unframed("doing", {str(n): n for n in range(200_000)}), refused=True
    ),
    "over: 200,000 kinds": Case(
        hello=hello(generates=[], draws=["eShow"],
                    kinds=[[f"AX{n}", [], [], [], []] for n in range(200_000)])
    ),
    "`pub`": Case(
        {"generates": []},
        question=lambda: {
            "ask": "pub", "type": "eLists", "data": {"items": f"[{'[],' * 5_000}[]]"}
        },
    ),
    "`order`": Case(
        {"generates": []},
        question=lambda: {"ask": "order", "event": ["eLists", [[[]] * (MAX_VALUES - 20)]]},
    ),
    "`status`": Case(question=lambda: {"ask": "status"}),
    "`scene`": Case(question=lambda: {"ask": "scene"}),
    "flood of hellos": Case({}, flood=flood_of("large", ["hello", hello()])),
    "flood of strangers": Case({}, flood=flood_of("stranger", ["hello", hello()])),
    "flood of events": Case({}, flood=flood_of("large", ["emitted", [["eNear", [1.0, "x"]]] * 15])),
    "flood of batches": Case({}, flood=flood_of("large", ["emitted", [BATCH]])),
    "flood of questions": Case({}, flood=questions),
}  # fmt: skip
