"""Golden bytes of single messages: each type with empty, full and extreme values.

    python -m tools.golden_messages            # compare with tests/golden/messages.toml
    python -m tools.golden_messages --record   # write it

A changed value is a change of the wire format and needs a new version in PROTOCOL.md.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Mapping
from hashlib import blake2b
from pathlib import Path

import numpy as np

from minerva_bus import (
    AgentKind,
    Cells,
    Default,
    Disc,
    Event,
    Events,
    EventType,
    Metres,
    Motion,
    Primitive,
    Reals,
    Scene,
    Transformation,
    Vocabulary,
)
from minerva_bus.frame import messages as m
from minerva_bus.grammar.columns import Change, Column, Columns, Delta
from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.ids import Ids, RowDelta
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.types import parse_type
from minerva_bus.wire.codec import encode
from minerva_bus.world import readings as r
from minerva_bus.world.services import Participation, When

GOLDEN = Path(__file__).resolve().parents[1] / "tests" / "golden" / "messages.toml"
LONGEST_HEX = 600
HEAD = """\
# Messages as they travel, written by `python -m tools.golden_messages --record`: bytes in
# hexadecimal; of long ones their number and BLAKE2b with 16 bytes.
"""

STAR = Primitive("PStar", size=Default(Metres, 0.5), shape=Disc("size", "#444444"))
BOX = Primitive("PBox", inside=Scene)
MOVE = Transformation("TMove", dist=Metres, motion=Motion(forward="dist"))
NEAR = EventType("eNear", distance=Metres)
MAP = EventType("eMap", cells=Cells, heights=Reals)
BOXED = EventType("eBox", inside=Scene, words=tuple[str, ...])
ALL = EventType("eAll", yes=bool, count=int, size=float, word=str)
BARE, SHOW = EventType("eBare"), EventType("eShow", visual=True)


def _fields(**types: str) -> Fields:
    return Fields(tuple(Field.of(name, parse_type(text)) for name, text in types.items()))


FOX = AgentKind(
    "AFox", _fields(x="real m", name="text"), frozenset({"eNear", "eBare"}),
    frozenset({"eShow"}), (("eNear", 0.25),), ("x",),
)  # fmt: skip
FISH = AgentKind("AFish", _fields(x="real m"), frozenset({"eNear"}), frozenset({"eShow"}))
STONE = AgentKind("AStone", _fields(), frozenset(), frozenset())
ENTRIES = (STAR, BOX, MOVE, NEAR, MAP, BOXED, ALL, BARE, SHOW, FOX, FISH, STONE)
VOCABULARY = Vocabulary.of(*ENTRIES)

LAST_FRAME = (1 << 63) - 1
LONG_ID = "f" * 64
STAR_BOX = BOX(STAR(0.25))
NESTED = VOCABULARY.read(
    "PStar<size=0.5> · TMove<dist=-0>("
    'AFox#a<x=5e-324, name="é\\n">(AStone#s() · PStar<size=1e308>))'
)
SLOTS = Scene((AgentNode("AFox", "a"), AgentNode("AFish", "~AFish.1"), *STAR(1.0).pieces))
EVENTS: tuple[Event, ...] = (
    BARE(),
    NEAR(0.25, condition="x < 5", sender="c", receivers=("b", "a")),
    NEAR(-0.0, receivers=(LONG_ID,)),
    ALL(True, -(1 << 63), 1e-310, 'a "b" \\ €𝄞'),
    ALL(False, LAST_FRAME, 1.7976931348623157e308, ""),
    MAP(np.array([[-32768, 32767]], np.int16), np.array([[1.5], [-0.0]])),
    BOXED(STAR_BOX, ("", "é")),
)
FISHES = 300


def fishes(first: int = 0, count: int = FISHES) -> Columns:
    """Agents in columns, with consecutive ids."""
    xs = np.arange(count, dtype=np.float64) / 3.0
    return Columns(
        "AFish", ("x",), (Column(xs),), count, Ids("f", np.arange(first, first + count)), None
    )  # fmt: skip


def stars(count: int = FISHES) -> Columns:
    """Transformations around figures, in columns."""
    sizes = Columns("PStar", ("size",), (Column(np.full(count, 0.5)),), count, None, None)
    return Columns("TMove", ("dist",), (Column(np.arange(count) * 0.5),), count, None, sizes)


def batch(count: int = FISHES) -> Events:
    """Events of one type, each to its sender."""
    distances, ids = Column(np.arange(count) * 0.25), Ids("f", np.arange(count))
    return Events("eNear", ("distance",), (distances,), count, "", ids, ids)


WORDS = np.empty(3, object)
WORDS[:] = ["a", "", "é"]
MIXED = Events(
    "eAll", ("yes", "count", "size", "word"),
    (Column(np.array([True, False, True])), Column(np.array([0, -129, 70_000])),
     Column(np.array([0.0, -0.0, 5e-324])), Column(WORDS)),
    3, "x < 5", Ids.of(["a", "b:1", "c"]), None,
)  # fmt: skip
ROWS = np.array([0, 5, 299], np.intp)
PATCH = Delta(FISHES, ("AFish",), (Change(0, 0, ROWS, Column(np.array([1.0, 2.0, 3.0]))),))
WHOLE_PATCH = Delta(2, ("AFish",), (Change(0, 0, None, Column(np.array([1.0, 2.0]))),))
WITH_ROWS = Delta(
    3, ("AFish",),
    (Change(0, 0, np.array([2], np.intp), Column(np.array([9.0]))),),
    RowDelta(3, np.array([0], np.intp), np.array([2], np.intp)), Ids.of(["f1:1"]),
)  # fmt: skip
POPULATION = {"~AFish.1": Scene((fishes(),)), "a": NESTED}
VIEWS = {"a": STAR(2.25), "~AFish.1": Scene((stars(),))}
FIGURES = {"count": LAST_FRAME, "load": 0.5, "late": False, "note": "é", "": -(1 << 63)}
SAVED = {"=": None, "bytes": b"\0\xff", "list": [1, [2.5, {"deep": True}]], "é": "text"}
NAMES = tuple(f"name{n}" for n in range(40))
FULL_HELLO = m.Hello(
    "hosts", 7, kinds=(FOX, FISH, STONE), generates=NAMES,
    when=When(Participation.IN_STEP, every=12), orders=("eNear",), draws=("eShow",),
    coupled=True, topics=("scan",), publishes=("scan", "image"), people=True, plain=True,
    about={"service": "a service, é", "pid": 1 << 31, "host": "machine"},
)  # fmt: skip
READINGS: tuple[r.Reading, ...] = (
    r.Scan("r", np.array([0.0, 1.5, np.inf], np.float32), -90.0, 0.5, 30.0, 0.1, 0.1, -0.2, 180.0),
    r.Scan("r", np.array([], np.float32), 0.0, 1.0, 5e-324, 1e308, beam_time=-0.001,
           path=(r.Displacement(0.0, 1.0, 2.0, 3.0), r.Displacement(0.5, -1.0, 0.0, 90.0))),
    r.Sightings("r", (r.Sighting("kitchen", 2.0, -12.5), r.Sighting("", 0.0, 0.0)), 0.7),
    r.Sightings("r", (), 0.0),
    r.Image("r", b"\0" * 6, "rgb8", 2, 1, 1.0, r.Mount(0.5, 0.0, -90.0)),
    r.Image("r", b"", "jpeg", 1, 1, 0.0),
    r.Odometry("r", 1.0, -2.0, 3.5, 0.0, -0.0, 1e9),
    r.Battery("é", 0.5, 12.0, 1.0),
    r.Position("r", 47.0, 8.0, None, None, 1.0),
    r.Position("r", -90.0, 180.0, 400.5, 0.02, 2.0),
)  # fmt: skip

MESSAGES: Mapping[str, m.Message] = {
    "hello.empty": m.Hello("", 0),
    "hello.full": FULL_HELLO,
    "hello.extreme": m.Hello(
        "h", LAST_FRAME, when=When(Participation.FREELY, rate=1.7976931348623157e308)
    ),
    "ticked.empty": m.TickReply("g", 0),
    "ticked.full": m.TickReply("g", 200, (*EVENTS, MIXED), SAVED),
    "ticked.extreme": m.TickReply("g", LAST_FRAME, EVENTS * 280, {}),
    "evolved.empty": m.EvolveReply("h", 0),
    "evolved.full": m.EvolveReply(
        "h", 70_000, 3, {**POPULATION, "~AFish.2": PATCH, "~AFish.3": WITH_ROWS},
        {"a": EVENTS, "~AFish.1": (batch(),)},
        {"eShow": {**VIEWS, "~AFish.2": WHOLE_PATCH}, "eOther": {}},
    ),
    "evolved.extreme": m.EvolveReply(
        "h", LAST_FRAME, LAST_FRAME, {LONG_ID: Scene(), "": NESTED}, {"a": ()}, {"": {}}
    ),
    "evolved.columns": m.EvolveReply(
        "h", 1, 0, {"~AFish.1": Scene((fishes(0, 2000),))}, {"~AFish.1": (batch(2000),)},
        {"eShow": {"~AFish.1": Scene((stars(2000),))}},
    ),
    "emitted.empty": m.Emitted("g", ()),
    "emitted.full": m.Emitted("g", (*EVENTS, MIXED, batch())),
    "emitted.extreme": m.Emitted("g", (batch(20_000),)),
    "failed.empty": m.Failed("h", -1, ""),
    "failed.full": m.Failed("h", 7, "ValueError: é", "Traceback\n  line"),
    "failed.extreme": m.Failed("h", LAST_FRAME, "x" * 70_000, "y" * 300),
    "resync.empty": m.Resync("o", ""),
    "resync.full": m.Resync("o", "eShow"),
    "leaving": m.Leaving("o"),
    "doing.empty": m.MemberMetrics("h", {}),
    "doing.full": m.MemberMetrics("h", FIGURES),
    "doing.extreme": m.MemberMetrics("h", {f"figure {n}": n / 7.0 for n in range(1000)}),
    "report.empty": m.Report("h", {}),
    "report.full": m.Report("h", FIGURES),
    "greet": m.Greet(),
    "welcome.empty": m.Welcome("", Vocabulary.of(), 0, 0.0, 0, ""),
    "welcome.full": m.Welcome("w", VOCABULARY, 7, 0.05, 12, "literal", SAVED),
    "welcome.extreme": m.Welcome("w", VOCABULARY, -(1 << 63), 5e-324, LAST_FRAME, saved={}),
    "refused.empty": m.Refused(""),
    "refused.full": m.Refused("another world, é"),
    "sources.empty": m.Sources({}),
    "sources.full": m.Sources({"scan": ("physics", "lidar"), "image": ()}),
    "tick.empty": m.TickRequest(0),
    "tick.full": m.TickRequest(128),
    "tick.extreme": m.TickRequest(LAST_FRAME),
    "fragments.empty": m.Fragments({}),
    "fragments.full": m.Fragments(POPULATION, ("b", LONG_ID)),
    "fragments.extreme": m.Fragments({str(n): STAR(float(n)) for n in range(70)}, NAMES),
    "evolve.empty": m.EvolveRequest(0, ()),
    "evolve.full": m.EvolveRequest(7, ("h", "i"), (*EVENTS, batch()), (SHOW(),), 2, ("a",)),
    "evolve.extreme": m.EvolveRequest(LAST_FRAME, NAMES, (MIXED,), (), LAST_FRAME, NAMES),
    "view.empty": m.ViewShown(frame=0, event_type="", sequence=0, parts={}),
    "view.full": m.ViewShown(
        frame=7, event_type="eShow", sequence=9, parts=VIEWS, skeleton=SLOTS, halted=("a", "b")
    ),
    "view.extreme": m.ViewShown(
        frame=LAST_FRAME, event_type="eShow", sequence=LAST_FRAME, skeleton=Scene(),
        parts={"a": Scene(), "~AFish.1": PATCH, "~AFish.2": WITH_ROWS}, halted=NAMES,
    ),
    "orders.empty": m.Orders(0, ()),
    "orders.full": m.Orders(8, (*EVENTS, MIXED)),
    "repeat.empty": m.Repeat(""),
    "repeat.full": m.Repeat("scan"),
    "stop.empty": m.Stop(""),
    "stop.full": m.Stop("the world has ended"),
    "frame.empty": m.FrameRecord(0, (), {}, b""),
    "frame.full": m.FrameRecord(7, (*EVENTS, MIXED), POPULATION, bytes(range(16))),
    "frame.extreme": m.FrameRecord(LAST_FRAME, (batch(),), {"a": Scene()}, b"\xff" * 16),
    "readings.empty": m.Readings("p", "scan", -1, ()),
    "readings.full": m.Readings("p", "scan", 7, READINGS),
    "readings.extreme": m.Readings("p", "scan", LAST_FRAME, READINGS[3:4] * 20),
}  # fmt: skip


def shown(data: bytes) -> str:
    """Bytes in hexadecimal; for long ones their number and a digest."""
    if len(data) <= LONGEST_HEX:
        return data.hex()
    return f"{len(data)} {blake2b(data, digest_size=16).hexdigest()}"


def recorded_messages() -> Mapping[str, str]:
    """Recorded values by sample."""
    return tomllib.loads(GOLDEN.read_text(encoding="utf-8"))


def main() -> int:
    parser = argparse.ArgumentParser(description="golden bytes of single messages")
    parser.add_argument("--record", action="store_true", help="write tests/golden/messages.toml")
    values = {name: shown(encode(message)) for name, message in MESSAGES.items()}
    if parser.parse_args().record:
        lines = [f'"{name}" = "{value}"' for name, value in values.items()]
        GOLDEN.write_text("\n".join([HEAD, *lines, ""]), encoding="utf-8")
        return 0
    known = recorded_messages()
    names = sorted(values.keys() | known.keys())
    differing = [name for name in names if values.get(name) != known.get(name)]
    print("\n".join(differing) or "all messages are as recorded")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
