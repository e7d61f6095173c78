"""Physics, sensors and clocks with agents in one world (section 4.2), also with imperfect robots."""

import math
from itertools import pairwise
from typing import Any

import pytest
from driving_world import RADIUS, PMarker, TPlace, Yard, driver, room

from minerva_bus import Scene
from minerva_services.physics.service import Physics

NOISY: dict[str, Any] = {
    "laser_noise": 0.02,
    "laser_dropout": 0.1,
    "drive_noise": 0.1,
    "turn_noise": 1.0,
    "camera_noise": 0.05,
    "camera_angle_noise": 2.0,
}
MARKERS = TPlace(3.5, 3.0, 0.0)(PMarker("door")) + TPlace(0.3, 0.4, 0.0)(PMarker("desk"))
CROWD = (
    room(4, 4)
    + MARKERS
    + driver("r1", x=1.0, y=1.0, angle=10.0, turn=3.3, speed=0.11)
    + driver("r2", x=2.5, y=1.7, angle=170.0, turn=-2.1, speed=0.09)
)


def alone(**state: float) -> Scene:
    return room(6, 4) + driver("r", **state)


def noisy() -> Physics:
    return Physics(beams=30, **NOISY)


def test_dead_reckoning_and_the_arena_agree_to_the_last_bit() -> None:
    yard = Yard(alone(x=3.0, y=1.0, angle=11.1, turn=7.3, speed=0.123))
    yard.run(1)
    for frame in range(1, 200):
        yard.run(1)
        assert yard.pose("r") == yard.belief(frame, "r").pose
    assert yard.mortal.service.report() == {
        "distance_driven": pytest.approx(199 * 0.123),
        "collisions": 0,
    }


def test_a_scan_is_taken_where_the_action_of_the_frame_before_has_led() -> None:
    yard = Yard(alone(x=1.0, y=1.0, speed=0.25)).run(6)
    assert yard.events(0, "eLaser") == []
    for frame in range(1, 6):
        (ahead,) = [event.dist for event in yard.events(frame, "eLaser") if event.angle == 0]
        believed = yard.belief(frame, "r")
        assert believed.x == 1.0 + 0.25 * frame
        assert ahead == pytest.approx(6.0 - believed.x, abs=1e-6)


def test_a_wall_stops_a_robot_and_the_next_frame_reports_it() -> None:
    yard = Yard(alone(x=5.0, y=1.0, speed=0.25)).run(8)
    collisions = {frame: yard.events(frame, "eCollision") for frame in range(8)}
    assert [frame for frame, events in collisions.items() if events] == [4, 5, 6, 7]
    (first,) = collisions[4]
    assert first.receivers == ("r",)
    assert first.shortfall == pytest.approx(5.0 + 4 * 0.25 - (6.0 - RADIUS))
    assert collisions[5][0].shortfall == pytest.approx(0.25)
    assert yard.pose("r") == pytest.approx((6.0 - RADIUS, 1.0, 0.0))
    believed = yard.belief(5, "r")
    assert believed.x - believed.short == pytest.approx(6.0 - RADIUS + 0.25)
    assert yard.mortal.service.report()["collisions"] == 4


def test_two_robots_receive_their_own_sensors_and_see_each_other() -> None:
    scene = room(6, 4) + driver("a", x=1.0, y=2.0) + driver("b", x=3.0, y=2.0, angle=180.0)
    yard = Yard(scene).run(3)
    for name, ahead in (("a", 3.0 - 1.0 - RADIUS), ("b", 3.0 - 1.0 - RADIUS)):
        events = [event for event in yard.events(2, "eLaser") if event.receivers == (name,)]
        assert len(events) == 90
        (dist,) = [event.dist for event in events if event.angle == 0]
        assert dist == pytest.approx(ahead, abs=1e-6)
    assert yard.belief(2, "a").heard != yard.belief(2, "b").heard


def test_the_robot_that_drives_into_another_is_notified() -> None:
    scene = room(6, 4) + driver("a", x=1.0, y=2.0, speed=0.25) + driver("b", x=2.0, y=2.0)
    yard = Yard(scene).run(5)
    collisions = [event for frame in range(5) for event in yard.events(frame, "eCollision")]
    assert {event.receivers for event in collisions} == {("a",)}
    assert yard.pose("a") == pytest.approx((2.0 - 2 * RADIUS, 2.0, 0.0))
    assert yard.pose("b") == (2.0, 2.0, 0.0)


def test_markers_are_seen_in_the_right_direction() -> None:
    facing = math.degrees(math.atan2(1.0, 1.5))
    yard = Yard(room(4, 4) + MARKERS + driver("r", x=2.0, y=2.0, angle=facing)).run(2)
    (seen,) = yard.events(1, "eCamera")
    assert (seen.marker, seen.receivers) == ("door", ("r",))
    assert (seen.dist, seen.angle) == pytest.approx((math.hypot(1.0, 1.5), 0.0), abs=1e-6)


def test_the_same_seed_gives_the_same_strings_and_another_seed_others() -> None:
    first, again, other = (Yard(CROWD, seed, noisy).run(15).digests for seed in (7, 7, 8))
    assert first == again
    assert first[:1] == other[:1]
    assert all(reading != its for reading, its in zip(first[1:], other[1:], strict=True))


