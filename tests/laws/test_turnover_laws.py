"""Births and deaths in columns: the transmitted delta reproduces exactly the new string."""

from __future__ import annotations

from collections import Counter

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import (
    Agent,
    EventType,
    Ids,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)
from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Composition, applied
from minerva_bus.frame.evolution_step import claim_ids
from minerva_bus.frame.member_side import Host
from minerva_bus.frame.world_state import FrameResult
from minerva_bus.grammar.columns import Columns, Delta, difference, patched
from minerva_bus.grammar.ids import RowDelta, row_delta_of_ids
from minerva_bus.grammar.types import Unfit
from minerva_bus.log.entries import apply_delta, delta_between
from minerva_bus.wire.columns_codec import plain_columns, plain_patch
from minerva_bus.wire.plain import Limits
from minerva_bus.wire.strings_codec import Reader
from minerva_bus.world.context import Frame, RngBatch, hash_of
from minerva_bus.world.evolution import Policy
from minerva_bus.world.visualization import visualize

PDot = Primitive("PDot", who=str, size=float)
TMove = Transformation("TMove", x=Metres)


class Fish(Agent, symbol="AFish"):
    """One attribute of each type that a column can hold."""

    x: Metres = 0.0
    age: int = 0
    calm: bool = True
    name: str = ""


VOCABULARY = Vocabulary.of(PDot, TMove, Fish)
READER = Reader(VOCABULARY)


def through(plain):
    return msgpack.unpackb(msgpack.packb(plain), ext_hook=msgpack.ExtType)


def fish(ids: Ids, number: float) -> Columns:
    """Fish whose state identifies them."""
    rows = np.arange(len(ids))
    names = np.array([f"{id}é" for id in ids], object)
    made = Fish.many(ids, x=rows + number, age=rows, calm=rows % 2 == 0, name=names)
    (piece,) = made.pieces
    assert isinstance(piece, Columns)
    return piece


def ids_of(count: int, *, numbered: bool) -> Ids:
    return (
        Ids.numbered("f", range(count)) if numbered else Ids.of([f"g{n}:{n}" for n in range(count)])
    )


@st.composite
def generations(draw):
    """Fish before and after births and deaths; the result is not empty."""
    old = fish(ids_of(draw(st.integers(1, 40)), numbered=draw(st.booleans())), 0.5)
    gone = draw(st.sets(st.integers(0, old.count - 1)))
    born = draw(st.integers(1 if len(gone) == old.count else 0, 9))
    after = old.count - len(gone) + born
    places = draw(st.sets(st.integers(0, after - 1), min_size=born, max_size=born))
    row_delta = RowDelta(
        old.count, np.array(sorted(gone), np.intp), np.array(sorted(places), np.intp)
    )
    newborn = fish(Ids.of([f"f{n}:1" for n in range(born)]), 100.5) if born else None
    now = old.updated(row_delta, newborn)
    rows = sorted(draw(st.sets(st.integers(0, after - 1))))
    if rows:
        x = now.columns[0].put(np.array(rows), np.arange(len(rows)) + 7.5)
        now = now.with_columns([x, *now.columns[1:]])
    return old, row_delta, now


def shown(columns: Columns) -> Columns:
    """A view of the fish with the id of each."""
    (piece,) = TMove(columns.column("x"))(PDot(columns.ids, 1.0)).pieces
    return piece


def from_scratch(columns: Columns) -> Columns:
    """Equal columns without any information about their origin."""
    (piece,) = READER.scene(through([1, plain_columns(columns)])).pieces
    return piece


# --- laws ---


@given(generations())
def test_a_turnover_leaves_the_others_in_their_order(generation):
    old, row_delta, now = generation
    gone, born = set(row_delta.gone.tolist()), set(row_delta.born.tolist())
    left = [id for row, id in enumerate(old.ids) if row not in gone]
    assert [id for row, id in enumerate(now.ids) if row not in born] == left
    assert VOCABULARY.check(Scene((now,))) == Scene((now,))
    ages = dict(zip(old.ids, old.column("age").tolist(), strict=True))
    assert all(ages.get(node.id, node.values[1]) == node.values[1] for node in now.nodes())


@given(generations(), st.booleans(), st.booleans())
def test_a_patch_with_births_and_deaths_makes_the_new_of_the_old(generation, known, travelled):
    """Also if the origin of the new columns is unknown, and after a transfer over the bus."""
    old, row_delta, now = generation
    patch = difference(old, now if known else from_scratch(now))
    if patch is None:
        assert len(row_delta.gone) == old.count
        assert not known
        return
    if travelled:
        old, patch = from_scratch(old), READER.patch(through(plain_patch(patch)))
    made = patched(old, patch)
    assert Scene((made,)) == Scene((now,))
    assert made.nodes() == now.nodes()
    assert [column.dtype for column in made.columns] == [column.dtype for column in now.columns]


