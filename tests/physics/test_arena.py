"""Bodies move exactly as commanded or stop at contacts; rays hit bodies."""

import json
import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_services.physics.arena import Arena
from minerva_services.physics.body import Body, DriveOutcome, Odometer, body_of, row_of
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.walls import Segments, wall_segments
from tests.counting import calls

MAPS = Path(__file__).parents[3] / "shared" / "data" / "ros_maps"
"""Real maps are not part of the project; tests that need them are skipped without them."""

TOUCHES = 2e-9
"""Maximum overlap in metres of a body with the obstacle that it rests against."""

Commands = Sequence[tuple[str, float, float]]


def room(width: float, height: float) -> Segments:
    """Four walls around (0, 0) to (width, height), with free space on their left."""
    corners = [(0, 0), (width, 0), (width, height), (0, height)]
    return np.array([(*corners[k - 1], *corners[k]) for k in range(4)], np.float64)


def clutter(count: int, size: float, rng: np.random.Generator) -> Segments:
    """A square room of `size` metres with random short walls, none near its centre."""
    middle = np.full(2, size / 2)
    starts = rng.uniform(0, size, (4 * count, 2))
    starts = starts[np.hypot(*(starts - middle).T) > 2.5][:count]
    directions = rng.uniform(0, 2 * math.pi, len(starts))
    lengths = rng.uniform(0.05, 1.0, len(starts))
    ends = starts + lengths[:, None] * np.stack([np.cos(directions), np.sin(directions)], axis=1)
    return np.concatenate([room(size, size), np.concatenate([starts, ends], axis=1)])


def crowded() -> Arena:
    """Three bodies in a narrow room with a free-standing wall."""
    arena = Arena()
    arena.add_walls(room(3, 3), solid_behind=True)
    arena.add_walls(np.array([[1.5, 1.0, 1.5, 2.0], [0.5, 2.5, 1.0, 2.7]]))
    for name, x, y in (("a", 0.6, 0.6), ("b", 1.1, 0.7), ("c", 2.2, 2.1)):
        arena.add_body(name, x, y, 0, 0.2)
    return arena


def drive(arena: Arena, commands: Commands) -> tuple[DriveOutcome, ...]:
    for name, turn, forward in commands:
        arena.drive(name, turn, forward)
    return arena.step(0.1)


def gap_to_walls(pose: Pose, walls: Segments) -> float:
    """Distance in metres from a pose to the nearest wall, by projection."""
    a, b = walls[:, :2], walls[:, 2:]
    along = b - a
    at = np.array([pose.x, pose.y])
    part = np.clip(((at - a) * along).sum(1) / (along**2).sum(1), 0, 1)
    return float(np.hypot(*(at - a - part[:, None] * along).T).min())


def ray_lengths(
    pose: Pose, angles: NDArray[np.float64], walls: Segments, range_max: float
) -> NDArray[np.float64]:
    """Ranges of all beams by Cramer's rule for every beam and wall."""
    headings = np.radians(pose.angle + angles)[:, None]
    dx, dy = np.cos(headings), np.sin(headings)
    ax, ay, bx, by = walls.T
    ux, uy, wx, wy = bx - ax, by - ay, ax - pose.x, ay - pose.y
    across = dx * uy - dy * ux
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (wx * uy - wy * ux) / across
        part = (wx * dy - wy * dx) / across
    hits = (distance >= 0) & (part >= 0) & (part <= 1)
    return np.where(hits, distance, range_max).min(axis=1).clip(max=range_max)


# Driving


def test_free_driving_is_dead_reckoning_to_the_last_bit() -> None:
    rng = np.random.default_rng(1)
    arena = Arena()
    arena.add_walls(room(1e6, 1e6) - 5e5)
    x, y, angle = 0.1, -0.2, 12.3
    arena.add_body("a", x, y, angle, 0.3)
    for turn, forward in rng.normal(0, (40, 0.5), (1000, 2)).tolist():
        (outcome,) = drive(arena, [("a", turn, forward)])
        angle += turn
        x += forward * portable.cos(math.radians(angle))
        y += forward * portable.sin(math.radians(angle))
        assert arena.pose("a") == Pose(x, y, angle)
        assert outcome == DriveOutcome("a", forward, 0.0, turn, False)


