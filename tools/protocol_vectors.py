"""Test vectors of the protocol for implementations in any language: protocol/vectors/*.json.

    python -m tools.protocol_vectors            # compare; exit code 1 if they differ
    python -m tools.protocol_vectors --write    # write them

Section 18 of PROTOCOL.md describes the notation. The cases of strings, columns and messages use
the vocabulary of the golden messages.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import msgpack
import numpy as np

from minerva_bus import Scene
from minerva_bus.errors import SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.batch import single
from minerva_bus.grammar.columns import Columns, merged, packed, unfolded
from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.delta import difference
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.printer import text, value_text
from minerva_bus.wire.arrays import plain_ids
from minerva_bus.wire.codec import FROM_MEMBER, encode
from minerva_bus.wire.columns import plain_columns, plain_patch
from minerva_bus.wire.epochs import stamp
from minerva_bus.wire.keys import is_name
from minerva_bus.wire.plain import pack
from minerva_bus.wire.readings import plain_reading
from minerva_bus.wire.values import plain_event, plain_scene, plain_value
from minerva_bus.wire.vocabulary import plain_vocabulary
from minerva_bus.world.lineage import copy_id
from minerva_bus.world.rng import Rng, answer_key, frame_key, hash_of, stream
from tools import golden_messages as golden

FOLDER: Final = Path(__file__).resolve().parents[1] / "protocol" / "vectors"
VOCABULARY: Final = golden.VOCABULARY
LONGEST_BYTES: Final = 20_000
"""Longest encoding of a case; longer golden messages are left out."""

Json: TypeAlias = Any
Cases: TypeAlias = Iterable[tuple[str, Json, Json]]


@dataclass(frozen=True, slots=True)
class Vectors:
    """One file: what it is about, the requirements that it shows, and its cases.

    `cases` yields the name, input and expected output of each case. `vocabulary`: whether the file
    contains the vocabulary, without which the cases cannot be read.
    """

    description: str
    requirements: tuple[str, ...]
    cases: Callable[[], Cases]
    vocabulary: bool = False

    def document(self) -> Json:
        """The content of the file."""
        head: dict[str, Json] = {
            "description": self.description,
            "requirements": list(self.requirements),
        }
        if self.vocabulary:
            head["vocabulary"] = tagged(plain_vocabulary(VOCABULARY))
        cases = [{"name": n, "input": given, "expected": e} for n, given, e in self.cases()]
        return {**head, "cases": cases}


# --- notation ---


def bits(number: float) -> str:
    """A float64 as 16 hexadecimal digits, most significant byte first."""
    return struct.pack(">d", number).hex()


def tagged(plain: Any) -> Json:
    """Plain data as JSON that keeps types: see section 18 of PROTOCOL.md."""
    match plain:
        case None | bool() | str():
            return plain
        case int():
            return {"int": str(plain)}
        case float():
            return {"float": bits(plain)}
        case bytes():
            return {"bytes": plain.hex()}
        case msgpack.ExtType():
            return {"ext": plain.code, "bytes": plain.data.hex()}
        case list() | tuple():
            return [tagged(item) for item in plain]
        case dict():
            return {"map": [[key, tagged(value)] for key, value in plain.items()]}
        case _:
            raise TypeError(f"{type(plain).__name__} has no notation")


def packed_hex(plain: Any) -> str:
    """Plain data as MessagePack in hexadecimal."""
    return pack(plain).hex()


# --- numbers and texts ---

FLOATS: Final = {
    "zero": 0.0, "minus zero": -0.0, "one": 1.0, "tenth": 0.1, "third": 1 / 3,
    "sum of a tenth and a fifth": 0.1 + 0.2, "whole": 1500.0, "negative": -2.5,
    "least that is written without exponent": 1e-4, "below it": 9.999999999999999e-05,
    "small": 1e-5, "greatest that is written without exponent": 9999999999999998.0,
    "exponent from 1e16": 1e16, "exponent of three digits": 1.5e100, "greatest exponent": 1e308,
    "greatest": 1.7976931348623157e308, "least normal": 2.2250738585072014e-308,
    "greatest denormal": 2.225073858507201e-308, "denormal": 1e-310, "least denormal": 5e-324,
    "negative denormal": -5e-324, "two to the 53": 2.0**53, "two to the 63": 2.0**63,
    "shortest of several": 5e-5, "halfway": 9007199254740993.0,
    "next after one": 1.0000000000000002,
    "greatest float32": 3.4028234663852886e38, "pi": 3.141592653589793, "million": 1e6,
}  # fmt: skip


def floats() -> Cases:
    """The text and the encoding of a real."""
    for name, number in FLOATS.items():
        expected = {"text": value_text(number), "msgpack": packed_hex(number)}
        yield name, bits(number), expected


INTEGERS: Final = (
    *(0, 1, 127, 128, 255, 256, 65535, 65536, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 32),
    *((1 << 53) - 1, 1 << 53, (1 << 53) + 1, (1 << 63) - 1),
    *(-1, -32, -33, -128, -129, -32768, -32769, -(1 << 31), -(1 << 31) - 1, -(1 << 53) - 1),
    -(1 << 63),
)


def integers() -> Cases:
    """The shortest encoding of an int, and one of 64 bits that a reader accepts as well."""
    for number in INTEGERS:
        longest = b"\xcf" if number >= 0 else b"\xd3"
        wide = longest + (number % (1 << 64)).to_bytes(8, "big")
        expected = {"text": str(number), "msgpack": packed_hex(number), "accepted": wide.hex()}
        yield str(number), str(number), expected


TEXTS: Final = {
    "empty": "", "plain": "kitchen", "quotes": 'a "b"', "backslash": "a\\b", "slash": "a/b",
    "line feed, tab, return": "a\n\t\r", "backspace, form feed": "\b\f", "control": "\x00\x1f",
    "delete is not escaped": "\x7f", "two bytes": "é", "three bytes": "€",
    "four bytes": "𝄞", "combining, not normalized": "e\u0301", "right to left": "שלום",
    "joined emoji": "👩\u200d🚀", "no-break space": "\u00a0", "separators": "\u2028\u2029",
    "byte order mark": "\ufeff", "last code point": "\U0010ffff", "32 bytes": "x" * 32,
}  # fmt: skip


def texts() -> Cases:
    """The quoted text and the encoding of a text, given by its code points."""
    for name, value in TEXTS.items():
        expected = {"text": value_text(value), "msgpack": packed_hex(value)}
        yield name, [ord(char) for char in value], expected


VALUES: Final[Mapping[str, Any]] = {
    "cells": np.array([[0, 1], [2, -1]], np.int16),
    "cells, least and greatest": np.array([[-32768, 32767]], np.int16),
    "matrix": np.array([[0.5]], np.float64),
    "matrix, minus zero and denormal": np.array([[-0.0, 5e-324]], np.float64),
    "list": (1.5, 2.0),
    "list of texts": ("a", ""),
    "nested lists": ((1,), ()),
    "string": golden.STAR_BOX,
    "empty string": Scene(),
    "true": True,
}


def values() -> Cases:
    """The text and the encoding of other values."""
    for name, value in VALUES.items():
        yield name, {"text": value_text(value)}, {"msgpack": packed_hex(plain_value(value))}


# --- strings, columns and events ---


def fishes(count: int) -> str:
    """A population as text."""
    return " · ".join(f"AFish#f{n}<x={n}>" for n in range(count))


STRINGS: Final = {
    "empty": "ε", "figure": "PStar<size=0.5>", "agent": 'AFox#a<x=2, name="é">()',
    "no attributes": "AStone#s()",
    "nested": 'PStar<size=0.5> · TMove<dist=1.5>(AFox#a<x=2, name="é">(PStar<size=1>) · '
    "PStar<size=1>)",
    "deep": "TMove<dist=1>(" * 40 + "PStar<size=1>" + ")" * 40,
    "agent in an agent": 'AFox#a<x=0, name="">(AFish#b<x=-0.0>(AStone#c()))',
    "denormal and exponents": "PStar<size=5e-324> · PStar<size=1e+16> · PStar<size=1e-05>",
    "string as a value": "PBox<inside={PStar<size=1> · PStar<size=2>}>",
    "31 neighbours are single nodes": fishes(31), "32 neighbours are a run": fishes(32),
    "two runs": f"{fishes(32)} · {' · '.join(['PStar<size=1>'] * 40)}",
    "a run between nodes": f"PBox<inside={{ε}}> · {fishes(33)} · AStone#s()",
    "a run of nested figures": " · ".join(
        f"TMove<dist={n}>(PStar<size=0.25>)" for n in range(32)
    ),
    "a run of minus zeros": " · ".join(["PStar<size=-0.0>"] * 32),
    "a run of texts": " · ".join(f'AFox#g{n}<x=0, name="é{n}">' for n in range(32)),
}  # fmt: skip


def strings() -> Cases:
    """The encoding without columns and the digest of a string, given as text."""
    for name, written in STRINGS.items():
        scene = unfolded(VOCABULARY.read(written))
        expected = {"msgpack": packed_hex(plain_scene(scene)), "digest": scene.digest.hex()}
        yield name, text(scene) or "ε", expected


def _of_rows(count: int) -> Scene:
    return packed(VOCABULARY.read(fishes(count)))


def digests() -> Cases:
    """The digests of long runs, of which only the columns are given."""
    for count in (32, 4096, 4097):
        scene = _of_rows(count)
        yield f"{count} rows", packed_hex(plain_scene(scene)), scene.digest.hex()
    ends = Scene((merged(_of_rows(32).pieces), *VOCABULARY.read("AStone#s()").pieces))
    yield "a run and a node", packed_hex(plain_scene(ends)), ends.digest.hex()


COLUMNS: Final[Mapping[str, Columns]] = {
    "agents with consecutive ids": golden.fishes(0, 3),
    "one row": golden.fishes(7, 1),
    "figures in transformations": golden.stars(3),
    "ids without a common stem": merged(
        VOCABULARY.read("AFish#a<x=1> · AFish#b:1<x=-0.0> · AFish#c<x=5e-324>").pieces
    ),
    "texts": merged(VOCABULARY.read('AFox#a<x=1, name="é"> · AFox#b<x=1, name="">').pieces),
    "texts that are ids": merged(
        VOCABULARY.read('AFox#f1<x=1, name="f1"> · AFox#f2<x=1, name="f3">').pieces
    ),
}


def columns() -> Cases:
    """Columns, and the same nodes one by one."""
    for name, group in COLUMNS.items():
        scene = Scene((group,))
        single_nodes = unfolded(scene)
        expected = {"msgpack": packed_hex(plain_scene(single_nodes)), "text": text(single_nodes)}
        yield name, packed_hex(plain_columns(group)), expected


IDS: Final = {
    "consecutive": Ids("f", np.arange(3)), "numbered": Ids("f", np.array([3, 1, 2])),
    "from another number": Ids("agent-", np.arange(70_000, 70_003)),
    "spelled": Ids.of(["a", "b:1", "c-2"]), "one": Ids.of(["a"]), "long": Ids.of(["x" * 64, "y"]),
}  # fmt: skip


def ids() -> Cases:
    """The forms of ids."""
    for name, group in IDS.items():
        yield name, packed_hex(plain_ids(group)), group.texts()


PATCHES: Final = {
    "one value": (fishes(6), fishes(6).replace("x=2>", "x=-0.0>")),
    "all values": (fishes(2), "AFish#f0<x=7> · AFish#f1<x=8>"),
    "a death": (fishes(8), fishes(8).replace("AFish#f3<x=3> · ", "")),
    "the last one dies": (fishes(8), fishes(7)),
    "a birth": (fishes(8), f"{fishes(8)} · AFish#f7:1<x=0.5>"),
    "birth, death and change": (
        fishes(8),
        fishes(8).replace("AFish#f0<x=0>", "AFish#f1:1<x=9>").replace("x=5>", "x=6>"),
    ),
    "two columns": (
        'AFox#a<x=1, name="p"> · AFox#b<x=2, name="q">',
        'AFox#a<x=3, name="p"> · AFox#b<x=2, name="r">',
    ),
}


def _merged(written: str) -> Columns:
    return merged(VOCABULARY.read(written).pieces)


def patches() -> Cases:
    """Columns and a patch, and the nodes after it."""
    for name, (before, after) in PATCHES.items():
        old, new = _merged(before), _merged(after)
        delta = difference(old, new)
        assert delta is not None, name
        given = {
            "columns": packed_hex(plain_columns(old)),
            "patch": packed_hex(plain_patch(delta)),
        }
        changed = unfolded(Scene((new,)))
        expected = {"msgpack": packed_hex(plain_scene(changed)), "text": text(changed)}
        yield name, given, expected


def events() -> Cases:
    """Events and batches, and the single events that they stand for."""
    for event in (*golden.EVENTS, golden.MIXED, golden.batch(3)):
        plain = [plain_event(each) for each in single([event])]
        shown = {"text": [str(each) for each in single([event])], "msgpack": packed_hex(plain)}
        yield f"{event.type} of {len(plain)}", packed_hex(plain_event(event)), shown


CONDITIONS: Final = (
    *("", "x < 5", "x <= 4.5", "x > 4.5", "x == 4.5", "x != 4.5", 'name == "é"', "alive"),
    *("alive == true", "not (x < 5)", "x < 5 and alive == false", "x < 5 or alive == false"),
    *('not alive == false and (name == "é" or x > 9)', "count == 3", "count < x", "missing < 5"),
    *("not missing < 5", 'name < "f"', "x ==", "(x < 5", "x < 5 and", "x = 5", "name < 5"),
)
STATE: Final = {"x": 4.5, "count": 3, "name": "é", "alive": True}


def conditions() -> Cases:
    """Whether a condition holds for a state; `refused` for one that is no condition."""
    for condition in CONDITIONS:
        try:
            expected: Json = holds(condition, STATE)
        except SceneError:
            expected = "refused"
        given = {"condition": condition, "state": tagged(STATE)}
        yield condition or "empty", given, expected


# --- random streams ---

STREAMS: Final = (
    *((7, "a", 3), (0, "rain", 0), (-1, "f1:1", 100), ((1 << 63) - 1, "é", 1 << 40)),
    (-(1 << 63), "x" * 64, 5),
)
DRAWS: Final = 9


def _given(seed: int, who: str, frame: int) -> dict[str, Json]:
    return {"seed": str(seed), "who": who, "frame": str(frame)}


def philox() -> Cases:
    """The first numbers of a member's or an agent's Philox stream."""
    for seed, name, frame in STREAMS:
        who = name if name == "rain" else f"#{name}"
        words = stream(seed, who, frame).bit_generator.random_raw(DRAWS).tolist()
        random = stream(seed, who, frame)
        numbers = [bits(random.random()) for _ in words]
        key = stream(seed, who, frame).bit_generator.state["state"]["key"].tolist()
        expected = {
            "key": [f"{word:016x}" for word in key],
            "words": [f"{word:016x}" for word in words],
            "numbers": numbers,
        }
        yield f"{seed} {who} {frame}", _given(seed, who, frame), expected


def _splitmix(key: int, who: str) -> Json:
    random = Rng.of(hash_of(who), key)
    word = f"{random.word:016x}"
    return {"word": word, "numbers": [bits(random.random()) for _ in range(DRAWS)]}


def splitmix64() -> Cases:
    """The first numbers of an agent's SplitMix64 stream."""
    for seed, who, frame in STREAMS:
        expected = {"hash": f"{hash_of(who):016x}", **_splitmix(frame_key(seed, frame), who)}
        yield f"{seed} {who} {frame}", _given(seed, who, frame), expected


