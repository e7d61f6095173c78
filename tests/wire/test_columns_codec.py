"""Columns on the wire: a round trip preserves them, and invalid data are rejected."""

from __future__ import annotations

from dataclasses import replace

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import (
    Agent,
    Default,
    EventType,
    Ids,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
)
from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.columns import Columns, Delta, difference
from minerva_bus.grammar.events import Events
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.columns_codec import plain_columns, plain_events, plain_ids, plain_patch
from minerva_bus.wire.plain import Limits
from minerva_bus.wire.strings_codec import Reader, plain_scene

PDot = Primitive("PDot", size=float, name=str)
TMove = Transformation("TMove", x=Metres)
eHit = EventType("eHit", amount=float, count=int, hard=bool, why=Default(str, ""))


class Fish(Agent, symbol="AFish"):
    """An attribute of each type that can be a column."""

    x: Metres = 0.0
    age: int = 0
    calm: bool = True
    name: str = ""

    @on("eHit")
    def suffer(self, hit, moment):
        self.calm = False


VOCABULARY = Vocabulary.of(PDot, TMove, eHit, Fish)
READER = Reader(VOCABULARY)

wholes = st.one_of(
    st.integers(-100, 100), st.integers(-40_000, 40_000), st.integers(-(1 << 63), (1 << 63) - 1)
)
reals = st.floats(allow_nan=False, allow_infinity=False)
letters = st.text("abcé\n\0", max_size=4)
id_texts = st.text("ab01", min_size=1, max_size=4)


def test_equal_ids_have_equal_bytes_even_if_taken_from_longer_ones():
    short, long = ["a", "b"], ["a", "b", "abcdefgh"]
    assert plain_ids(Ids.of(long).take(slice(0, 2))) == plain_ids(Ids.of(short)) == [None, 1, b"ab"]
    assert plain_ids(Ids.of(long).take(slice(0, 0)))[2] == b""


def column(draw, values, count, dtype):
    array = np.empty(count, dtype)
    array[:] = draw(st.lists(values, min_size=count, max_size=count))
    return array


@st.composite
def shoals(draw):
    ids = Ids.of(draw(st.lists(id_texts, unique=True, min_size=1, max_size=8)))
    count = len(ids)
    return Fish.many(
        ids,
        x=column(draw, reals, count, float),
        age=column(draw, wholes, count, np.int64),
        calm=column(draw, st.booleans(), count, bool),
        name=column(draw, letters, count, object),
    )


@st.composite
def many_events(draw):
    ids = Ids.of(draw(st.lists(id_texts, min_size=1, max_size=8)))
    count = len(ids)
    return Events(
        "eHit",
        ("amount", "count", "hard", "why"),
        eHit(
            column(draw, reals, count, float),
            column(draw, wholes, count, np.int64),
            column(draw, st.booleans(), count, bool),
            column(draw, letters, count, object),
        ).columns,
        count,
        draw(st.sampled_from(["", "x < 3", 'name == "é"'])),
        draw(st.sampled_from([None, ids])),
        draw(st.sampled_from([None, ids])),
    )


def through(plain):
    return msgpack.unpackb(msgpack.packb(plain), ext_hook=msgpack.ExtType)


@given(shoals())
def test_columns_that_have_travelled_are_the_same(w):
    back = READER.scene(through(plain_scene(w)))
    assert isinstance(back.pieces[0], Columns)
    assert back == w
    assert back.nodes == w.nodes
    assert all(
        column.array.dtype == other.array.dtype
        for column, other in zip(back.pieces[0].columns, w.pieces[0].columns, strict=True)
    )


@given(shoals(), reals)
def test_columns_within_columns_travel_too(w, size):
    count = w.pieces[0].count
    shown = TMove(w.pieces[0].columns[0].array)(TMove(np.zeros(count))(PDot(size, w.pieces[0].ids)))
    back = READER.view(through(plain_scene(Scene((*shown.pieces, *PDot(1, "a").pieces)))))
    assert str(back) == str(shown + PDot(1, "a"))


@given(many_events())
def test_events_that_have_travelled_are_the_same(events):
    back = READER.event(through(plain_events(events)))
    assert isinstance(back, Events)
    assert list(back) == list(events)


@given(shoals(), st.data())
def test_a_reply_with_patches_travels(w, data):
    old = w.pieces[0]
    rows = np.array(sorted(data.draw(st.sets(st.integers(0, old.count - 1), min_size=1))))
    x = old.columns[0].put(rows, np.arange(len(rows)) + 0.5)
    patch = difference(old, old.with_columns([x, *old.columns[1:]]))
    reply = m.EvolveReply("h", 3, 0, {"a": w, "~AFish.1": patch}, {}, {"eHit": {"b": PDot(1, "a")}})
    back = Decoder(VOCABULARY).from_member("h", encode(reply))
    assert list(back.changed) == ["a", "~AFish.1"]
    assert back.changed["a"] == w
    (change,) = back.changed["~AFish.1"].changes
    rows_read = np.arange(old.count) if change.rows is None else change.rows
    assert set(rows_read.tolist()) >= set(rows.tolist())
    assert change.column.list() == x.array[rows_read].tolist()


# --- invalid data ---

SHOAL = Fish.many("f", 3, x=np.array([1.0, 2.0, 3.0])).pieces[0]
PATCH = Delta(
    3,
    ("AFish",),
    difference(
        SHOAL,
        SHOAL.with_columns(
            [SHOAL.columns[0].put(np.array([1]), np.array([9.0])), *SHOAL.columns[1:]]
        ),
    ).changes,
)
HITS = eHit(np.ones(3), np.arange(3), False, receivers=Ids.numbered("f", range(3)))