@pytest.mark.parametrize("forward", [0.7, 2.0, 50.0])
@pytest.mark.parametrize(("angle", "room_ahead"), [(0, 1.8), (90, 0.8), (180, 1.8), (270, 0.8)])
def test_a_wall_stops_a_body_at_its_radius(angle: float, room_ahead: float, forward: float) -> None:
    arena = Arena()
    arena.add_walls(room(4, 2))
    arena.add_body("a", 2, 1, 0, 0.2)
    (outcome,) = drive(arena, [("a", angle, forward)])
    moved = min(forward, room_ahead)
    assert outcome.moved_m == pytest.approx(moved, abs=1e-12)
    assert outcome.shortfall_m == pytest.approx(forward - moved, abs=1e-12)
    assert outcome.collided == (forward > room_ahead)
    assert arena.pose("a").angle == angle


def test_a_stopped_body_is_where_dead_reckoning_of_its_outcome_is() -> None:
    arena = Arena()
    arena.add_walls(room(4, 2))
    arena.add_body("a", 2, 1, 0, 0.2)
    (outcome,) = drive(arena, [("a", 33, 9)])
    heading = math.radians(33)
    x, y = 2 + outcome.moved_m * math.cos(heading), 1 + outcome.moved_m * math.sin(heading)
    assert outcome.collided
    assert arena.pose("a") == Pose(x, y, 33)


def test_driving_backwards_is_stopped_too_and_signed() -> None:
    arena = Arena()
    arena.add_walls(room(4, 2))
    arena.add_body("a", 2, 1, 0, 0.2)
    (outcome,) = drive(arena, [("a", 0, -5)])
    assert outcome.moved_m == pytest.approx(-1.8)
    assert outcome.shortfall_m == pytest.approx(3.2)
    assert arena.odometer("a") == Odometer(-outcome.moved_m, 1)


def test_a_body_at_a_wall_turns_slides_along_it_and_leaves() -> None:
    arena = Arena()
    arena.add_walls(np.array([[k, 0, k + 1, 0] for k in range(10)], np.float64))
    arena.add_body("a", 0.5, 1, -90, 0.2)
    assert drive(arena, [("a", 0, 3)])[0].collided
    (stuck,) = drive(arena, [("a", 0, 0.1)])
    assert stuck == DriveOutcome("a", 0.0, 0.1, 0.0, True, stuck.contact)
    assert drive(arena, [("a", 90, 8)])[0] == DriveOutcome("a", 8.0, 0.0, 90.0, False)
    assert drive(arena, [("a", 90, 1)])[0] == DriveOutcome("a", 1.0, 0.0, 90.0, False)


@pytest.mark.parametrize("angle", [27, 90, 133, -61.7])
def test_a_body_slides_past_the_joints_of_a_turned_wall(angle: float) -> None:
    heading = math.radians(angle)
    joints = np.outer(np.arange(0, 10.1, 0.1), [math.cos(heading), math.sin(heading)])
    arena = Arena()
    arena.add_walls(np.hstack([joints[:-1], joints[1:]]) + np.array([3, 1, 3, 1]))
    x, y = 3 + math.cos(heading) - math.sin(heading), 1 + math.sin(heading) + math.cos(heading)
    arena.add_body("a", x, y, angle, 0.2)
    assert drive(arena, [("a", -90, 2)])[0].collided
    for _ in range(20):
        assert not drive(arena, [("a", 90, 0.33)])[0].collided
        assert drive(arena, [("a", -90, 0.01)])[0].collided


