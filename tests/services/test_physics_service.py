"""The physics world alone: views in, readings and collisions out."""

import json
from typing import Any

import numpy as np
import pytest
from driving_world import (
    INFO,
    PMarker,
    PRobot,
    TMove,
    TPlace,
    TRotate,
    joined,
    room,
    tick,
    world_with,
)

from minerva_bus import EventType, MinervaError, Scene, Tick, View
from minerva_bus.world.context import stream
from minerva_bus.world.readings import Scan, Sightings
from minerva_services.physics import arena
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.kept import kept_bodies
from minerva_services.physics.service import Physics
from minerva_services.physics.walls import wall_segments

FLOOR = room(4, 4)
NOISY: dict[str, Any] = {
    "laser_noise": 0.02,
    "laser_dropout": 0.1,
    "drive_noise": 0.1,
    "turn_noise": 1.0,
    "camera_noise": 0.05,
    "camera_angle_noise": 2.0,
}


def robot(
    name: str = "r", x: float = 2.0, y: float = 2.0, turn: float = 0, dist: float = 0
) -> Scene:
    return TPlace(x, y, 0.0)(TRotate(turn)(TMove(dist)(PRobot(name, 0.2))))


def marker(name: str, x: float, y: float) -> Scene:
    return TPlace(x, y, 0.0)(PMarker(name))


def show(service: Physics, frame: int, *scene: Scene) -> None:
    whole = Scene(tuple(node for nodes in (FLOOR, *scene) for node in nodes))
    service.show(View(frame, "eRepresent", INFO.vocabulary.check(whole)))


def pose(service: Physics, name: str = "r") -> list[float]:
    at = kept_bodies(service.save())[name].body.pose
    return [at.x, at.y, at.angle]


def run(service: Physics, number: int = 1, seed: int = 7) -> tuple[Tick, list[Any]]:
    moment = tick(number, seed=seed)
    return moment, list(service.generate(moment))


def readings(moment: Tick, kind: type) -> dict[str, Any]:
    return {reading.robot: reading for _, reading in moment.published if isinstance(reading, kind)}


def test_before_the_first_view_there_is_nothing() -> None:
    service = joined(Physics())
    moment, events = run(service)
    assert (moment.published, events) == ([], [])
    assert service.report() == {"distance_driven": 0.0, "collisions": 0}


def test_a_command_is_carried_out_once_in_the_next_tick() -> None:
    service = joined(Physics())
    show(service, 0, robot(turn=90, dist=0.25))
    assert pose(service) == [2, 2, 0]
    run(service, 1)
    assert pose(service) == pytest.approx([2, 2.25, 90])
    run(service, 2)
    assert pose(service) == pytest.approx([2, 2.25, 90])


def test_the_same_command_in_the_next_view_is_another_command() -> None:
    service = joined(Physics())
    for frame in range(3):
        show(service, frame, robot(dist=0.25))
        run(service, frame + 1)
    assert pose(service) == [2.75, 2, 0]


def test_a_belief_does_not_move_a_body() -> None:
    service = joined(Physics())
    show(service, 0, robot())
    show(service, 1, robot(x=1.0, y=3.0, dist=0.5))
    run(service)
    assert pose(service) == [2.5, 2, 0]


def test_a_body_that_no_longer_appears_is_gone_and_its_deeds_are_counted() -> None:
    service = joined(Physics())
    show(service, 0, robot("a", x=1.0, dist=0.5), robot("b", x=3.0, dist=1.0))
    run(service, 1)
    show(service, 1, robot("b", dist=-0.25))
    moment, _ = run(service, 2)
    assert list(readings(moment, Scan)) == ["b"]
    assert service.report() == {"distance_driven": 0.5 + 0.8 + 0.25, "collisions": 1}
    assert successor(service.save()).report() == service.report()
    show(service, 2, robot("a", x=1.0), robot("b"))
    assert pose(service, "a") == [1, 2, 0]


def test_walls_are_built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[int] = []

    def counted(cells: Any, *place: float) -> Any:
        built.append(cells.size)
        return wall_segments(cells, *place)

    monkeypatch.setattr(arena, "wall_segments", counted)
    service = joined(Physics())
    show(service, 0, robot())
    show(service, 1, robot())
    service.show(View(2, "eRepresent", INFO.vocabulary.check(room(4, 4) + robot())))
    assert built == [1600]
    service.show(View(3, "eRepresent", INFO.vocabulary.check(room(6, 4) + robot())))
    assert built == [1600, 2400]
    (scan,) = readings(run(service)[0], Scan).values()
    assert scan.ranges[45] == 4


def test_markers_appear_and_disappear() -> None:
    service = joined(Physics())
    for frame, place in ((0, 3.0), (1, 3.5)):
        show(service, frame, robot(), marker("m", place, 2.0))
        (image,) = readings(run(service, frame + 1)[0], Sightings).values()
        assert [
            (sighting.marker, sighting.distance, sighting.angle) for sighting in image.seen
        ] == [("m", place - 2, 0)]
    show(service, 2, robot())
    (image,) = readings(run(service, 3)[0], Sightings).values()
    assert image.seen == ()


