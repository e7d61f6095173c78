"""Columns are an equivalent representation of strings, and populations one of agents."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from minerva_bus import (
    EMPTY,
    Agent,
    EventType,
    Geometry,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    interpret,
    on,
    parse,
    view,
)
from minerva_bus import evolve as eta
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.frame.composition import Composition, shares
from minerva_bus.grammar.columns import CHUNK, Columns, difference, packed, patched
from minerva_bus.grammar.events import Events, single
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.context import Frame
from minerva_bus.world.event_collection import Priority, collect
from minerva_bus.world.evolution import Evolved
from minerva_bus.world.visualization import visualize

PDot = Primitive("PDot", size=float, name=str)
TMove = Transformation("TMove", x=Metres, y=Metres)
eStep = EventType("eStep", dist=float)
eHit = EventType("eHit", amount=float)
eMeet = EventType("eMeet", who=str)
eShow = EventType("eShow", visual=True)


class State(Agent):
    """State that both forms share."""

    x: Metres = 0.0
    hits: int = 0
    calm: bool = True
    friend: str = ""
    births: int = 0


class One(State, symbol="AFish"):
    """Activities for a single agent."""

    @on("eStep")
    def step(self, step, moment):
        self.x += step.dist * moment.chance.uniform(-1.0, 1.0)
        if not self.calm:
            moment.emit(eHit(self.x, receivers=[self.id]))
        if moment.chance.chance(0.2):
            return self.string + self.child(x=self.x / 2, calm=not self.calm)
        return None

    @on("eHit")
    def hit(self, hit, moment):
        self.hits += 1
        self.calm = False
        self.x += hit.amount * moment.chance.normal()
        if self.hits > 3:
            return EMPTY
        return None

    @on("eMeet")
    def meet(self, meet, moment):
        self.friend = meet.who
        moment.emit(eHit(1.0))

    @view("eShow")
    def show(self, event):
        return TMove(self.x, 0)(PDot(1.0, self.id))


class Many(State, symbol="AFish"):
    """Activities for a population."""

    @on("eStep", population=True)
    def step(self, step, moment):
        self.x += step.dist * moment.chance.uniform(-1.0, 1.0)
        moment.emit(eHit(self.x, receivers=self.id), where=~self.calm)
        self.bear(moment.chance.chance(0.2), x=self.x / 2, calm=~self.calm)

    @on("eHit", population=True)
    def hit(self, hit, moment):
        self.hits += 1
        self.calm = False
        self.x += hit.amount * moment.chance.normal()
        self.die(self.hits > 3)

    @on("eMeet", population=True)
    def meet(self, meet, moment):
        self.friend = meet.who
        moment.emit(eHit(1.0))

    @view("eShow", population=True)
    def show(self, event):
        return TMove(self.x, 0)(PDot(1.0, self.id))


class Mixed(State, symbol="AFish"):
    """Some activities for a population, some for a single agent."""

    step = Many.step
    hit = One.hit
    meet = Many.meet
    show = One.show


FORMS = [One, Many, Mixed]
VOCABULARY = Vocabulary.of(PDot, TMove, eStep, eHit, eMeet, eShow, One)
TYPES = ("eHit", "eMeet", "eStep")

numbers = st.floats(-8, 8).map(partial(round, ndigits=3))
counts = st.sampled_from([1, 2, 31, 32, 33, 70])


@st.composite
def shoals(draw):
    """A string of fish in columns, with numbered or arbitrary ids."""
    count = draw(counts)
    xs = draw(st.lists(numbers, min_size=count, max_size=count))
    hits = draw(st.lists(st.integers(0, 4), min_size=count, max_size=count))
    calm = draw(st.lists(st.booleans(), min_size=count, max_size=count))
    ids = Ids.numbered("f", range(count))
    if draw(st.booleans()):
        ids = Ids.of([f"{'xyz'[n % 3]}:{n * 7 % count}-{n}" for n in range(count)])
    state = {"x": np.array(xs), "hits": np.array(hits), "calm": np.array(calm)}
    return One.many(ids, **state)


@st.composite
def batches(draw, ids):
    """The ordered events of a frame, some of them in columns."""
    collected = []
    for _ in range(draw(st.integers(0, 4))):
        count = draw(st.integers(1, 40))
        to = ids.take(
            np.array(draw(st.lists(st.integers(0, len(ids) - 1), min_size=count, max_size=count)))
        )
        condition = draw(st.sampled_from(["", "", "calm == true", "x > 0 and hits < 3"]))
        amounts = np.array(draw(st.lists(numbers, min_size=count, max_size=count)))
        collected.append(
            draw(
                st.sampled_from(
                    [
                        eHit(amounts, receivers=to, condition=condition),
                        eMeet(to, receivers=to, condition=condition),
                        eStep(amounts[0].item(), condition=condition),
                        eStep(2.0, receivers=to.texts()),
                        eHit(amounts[:3]),
                    ]
                )
            )
        )
    return collect(Priority(), {"a": collected})


@st.composite
def frames(draw):
    w = draw(shoals())
    events = draw(batches(w.pieces[0].ids))
    return w, events, Frame(draw(st.integers(0, 5)), 0.1, draw(st.integers(0, 9)))


def sent(result: Evolved):
    """Sent events by type, since the world's order sorts types anyway."""
    events = [e for events in result.emitted.values() for e in events] + list(
        single(result.batches)
    )
    return {name: [e for e in events if e.type == name] for name in TYPES}