@pytest.mark.parametrize("angle", [0, 17, 45, 80, -60])
def test_nothing_passes_through_a_wall_of_one_cell(angle: float) -> None:
    cells = np.zeros((200, 200), np.int16)
    cells[100, :] = 100
    arena = Arena()
    arena.add_walls(wall_segments(cells, 0.05), solid_behind=True)
    arena.add_body("a", 4.0, 5, angle, 0.02)
    for _ in range(5):
        drive(arena, [("a", 0, 2)])
    assert arena.pose("a").x <= 4.98 + TOUCHES
    assert arena.odometer("a").collisions > 0


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_no_sequence_of_commands_makes_bodies_overlap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arena = Arena()
    walls = clutter(30, 8, rng)
    arena.add_walls(walls)
    radii = dict(zip("abcde", rng.uniform(0.1, 0.35, 5).tolist(), strict=True))
    for k, (name, radius) in enumerate(radii.items()):
        arena.add_body(name, 4 + math.cos(k * 1.2566), 4 + math.sin(k * 1.2566), 0, radius)
    for _ in range(20):
        drive(arena, [(name, *rng.uniform((-180, -1), (180, 3)).tolist()) for name in radii])
        poses = {name: arena.pose(name) for name in radii}
        for name, pose in poses.items():
            assert gap_to_walls(pose, walls) >= radii[name] - TOUCHES
        for first, other in combinations(radii, 2):
            apart = math.dist((poses[first].x, poses[first].y), (poses[other].x, poses[other].y))
            assert apart >= radii[first] + radii[other] - TOUCHES


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_body_stops_at_the_first_touch_and_not_before(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arena = Arena()
    walls = clutter(40, 8, rng)
    arena.add_walls(walls)
    arena.add_body("a", 4, 4, 0, 0.3)
    (outcome,) = drive(arena, [("a", float(rng.uniform(0, 360)), 9)])
    pose, heading = arena.pose("a"), math.radians(arena.pose("a").angle)
    assert outcome.collided
    assert gap_to_walls(pose, walls) == pytest.approx(0.3, abs=TOUCHES)
    further = Pose(pose.x + 1e-3 * math.cos(heading), pose.y + 1e-3 * math.sin(heading), 0)
    assert gap_to_walls(further, walls) < 0.3
    for part in np.linspace(0, outcome.moved_m, 200).tolist():
        at = Pose(4 + part * math.cos(heading), 4 + part * math.sin(heading), 0)
        assert gap_to_walls(at, walls) >= 0.3 - TOUCHES


# Collisions between bodies


def pair(distance: float) -> Arena:
    arena = Arena()
    arena.add_body("a", 0, 0, 0, 0.2)
    arena.add_body("b", distance, 0, 180, 0.3)
    return arena


def test_a_standing_body_stops_another_and_has_not_collided() -> None:
    arena = pair(2)
    assert [outcome.name for outcome in drive(arena, [("a", 0, 5)])] == ["a"]
    assert arena.pose("a").x == pytest.approx(1.5, abs=1e-12)
    assert arena.pose("b") == Pose(2, 0, 180)
    assert arena.odometer("b") == Odometer(0.0, 0)


def test_bodies_in_a_head_on_collision_stop_according_to_their_speeds() -> None:
    arena = pair(2)
    outcomes = drive(arena, [("b", 0, 4), ("a", 0, 2)])
    assert [outcome.name for outcome in outcomes] == ["a", "b"]
    assert all(outcome.collided for outcome in outcomes)
    assert arena.pose("a").x == pytest.approx(0.5)
    assert arena.pose("b").x == pytest.approx(1.0)


def test_the_name_of_a_body_has_no_effect() -> None:
    courses = {"p": (0, 0, 30.0, 2.0), "q": (1, 0, 120.0, 1.5), "r": (0.5, 0.9, -90.0, 1.0)}
    results: set[tuple[Pose, ...]] = set()
    for names in ("abc", "cba", "bca"):
        arena = Arena()
        for name, (x, y, angle, _) in zip(names, courses.values(), strict=True):
            arena.add_body(name, x, y, angle, 0.2)
        commands = zip(names, courses.values(), strict=True)
        drive(arena, [(name, 0, forward) for name, (_, _, _, forward) in commands])
        results.add(tuple(arena.pose(name) for name in names))
    assert len(results) == 1


def test_a_robot_that_is_hit_continues() -> None:
    arena = Arena()
    arena.add_body("front", 1, 0, 0, 0.2)
    arena.add_body("rear", 0, 0, 0, 0.2)
    front, rear = drive(arena, [("front", 0, 1), ("rear", 0, 3)])
    assert front == DriveOutcome("front", 1.0, 0.0, 0.0, False)
    assert rear.collided
    assert rear.moved_m == pytest.approx(0.9)


def test_a_convoy_of_equals_does_not_collide_even_touching() -> None:
    arena = Arena()
    for k in range(5):
        arena.add_body(str(k), 0.4 * k, 0, 0, 0.2)
    assert not any(outcome.collided for outcome in drive(arena, [(str(k), 0, 1) for k in range(5)]))


def test_one_stopped_by_a_wall_stops_the_one_behind() -> None:
    arena = Arena()
    arena.add_walls(np.array([[2.0, -1, 2, 1]]))
    arena.add_body("front", 1, 0, 0, 0.2)
    arena.add_body("rear", 0, 0, 0, 0.2)
    front, rear = drive(arena, [("front", 0, 2), ("rear", 0, 2)])
    assert (front.collided, rear.collided) == (True, True)
    assert arena.pose("front").x == pytest.approx(1.8)
    assert arena.pose("rear").x == pytest.approx(1.4)


def test_paths_that_cross_at_different_times_do_not_collide() -> None:
    arena = Arena()
    arena.add_body("a", -4, 0, 0, 0.2)
    arena.add_body("b", 0, -1, 90, 0.2)
    assert not any(outcome.collided for outcome in drive(arena, [("a", 0, 8), ("b", 0, 8)]))


# Sensing


def test_a_scan_measures_a_room() -> None:
    arena = Arena()
    arena.add_walls(room(4, 2))
    arena.add_body("a", 1, 0.5, 90, 0.2)
    scan = arena.scan("a", 5, -90, 45, 2.5)
    expected = [2.5, 1.5 * math.sqrt(2), 1.5, math.sqrt(2), 1.0]
    assert scan.shape == (5,)
    assert scan.dtype == np.float64
    assert np.allclose(scan, expected, rtol=0, atol=1e-12)


def test_a_scan_sees_other_bodies_and_not_its_own() -> None:
    arena = pair(2)
    assert arena.scan("a", 2, 0, 180, 10).tolist() == pytest.approx([1.7, 10.0], abs=1e-12)
    drive(arena, [("b", 0, 1)])
    assert arena.scan("a", 1, 0, 1, 10)[0] == pytest.approx(0.7, abs=1e-12)
    arena.remove_body("b")
    assert arena.scan("a", 1, 0, 1, 10)[0] == 10


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_a_scan_equals_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls = clutter(200, 10, rng)
    arena = Arena()
    arena.add_walls(walls)
    arena.add_body("a", 5, 5, float(rng.uniform(-720, 720)), 0.3)
    scan = arena.scan("a", 360, -180, 1, 6)
    expected = ray_lengths(arena.pose("a"), np.arange(-180, 180, dtype=np.float64), walls, 6)
    assert np.allclose(scan, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0, 30, 90, 201.5])
