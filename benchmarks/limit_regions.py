"""Costs of the largest messages between regions and to their coordinator, in this process.

A frame of a region waits for `parcel`, `replies` and `advance`, one of the coordinator for `part`.
All regions are in this process, so that nothing but the message counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.limit_cases import AGENTS, DEFAULT, OWN, VOCABULARY, Fox, eNear
from minerva_bus import Scene
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.description import World
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.column import Column
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Piece
from minerva_bus.log.entries import encode_inputs, part_codec
from minerva_bus.regions.attached import Replies
from minerva_bus.regions.journal import PROCESS
from minerva_bus.regions.merging import PlacedEvent, Units, agents_in
from minerva_bus.regions.messages import from_message, to_message
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.part import PartSender
from minerva_bus.regions.partition import ByPosition
from minerva_bus.regions.progress import NO_PROGRESS
from minerva_bus.regions.region import Region
from minerva_bus.regions.whole import PART, WholeSource
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.world.kinds import kinds_of

Measured = tuple[int, float, float]
"""Bytes, and milliseconds of CPU time to decode a message and to process it."""

NAMES: Final = ("region-0", "region-1")
VALUES: Final = DEFAULT.region_values + 4 * OWN - 40


def agents(name: str, count: int, x: float = 0.0) -> tuple[Piece, ...]:
    """Agents outside columns."""
    return tuple(node for n in range(count) for node in Fox(f"{name}{n}", x=x).string.nodes)


def in_columns(name: str, count: int, x: float = 0.0) -> Columns:
    """Agents in columns."""
    names = Column.of_ids(Ids.numbered("n", range(count)))
    columns = (Column(np.full(count, x)), names)
    return Columns("AFox", ("x", "name"), columns, count, Ids.numbered(name, range(count)))


def after(pieces: Sequence[Piece]) -> Units:
    """Units with places after those of all other agents."""
    count = sum(piece.count for piece in pieces)
    return Units([(AGENTS + number,) for number in range(count)], tuple(pieces))


WORLD: Final = World("w", Scene(agents("f", AGENTS)), VOCABULARY, dt=0.05)
# No agent of this world is in region 1.
PARTITION: Final = ByPosition((0.5,))


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Milliseconds of CPU time of a call, and its result."""
    began = time.thread_time()
    result = call()
    return 1e3 * (time.thread_time() - began), result


def sent(events: Sequence[AnyEvent]) -> list[PlacedEvent]:
    """Events with the place of their sender."""
    return [PlacedEvent([(0,)], event) for event in events]


def reported(units: Units, events: Sequence[PlacedEvent] = ()) -> Measured:
    """A frame of the coordinator, from the report of region 1 on."""
    codec = part_codec(VOCABULARY, DEFAULT)
    kinds = kinds_of([Fox])
    source = partial(WholeSource, partition=PARTITION, names=NAMES, kinds=kinds, codec=codec)
    algorithm = FrameAlgorithm(replace(WORLD, expected=frozenset(NAMES)), source)
    for name in NAMES:
        algorithm.receive(s.Appeared(name))
        algorithm.receive(m.Hello(name, PROTOCOL_VERSION, lockstep=True))
    algorithm.receive(s.Begin())
    inputs = encode_inputs(FrameInputs(0, (), {}, {}, (), (), {}))
    first = PartSender().message(
        0, Units([(n,) for n in range(AGENTS)], WORLD.scene.pieces), (), NO_PROGRESS, (), inputs
    )
    algorithm.receive(m.TickReply(NAMES[0], 0, (), {PART: encode(first), PROCESS: 1}))
    data = encode(PartSender().message(0, units, events, NO_PROGRESS, (), b""))
    decoding, _ = timed(lambda: codec.decode(data, algorithm.source.agents_of(NAMES[1])))
    report = m.TickReply(NAMES[1], 0, (), {PART: data, PROCESS: 1})
    took, done = timed(lambda: list(algorithm.receive(report)))
    if not any(isinstance(item, s.FrameDone) for item in done):
        raise SystemExit(f"the frame is not done: {done!r:.300}")
    return len(data), decoding, took - decoding


def arrived(units: Units, events: Sequence[PlacedEvent] = ()) -> Measured:
    """What region 1 does with a parcel before it begins a frame."""
    region = Region(WORLD, 1, PARTITION)
    InProcessRunner(region.algorithm, ()).start()
    region.algorithm.frame = 1
    region.receive(Parcel(0, 1, 1, Units((), ()), ()))
    region.expect({0: [0]})
    data = encode(to_message(Parcel(0, 0, 1, units, tuple(events))))
    known = agents_in(lambda: [Units((), WORLD.scene.pieces), region.units])
    decoding, message = timed(lambda: Decoder(VOCABULARY).parcel(data, known))

    def enter() -> None:
        region.receive(from_message(message, 0, 1))
        region.enter()

    return len(data), decoding, timed(enter)[0]


def singles(count: int) -> list[AnyEvent]:
    """Single events of an agent."""
    return [eNear(float(n), "x", sender="f0", receivers=["f1"]) for n in range(count)]


def batch(rows: int) -> Events:
    """Events in columns, of all agents."""
    ids = Ids.numbered("f", np.arange(rows) % AGENTS)
    return Events("eStep", ("by",), (Column(np.zeros(rows)),), rows, "", ids, ids)


def answered() -> Measured:
    """The events of attached services for a region."""
    message = to_message(Replies(0, 0, 1, {"service": tuple(singles(VALUES // 9))}))
    data = encode(message)
    known = agents_in(lambda: [Units((), WORLD.scene.pieces)])
    decoding, message = timed(lambda: Decoder(VOCABULARY).parcel(data, known))
    return len(data), decoding, timed(lambda: from_message(message, 0, 1))[0]


def requested() -> Measured:
    """The most events of a generator that runs freely, for a frame."""
    events = (*singles(DEFAULT.single_events), batch(DEFAULT.events - DEFAULT.single_events))
    data = encode(m.RegionRequest(0, (), {"rain": events}))
    region = Region(WORLD, 1, PARTITION)
    decoding, request = timed(lambda: Decoder(VOCABULARY).to_member(data))
    return len(data), decoding, timed(lambda: region.give(request))[0]


LONG: Final = tuple(range(VALUES // 2 - 3 | 1))
"""The longest place."""

REGION_CASES: Final[dict[str, Callable[[], Measured]]] = {
    "part": lambda: reported(after(agents("g", VALUES // 10, 1.0))),
    "part, columns": lambda: reported(after([in_columns("g", VALUES // 3, 1.0)])),
    "part, events": lambda: reported(after(()), sent(singles(VALUES // 9))),
    "part, long place": lambda: reported(Units([LONG], agents("g", 1, 1.0))),
    "parcel": lambda: arrived(after(agents("g", VALUES // 7, 1.0))),
    "parcel, columns": lambda: arrived(after([in_columns("g", VALUES // 3, 1.0)])),
    "parcel, events": lambda: arrived(after(()), sent(singles(VALUES // 9))),
    "parcel, long place": lambda: arrived(Units([LONG], agents("g", 1, 1.0))),
    "replies": answered,
    "advance": requested,
}  # fmt: skip