def plain(w: Scene) -> Scene:
    return Scene(w.nodes)


def test_what_an_agent_sends_keeps_its_order_whatever_its_methods_are_for():
    class Both(Mixed, symbol="AFish"):
        meet = Many.meet

        @on("eHit")
        def hit(self, hit, moment):
            moment.emit(eHit(2.0))

    w = Both.many("f", 2)
    rows, nodes = (eta(form, [eHit(1.0), eMeet("a")], [Both]) for form in (w, plain(w)))
    assert sent(rows) == sent(nodes)


# --- strings ---


@given(shoals())
def test_columns_print_parse_compare_and_digest_as_what_they_stand_for(w):
    separate = plain(w)
    assert isinstance(w.pieces[0], Columns)
    assert str(w) == str(separate)
    assert w == separate
    assert w.digest == separate.digest == packed(separate).digest
    assert VOCABULARY.read(str(w)) == w
    assert VOCABULARY.check(w) == w
    assert w.nodes == separate.nodes
    assert parse(str(w)).digest == w.digest


@given(shoals(), st.data())
def test_a_digest_that_has_grown_is_the_one_from_scratch(w, data):
    """Repeated updates of some rows reuse the digests of the other chunks."""
    now = w.pieces[0]
    for _ in range(3):
        assert Scene((now,)).digest == plain(Scene((now,))).digest
        rows = np.array(sorted(data.draw(st.sets(st.integers(0, now.count - 1), min_size=1))))
        x = now.columns[0].put(rows, np.array([data.draw(numbers) for _ in rows]))
        now = now.with_columns([x, *now.columns[1:]])
    assert Scene((now,)).digest == plain(Scene((now,))).digest


def test_a_long_column_is_digested_by_chunks_that_are_kept():
    w = One.many("f", 3 * CHUNK + 5, x=np.arange(3.0 * CHUNK + 5))
    now = w.pieces[0]
    whole = w.digest
    other = now.with_columns(
        [now.columns[0].put(np.array([CHUNK]), np.array([0.5])), *now.columns[1:]]
    )
    assert other.columns[0].chunks[1] == b""
    assert other.columns[0].chunks[0] == now.columns[0].chunks[0] != b""
    assert Scene((other,)).digest == plain(Scene((other,))).digest != whole


@given(shoals(), st.data())
def test_parts_beside_one_another_are_the_whole(w, data):
    part = w.pieces[0]
    at = data.draw(st.integers(0, part.count))
    cut = [half for half in (part.take(slice(0, at)), part.take(slice(at, None))) if half.count]
    assert Scene(tuple(cut)) == w
    assert str(Scene(tuple(cut))) == str(w)
    assert packed(Scene(tuple(cut))) == w


@pytest.mark.parametrize("count", [31, 32])
def test_numbers_digest_as_they_print(count):
    """3 and 3.0 print the same, and so do integers beyond 2^53 that float64 can represent."""
    for number in (3, 2**53 + 2, 10**16 - 2, 2**62):
        whole = parse(" · ".join([f"P<n={number}>"] * count))
        real = Scene(tuple(node.__class__("P", ("n",), (float(number),)) for node in whole.nodes))
        assert (str(whole) == str(real)) == (whole == real)


@pytest.mark.parametrize("text", ['1, "a"', "true, 1", "1.5, 2", "9007199254740993, 1"])
def test_columns_of_several_types_are_columns_all_the_same(text):
    first, other = text.split(", ")
    w = parse(" · ".join(f"P<n={first}> · P<n={other}>" for _ in range(20)))
    assert isinstance(packed(w).pieces[0], Columns)
    assert packed(w) == w
    assert str(packed(w)) == str(w)


def test_a_chain_of_transformations_is_columns_down_to_the_figure():
    w = TMove(np.arange(40.0), 1)(TMove(0, np.arange(40.0))(PDot(np.arange(40.0), "a")))
    assert len(w.pieces) == 1
    assert w.pieces[0].shape == (
        ("TMove", ("x", "y")),
        ("TMove", ("x", "y")),
        ("PDot", ("size", "name")),
    )
    assert packed(plain(w)).pieces[0].shape == w.pieces[0].shape
    assert w == plain(w)