def test_no_ray_slips_through_a_corner(angle: float) -> None:
    walls = wall_segments(np.zeros((6, 6), np.int16), 0.37, x=1.3, y=-2.2, angle=angle)
    middle = walls[:, :2].mean(axis=0)
    arena = Arena()
    arena.add_walls(walls)
    for x, y in (middle + np.random.default_rng(5).uniform(-0.5, 0.5, (300, 2))).tolist():
        arena.add_body("a", x, y, 0, 0.1)
        for corner_x, corner_y in walls[:, :2].tolist():
            aim = math.degrees(math.atan2(corner_y - y, corner_x - x))
            distance = math.dist((x, y), (corner_x, corner_y))
            assert arena.scan("a", 1, aim, 0, 9)[0] == pytest.approx(distance, abs=1e-9)
        arena.remove_body("a")


def test_a_camera_sees_what_is_in_its_field_in_range_and_not_hidden() -> None:
    arena = Arena()
    arena.add_walls(np.array([[2.0, 0.5, 2, 1.5], [-2, -2, -2, 2]]))
    arena.add_body("a", 0, 0, 0, 0.2)
    places = {"hidden": (4, 2), "ahead": (3, 0), "far": (9, 0), "side": (0, 3), "edge": (2, -2)}
    for name, (x, y) in places.items():
        arena.add_marker(name, x, y)
    seen = arena.visible("a", 90, 8)
    assert [sighting.marker for sighting in seen] == ["ahead", "edge"]
    assert [sighting.distance for sighting in seen] == pytest.approx([3, math.sqrt(8)])
    assert [sighting.angle for sighting in seen] == pytest.approx([0, -45])
    drive(arena, [("a", 60, 0)])
    assert [(s.marker, round(s.angle, 9)) for s in arena.visible("a", 90, 8)] == [("side", 30)]