def responses() -> Cases:
    """The stream that decides about events with a probability."""
    for seed, who, frame in STREAMS:
        given = {**_given(seed, who, frame), "event_type": "eNear"}
        yield f"{seed} {who} {frame}", given, _splitmix(answer_key(seed, frame, "eNear"), who)


def distributions() -> Cases:
    """Normal and exponential numbers, each the first of the stream with this word."""
    for word in (0, 3, 1 << 63, (1 << 64) - 1, 0x13DF69F3D588EC2B):
        expected = {
            "normal": bits(Rng(word).normal()),
            "exponential": bits(Rng(word).exponential()),
            "uniform": bits(Rng(word).uniform(-1.0, 3.0)),
            "integer": str(Rng(word).integers(-5, 100)),
        }
        yield f"{word:016x}", {"word": f"{word:016x}"}, expected


COPIES: Final = (("a", 7, 2, 1), ("a", 7, 2, 3), ("a:1", 0, 10, 1), ("x" * 64, 7, 2, 1),
                 ("fox:3-2", 12, 3, 2), (f"{'y' * 30}:{'z' * 33}", 1 << 40, 2, 1))  # fmt: skip


def copies() -> Cases:
    """Ids of copies under the literal policy."""
    for original, frame, number, height in COPIES:
        given = {"id": original, "frame": str(frame), "copy": number, "height": height}
        yield f"{original[:12]} {number} {height}", given, copy_id(original, frame, number, height)