junk = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-3, 300),
        st.floats(),
        st.text("APTe~f01.", max_size=6),
        st.binary(max_size=9),
        st.builds(msgpack.ExtType, st.integers(0, 4), st.binary(max_size=20)),
        st.builds(lambda d: msgpack.ExtType(3, d), st.binary(max_size=26)),
    ),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=5,
)


@st.composite
def spoilt(draw, plain):
    """The data with one item replaced or removed."""
    copy = through(plain)
    at, inside = draw(st.integers(0, len(copy) - 1)), copy
    while isinstance(inside[at], list) and inside[at] and draw(st.booleans()):
        inside = inside[at]
        at = draw(st.integers(0, len(inside) - 1))
    if draw(st.booleans()):
        inside[at] = draw(junk)
    else:
        del inside[at]
    return copy


@pytest.mark.parametrize(
    ("plain", "read"),
    [
        ([1, plain_columns(SHOAL)], READER.scene),
        (plain_events(HITS), READER.event),
        (plain_patch(PATCH), READER.patch),
    ],
    ids=["columns", "events", "patch"],
)
def test_spoilt_columns_are_refused_or_right(plain, read):
    @given(spoilt(plain))
    def check(wrong):
        try:
            result = read(wrong)
        except (ProtocolError, SceneError):
            return
        if isinstance(result, Scene):
            assert VOCABULARY.check(result) == result
        elif isinstance(result, Events):
            assert [VOCABULARY.check_event(event) for event in result] == list(result)

    check()


def columns_with(change):
    plain = plain_columns(SHOAL)
    change(plain)
    return [1, plain]


def ext(data):
    return msgpack.ExtType(3, data)


DOTS = ["PDot", [ext(b"d" + bytes(24)), ["a", "b", "c"]]]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: p.__setitem__(0, 2), "has 3 values; expected 2"),
        (lambda p: p.__setitem__(0, 0), "whole number from 1"),
        (lambda p: p.__setitem__(1, None), "cannot stand in columns"),
        (lambda p: p.__setitem__(1, ["f", ext(b"b\0\1\1")]), "two agents have the id #f1"),
        (lambda p: p.__setitem__(1, ["f", ext(b"b\0\1\xff")]), "from 0"),
        (lambda p: p.__setitem__(1, ["-f", ext(b"b\0\1\2")]), "not a valid agent id"),
        (lambda p: p.__setitem__(1, [None, 2, b"a\0b\0"]), "3 ids of 2 bytes"),
        (lambda p: p[2][0].__setitem__(0, "AGhost"), "has no AGhost"),
        (lambda p: p[2][0].__setitem__(0, "PDot"), "PDot has 4 columns; expected 2"),
        (lambda p: p[2][0][1].pop(), "3 columns; expected 4"),
        (lambda p: p[2][0][1].__setitem__(0, ext(b"x" + bytes(24))), "of type b'x'"),
        (lambda p: p[2][0][1].__setitem__(0, ext(b"d" + bytes(23))), "has 23 bytes"),
        (lambda p: p[2][0][1].__setitem__(0, ext(b"d" + b"\xff" * 24)), "x must be real m"),
        (lambda p: p[2][0][1].__setitem__(1, ext(b"d" + bytes(24))), "age must be int"),
        (lambda p: p[2][0][1].__setitem__(2, ext(b"?\0\1\2")), "bytes 0 or 1"),
        (lambda p: p[2][0][1].__setitem__(3, ["a", "b", 3]), "must be text"),
        (lambda p: p.__setitem__(2, []), "1 to 8 levels"),
        (lambda p: p.__setitem__(2, p[2] * 2), "cannot stand in columns"),
        (lambda p: p[2].append(DOTS), "'AFish' cannot stand in columns"),
        (lambda p: p.__setitem__(slice(1, 3), [None, [DOTS, DOTS]]), "'PDot' cannot stand in col"),
    ],
)  # fmt: skip
def test_errors_of_columns_are_reported(change, said):
    with pytest.raises((ProtocolError, SceneError), match=said):
        READER.scene(columns_with(change))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ([0, 0, ext(b"b\2\1"), ext(b"d" + bytes(16))], "rows must ascend"),
        ([0, 0, ext(b"b\1\3"), ext(b"d" + bytes(16))], "below 3"),
        ([0, 9, None, ext(b"d" + bytes(24))], "which does not exist"),
        ([1, 0, None, ext(b"d" + bytes(24))], "which does not exist"),
        ([0, 0, ext(b"b\1"), ext(b"d" + bytes(16))], "2 values; expected 1"),
        ([0, 1, None, ext(b"d" + bytes(24))], "age must be int"),
    ],
)
def test_errors_of_a_patch_are_reported(change, said):
    with pytest.raises((ProtocolError, SceneError), match=said):
        READER.patch(["patch", 3, ["AFish"], [change]])


def test_columns_count_as_the_nodes_that_they_stand_for():
    tight = Reader(VOCABULARY, Limits(nodes=2))
    with pytest.raises(ProtocolError, match="3 rows, over 2"):
        tight.scene([1, plain_columns(SHOAL)])
    enough = Reader(VOCABULARY, Limits(nodes=3))
    assert enough.scene([1, plain_columns(SHOAL)]) == Scene((SHOAL,))


def test_a_condition_of_a_batch_that_no_agent_can_fulfil_is_refused():
    assert READER.event(plain_events(replace(HITS, condition="age > 1"))).condition == "age > 1"
    with pytest.raises(SceneError, match="AFish has no agee; did you mean 'age'"):
        READER.event(plain_events(replace(HITS, condition="agee > 1")))


def test_an_id_in_columns_and_beside_them_is_refused():
    both = plain_scene(Scene((SHOAL, *Fish("f1").string.pieces)))
    with pytest.raises(ProtocolError, match="two agents have the id #f1"):
        READER.scene(through(both))