def test_a_marker_on_a_wall_is_seen_from_its_side_only() -> None:
    arena = Arena()
    cells = np.zeros((40, 20), np.int16)
    cells[20, :] = 100
    arena.add_walls(wall_segments(cells, 0.1), solid_behind=True)
    arena.add_marker("near", 2.0, 1.3)
    arena.add_marker("back", 2.1, 1.3)
    arena.add_marker("sunk in", 2.0005, 1.2)
    arena.add_body("a", 0.7, 1, 0, 0.2)
    arena.add_body("b", 3.2, 1, 170, 0.2)
    assert [s.marker for s in arena.visible("a", 60, 5)] == ["near", "sunk in"]
    assert [s.marker for s in arena.visible("b", 60, 5)] == ["back"]


def test_a_body_hides_a_marker_and_bearings_wrap() -> None:
    arena = pair(2)
    arena.add_marker("m", 4, 0)
    arena.add_marker("behind", -1, 0.01)
    assert [s.marker for s in arena.visible("a", 180, 9)] == []
    assert [s.marker for s in arena.visible("b", 180, 9)] == []
    drive(arena, [("a", 720, 0)])
    (sighting,) = arena.visible("a", 360, 9)
    assert sighting.marker == "behind"
    assert 179 < sighting.angle < 180


# State


COMMANDS = st.lists(
    st.fixed_dictionaries(
        {},
        optional={
            name: st.tuples(st.floats(-180, 180), st.floats(-1, 2)) for name in ("a", "b", "c")
        },
    ),
    max_size=12,
)


def follow(arena: Arena, frames: Sequence[dict[str, tuple[float, float]]]) -> list[object]:
    """All observable results of a sequence of commands."""
    seen: list[object] = []
    for frame in frames:
        seen.append(drive(arena, [(name, *command) for name, command in frame.items()]))
        seen.append([(arena.pose(name), arena.odometer(name)) for name in arena.bodies])
        seen.extend(arena.scan(name, 12, 0, 30, 5).tobytes() for name in arena.bodies)
    return seen


def bodies(arena: Arena) -> dict[str, Body]:
    return {name: arena.body(name) for name in arena.bodies}


