"""Numbers that are not finite are rejected anywhere in a message."""

import math

import msgpack
import numpy as np
import pytest

from minerva_bus import (
    EventType,
    Generator,
    Metres,
    Primitive,
    Reals,
    Scene,
    Transformation,
    Vocabulary,
)
from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.member import Member
from minerva_bus.grammar.forms import Disc, Motion
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.plain import unpack
from minerva_bus.wire.readings import read_reading
from minerva_bus.wire.status import read_status
from minerva_bus.wire.vocabulary import plain_vocabulary

ODD = (math.nan, math.inf, -math.inf)
ALL = EventType("eAll", x=Metres, some=tuple[float, ...], matrix=Reals, string=Scene)
DOTS = Primitive("PDot", size=float, shape=Disc(0.5))
VOCABULARY = Vocabulary.of(ALL, DOTS, Transformation("TAt", x=Metres, motion=Motion(x=0.5)))
DECODER = Decoder(VOCABULARY)


def column(*values):
    return msgpack.ExtType(3, b"d" + np.array(values, "<f8").tobytes())


MATRIX = msgpack.ExtType(1, b"r" + b"\x01\0\0\0\x02\0\0\0" + bytes(16))
DOT = [1, ["TAt", [1.0], 1], ["PDot", [0.5]]]
MANY = [1, [2, None, [["TAt", [column(1.0, 2.0)]], ["PDot", [column(0.5, 0.5)]]]]]
PATCH = ["patch", 2, ["TAt", "PDot"], [[0, 0, None, column(1.0, 2.0)]]]
EVENT = ["eAll", [1.0, [2.0, 3.0], MATRIX, msgpack.ExtType(2, msgpack.packb(DOT))]]
DRAWN = {"a": DOT, "b": MANY, "c": PATCH}
KIND = ["AFox", [["x", "real m", "0.5"]], [["eAll", 0.5]], [], ["x"]]
SPOKEN = {
    "hello": [{
        "version": PROTOCOL_VERSION, "kinds": [KIND], "generates": [], "when": "at 2.5 Hz",
        "orders": [], "draws": [], "coupled": False, "topics": [], "publishes": [],
        "about": {"service": "", "pid": 1, "host": "", "load": 2.5},
    }],
    "ticked": [1, [EVENT], None],
    "evolved": [1, 0, DRAWN, {"a": [EVENT]}, {"eAll": DRAWN}],
    "emitted": [[EVENT]],
    "doing": [{"mean": 0.5}],
    "report": [{"mean": 0.5}],
}  # fmt: skip
HEARD = {
    "welcome": ["w", {**plain_vocabulary(VOCABULARY), "kinds": [KIND]}, 7, 0.1, 0, "literal", None],
    "fragments": [{"a": DOT, "b": MANY}, []],
    "evolve": [1, [], [EVENT], [EVENT], 0, []],
    "view": ["eAll", 1, 0, DRAWN, DOT, ["a"]],
    "orders": [3, [EVENT]],
}
READINGS = [
    ["scan", "r", 0.5, bytes(8), 0.0, 1.0, 8.0, [0.0, 0.0, 0.0]],
    ["sightings", "r", 0.5, [["m", 1.0, 2.0]]],
    ["image", "r", 0.5, "mono8", 1, 1, b"\0", [0.0, 0.0, 0.0]],
    ["odometry", "r", 0.5, 1.0, 2.0, 3.0, 4.0, 5.0],
    ["battery", "r", 0.5, 0.5, 12.0],
    ["position", "r", 0.5, 1.0, 2.0, 3.0, 4.0],
]
CASES = [
    *((DECODER.to_member, [name, *items]) for name, items in HEARD.items()),
    *((lambda data: DECODER.from_member("a", data), [name, *items])
      for name, items in SPOKEN.items()),
    (lambda data: DECODER.readings("t", "a", data), ["readings", 1, READINGS]),
    (DECODER.record, ["frame", 1, [EVENT], {"a": DOT, "b": MANY}, b""]),
]  # fmt: skip


def spoilt(plain, odd):
    """Copies of the data, each with one of its numbers replaced by another."""
    if isinstance(plain, float):
        yield odd
    elif isinstance(plain, list):
        for place, value in enumerate(plain):
            for other in spoilt(value, odd):
                yield [*plain[:place], other, *plain[place + 1 :]]
    elif isinstance(plain, dict):
        for name, value in plain.items():
            for other in spoilt(value, odd):
                yield {**plain, name: other}
    elif isinstance(plain, msgpack.ExtType) and plain.code == 2:
        for other in spoilt(unpack(plain.data), odd):
            yield msgpack.ExtType(2, msgpack.packb(other))
    elif isinstance(plain, msgpack.ExtType):  # A matrix or a column: its last number.
        yield msgpack.ExtType(plain.code, plain.data[:-8] + np.float64(odd).tobytes())


@pytest.mark.parametrize(("read", "plain"), CASES, ids=[plain[0] for _, plain in CASES])
def test_a_message_with_a_number_that_is_none_is_refused(read, plain):
    assert read(msgpack.packb(plain))
    count = 0
    for odd in ODD:
        for damaged in spoilt(plain, odd):
            count += 1
            with pytest.raises((ProtocolError, SceneError)):
                read(msgpack.packb(damaged))
    assert count


@pytest.mark.parametrize("name", ["doing", "report"])
@pytest.mark.parametrize("odd", [*ODD, None, [1.0]])
def test_a_figure_is_a_finite_number_or_a_text(name, odd):
    with pytest.raises(ProtocolError, match="figures: mean must be a finite number or text"):
        DECODER.from_member("a", msgpack.packb([name, {"mean": odd}]))
    figures = {"mean": 0.5, "count": 1, "on": True, "how": "well"}
    assert DECODER.from_member("a", msgpack.packb([name, figures])).figures == figures


@pytest.mark.parametrize("odd", ODD)
def test_a_member_of_ours_leaves_out_what_is_none(odd):
    class Meter(Generator):
        def report(self):
            return {"count": 1, "mean": odd, "how": "well"}

    assert Member("meter", Meter()).figures() == {"count": 1, "how": "well"}


@pytest.mark.parametrize("odd", ODD)
def test_figures_are_as_finite_where_a_status_has_them(odd):
    member = {"name": "a", "state": "present", "figures": {"mean": odd}}
    with pytest.raises(ProtocolError, match="figures: mean must be a finite number"):
        read_status({"world": "w", "frame": 1, "members": [member]})


def test_a_range_is_a_number_and_as_far_as_one_likes():
    def scan(*ranges):
        return ["scan", "r", 0.5, np.array(ranges, "<f4").tobytes(), *READINGS[0][4:]]

    with pytest.raises(ProtocolError, match="not a number; 0 means that nothing was hit"):
        read_reading(scan(1.0, math.nan))
    assert read_reading(scan(1.0, math.inf, -1.0)).ranges.tolist() == [1.0, math.inf, -1.0]
