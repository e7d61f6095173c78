"""Errors of motors and sensors in the physics service: per robot, and reproducible."""

import math
from typing import Any

import pytest
from driving_world import PMarker, TPlace, Yard, driver, room

from minerva_services.physics.service import Physics

ALL: dict[str, Any] = {
    "alpha1": 0.1, "alpha2": 0.1, "alpha3": 0.1, "alpha4": 0.1, "laser_short": 0.1,
    "laser_random": 0.1, "laser_dropout": 0.1, "camera_miss": 0.3, "camera_mistake": 0.3,
}  # fmt: skip
MARKERS = TPlace(3.5, 3.0, 0.0)(PMarker("door")) + TPlace(5.3, 2.4, 0.0)(PMarker("desk"))
ALONE = room(6, 4) + MARKERS + driver("r1", x=1.0, y=1.0, angle=10.0, turn=3.3, speed=0.11)
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
