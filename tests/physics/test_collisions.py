"""Collision events, compared with brute force and with the geometry of another library."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pymunk
import pytest
from colliding_world import (
    VOCABULARY,
    PBar,
    PBlock,
    PBody,
    Shape,
    TPlace,
    ball,
    joined,
    scene_of,
    shapes,
    slots,
    told,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

from minerva_bus import EMPTY, EventType, Frame, MinervaError, Scene, Tick, View
from minerva_services.geometry.volumes import Volumes, volumes
from minerva_services.physics.collisions import Collisions
from minerva_services.physics.collisions.contacts import (
    TOLERANCE,
    Boxes,
    contacts,
    owners_of,
    pairs_among,
    pairs_between,
    touches,
)
from minerva_services.physics.collisions.service import ContactMemory, ContactPair

BOX = np.ones((1, 1), np.int16)


def said(events: list[Any]) -> list[tuple[str, str, str]]:
    return [(event.receivers[0], event.other, event.what) for event in events]


# --- contents of events ---------------------------------------------------------------------------


def test_both_agents_receive_it_from_their_perspective() -> None:
    events = told(joined(), ball("a", 0.0, 0.0) + ball("b", 0.75, 0.0))
    assert said(events) == [("a", "b", "PBody"), ("b", "a", "PBody")]
    first, second = events
    assert (first.x, first.y, first.depth) == (second.x, second.y, second.depth) == (0.375, 0, 0.25)
    assert (first.nx, first.ny) == (-1, 0)
    assert (second.nx, second.ny) == (1, 0)
    assert first.begins
    assert first.shortfall == 0


def test_touching_bodies_are_notified_and_others_are_not() -> None:
    assert told(joined(), ball("a", 0.0, 0.0) + ball("b", 1.0, 0.0))
    assert not told(joined(), ball("a", 0.0, 0.0) + ball("b", 1.0 + 1e-6, 0.0))
    assert not told(joined(), EMPTY)


def test_two_at_one_place_are_pushed_in_opposite_directions() -> None:
    events = told(joined(), ball("a", 1.0, 1.0) + ball("b", 1.0, 1.0))
    assert [(event.nx, event.ny, event.depth) for event in events] == [(1, 0, 1), (-1, 0, 1)]


def test_parts_of_one_agent_do_not_collide_with_each_other() -> None:
    scene = ball("a", 0.0, 0.0) + ball("a", 0.1, 0.0) + ball("", 9.0, 0.0) + ball("", 9.1, 0.0)
    assert not told(joined(), scene)


def test_of_two_agents_only_the_deepest_contact_counts() -> None:
    scene = ball("a", 0.0, 0.0) + ball("b", 0.9, 0.0) + ball("a", 0.0, 1.0) + ball("b", 0.7, 1.0)
    events = told(joined(), scene)
    assert said(events) == [("a", "b", "PBody"), ("b", "a", "PBody")]
    assert [event.depth for event in events] == pytest.approx([0.3, 0.3])


def test_a_wall_of_many_pieces_is_one_wall_and_a_corner_two() -> None:
    tiles = sum((TPlace(x / 4, -0.25, 0.0)(PBlock(BOX, 0.25)) for x in range(20)), start=EMPTY)
    (event,) = told(joined(), tiles + ball("a", 2.1, 0.4))
    assert (event.other, event.what, event.ny) == ("", "PBlock", 1)
    assert event.depth == pytest.approx(0.1)
    corner = tiles + PBar((0.0, 0.0), (0.0, 4.0))
    ways = [(event.nx, event.ny) for event in told(joined(), corner + ball("a", 0.5, 0.375))]
    assert sorted(ways) == [(0, 1), (1, 0)]


def test_scenery_is_first_and_agents_are_in_the_order_of_the_string() -> None:
    scene = ball("z", 0.0, 0.0) + ball("b", 0.6, 0.0) + ball("a", 0.0, 0.6) + ball("", -0.6, 0.0)
    assert said(told(joined(), scene)) == [
        ("z", "", "PBody"),
        ("z", "b", "PBody"),
        ("z", "a", "PBody"),
        ("b", "z", "PBody"),
        ("b", "a", "PBody"),
        ("a", "", "PBody"),
        ("a", "z", "PBody"),
        ("a", "b", "PBody"),
    ]


def test_a_world_has_the_data_that_it_declares() -> None:
    service = joined(collision=EventType("eCollision", depth=float))
    service.show(view(ball("a", 0.0, 0.0) + ball("b", 0.75, 0.0)))
    (events,) = service.generate(tick(1))
    assert (events.names, len(events)) == (("depth",), 2)


def test_an_event_of_another_frame_is_not_delivered_late() -> None:
    service = joined()
    service.show(view(ball("a", 0.0, 0.0) + ball("b", 0.75, 0.0), frame=3))
    assert not list(service.generate(tick(5)))
    assert list(service.generate(tick(4)))


def view(scene: Scene, frame: int = 0) -> View:
    return View(frame, "eBody", scene)


def tick(number: int) -> Tick:
    return Tick(Frame(number=number), "collisions")


# --- begin, persist, ignore -----------------------------------------------------------------------

APART = ball("a", 0.0, 0.0) + ball("b", 5.0, 0.0)
TOGETHER = ball("a", 0.0, 0.0) + ball("b", 0.75, 0.0)


def test_a_collision_is_reported_when_it_begins() -> None:
    service = joined()
    story = [TOGETHER, TOGETHER, APART, TOGETHER]
    assert [len(told(service, scene, frame)) for frame, scene in enumerate(story)] == [2, 0, 0, 2]
    assert service.report() == {"collisions": 2}
    assert type(service.save()["count"]) is int


def test_or_as_long_as_it_lasts() -> None:
    service = joined(persist=True)
    story = [TOGETHER, TOGETHER, APART, TOGETHER]
    begins = [[e.begins for e in told(service, scene, n)] for n, scene in enumerate(story)]
    assert begins == [[True, True], [False, False], [], [True, True]]
    assert service.report() == {"collisions": 2}


def test_along_a_wall_it_goes_on_and_another_wall_begins() -> None:
    walls = PBar((0.0, 6.0), (0.0, 0.0)) + PBar((0.0, 0.0), (0.0, 6.0))
    service = joined(persist=True)
    places = [(3.0, 0.6), (2.0, 0.6), (0.6, 0.6), (0.6, 2.0)]
    begins = [
        [(event.nx, event.begins) for event in told(service, walls + ball("a", *at), frame)]
        for frame, at in enumerate(places)
    ]
    assert begins == [[(0, True)], [(0, False)], [(0, False), (1, True)], [(1, False)]]


def test_a_successor_knows_what_has_begun() -> None:
    service, heir = joined(), joined()
    wall = PBar((-1.0, -1.0), (-3.0, 3.0))
    told(service, wall + ball("a", -0.6, 0.0) + ball("b", 0.2, 0.0))
    heir.restore(service.save())
    assert told(heir, wall + ball("a", -0.6, 0.1) + ball("b", 0.2, 0.0), 1) == []
    assert heir.report() == {"collisions": 2}
    with pytest.raises(MinervaError, match="collisions: not a saved state"):
        heir.restore({"agents": "a\tb", "count": 0})


def test_contacts_are_saved_as_lines_of_agents() -> None:
    """In one text, because a saved state has a limit of values (`tick_values`)."""
    pairs = [
        ContactPair(f"a{n}", f"b\t{n}\n" if n % 3 else "", math.cos(n), math.sin(n))
        for n in range(9)
    ]
    corner = ContactPair("a0", "", 0.0, 1.0)
    saved = ContactMemory([*pairs, corner]).save()
    again = ContactMemory.restored(saved)
    assert again.save() == saved
    assert all(map(again.knows, [*pairs, corner]))
    assert not again.knows(ContactPair("a1", "b2", 1.0, 0.0))
    assert saved.split("\n")[0] == 'a0\t[["", 1.0, 0.0], ["", 0.0, 1.0]]'


@pytest.mark.parametrize(
    ("ignore", "expected"),
    [
        ([], {("a", "b"), ("b", "a"), ("a", ""), ("b", "")}),
        ([["ABall", "ABall"]], {("a", ""), ("b", "")}),
        ([["ABall", "PBar"]], {("a", "b"), ("b", "a")}),
        ([["PBar", "*"]], {("a", "b"), ("b", "a")}),
        ([["*", "ABall"]], set()),
        ([["ABall", "PBlock"], ["PBlock", "PBar"]], {("a", "b"), ("b", "a"), ("a", ""), ("b", "")}),
    ],
)
def test_pairs_may_be_ignored(ignore: list[list[str]], expected: set[tuple[str, str]]) -> None:
    skeleton = PBar((-9.0, 9.0), (-0.5, -0.5)) + slots("a", "b")
    parts = {"a": ball("", 0.0, 0.0), "b": ball("", 0.75, 0.0)}
    events = told(joined(ignore=ignore), skeleton, parts=parts)
    assert {(event.receivers[0], event.other) for event in events} == expected


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"every": 0}, "every is 0; expected a number of frames from 1"),
        ({"ignore": ["ACar"]}, "ignore has 'ACar'; expected pairs"),
        ({"ignore": "ACar"}, "ignore has 'ACar'; expected pairs"),
        ({"ignore": [["ACar", 1]]}, "expected pairs"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], why: str) -> None:
    with pytest.raises(MinervaError, match=why):
        Collisions(**options)


def test_a_world_with_other_words_is_refused() -> None:
    with pytest.raises(MinervaError, match="collisions: the world 'test' has no event type eHit"):
        joined(event="eHit")
    with pytest.raises(MinervaError, match=r"ignore has ABell, .* did you mean 'ABall'"):
        joined(ignore=[["ABell", "*"]])
    with pytest.raises(MinervaError, match="collisions: eCollision declares other as"):
        joined(collision=EventType("eCollision", other=float))
    with pytest.raises(MinervaError, match=r"PBody in the view of .* ABall has no owner"):
        told(joined(), slots("~0"), parts={"~0": ball("", 0.0, 0.0)})


# --- laws -----------------------------------------------------------------------------------------

scenes = st.lists(shapes, max_size=14)


@given(scenes, st.integers(1, 5), st.integers(0, 3))
@settings(max_examples=40)
@example([("block", 1.0, 1.0, 0.0, 0.5, 0.5), ("disc", 1.25, 1.25, 0.0, 0.125, 0.5)], 1, 0)
def test_the_grid_leaves_nothing_out(shapes: list[Shape], agents: int, ignored: int) -> None:
    solids = volumes(scene_of(shapes, agents), VOCABULARY)
    pairs = [("PBody", "PBar"), ("PBlock", "*")][:ignored]
    owners = owners_of(solids)
    touching = contacts(solids, pairs)
    rows = zip(owners[touching.first].tolist(), owners[touching.second].tolist(), strict=True)
    agents_told = {(row, other) for row, other in rows if other >= 0}
    expected: set[tuple[int, int]] = set()
    walls: set[int] = set()
    for i, j in itertools.permutations(range(len(solids)), 2):
        first, other = owners[i], owners[j]
        names = {solids.symbols[i], solids.symbols[j]}
        skipped = any({a, b} == names or (b == "*" and a in names) for a, b in pairs)
        if first < 0 or first == other or skipped:
            continue
        if len(touches(solids, np.array([i]), np.array([j])).first):
            walls |= {int(first)} if other < 0 else set()
            expected |= {(int(first), int(other))} if other >= 0 else set()
    assert agents_told == expected
    assert {
        owner
        for owner, other in zip(owners[touching.first], owners[touching.second], strict=True)
        if other < 0
    } == walls


corners = st.tuples(*[st.integers(-50, 50).map(lambda number: number / 4)] * 2)
spans = st.tuples(*[st.sampled_from((0.0, 0.25, 1.0, 40.0))] * 2)
boxes = st.lists(st.tuples(corners, spans), max_size=25)


def boxes_of(rectangles: list[Any]) -> Boxes:
    lower = np.array([corner for corner, _ in rectangles], np.float64).reshape(-1, 2)
    return Boxes(lower, lower + np.array([span for _, span in rectangles]).reshape(-1, 2))


@given(boxes, boxes)
@settings(max_examples=40)
@example([((0.0, 0.0), (0.0, 0.0))], [((0.0, 0.0), (0.0, 0.0))])
def test_pairs_of_boxes_are_those_of_brute_force(rectangles: list[Any], others: list[Any]) -> None:
    first, other = boxes_of(rectangles), boxes_of(others)

    def meet(a: Boxes, i: int, b: Boxes, j: int) -> bool:
        return bool((a.lower[i] <= b.upper[j]).all() and (b.lower[j] <= a.upper[i]).all())

    every = [
        (i, j) for i in range(len(first)) for j in range(len(other)) if meet(first, i, other, j)
    ]
    assert list(zip(*(rows.tolist() for rows in pairs_between(first, other)), strict=True)) == every
    own = [
        (i, j)
        for i in range(len(first))
        for j in range(i + 1, len(first))
        if meet(first, i, first, j)
    ]
    assert list(zip(*(rows.tolist() for rows in pairs_among(first)), strict=True)) == own


def test_boxes_very_far_away_and_very_large_are_no_trouble() -> None:
    scattered = boxes_of(
        [((0.0, 0.0), (1.0, 1.0)), ((1e300, 0.0), (1.0, 1.0)), ((-1e9, -1e9), (4e9, 4e9))]
    )
    first, other = pairs_among(scattered)
    assert list(zip(first.tolist(), other.tolist(), strict=True)) == [(0, 2)]


def test_of_many_only_those_close_by_are_looked_at() -> None:
    n = 3000
    rng = np.random.default_rng(1)
    lower = rng.uniform(0, 100, (n, 2))
    walls = Boxes(np.array([[0.0, 0.0], [50.0, 0.0]]), np.array([[100.0, 0.1], [50.1, 100.0]]))
    first, other = pairs_among(Boxes(lower, lower + 0.5))
    assert 0 < len(first) == len(other) < 10 * n
    assert len(pairs_between(Boxes(lower, lower + 0.5), walls)[0]) < n


# --- comparison with pymunk -----------------------------------------------------------------------


def pymunk_shapes(solids: Volumes, body: pymunk.Body) -> list[pymunk.Shape]:
    made: list[pymunk.Shape] = []
    for row in range(len(solids)):
        core = [tuple(p) for p in solids.points[solids.first[row] : solids.first[row + 1]].tolist()]
        radius = float(solids.radius[row])
        if len(core) == 1:
            made.append(pymunk.Circle(body, radius, core[0]))
        elif len(core) == 2:
            made.append(pymunk.Segment(body, core[0], core[1], radius))
        else:
            made.append(pymunk.Poly(body, core, radius=radius))
    return made


def anywhere(seed: int, count: int) -> list[Shape]:
    """Shapes in general position, because pymunk fails if corners coincide exactly."""
    rng = np.random.default_rng(seed)
    kinds = ("disc", "bar", "block")
    shapes: list[Shape] = []
    for _ in range(count):
        kind, (x, y) = kinds[rng.integers(3)], rng.uniform(0, 4, 2).tolist()
        angle, (width, height) = rng.uniform(0, 360), rng.uniform(0.1, 1, 2).tolist()
        shapes.append((kind, x, y, angle, width, height))
    return shapes


def depths_by_pymunk(solids: Volumes) -> dict[tuple[int, int], float]:
    """Depths by pair of rows, the smaller row first."""
    space = pymunk.Space()
    others = pymunk_shapes(solids, space.static_body)
    space.add(*others)
    number = {shape: row for row, shape in enumerate(others)}
    depths: dict[tuple[int, int], float] = {}
    for row, shape in enumerate(others):
        for info in space.shape_query(shape):
            points = info.contact_point_set.points
            if info.shape is not None and number[info.shape] > row and points:
                depths[row, number[info.shape]] = max(abs(point.distance) for point in points)
    return depths


@given(st.integers(0, 10**6), st.integers(2, 16))
@settings(max_examples=60)
def test_contacts_agree_with_pymunk(seed: int, count: int) -> None:
    solids = volumes(scene_of(anywhere(seed, count), count), VOCABULARY)
    every = np.array(list(itertools.combinations(range(len(solids)), 2)))
    touch = touches(solids, every[:, 0], every[:, 1])
    rows = zip(touch.first.tolist(), touch.second.tolist(), touch.depth.tolist(), strict=True)
    depths = {(a, b): depth for a, b, depth in rows}
    theirs = depths_by_pymunk(solids)
    for pair in depths.keys() | theirs.keys():
        assert depths.get(pair, 0.0) == pytest.approx(theirs.get(pair, 0.0), abs=1e-6), pair


@given(shapes, shapes)
@example(("block", 0.0, 0.0, 30.0, 1 / 8, 1 / 8), ("block", 1 / 8, 0.0, 30.0, 1 / 8, 1 / 8))
@settings(max_examples=60)
def test_along_the_normal_by_the_depth_and_they_just_touch(first: Shape, other: Shape) -> None:
    solids = volumes(scene_of([first, other], 2), VOCABULARY)
    pair = np.array([0]), np.array([len(solids) - 1])
    touch = touches(solids, *pair)
    if not len(touch.first):
        return
    (nx, ny), depth = touch.normal[0], float(touch.depth[0])
    assert math.hypot(nx, ny) == pytest.approx(1)
    moved = solids.points.copy()
    moved[solids.first[0] : solids.first[1]] += depth * touch.normal[0]
    out = Volumes(moved, solids.first, solids.radius, solids.owners, solids.kinds, solids.symbols)
    left = touches(out, *pair)
    assert not len(left.first) or left.depth[0] <= 1e-9
    moved[solids.first[0] : solids.first[1]] += 2 * TOLERANCE * touch.normal[0]
    assert not len(touches(out, *pair).first)
    if depth > 1e-6:
        moved[solids.first[0] : solids.first[1]] -= depth / 10 * touch.normal[0]
        assert len(touches(out, *pair).first)
    # The contact point is at most half of the overlap away from either shape.
    place = TPlace(*touch.point[0].tolist(), 0.0)(PBody(depth / 2 + 1e-6))
    probe = volumes(scene_of([first, other], 2) + place, VOCABULARY)
    last = len(probe) - 1
    assert len(touches(probe, np.array([0, last - 1]), np.array([last, last])).first) == 2


@given(shapes, shapes)
@settings(max_examples=40)
def test_it_is_the_same_from_the_other_side(first: Shape, other: Shape) -> None:
    solids = volumes(scene_of([first, other], 2), VOCABULARY)
    rows = np.array([0]), np.array([len(solids) - 1])
    forth, back = touches(solids, *rows), touches(solids, *rows[::-1])
    assert len(forth.first) == len(back.first)
    assert forth.depth == pytest.approx(back.depth, abs=1e-12)
