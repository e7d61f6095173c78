"""Neighbours: compared with brute force in a plane, on a torus, and on a lattice."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from minerva_bus import (
    EMPTY,
    Event,
    EventType,
    Frame,
    MinervaError,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import single
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.ids import Ids
from minerva_services.physics.neighbours import Neighbours, search
from minerva_services.physics.neighbours.cells import Candidates
from minerva_services.physics.neighbours.perception import summary
from minerva_services.physics.neighbours.search import near
from minerva_services.physics.neighbours.spots import Names, SpotReader, Spots

PSpot = Primitive("PSpot", who=str, vx=float)
PCell = Primitive("PCell", who=str, x=int, y=int, colour=int, age=float)
PTree = Primitive("PTree", ages=tuple[float, ...])
PNumbered = Primitive("PNumbered", who=int)
TMove = Transformation("TMove", x=float, y=float)
TTurn = Transformation("TTurn", angle=float)
eWhere = EventType("eWhere", visual=True)
eNear = EventType("eNear", who=str, dx=float, dy=float, distance=float, vx=float)
eClose = EventType("eClose", distance=float)
eFlock = EventType(
    "eFlock",
    number=int,
    dx=float,
    dy=float,
    distance=float,
    vx=float,
    apart_x=float,
    apart_y=float,
)
eSums = EventType("eSums", number=int, dx=float, vx=float, apart_x=float, apart_y=float)
eLike = EventType("eLike", number=int, same=int, age=float)
eMore = EventType(
    "eMore", number=int, sum_age=float, same_colour=int, more_colour=int, more_age=int
)
eRank = EventType("eRank", sum_vx=float, same_vx=int, more_vx=int)
eOdd = EventType("eOdd", dx=int)
eTextual = EventType("eTextual", vx=str)
eTaste = EventType("eTaste", taste=float)
eSmell = EventType("eSmell", number=int, smell=Default(float, 0.5))
VOCABULARY = Vocabulary.of(
    *(PSpot, PCell, PNumbered, PTree, TMove, TTurn, eWhere),
    *(eNear, eClose, eFlock, eSums, eLike, eMore, eRank, eOdd, eTextual, eTaste, eSmell),
)
INFO = WorldInfo("test", VOCABULARY, seed=0, dt=0.1)
Point = tuple[float, float, float]

WIDTH, HEIGHT = 8.0, 6.0
# Sums and products of eighths are exact, so that different computations give equal results.
eighths = st.integers(-16, 80).map(lambda number: number / 8)
points = st.lists(st.tuples(eighths, eighths, eighths), max_size=45)
radii = st.integers(1, 23).map(lambda number: number / 8)


def joined(**options: Any) -> Neighbours:
    service = Neighbours(**options)
    service.joined(INFO)
    return service


def told(service: Neighbours, view: Scene, frame: int = 3) -> list[Event]:
    service.show(View(frame, "eWhere", view))
    tick = Tick(Frame(number=frame + 1, dt=0.1, seed=0), "neighbours")
    made = [VOCABULARY.check_any(event) for event in service.generate(tick)]
    return list(single(made))


def ids(count: int) -> list[str]:
    return [f"a{number}" for number in range(count)]


def spots(points: Sequence[Point], names: Sequence[str] | None = None) -> Scene:
    """A figure for each point, in columns if their number is even, otherwise as single nodes."""
    names = ids(len(points)) if names is None else names
    if len(points) % 2 == 0 and points:
        x, y, vx = np.array(points, float).T.copy()
        return TMove(x, y)(PSpot(np.array(names, object), vx))
    both = zip(points, names, strict=True)
    return Scene(tuple(n for (x, y, vx), who in both for n in TMove(x, y)(PSpot(who, vx)).pieces))


def way(start: float, other: float, size: float) -> float:
    """Signed distance along an axis, the shorter way around if the axis has a period `size`."""
    if not size:
        return other - start
    start, other = start % size, other % size
    return min((other - start + shift for shift in (-size, 0.0, size)), key=abs)


def brute_force(points: Sequence[Point], radius: float, periodic: bool) -> list[tuple[Any, ...]]:
    """(receiver, neighbour, dx, dy, distance, vx) of all pairs, in order."""
    size = (WIDTH, HEIGHT) if periodic else (0.0, 0.0)
    pairs = []
    for i, point in enumerate(points):
        for j, other in enumerate(points):
            dx, dy = way(point[0], other[0], size[0]), way(point[1], other[1], size[1])
            if i != j and dx * dx + dy * dy <= radius * radius:
                pairs.append((i, j, dx, dy, math.sqrt(dx * dx + dy * dy), other[2]))
    return pairs


def plane(radius: float, periodic: bool, **rest: Any) -> Neighbours:
    size = {"width": WIDTH, "height": HEIGHT} if periodic else {}
    return joined(radius=radius, periodic=periodic, **size, **rest)


# --- one event for each neighbour -----------------------------------------------------------------


@given(points, radii, st.booleans())
@example([(0.0, 0.0, 1.0), (8.0, 6.0, 2.0), (7.5, 5.5, 3.0)], 1.0, True)
@example([(0.0, 0.0, 1.0), (0.0, 0.0, 2.0)], 0.125, False)
def test_neighbours_are_those_of_brute_force(
    points: list[Point], radius: float, periodic: bool
) -> None:
    events = told(plane(radius, periodic), spots(points))
    expected = brute_force(points, radius, periodic)
    neighbours = [(e.receivers, e.who, e.dx, e.dy, e.distance, e.vx) for e in events]
    assert neighbours == [((f"a{i}",), f"a{j}", *rest) for i, j, *rest in expected]


@given(points, radii, st.booleans(), st.integers(1, 4))
def test_the_nearest_are_first_and_limited_in_number(
    points: list[Point], radius: float, periodic: bool, nearest: int
) -> None:
    events = told(plane(radius, periodic, nearest=nearest), spots(points))
    expected: list[tuple[str, str]] = []
    pairs = brute_force(points, radius, periodic)
    for number in range(len(points)):
        near = sorted((row for row in pairs if row[0] == number), key=lambda row: (row[4], row[1]))
        expected += [(f"a{number}", f"a{row[1]}") for row in near[:nearest]]
    assert [(e.receivers[0], e.who) for e in events] == expected


def test_points_in_a_clump_are_all_found() -> None:
    chance = np.random.default_rng(1)
    points = [tuple(row) for row in chance.integers(0, 64, (300, 3)) / 8]
    assert len(told(plane(1.5, True), spots(points))) == len(brute_force(points, 1.5, True)) > 1000


def test_a_place_a_hair_before_the_edge_of_a_torus_is_near_the_other_edge() -> None:
    events = told(plane(1.5, True), spots([(-1e-18, 0, 1), (0.5, 0, 2)]))
    assert len(events) == 2


def test_whole_coordinates_on_a_torus_are_those_of_reals() -> None:
    view = PCell("a", 0, 1, 3, 0.5) + PCell("b", 7, 1, 3, 0.5)
    service = plane(1.5, True, event="eClose")
    assert [event.distance for event in told(service, view)] == [1.0, 1.0]


def test_missing_scipy_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[neighbours\]'"):
        Neighbours(radius=1.0)
    Neighbours(radius=1, grid=True, width=8, height=8)


def test_only_declared_fields_are_sent() -> None:
    (first, other) = told(joined(event="eClose", radius=5.0), spots([(0, 0, 1), (3, 4, 2)]))
    assert first == VOCABULARY.events["eClose"](5.0, receivers=["a0"])
    assert other == VOCABULARY.events["eClose"](5.0, receivers=["a1"])


def test_no_view_is_shown_twice_or_late() -> None:
    service = joined(radius=5.0)
    service.show(View(3, "eWhere", spots([(0, 0, 1), (3, 4, 2)])))
    made = [
        len(tuple(service.generate(Tick(Frame(number=n, dt=0.1, seed=0), "n")))) for n in (3, 4, 5)
    ]
    assert made == [0, 1, 0]


def test_an_empty_view_and_a_lonely_agent_are_quiet() -> None:
    assert told(joined(), EMPTY) == []
    assert told(joined(), spots([(1, 1, 1)])) == []


# --- a summary ------------------------------------------------------------------------------------


@given(points, radii, st.booleans(), radii)
def test_a_summary_adds_up_single_lines(
    points: list[Point], radius: float, periodic: bool, apart: float
) -> None:
    service = plane(radius, periodic, event="eFlock", summary=True, apart=apart)
    events = told(service, spots(points))
    pairs = brute_force(points, radius, periodic)
    assert [event.receivers[0] for event in events] == ids(len(points))
    for number, event in enumerate(events):
        near = [row[2:] for row in pairs if row[0] == number]
        close = [row for row in near if row[2] < apart]
        count = max(len(near), 1)
        assert event.number == len(near)
        assert event.dx == sum(row[0] for row in near) / count
        assert event.dy == sum(row[1] for row in near) / count
        assert event.distance == pytest.approx(sum(row[2] for row in near) / count)
        assert event.vx == sum(row[3] for row in near) / count
        assert event.apart_x == -sum(row[0] for row in close)
        assert event.apart_y == -sum(row[1] for row in close)


@given(points, st.randoms(use_true_random=False))
def test_collision_events_do_not_depend_on_the_order_of_agents(
    points: list[Point], random: Any
) -> None:
    order = list(range(len(points)))
    random.shuffle(order)
    mixed = spots([points[row] for row in order], [f"a{row}" for row in order])
    for options in ({}, {"event": "eSums", "summary": True}, {"nearest": 3}):
        plain = told(joined(radius=1.5, **options), spots(points))
        again = told(joined(radius=1.5, **options), mixed)
        key = lambda event: (event.receivers, str(event))  # noqa: E731
        if "nearest" not in options:  # among equally near neighbours the order decides
            assert sorted(again, key=key) == sorted(plain, key=key)
        assert len(again) == len(plain)


def test_texts_are_read_once_for_each_column() -> None:
    reader, names = SpotReader("test", Names()), np.array(["a", "b", "c"], object)
    view = TMove(np.zeros(3), np.zeros(3))(PSpot(names, np.zeros(3)))
    who = view.pieces[0].scope.columns[0]  # type: ignore[union-attr]
    moved = view.pieces[
        0
    ].with_columns(  # type: ignore[union-attr]
        [*TMove(np.ones(3), np.ones(3))(PSpot(names, np.ones(3))).pieces[0].all_columns()[:2]]  # type: ignore[union-attr]
        + [who, view.pieces[0].scope.columns[1]]  # type: ignore[union-attr]
    )
    first, then = reader.read(view), reader.read(Scene((moved,)))
    assert first is not None
    assert then is not None
    assert then.ids is first.ids
    assert then.x.tolist() == [1.0, 1.0, 1.0]
    other = reader.read(TMove(np.zeros(3), np.zeros(3))(PSpot(names[::-1].copy(), np.zeros(3))))
    assert other is not None
    assert other.ids.texts() == ["c", "b", "a"]


def test_figures_of_several_shapes_are_one_crowd() -> None:
    bare = Scene((*spots([(0, 0, 1.0), (3, 4, 2.0)]).pieces, *PCell("cell", 0, 1, 3, 0.5).pieces))
    events = told(joined(event="eClose", radius=1.0), bare)
    assert [(event.receivers[0], event.distance) for event in events] == [("a0", 1), ("cell", 1)]
    with pytest.raises(MinervaError, match=r"eNear needs a value for vx .* agents show x, y"):
        told(joined(radius=1.0), bare)


# --- a lattice ------------------------------------------------------------------------------------

cells = st.lists(
    st.tuples(st.integers(0, 6), st.integers(0, 4), st.integers(-1, 2), eighths), max_size=40
)


@given(cells, st.integers(1, 2), st.booleans(), st.sampled_from(["moore", "von neumann"]))
def test_lattice_counts_are_those_of_brute_force(
    sites: list[tuple[int, int, int, float]], reach: int, periodic: bool, hood: str
) -> None:
    service = joined(
        event="eLike",
        grid=True,
        width=7,
        height=5,
        same="colour",
        radius=reach,
        periodic=periodic,
        hood=hood,
    )
    both = enumerate(sites)
    view = Scene(tuple(PCell(f"a{n}", *values).pieces[0] for n, values in both))
    events = told(service, view)
    assert [event.receivers[0] for event in events] == ids(len(sites))
    for row, (site, event) in enumerate(zip(sites, events, strict=True)):
        near = []
        for number, other in enumerate(sites):
            dx = abs(way(site[0], other[0], 7.0 if periodic else 0))
            dy = abs(way(site[1], other[1], 5.0 if periodic else 0))
            inside = max(dx, dy) <= reach if hood == "moore" else dx + dy <= reach
            if number != row and inside:
                near.append(other)
        assert event.number == len(near)
        assert event.same == sum(other[2] == site[2] for other in near)
        assert event.age == sum(other[3] for other in near) / max(len(near), 1)


@given(cells, st.booleans(), st.sampled_from(["moore", "von neumann"]))
def test_sums_and_comparisons_on_a_lattice_are_those_of_brute_force(
    sites: list[tuple[int, int, int, float]], periodic: bool, hood: str
) -> None:
    service = joined(event="eMore", grid=True, width=7, height=5, periodic=periodic, hood=hood)
    view = Scene(tuple(PCell(f"a{n}", *values).pieces[0] for n, values in enumerate(sites)))
    for row, event in enumerate(told(service, view)):
        x, y, colour, age = sites[row]
        near = []
        for number, other in enumerate(sites):
            dx = abs(way(x, other[0], 7.0 if periodic else 0))
            dy = abs(way(y, other[1], 5.0 if periodic else 0))
            if number != row and (max(dx, dy) if hood == "moore" else dx + dy) <= 1:
                near.append(other)
        assert event.sum_age == sum(other[3] for other in near)
        assert event.same_colour == sum(other[2] == colour for other in near)
        assert event.more_colour == sum(other[2] > colour for other in near)
        assert event.more_age == sum(other[3] > age for other in near)


@given(points, radii, st.booleans())
def test_sums_and_comparisons_in_a_plane_are_those_of_brute_force(points, radius, periodic):
    events = told(plane(min(radius, 2.5), periodic, event="eRank", summary=True), spots(points))
    pairs = brute_force(points, min(radius, 2.5), periodic)
    for row, event in enumerate(events):
        own, near = points[row][2], [pair[5] for pair in pairs if pair[0] == row]
        assert event.sum_vx == sum(near)
        assert event.same_vx == near.count(own)
        assert event.more_vx == sum(other > own for other in near)


@pytest.mark.parametrize(("x", "y"), [(7, 0), (-1, 0), (0, 5)])
def test_an_agent_outside_all_cells_is_named(x: int, y: int) -> None:
    service = joined(event="eLike", grid=True, width=7, height=5, same="colour")
    with pytest.raises(MinervaError, match=r"neighbours: #b is not on the lattice: [xy] is"):
        told(service, PCell("a", 1, 1, 1, 0.0) + PCell("b", x, y, 1, 0.0))


# --- rejected options and views -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"event": "eNeer"}, "neighbours: .* no event type eNeer; did you mean 'eNear'"),
        ({"every": 0}, "every is 0"),
        ({"radius": 0.0}, r"radius is 0\.0"),
        ({"radius": math.nan}, "radius is nan"),
        ({"periodic": True, "width": math.inf, "height": 9.0}, "inf and 9.0; expected numbers"),
        ({"periodic": True, "width": math.nan, "height": 9.0}, "nan and 9.0; expected numbers"),
        ({"grid": True, "width": math.inf, "height": 9}, "width of a lattice is inf"),
        ({"grid": True, "width": 9, "height": math.nan}, "height of a lattice is nan"),
        ({"nearest": -1}, "nearest is -1"),
        ({"nearest": 2, "summary": True}, "nearest requires one event per neighbour"),
        ({"hood": "more"}, "hood is 'more'; expected moore or von neumann"),
        ({"periodic": True, "width": 2.0, "height": 9.0}, r"expected numbers above 2\.0"),
        ({"periodic": True}, r"width and height of a periodic plane are 0\.0 and 0\.0"),
        ({"grid": True}, r"width of a lattice is 0\.0"),
        ({"grid": True, "width": 2, "height": 9, "periodic": True}, "expected numbers above 2"),
        ({"grid": True, "width": 9, "height": 9, "radius": 1.5}, r"radius of a lattice is 1\.5"),
        ({"event": "eOdd"}, "eOdd declares dx as int; neighbours produces real"),
        ({"event": "eTextual", "summary": True}, "eTextual declares vx as text; .* produces real"),
        ({"who": "whom"}, "who is 'whom', which no primitive .* has; did you mean 'who'"),
        ({"x": "east"}, "x is 'east', which no primitive and no transformation of the world has"),
        ({"grid": True, "width": 9, "height": 9, "same": "hue"}, "same is 'hue', which no primi"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict[str, Any], problem: str) -> None:
    with pytest.raises(MinervaError, match=problem):
        joined(**options)


@pytest.mark.parametrize(
    ("view", "problem"),
    [
        (PSpot("a", 1.0), "figure of an agent, PSpot, has no number x"),
        (TMove(1.0, 2.0)(PNumbered(3)), "TMove around PNumbered, has no text who"),
        (TMove(1.0, 2.0)(TMove(1.0, 2.0)(PSpot("a", 1.0))), "TMove around PSpot, has two values x"),
        (TMove(1.0, 2.0)(PSpot("a", 1.0) + PSpot("b", 1.0)), "PSpot shares its subtree"),
    ],
)
def test_a_view_that_names_no_agent_is_rejected(view: Scene, problem: str) -> None:
    with pytest.raises(MinervaError, match=f"neighbours: .*{problem}"):
        told(joined(), view)


def test_undrawn_symbols_are_named_unless_they_have_a_default() -> None:
    view = spots([(0, 0, 1), (0, 1, 2)])
    with pytest.raises(MinervaError, match=r"eTaste needs a value for taste .* show vx, x, y"):
        told(joined(event="eTaste", radius=5.0), view)
    events = told(joined(event="eSmell", summary=True, radius=5.0), view)
    assert [(event.number, event.smell) for event in events] == [(1, 0.5), (1, 0.5)]


def test_scenery_is_overlooked() -> None:
    trees = PTree([1.0]) + TMove(0.5, 0.5)(PTree([1.0]) + PTree([2.0]))
    assert told(joined(radius=5.0), trees) == []
    plain = told(joined(radius=5.0), spots([(0, 0, 1), (3, 4, 2)]))
    assert told(joined(radius=5.0), trees + spots([(0, 0, 1), (3, 4, 2)]) + trees) == plain


def test_turned_spots_keep_their_place() -> None:
    view = TMove(0.0, 0.0)(TTurn(90.0)(PSpot("a", 1.0))) + TMove(1.0, 0.0)(PSpot("b", 2.0))
    assert [(event.who, event.dx) for event in told(joined(), view)] == [("b", 1.0), ("a", -1.0)]


@pytest.mark.parametrize("size", [None, (4.0, 4.0)])
def test_a_part_of_a_plane_has_the_sums_of_the_whole(size: tuple[float, float] | None) -> None:
    # Half of the points are on a lattice whose distances are as long as the radius, but rounded.
    x, y = np.random.default_rng(5).uniform(0, 4, (2, 200))
    x[:100], y[:100] = np.round(x[:100], 1), np.round(y[:100], 1)
    speeds = np.sin(9.0 * x + y)

    def sums(rows: Any) -> dict[str, Any]:
        spots = Spots(Ids.of([f"{row}" for row in rows]), x[rows], y[rows], {"vx": speeds[rows]})
        pairs = near(spots.x, spots.y, 0.8, size)
        return {**summary(spots, pairs, frozenset(("number", "dx", "vx", "apart_x")), 0.5)}

    whole = sums(np.arange(200))
    for row in range(200):
        along, across = abs(x - x[row]), abs(y - y[row])
        if size is not None:
            along, across = np.minimum(along, 4.0 - along), np.minimum(across, 4.0 - across)
        part = np.flatnonzero((along < 0.9) & (across < 0.9))
        own = np.flatnonzero(part == row)[0]
        own_sums = {name: column[own] for name, column in sums(part).items()}
        assert own_sums == {name: column[row] for name, column in whole.items()}


def test_pairs_depend_neither_on_the_order_nor_on_the_rounding_of_the_tree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Tree:
        def __init__(self, points: Any, boxsize: Any) -> None:
            self.points = points

        def query_pairs(self, radius: float, output_type: str) -> Any:
            return np.array([[1, 2], [0, 2], [0, 1]])

    monkeypatch.setattr(search, "tree", lambda: Tree)
    monkeypatch.setattr(Candidates, "win", lambda _: False)
    pairs = near(np.array([0.0, 0.5, 1.0]), np.zeros(3), 0.5)
    assert [*zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)] == [(0, 1), (1, 2)]