# --- messages ---


def _messages() -> Iterator[tuple[str, m.Message, bytes]]:
    for name, message in golden.MESSAGES.items():
        data = encode(message)
        if len(data) <= LONGEST_BYTES:
            yield name, message, data


def messages() -> Cases:
    """Messages as bytes, and what these are."""
    for name, message, data in _messages():
        plain: Any = msgpack.unpackb(data, ext_hook=msgpack.ExtType)
        sender = "member" if plain[0] in FROM_MEMBER else "coordinator"
        sender = "anyone" if isinstance(message, m.Readings | m.FrameRecord) else sender
        yield name, {"sender": sender, "msgpack": data.hex()}, tagged(plain)


def readings() -> Cases:
    """Readings as bytes, and what these are."""
    for number, reading in enumerate(golden.READINGS):
        plain = plain_reading(reading)
        yield f"{plain[0]} {number}", packed_hex(plain), tagged(plain)


def epochs() -> Cases:
    """A message with the epoch of its coordinator."""
    tick = encode(m.TickRequest(7))
    for epoch in (0, 1, 127, 128, 255, 256, 65535, 65536, 1_700_000_000, 1 << 32, (1 << 63) - 1):
        given = {"epoch": str(epoch), "message": tick.hex()}
        yield str(epoch), given, (stamp(epoch) + tick).hex()