def test_published_messages() -> None:
    service = joined(Physics(beams=8, range_max=3.0, camera_range=1.4))
    show(
        service, 0, robot("b", x=1.0), robot("a", turn=90), marker("m", 2.5, 3.0), marker("n", 3, 3)
    )
    moment, _ = run(service, 3)
    assert [(topic, reading.robot) for topic, reading in moment.published] == [
        ("scan", "b"), ("scan", "a"), ("sightings", "b"), ("sightings", "a"),
    ]  # fmt: skip
    scan = readings(moment, Scan)["a"]
    assert (scan.first, scan.step, scan.range_max) == (-180, 45, 3)
    assert scan.time == moment.time
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == (0, 0, 0)
    assert scan.ranges.dtype == np.float32
    assert scan.ranges.tolist() == pytest.approx([2, 8**0.5, 2, 8**0.5, 2, 8**0.5, 0.8, 8**0.5])
    image = readings(moment, Sightings)["a"]
    assert [(sighting.marker, sighting.distance) for sighting in image.seen] == [
        ("m", pytest.approx(1.25**0.5))
    ]
    assert image.seen[0].angle == pytest.approx(-26.565, abs=1e-3)


@pytest.mark.parametrize(
    ("beams", "fov", "angles"),
    [
        (4, 360, [-180, -90, 0, 90]),
        (3, 360, [-120, 0, 120]),
        (3, 90, [-45, 0, 45]),
        (2, 10, [-5, 5]),
        (1, 90, [0]),
        (1, 360, [0]),
    ],
)
def test_beams_are_even_over_the_field_of_view(beams: int, fov: float, angles: list[float]) -> None:
    service = joined(Physics(beams=beams, fov=fov))
    show(service, 0, robot())
    (scan,) = readings(run(service)[0], Scan).values()
    assert [scan.first + index * scan.step for index in range(beams)] == angles
    assert len(scan.ranges) == beams


def test_a_wall_stops_a_move_and_the_robot_learns_the_shortfall() -> None:
    service = joined(Physics())
    show(service, 0, robot("r", dist=2.5), robot("s", y=1.0, dist=0.5))
    _, (collision,) = run(service)
    assert (collision.type, collision.receivers) == ("eCollision", ("r",))
    assert collision.shortfall == pytest.approx(0.7)
    assert pose(service) == pytest.approx([3.8, 2, 0])
    show(service, 1, robot("r", dist=-0.5), robot("s", y=1.0))
    assert run(service, 2)[1] == []
    assert service.report() == {"distance_driven": pytest.approx(1.8 + 0.5 + 0.5), "collisions": 1}


def test_a_shortfall_is_of_what_the_robot_itself_had_commanded() -> None:
    service = joined(Physics(drive_noise=0.1))
    show(service, 0, robot("r", dist=2.5))
    _, (collision,) = run(service)
    assert collision.shortfall == pytest.approx(2.0 + 2.5 - 3.8)


def test_without_noise_nothing_is_drawn() -> None:
    service = joined(Physics())
    show(service, 0, robot(turn=5, dist=0.1), marker("m", 3.0, 2.0))
    moment, _ = run(service)
    assert moment.random.random() == stream(7, "tested", 1).random()


@pytest.mark.parametrize("kind", sorted(NOISY))
def test_each_kind_of_noise_is_drawn_from_the_tick_and_changes_the_readings(kind: str) -> None:
    def measured(seed: int, **options: float) -> tuple[Any, ...]:
        service = joined(Physics(**options))  # type: ignore[arg-type]
        show(service, 0, robot(turn=5, dist=0.1), marker("m", 3.5, 2.0))
        moment, _ = run(service, 1, seed)
        image = readings(moment, Sightings)["r"].seen[0]
        ranges = readings(moment, Scan)["r"].ranges
        return pose(service)[0], pose(service)[2], ranges.tobytes(), image.distance, image.angle

    noise = {kind: NOISY[kind]}
    changed = [a != b for a, b in zip(measured(7), measured(7, **noise), strict=True)]
    moved = [True, kind == "turn_noise", True, True, True]
    expected = {
        "laser_noise": [False, False, True, False, False],
        "laser_dropout": [False, False, True, False, False],
        "drive_noise": moved,
        "turn_noise": moved,
        "camera_noise": [False, False, False, True, False],
        "camera_angle_noise": [False, False, False, False, True],
    }
    assert changed == expected[kind]
    assert measured(7, **noise) == measured(7, **noise)
    assert measured(7, **noise) != measured(8, **noise)


def successor(saved: Any, **options: Any) -> Physics:
    made = joined(Physics(**options))
    made.restore(json.loads(json.dumps(saved)))
    return made