@given(generations(), st.booleans())
def test_a_view_is_patched_as_what_it_is_of(generation, travelled):
    old, _, now = generation
    patch = difference(shown(old), shown(now), row_delta_of_ids(old.ids, now.ids))
    was = shown(old)
    if travelled:
        was = READER.view(through([1, plain_columns(was)])).pieces[0]
        patch = READER.patch(through(plain_patch(patch)))
    assert patched(was, patch).nodes() == shown(now).nodes()


@given(generations())
def test_unchanged_parts_are_not_sent(generation):
    old, row_delta, now = generation
    patch = difference(old, now)
    assert patch.born is None or patch.born.texts() == now.ids.take(row_delta.born).texts()
    for change in patch.changes[1:] if len(row_delta.born) * 4 <= now.count else ():
        assert change.place == 0 or change.rows.tolist() == row_delta.born.tolist()


@given(generations())
def test_a_record_has_the_patch_alone(generation):
    old, _, now = generation
    delta = through(delta_between(Scene((old,)), Scene((now,))))
    assert apply_delta(Scene((from_scratch(old),)), delta, READER) == Scene((now,))
    assert all(step[0] == "patch" for step in delta)


@given(st.lists(generations(), min_size=1, max_size=3))
def test_a_string_in_parts_finds_newborns(parts):
    """Only an id that another part already has is rejected."""
    old = [part.with_columns(part.columns) for part, _, _ in parts]
    ids = [Ids.of([f"p{n}-{id}" for id in part.ids]) for n, part in enumerate(old)]
    before = [fish(id, 0.5) for id in ids]
    composition = Composition(Scene(tuple(before)))
    after = {}
    for name, part, (_, row_delta, now) in zip(composition.parts, before, parts, strict=True):
        born = now.take(row_delta.born) if len(row_delta.born) else None
        after[name] = Scene((part.updated(row_delta, born),))
    texts = Counter(id for scene in after.values() for id in scene.pieces[0].ids)
    if max(texts.values()) > 1:
        with pytest.raises(Unfit, match="second agent"):
            claim_ids(after, FrameResult(), composition)
    else:
        claim_ids(after, FrameResult(), composition)
        composition.replace(after)
        assert composition.count == len(texts)


class Prey(Agent, symbol="APrey"):
    """Agents with identical views that only die and reproduce."""

    births: int = 0

    @on("eBite", population=True)
    def bitten(self, bite, moment):
        self.die()

    @on("eSpring", population=True)
    def breed(self, spring, moment):
        self.bear()

    @view("eShow", population=True)
    def picture(self, event):
        return PDot("prey", np.ones(len(self)))


eBite, eSpring, eShow = EventType("eBite"), EventType("eSpring"), EventType("eShow", visual=True)
HUNT = Vocabulary.of(PDot, Prey, eBite, eSpring, eShow)


@given(st.lists(st.tuples(st.sampled_from([eBite, eSpring]), st.sets(st.integers(0, 7)))))
def test_deltas_of_views_add_up_to_the_views(frames):
    """Also if the views of all survivors are unchanged."""
    host = Host("h", {"APrey": Prey})
    host.take(m.Fragments({"~APrey.1": Prey.many("p", 9)}))
    parts, views = {"~APrey.1": Prey.many("p", 9)}, {}
    for number, (event, rows) in enumerate(frames):
        (part,) = parts["~APrey.1"].pieces
        rows = sorted(row for row in rows if row + 1 < part.count)  # at least one remains
        to = part.ids.take(np.array(rows, np.intp))
        events = (event(receivers=to),) if rows else ()
        request = m.EvolveRequest(number, ("h",), events, (eShow(),))
        reply = host.answer(request, Frame(number), Policy.SEQUENTIAL, HUNT)
        views |= applied(views, reply.views["eShow"])
        assert views["~APrey.1"] == visualize(parts["~APrey.1"], [eShow()], [Prey])
        assert all(isinstance(change, Delta) for change in reply.changed.values())
        parts |= applied(parts, reply.changed)


# --- ids ---


@given(st.lists(st.text("ab01:", min_size=1, max_size=5), unique=True, min_size=1), st.data())
def test_ids_are_found_even_where_hashes_are_the_same(texts, data):
    """The test sets equal hashes, because real collisions are too rare."""
    ids, wanted = Ids(None, np.array(texts, "S5")), Ids(None, np.array([*texts, "zz"], "S5"))
    same = data.draw(st.sampled_from([1, 2, 3]))
    ids.__dict__["hashes"] = np.arange(len(texts), dtype=np.uint64) % same
    wanted.__dict__["hashes"] = np.arange(len(texts) + 1, dtype=np.uint64) % same
    assert ids.rows_of(wanted).tolist() == [*range(len(texts)), -1]


@given(st.integers(1, 3000), st.integers(0, 99))
def test_all_neighbours_are_found_and_no_others(count, seed):
    ids = Ids.of([f"{n % 7}:{n}" for n in np.random.default_rng(seed).permutation(count).tolist()])
    others = Ids.of([f"{n % 7}:{n}" for n in range(count + 9)])
    rows = ids.rows_of(others)
    assert ids.take(rows[:count]) == others.take(slice(count))
    assert (rows[count:] == -1).all()