def _refused() -> Iterator[tuple[str, bytes]]:
    reply = encode(m.TickReply("g", 7, golden.EVENTS[:1]))
    yield "nothing", b""
    yield "no list", pack({"ticked": 7})
    yield "an empty list", pack([])
    yield "an unknown message", pack(["tocked", 7])
    yield "cut off", reply[:-1]
    yield "data after the end", reply + b"\xc0"
    yield "a name that is no text", pack([7, 7, [], None])
    yield "too few items", pack(["ticked", 7, []])
    yield "too many items", pack(["ticked", 7, [], None, None])
    yield "a negative frame", pack(["ticked", -1, [], None])
    yield "a frame that is no integer", pack(["ticked", 7.0, [], None])
    yield "a bool as frame", pack(["ticked", True, [], None])
    yield "nil as a value", pack(["ticked", 7, [["eNear", [None]]], None])
    yield "a number that is not finite", pack(["ticked", 7, [["eNear", [float("inf")]]], None])
    yield "a text for a number", pack(["ticked", 7, [["eNear", ["0.5"]]], None])
    yield "an unknown event type", pack(["ticked", 7, [["eFar", [0.5]]], None])
    yield "an event without its data", pack(["ticked", 7, [["eNear", []]], None])
    yield "an event of three items", pack(["ticked", 7, [["eNear", [0.5], ""]], None])
    yield "a condition that is none", pack(["ticked", 7, [["eNear", [0.5], "x <", "", []]], None])
    yield "an invalid id", pack(["ticked", 7, [["eNear", [0.5], "", "", ["a b"]]], None])
    yield "a key that is no text", pack(["ticked", 7, [], {1: 2}])
    yield "text that is not UTF-8", b"\x94\xa6ticked\x07\x90\x81\xa1\xff\x01"
    for name, changed in (
        ("a string that is cut off", [2, ["PStar", [0.5]]]),
        ("a string with data after its end", [0, ["PStar", [0.5]]]),
        ("a symbol that the vocabulary lacks", [1, ["PMoon", [0.5]]]),
        ("a value too few", [1, ["PStar", []]]),
        ("a slot outside a skeleton", [1, ["AFox", "a", None, 0]]),
        ("two agents with one id", [2, ["AStone", "s", [], 0], ["AStone", "s", [], 0]]),
        ("a figure with a scope", [1, ["PStar", [0.5], 0]]),
    ):
        yield name, pack(["evolved", 7, 0, {"a": changed}, {}, {}])