def test_two_agents_of_one_id_are_refused_wherever_they_stand():
    twice = One.many(Ids.of(["a", "b", "a"]))
    with pytest.raises(MinervaError, match="two agents have the id #a"):
        VOCABULARY.check(twice)
    with pytest.raises(MinervaError, match="two agents have the id #f3"):
        VOCABULARY.check(One.many("f", 40) + One("f3").string)
    with pytest.raises(MinervaError, match="two agents have the id #f3"):
        Composition(One.many("f", 40) + TMove(0, 0)(One("f3").string))


@pytest.mark.parametrize(
    "wrong", [{"x": np.array([1.0, np.nan])}, {"x": np.ones(3)}, {"hits": np.ones(2)}, {"y": 1}]
)
def test_columns_of_a_wrong_type_or_length_are_refused(wrong):
    with pytest.raises(MisuseError, match="AFish"):
        One.many("f", 2, **wrong)


# --- ids ---


@given(st.lists(st.text("ab01:-_", min_size=1, max_size=6), unique=True, min_size=1), st.data())
def test_ids_are_found_whatever_form_they_have(texts, data):
    ids, wanted = Ids.of(texts), data.draw(st.lists(st.sampled_from([*texts, "a", "b10", "zz"])))
    expected = [texts.index(text) if text in texts else -1 for text in wanted]
    assert ids.rows_of(Ids.of(wanted)).tolist() == expected if wanted else True
    assert ids.texts() == texts
    assert [ids.row_of(text) for text in texts] == list(range(len(texts)))
    assert Ids.of(texts) == Ids(None, ids.spelled)
    assert (Ids(None, ids.spelled).hashes == ids.hashes).all()
    assert ids.text_of(slice(None)) == Ids(None, ids.spelled).text_of(slice(None))


# --- evolution and views ---


@given(frames())
def test_one_by_one_is_all_at_once_is_separate_agents(frame):
    w, events, moment = frame
    results = [
        eta(string, given_events, [form], moment)
        for form in FORMS
        for string in (w, plain(w))
        for given_events in (events, tuple(single(events)))
    ]
    first = results[0]
    for other in results[1:]:
        assert str(other.scene) == str(first.scene)
        assert other.scene == first.scene
        assert sent(other) == sent(first)


@given(frames(), st.data())
def test_a_population_in_parts_becomes_what_it_becomes_whole(frame, data):
    w, events, moment = frame
    part = w.pieces[0]
    at = data.draw(st.integers(0, part.count))
    cut = [half for half in (part.take(slice(0, at)), part.take(slice(at, None))) if half.count]
    whole = eta(w, events, [Many], moment)
    parts = [eta(Scene((piece,)), events, [Many], moment) for piece in cut]
    together = EMPTY
    for evolved in parts:
        together += evolved.scene
    assert together == whole.scene
    for name in TYPES:
        assert [event for part in parts for event in sent(part)[name]] == sent(whole)[name]


@given(shoals(), st.sampled_from(["", "x > 0", "calm == true"]))
def test_a_view_of_all_is_the_views_of_each(w, condition):
    shown = [
        visualize(string, [eShow(condition=condition)], [form])
        for form in (One, Many)
        for string in (w, plain(w))
    ]
    assert all(string == shown[0] for string in shown)
    assert str(shown[1]) == str(shown[2])


@given(frames())
def test_a_patch_makes_the_new_of_the_old(frame):
    w, events, moment = frame
    old = w.pieces[0]
    _ = w.digest
    new = eta(w, events, [Many], moment).scene
    if len(new.pieces) != 1:
        return
    patch = difference(old, new.pieces[0])
    if patch is None:
        assert new.pieces[0].ids != old.ids or new.pieces[0].count != old.count
        return
    assert Scene((patched(old, patch),)) == new


class Returning(State, symbol="AFish"):
    """An activity that returns a string of each form, by the agent's number of hits."""

    @on("eHit")
    def hit(self, hit, moment):
        self.x += hit.amount
        before = self.string
        young = self.child(x=self.x / 2), self.child(hits=2)
        strings = [EMPTY, before, before + young[0], young[0] + young[1],
                   young[0] + before + young[1]]  # fmt: skip
        return strings[self.hits]

    @on("eStep")
    def step(self, step, moment):
        self.x += step.dist

    meet = Many.meet


@given(frames())
def test_a_returned_string_is_the_same_in_columns(frame):
    w, events, moment = frame
    in_columns, separate = (eta(string, events, [Returning], moment) for string in (w, plain(w)))
    assert str(in_columns.scene) == str(separate.scene)
    assert in_columns.scene == separate.scene