@given(st.lists(st.text("ab01:-_", min_size=1, max_size=64)))
def test_hashes_of_many_are_those_of_each(texts):
    ids = Ids.of(texts)
    assert ids.hashes.tolist() == [hash_of(text) for text in texts]


@given(st.lists(st.integers(0, 120), unique=True, min_size=1), st.booleans())
def test_numbered_ids_are_found_among_spelled_ones(numbers, rising):
    numbered = Ids.numbered("f", np.array(sorted(numbers) if rising else numbers))
    others = ["f", "f00", "f1x", "g1", "f007", *[f"f{n}" for n in range(121)]]
    texts = numbered.texts()
    expected = [texts.index(text) if text in texts else -1 for text in others]
    assert numbered.rows_of(Ids.of(others)).tolist() == expected


def test_equal_ids_that_are_read_twice_are_read_once():
    plain = [None, 2, b"a1b2"]
    first, second = (READER.column(plain, 2).ids for _ in range(2))
    assert first is second
    assert READER.column([None, 2, b"a1b3"], 2).ids is not first


@pytest.mark.parametrize("count", [1, 31, 32, 5000])
def test_ids_one_after_another_travel_as_their_first(count):
    school = fish(Ids.numbered("f", range(7, 7 + count)), 0.5)
    plain = through(plain_columns(school))
    assert (plain[1] == ["f", 7, count]) == (count >= 32)
    assert from_scratch(school).ids == school.ids


def test_some_of_some_draw_from_their_own_streams():
    every = RngBatch(RngBatch.begin(Ids.numbered("f", range(9)).hashes, 5))
    drawn = every.of(np.array([1, 4, 7])).of(np.array([0, 2])).random()
    alone = RngBatch(RngBatch.begin(Ids.numbered("f", range(9)).hashes, 5)).random()
    assert drawn.tolist() == alone[[1, 7]].tolist()


# --- invalid deltas ---

SHOAL = fish(ids_of(3, numbered=True), 0.5)
ONE = fish(Ids.of(["f1:1"]), 9.5)
UPDATED = SHOAL.updated(RowDelta(3, np.array([0]), np.array([1])), ONE)


def ext(data):
    return msgpack.ExtType(3, data)


def wrong(place, value):
    plain = through(plain_patch(difference(SHOAL, UPDATED)))
    plain[place] = value
    return plain


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (1, 4, "3 values; expected 4"),
        (1, 0, "whole number from 1"),
        (2, ["AFish", "AFish"], "a patch of 3 AFish"),
        (3, [], "without values for 1 added"),
        (4, ext(b"b\1\1"), "rows must ascend"),
        (4, ext(b"b\3"), "below 3"),
        (4, ext(b"d" + bytes(8)), "rows must be integers"),
        (4, [0], "extension 3"),
        (4, ext(b"b\0\1\2"), "born row 1 is not below 1"),
        (5, ext(b"b\3"), "born row 3 is not below 3"),
        (5, ext(b"b\xff"), "rows must ascend"),
        (5, ext(b"h\xff\x7f"), "born row"),
        (5, ext(b"b"), "0 ids of 4 bytes"),
        (6, None, "0 ids for 1 added"),
        (6, ["-", 0, 1], "not a valid agent id"),
        (6, [None, 2, b"f2"], "two agents have the id #f2"),
        (6, [None, 4, b"a b "], "not a valid agent id"),
        (6, [None, 65, bytes(65)], "65 bytes"),
        (6, ["f", (1 << 63) - 1, 1], "64 bits"),
        (6, ["f", -1, 1], "from 0"),
        (6, ["f", 0, 2], "2 ids; expected 1"),
        (6, [["f"], 0, 1], "ids are"),
    ],
)  # fmt: skip
def test_errors_of_births_and_deaths_are_reported(place, value, said):
    with pytest.raises((ProtocolError, SceneError, Unfit), match=said):
        patched(from_scratch(SHOAL), READER.patch(wrong(place, value)))


def test_no_patch_removes_all_rows():
    nobody = ["patch", 3, ["AFish"], [], ext(b"b\0\1\2"), ext(b"b"), None]
    with pytest.raises(ProtocolError, match="whole number from 1"):
        READER.patch(nobody)
    with pytest.raises(Unfit, match="removes all"):
        patched(SHOAL, Delta(3, ("AFish",), (), RowDelta(3, np.arange(3), np.arange(0))))


def test_births_count_as_the_nodes_that_they_are():
    with pytest.raises(ProtocolError, match=r"over 2"):
        Reader(VOCABULARY, Limits(nodes=2)).patch(wrong(1, 3))


def test_two_of_the_newborn_have_two_ids():
    plain = ["patch", 3, ["AFish"], [], ext(b"b"), ext(b"b\3\4"), [None, 1, b"aa"]]
    with pytest.raises(ProtocolError, match="two agents have the id #a"):
        READER.patch(plain)


def test_lists_within_lists_are_no_ids_however_deep():
    plain = ["f", 1]
    for _ in range(500):
        plain = [None, plain]
    with pytest.raises(ProtocolError, match="ids are"):
        READER.column(plain, 2)