@settings(deadline=None)
@given(COMMANDS, COMMANDS)
def test_a_restored_arena_goes_on_bit_for_bit(
    before: list[dict[str, tuple[float, float]]], after: list[dict[str, tuple[float, float]]]
) -> None:
    original, other = crowded(), crowded()
    follow(original, before)
    rows = json.loads(json.dumps({name: row_of(original.body(name)) for name in original.bodies}))
    for name, row in rows.items():
        other.remove_body(name)
        other.put_body(name, body_of(row))
    assert bodies(other) == bodies(original)
    assert follow(other, after) == follow(original, after)


@settings(deadline=None)
@given(COMMANDS)
def test_the_same_commands_give_the_same_world(
    frames: list[dict[str, tuple[float, float]]],
) -> None:
    assert follow(crowded(), frames) == follow(crowded(), frames)


def test_the_order_of_commands_does_not_matter() -> None:
    first, other = crowded(), crowded()
    commands = [("a", 10.0, 2.0), ("b", 170.0, 2.0), ("c", -130.0, 3.0)]
    assert drive(first, commands) == drive(other, commands[::-1])
    assert bodies(first) == bodies(other)


@pytest.mark.parametrize(
    "row", [[1, 2, 3], [1, 2, math.nan, 0.2, 0, 0], [1, 2, 3, 0, 0, 0], [1, 2, 3, 0.2, 0, "a"]]
)
def test_a_row_that_is_no_body_is_rejected(row: list[float]) -> None:
    with pytest.raises((PhysicsError, ValueError)):
        body_of(row)


# Errors


def test_a_body_in_a_wall_is_refused_with_the_way_to_a_free_place() -> None:
    arena = Arena()
    cells = np.full((100, 100), -1, np.int16)
    cells[40:60, 40:60] = 0
    arena.add_walls(wall_segments(cells, 0.1), solid_behind=True)
    for x, y, away in ((4.1, 5, 0.1), (3.9, 5, 0.3), (1, 5, 3.2), (1, 1, 4.443), (20, 5, 14.2)):
        with pytest.raises(PhysicsError, match=rf"'a'.*\({x:g}, {y:g}\).*{away:.3f} m"):
            arena.add_body("a", x, y, 0, 0.2)
    arena.add_body("a", 4.2, 4.2, 0, 0.2)


def test_free_cells_of_a_ragged_map_are_distinguished_from_solid_ones() -> None:
    rng = np.random.default_rng(3)
    cells = rng.choice(np.array([0, 100, -1], np.int16), (30, 30))
    arena = Arena()
    arena.add_walls(wall_segments(cells, 1.0, x=-4, y=3, angle=31), solid_behind=True)
    heading = math.radians(31)
    cos, sin = math.cos(heading), math.sin(heading)
    for u, v in rng.uniform(0, 30, (500, 2)).tolist():
        margin = min(u % 1, v % 1, 1 - u % 1, 1 - v % 1)
        x, y = -4 + u * cos - v * sin, 3 + u * sin + v * cos
        if cells[int(u), int(v)] == 0:
            arena.add_body("a", x, y, 0, margin * 0.999)
            arena.remove_body("a")
        else:
            with pytest.raises(PhysicsError, match="inside a wall"):
                arena.add_body("a", x, y, 0, margin * 0.999)


def test_a_place_beyond_the_tip_of_a_solid_spike_is_free() -> None:
    arena = Arena()
    spike = np.array([[0.0, 0, -9, 2], [-9, 2, -9, -2], [-9, -2, 0, 0]])
    arena.add_walls(spike[:, [2, 3, 0, 1]], solid_behind=True)
    for x, y in ((1, 0), (1, 0.5), (1, -0.5), (0.3, 0.05), (-4, 1.3), (-4, -1.3)):
        arena.add_body("a", x, y, 0, 0.1)
        arena.remove_body("a")
    for x, y in ((-4, 0), (-4, 0.4), (-8, -1)):
        with pytest.raises(PhysicsError, match="inside a wall"):
            arena.add_body("a", x, y, 0, 0.1)