def test_a_successor_goes_on_whenever_its_predecessor_died() -> None:
    views = [(robot(turn=7, dist=0.1), marker("m", 3, 2)), (robot(turn=-3, dist=0.2),)] * 3
    undisturbed, always_new = joined(Physics(**NOISY)), joined(Physics(**NOISY))
    saved: Any = None
    for frame, view in enumerate(views):
        for service in (undisturbed, always_new):
            show(service, frame, *view)
        if frame:  # a process that dies before this tick has saved the previous frame
            always_new = successor(saved, **NOISY)
            show(always_new, frame, *view)
        expected, got = run(undisturbed, frame + 1), run(always_new, frame + 1)
        assert got[1] == expected[1]
        for (_, reading), (_, other) in zip(got[0].published, expected[0].published, strict=True):
            if isinstance(reading, Scan):
                assert isinstance(other, Scan)
                assert reading.ranges.tobytes() == other.ranges.tobytes()
            assert reading == other if isinstance(reading, Sightings) else True
        saved = always_new.save()
        assert saved == undisturbed.save()
        always_new = successor(saved, **NOISY)  # died after the tick: shown the same view again
        show(always_new, frame, *view)
        assert always_new.save() == undisturbed.save()
    assert undisturbed.report() == always_new.report()


def test_a_view_that_was_carried_out_is_not_carried_out_again() -> None:
    service = joined(Physics())
    show(service, 4, robot(dist=0.5))
    run(service, 5)
    after = successor(service.save())
    show(after, 4, robot(dist=0.5))
    run(after, 6)
    assert pose(after) == [2.5, 2, 0]
    show(after, 6, robot(dist=0.5))
    run(after, 7)
    assert pose(after) == [3.0, 2, 0]


def test_a_successor_that_was_shown_nothing_yet_measures_nothing() -> None:
    service = joined(Physics())
    show(service, 0, robot())
    run(service)
    moment, events = run(successor(service.save()), 2)
    assert (moment.published, events) == ([], [])


def test_joining_another_world_starts_over() -> None:
    service = joined(Physics())
    show(service, 0, robot(dist=0.5))
    run(service)
    service.joined(INFO)
    assert run(service)[0].published == []
    show(service, 0, robot(x=1.0))
    assert pose(service) == [1, 2, 0]


def test_saved_data_are_small() -> None:
    service = joined(Physics())
    show(service, 0, *[robot(f"robot-{n}", x=0.5 + n, dist=0.1234567) for n in range(4)])
    run(service)
    assert len(json.dumps(service.save())) < 4 * 200


@pytest.mark.parametrize(
    "saved",
    [
        {},
        {"agents": ""},
        {"agents": "a\tb", "retired_um": 0, "retired_collisions": 0},
        {"agents": "a\t[1, 2, 0, 0.2, 0, 0, 3, 4]", "retired_um": 0, "retired_collisions": 0},
        {"agents": "a\t[1, 2, 0, -1, 0, 0, 3, null]", "retired_um": 0, "retired_collisions": 0},
        {"agents": "", "retired_um": None, "retired_collisions": 0},
        {"agents": 3, "retired_um": 0, "retired_collisions": 0},
    ],
)
def test_an_invalid_saved_state_is_rejected(saved: dict[str, Any]) -> None:
    with pytest.raises(PhysicsError, match="saved state"):
        joined(Physics()).restore(saved)


def test_a_place_that_is_not_free_is_an_error_that_names_the_body() -> None:
    service = joined(Physics())
    with pytest.raises(MinervaError, match=r"body 'r' of radius 0.2 m at .* is inside a wall"):
        show(service, 0, robot(x=4.5))
    with pytest.raises(MinervaError, match=r"body 'b' at .* overlaps body 'a'"):
        show(service, 0, robot("a"), robot("b"))


def test_a_body_cannot_grow() -> None:
    service = joined(Physics())
    show(service, 0, robot())
    with pytest.raises(PhysicsError, match=r"body 'r' has a radius of 0.2 m"):
        show(service, 1, TPlace(2.0, 2.0, 0.0)(PRobot("r", 0.3)))


@pytest.mark.parametrize(
    "options",
    [
        {"beams": 0}, {"fov": 0}, {"fov": 361}, {"fov": float("nan")}, {"range_max": 0},
        {"camera_fov": -1}, {"camera_range": float("inf")}, {"laser_noise": -1},
        {"laser_dropout": 2},
    ],
)  # fmt: skip
def test_options_that_make_no_sense_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(MinervaError, match=r"expected"):
        Physics(**options)


def test_a_world_with_another_event_type_for_collisions_is_rejected() -> None:
    with pytest.raises(MinervaError, match="physics: eCollision has no shortfall"):
        joined(Physics(), world_with(EventType("eCollision", speed=float)))


def test_its_faces() -> None:
    service = Physics()
    assert (service.draws, service.coupled, service.generates()) == (
        ("eRepresent",), True, ("eCollision",),
    )  # fmt: skip
    assert service.publishes == ("scan", "sightings")