def refused() -> Cases:
    """Messages of members that a reader refuses."""
    for name, data in _refused():
        yield name, data.hex(), "refused"


NAMES: Final = ("a", "A-1", "_x", "0", "a.b~c", "x" * 64, "", "x" * 65, "-a", ".a", "~a", "a b",
                "a/b", "é", "a*", "a$", "a?", "a#")  # fmt: skip


def names() -> Cases:
    """Whether a text can name a world, a member or a topic."""
    for name in NAMES:
        yield name or "empty", name, is_name(name)


FILES: Final[Mapping[str, Vectors]] = {
    "floats": Vectors(
        "Reals. Input: the bits of a float64. Expected: its text and its MessagePack.",
        ("P5.4",), floats,
    ),
    "integers": Vectors(
        "64-bit integers. Expected: text, shortest MessagePack, a longer form that is accepted.",
        ("P3.1", "P5.4"), integers,
    ),
    "texts": Vectors(
        "Unicode. Input: code points. Expected: quoted text, as in digests, and MessagePack.",
        ("P3.2", "P5.4"), texts,
    ),
    "values": Vectors(
        "Lists, matrices and strings as values. Input: text. Expected: MessagePack.",
        ("P3.4", "P3.5"), values, vocabulary=True,
    ),
    "strings": Vectors(
        "Strings. Input: text. Expected: MessagePack of single nodes, and the digest.",
        ("P3.6", "P3.7", "P3.8", "P5.1", "P5.2", "P5.3"), strings, vocabulary=True,
    ),
    "digests": Vectors(
        "Digests of strings in columns. Input: MessagePack of the string. Expected: the digest.",
        ("P5.1", "P5.2"), digests, vocabulary=True,
    ),
    "columns": Vectors(
        "Columns. Input: MessagePack. Expected: the same string of single nodes.",
        ("P3.15", "P3.16", "P3.17"), columns, vocabulary=True,
    ),
    "ids": Vectors("Columns of ids. Input: MessagePack. Expected: the ids.", ("P3.18",), ids),
    "patches": Vectors(
        "Patches. Input: columns and a patch. Expected: the string after it, of single nodes.",
        ("P3.20", "P3.21"), patches, vocabulary=True,
    ),
    "events": Vectors(
        "Events. Input: MessagePack of an event or a batch. Expected: a list of single events.",
        ("P3.13", "P3.14", "P3.19"), events, vocabulary=True,
    ),
    "conditions": Vectors(
        "Conditions of events. Input: text, and an agent's attributes. Expected: whether it holds.",
        ("P3.10",), conditions,
    ),
    "philox": Vectors(
        "Philox streams. Expected: key, lower word first; the first words and numbers.",
        ("P9.24", "P9.28"), philox,
    ),
    "splitmix64": Vectors(
        "SplitMix64 streams of agents. Expected: hash of the id, first state, first numbers.",
        ("P9.25", "P9.26", "P9.27"), splitmix64,
    ),
    "responses": Vectors(
        "Streams that decide about events with a probability. Expected: first state and numbers.",
        ("P9.30",), responses,
    ),
    "distributions": Vectors(
        "Distributions. Input: state of a SplitMix64 stream. Expected: the first number of each;"
        " uniform from -1 to 3, integer from -5 to 99.",
        ("P9.29",), distributions,
    ),
    "copies": Vectors("Ids of copies under the literal policy.", ("P9.14",), copies),
    "messages": Vectors(
        "Messages. Input: MessagePack without the epoch. Expected: the message.",
        ("P3.1", "P8.1", "P8.2"), messages, vocabulary=True,
    ),
    "readings": Vectors(
        "Readings. Input: MessagePack of one reading. Expected: the reading.",
        ("P11.1",), readings,
    ),
    "epochs": Vectors(
        "Epochs. Input: epoch and message. Expected: the payload.", ("P2.5",), epochs
    ),
    "refused": Vectors(
        "Messages of members that a reader refuses.", ("P14.2",), refused, vocabulary=True
    ),
    "names": Vectors("Names of worlds, members and topics: valid or not.", ("P2.1",), names),
}  # fmt: skip


def contents() -> dict[str, str]:
    """The content of each file, by its name."""
    return {f"{name}.json": _lines(vectors.document()) for name, vectors in sorted(FILES.items())}


def _lines(document: Json) -> str:
    """JSON with one case per line, so that a difference shows the case."""
    head = [f" {json.dumps(k)}: {json.dumps(v)}" for k, v in document.items() if k != "cases"]
    cases = ",\n".join(f"  {json.dumps(case)}" for case in document["cases"])
    return "{\n" + ",\n".join([*head, f' "cases": [\n{cases}\n ]']) + "\n}\n"


def main() -> int:
    parser = argparse.ArgumentParser(description="test vectors of the protocol")
    parser.add_argument("--write", action="store_true", help="write protocol/vectors")
    wanted = contents()
    if parser.parse_args().write:
        FOLDER.mkdir(parents=True, exist_ok=True)
        for name, content in wanted.items():
            (FOLDER / name).write_text(content, encoding="utf-8")
        return 0
    known = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    names = sorted(wanted.keys() | known.keys())
    differing = [name for name in names if wanted.get(name) != known.get(name)]
    print("\n".join(differing) or "the vectors are up to date")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