def test_noise_makes_beliefs_drift() -> None:
    yard = Yard(alone(x=3.0, y=1.0, turn=5.0, speed=0.05), physics=noisy).run(30)
    believed = yard.belief(29, "r")
    drift = math.dist(yard.pose("r")[:2], (believed.x, believed.y))
    assert 0.001 < drift < 0.5


FRAMES = 6
FIRST_TICK = 3
"""Index of the first tick, after greeting, welcome and publishers; views follow ticks."""


@pytest.fixture(scope="module")
def undisturbed() -> Yard:
    return Yard(CROWD, physics=noisy).run(FRAMES)


def test_there_is_something_to_lose(undisturbed: Yard) -> None:
    assert len(set(undisturbed.digests)) == FRAMES
    assert undisturbed.mortal.heard == FIRST_TICK + 2 * FRAMES
    assert any(undisturbed.events(frame, "eCamera") for frame in range(FRAMES))
    assert all(a != b for a, b in pairwise(undisturbed.scenes))


@pytest.mark.parametrize("notices_at_once", [True, False])
@pytest.mark.parametrize("answers", [0, 1, 2, 3])
@pytest.mark.parametrize("dies_at", range(FIRST_TICK, FIRST_TICK + 2 * FRAMES - 2))
def test_a_death_of_physics_at_any_point_leaves_the_same_strings(
    undisturbed: Yard, dies_at: int, answers: int, notices_at_once: bool
) -> None:
    """Per tick, physics sends readings of two topics and a reply; 0 to 3 of them get out."""
    yard = Yard(CROWD, physics=noisy, notices_at_once=notices_at_once)
    yard.mortal.dies_at, yard.mortal.answers = dies_at, answers
    yard.run(FRAMES)
    assert yard.deaths == 1
    assert yard.digests == undisturbed.digests
    assert yard.mortal.service.save() == undisturbed.mortal.service.save()
    assert yard.mortal.service.report() == undisturbed.mortal.service.report()


@pytest.mark.parametrize("answers", [0, 1, 2, 3])
@pytest.mark.parametrize("dies_at", range(FIRST_TICK, FIRST_TICK + FRAMES))
def test_a_command_is_not_carried_out_twice_where_frames_pass_without_a_view(
    dies_at: int, answers: int
) -> None:
    undisturbed = Yard(CROWD, physics=noisy, represents_every=3).run(FRAMES)
    yard = Yard(CROWD, physics=noisy, represents_every=3)
    yard.mortal.dies_at, yard.mortal.answers = dies_at, answers
    yard.run(FRAMES)
    assert yard.deaths == 1
    assert yard.digests == undisturbed.digests
    assert yard.mortal.service.report() == undisturbed.mortal.service.report()


def test_dying_in_every_frame(undisturbed: Yard) -> None:
    yard = Yard(CROWD, physics=noisy)
    for frame in range(FRAMES):
        yard.mortal.dies_at, yard.mortal.answers = yard.mortal.heard + 1, frame % 4
        yard.run(1)
    assert yard.deaths >= FRAMES - 1
    assert yard.digests == undisturbed.digests


ALL: dict[str, Any] = {
    "alpha1": 0.1, "alpha2": 0.1, "alpha3": 0.1, "alpha4": 0.1, "laser_short": 0.1,
    "laser_random": 0.1, "laser_dropout": 0.1, "camera_miss": 0.3, "camera_mistake": 0.3,
}  # fmt: skip
SIGNS = TPlace(3.5, 3.0, 0.0)(PMarker("door")) + TPlace(5.3, 2.4, 0.0)(PMarker("desk"))
ALONE = room(6, 4) + SIGNS + driver("r1", x=1.0, y=1.0, angle=10.0, turn=3.3, speed=0.11)
TWO = ALONE + driver("r2", x=1.0, y=3.5, angle=170.0, turn=-2.1)


def yard(scene: Any = ALONE, **errors: Any) -> Yard:
    return Yard(scene, 7, lambda: Physics(beams=30, **errors)).run(12)


def seen(yard: Yard) -> list[Any]:
    return [yard.events(frame, "eCamera") for frame in range(12)]


def test_other_robots_do_not_change_a_robots_random_draws() -> None:
    errors = {name: ALL[name] for name in ("alpha1", "alpha2", "alpha3", "alpha4")}
    assert yard(**errors).pose("r1") == yard(TWO, **errors).pose("r1")


@pytest.mark.parametrize("name", sorted(ALL))
def test_each_error_does_something_and_is_the_same_again(name: str) -> None:
    level = 0.9 if name.startswith("camera") else ALL[name]
    first, again, none = yard(**{name: level}), yard(**{name: level}), yard()
    assert first.digests == again.digests
    assert (first.digests, seen(first)) != (none.digests, seen(none))
    assert seen(first) == seen(again)
    assert (first.pose("r1") != none.pose("r1")) == name.startswith("alpha")


def test_a_second_turn_is_made_after_the_way() -> None:
    still = room(6, 4) + driver("r1", x=1.0, y=1.0, speed=0.2)
    pose = yard(still, alpha2=0.05).pose("r1")
    assert pose[2] != 0.0
    assert math.hypot(pose[0] - 1.0, pose[1] - 1.0) < 11 * 0.2


def test_zero_errors_are_the_world_without_them() -> None:
    assert yard(**dict.fromkeys(ALL, 0.0)).digests == yard().digests