def test_names_must_be_known_and_new() -> None:
    arena = crowded()
    with pytest.raises(PhysicsError, match="exists already"):
        arena.add_body("a", 1, 2.2, 0, 0.1)
    arena.add_marker("m", 0, 0)
    with pytest.raises(PhysicsError, match="exists already"):
        arena.add_marker("m", 1, 1)
    with pytest.raises(PhysicsError, match=r"overlaps body 'a' by 0\.100 m"):
        arena.add_body("d", 0.6, 0.8, 0, 0.1)
    for use in (arena.pose, arena.odometer, arena.remove_body):
        with pytest.raises(
            PhysicsError, match=r"there is no body 'x'; existing bodies: \['a', 'b', 'c'\]"
        ):
            use("x")
    with pytest.raises(PhysicsError, match="no body"):
        arena.drive("x", 0, 0)


def test_commands_and_numbers_must_make_sense() -> None:
    arena = crowded()
    for turn, forward in ((math.nan, 0), (0, math.inf)):
        with pytest.raises(PhysicsError, match="finite"):
            arena.drive("a", turn, forward)
    arena.drive("a", 0, 0)
    with pytest.raises(PhysicsError, match="already"):
        arena.drive("a", 0, 0)
    for dt in (0, -1, math.nan):
        with pytest.raises(PhysicsError, match="seconds"):
            arena.step(dt)
    with pytest.raises(PhysicsError, match="range"):
        arena.scan("a", 1, 0, 1, 0)
    with pytest.raises(PhysicsError, match="beams"):
        arena.scan("a", -1, 0, 1, 1)
    with pytest.raises(PhysicsError, match="field of view"):
        arena.visible("a", 0, 1)
    with pytest.raises(PhysicsError, match="length"):
        arena.add_walls(np.ones((1, 4)))
    with pytest.raises(PhysicsError, match="rows of"):
        arena.add_walls(np.ones((1, 3)))


# Large maps


def depot() -> NDArray[np.int16]:
    """The depot map: rows along x, columns along y; 0 free, 100 occupied, -1 unknown."""
    if not (MAPS / "depot.pgm").exists():
        pytest.skip("no depot map: ../shared/data/ros_maps is not there")
    head, pixels = (MAPS / "depot.pgm").read_bytes().split(b"\n255\n", 1)
    width, height = map(int, head.split()[-2:])
    dark = 1 - np.frombuffer(pixels, np.uint8).reshape(height, width)[::-1].T / 255
    return np.select([dark > 0.65, dark < 0.25], [100, 0], -1).astype(np.int16)


def test_a_body_on_a_real_map_stays_clear_of_its_walls() -> None:
    walls = wall_segments(depot(), 0.05)
    arena = Arena()
    arena.add_walls(walls, solid_behind=True)
    arena.add_body("a", 15, 7.5, 0, 0.2)
    for turn, forward in np.random.default_rng(0).normal(0, (40, 0.3), (100, 2)).tolist():
        drive(arena, [("a", turn, forward)])
        assert gap_to_walls(arena.pose("a"), walls) >= 0.2 - TOUCHES


def test_scans_do_not_grow_with_the_walls_and_adding_does_with_their_number() -> None:
    adding, scanning = [], []
    for rows in (100, 400):
        cells = np.zeros((rows, rows // 2), np.int16)
        cells[10::20, 10::20] = 100
        walls = wall_segments(cells, 0.05)
        arena = Arena()
        arena.add_walls(walls, solid_behind=True)
        arena.add_body("a", 0.25, 0.25, 0, 0.2)
        adding.append(calls(lambda walls=walls: Arena().add_walls(walls)) / len(walls))
        scanning.append(calls(lambda arena=arena: arena.scan("a", 90, 0, 4, 10)))
    assert adding[1] < 2 * adding[0]
    assert scanning[1] < 2 * scanning[0]