@pytest.mark.parametrize(("hits", "others"), [(0, 2), (1, 1), (2, 2), (3, 3)])
def test_a_returned_string_changes_only_its_row(hits, others):
    hit = np.ones(100, int)
    hit[50] = hits
    w = Returning.many("f", 100, x=np.arange(100.0), hits=hit)
    now = eta(w, [eHit(1.0, receivers=["f50"])], [Returning]).scene
    assert len(now.pieces) == 1
    patch = difference(w.pieces[0], now.pieces[0])
    assert (
        sum(len(change.rows) for change in patch.changes if change.rows is not None) <= 5 * others
    )
    assert all(change.rows is not None for change in patch.changes)
    assert Scene((patched(w.pieces[0], patch),)) == now


@given(st.data())
def test_each_event_counts_once_in_columns_as_well(data):
    ids = Ids.numbered("f", range(5))
    rows = data.draw(st.lists(st.integers(0, 4), min_size=1, max_size=12))
    amounts = data.draw(
        st.lists(st.sampled_from([0.0, -0.0, 1.0]), min_size=len(rows), max_size=len(rows))
    )
    batch = eHit(np.array(amounts), receivers=ids.take(np.array(rows)))
    sources = {"a": [batch], "b": [eHit(1.0, receivers=["f1"]), *batch]}
    collected = collect(Priority(), sources)
    assert isinstance(collected[0], Events)
    assert list(single(collected)) == list(
        collect(Priority(), {name: list(single(e)) for name, e in sources.items()})
    )


@given(
    st.integers(1, 100_000) | st.integers(1, 9),
    st.lists(st.floats(0.1, 10) | st.floats(1e-6, 1e6), min_size=1, max_size=6),
)
@example(200, [1e6, 1.0])
def test_shares_cover_everything_and_none_is_empty(rows, weights):
    shared = shares(rows, weights)
    assert sum(shared) == rows
    assert len(shared) == len(weights)
    assert min(shared) >= (1 if rows >= len(weights) else 0)


def test_ids_of_long_lineages_are_as_short_as_they_can_be_and_the_same_either_way():
    """Ids of children are hashed if they would exceed 64 characters."""
    moment = Frame(1, 0.1, 3)
    w = One.many(Ids.of(["a" * 63, "b:" * 30 + "1", "c"]))
    events = [eStep(1.0)] * 8
    single, columns = (eta(w, events, [form], moment).scene for form in (One, Many))
    assert single == columns
    assert any(":-" in node.id for node in columns.nodes)
    for piece in columns.pieces:
        if isinstance(piece, Columns):
            assert piece.ids.data.dtype.itemsize <= 64


class Plot(Geometry):
    """Positions of dots, drawn one at a time or, if `at_once`, as columns."""

    def __init__(self, at_once):
        self.at_once = at_once
        self.x = 0.0
        self.dots = []
        self.calls = 0

    @contextmanager
    def TMove(self, x, y):
        before, self.x = self.x, self.x + x
        yield
        self.x = before

    def PDot(self, size, name):
        self.dots.append((self.x, size))

    def many(self, columns):
        if not self.at_once or columns.shape != (("TMove", ("x", "y")), ("PDot", ("size", "name"))):
            return False
        self.calls += 1
        xs = (self.x + columns.column("x")).tolist()
        self.dots += zip(xs, columns.scope.column("size").tolist(), strict=True)
        return True


def test_a_geometry_may_draw_many_at_once():
    """Also within the scope of a transformation; agents in columns are rejected too."""
    count = 50
    dots = TMove(np.arange(count) / 7, 0)(PDot(np.arange(count) + 0.0, "a"))
    w = PDot(1, "b") + TMove(100, 0)(dots + PDot(2, "c")) + dots
    single, whole = Plot(False), Plot(True)
    for geometry in (single, whole):
        interpret(w, geometry)
    assert whole.calls == 2
    assert whole.dots == single.dots
    assert len(single.dots) == 2 * count + 2
    with pytest.raises(MisuseError, match="not AFish#f0"):
        interpret(One.many("f", 3), whole)


@pytest.mark.parametrize("changed", [0, 1, 10, 39, 40])
def test_a_patch_has_just_what_differs_or_a_whole_column(changed):
    """The columns were created independently of each other, like those of two views."""
    rows = np.arange(changed)
    w = One.many("f", 40, x=np.arange(40.0))
    other = np.arange(40.0)
    other[rows] += 0.5
    new = One.many(w.pieces[0].ids, x=other)
    patch = difference(w.pieces[0], new.pieces[0])
    assert Scene((patched(w.pieces[0], patch),)) == new
    changed_rows = [
        change.rows if change.rows is None else len(change.rows) for change in patch.changes
    ]
    assert changed_rows == {0: [], 1: [1], 10: [10]}.get(changed, [None])
