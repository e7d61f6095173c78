"""gLaser and gCamera: events from readings of any source."""

import math
from typing import Any

import numpy as np
import pytest
from driving_world import INFO, joined, tick, world_with

from minerva_bus import Degrees, EventType, Metres, MinervaError
from minerva_bus.grammar.events import single
from minerva_bus.grammar.fields import Default
from minerva_bus.world.readings import Scan, Sighting, Sightings
from minerva_services.sensors.camera import Camera
from minerva_services.sensors.laser import Laser


def scan(ranges: list[float], first: float = -90.0, step: float = 45.0, **rest: Any) -> Scan:
    return Scan(
        "r", np.array(ranges, np.float32), first, step, rest.pop("range_max", 5.0), 0.1, **rest
    )


def hits(made: Scan, **options: Any) -> list[tuple[float, float]]:
    events = joined(Laser(**options)).generate(tick(1, made))
    return [(event.dist, event.angle) for event in events]


def test_each_beam_that_hits_is_an_event_with_the_raw_numbers() -> None:
    expected = [(float(np.float32(1.1)), -90.0), (float(np.float32(2.3)), 0.0)]
    assert hits(scan([1.1, 5.0, 2.3])) == expected


def test_events_go_to_the_robot_that_carries_the_sensor() -> None:
    first, other = scan([1.0]), Scan("s", np.ones(2, np.float32), 0.0, 1.0, 5.0, 0.1)
    events = list(joined(Laser()).generate(tick(1, first, other)))
    assert [event.receivers for event in events] == [("r",), ("s",), ("s",)]


def test_events_are_those_that_the_vocabulary_makes() -> None:
    laser, declared = joined(Laser()), INFO.vocabulary.events["eLaser"]
    (event,) = laser.generate(tick(1, scan([1.5])))
    assert event == declared(dist=1.5, angle=-90.0, receivers=["r"])
    assert INFO.vocabulary.check_event(event) is event


@pytest.mark.parametrize("nothing", [0.0, -1.0, math.nan, math.inf, 5.0, 7.0])
def test_a_beam_that_hits_nothing_is_no_event(nothing: float) -> None:
    assert hits(scan([nothing, 1.0])) == [(1.0, -45.0)]


@pytest.mark.parametrize("limit", [5.1, 5.3, 8.0, np.float64(5.1)])
def test_the_limit_is_no_hit_although_a_float32_rounds_it(limit: float) -> None:
    assert hits(scan([limit, 1.0], range_max=limit)) == [(1.0, -45.0)]


@pytest.mark.parametrize("beams", [2, 100])
def test_equal_beams_of_two_scans_are_two_events_where_the_type_has_a_time(beams: int) -> None:
    """Eq. 6 merges equal events: a world that counts hits declares `time`."""
    from minerva_bus import Seconds, Vocabulary, WorldInfo

    scans = [Scan("r", np.ones(beams, np.float32), 0.0, 1.0, 5.0, time) for time in (0.1, 0.2)]
    known = {"plain": {}, "timed": {"time": Seconds}}
    count = {}
    for name, more in known.items():
        laser = Laser(takes="all")
        event = EventType("eLaser", dist=Metres, angle=Degrees, **more)
        laser.joined(WorldInfo("w", Vocabulary.of(event), 0, 0.1))
        events = list(single(laser.generate(tick(1, *scans))))
        count[name] = len({str(event) for event in events})
    assert count == {"plain": beams, "timed": 2 * beams}


def clears(made: Scan, **options: Any) -> list[tuple[float, float]]:
    events = single(joined(Laser(clear="eClear", **options)).generate(tick(1, made)))
    return [(event.dist, event.angle) for event in events if event.type == "eClear"]


@pytest.mark.parametrize("nothing", [5.0, 7.0, math.inf])
def test_a_beam_without_return_reports_the_free_distance(nothing: float) -> None:
    assert clears(scan([nothing, 1.0])) == [(5.0, -90.0)]


@pytest.mark.parametrize("invalid", [0.0, -1.0, math.nan, -math.inf])
def test_an_invalid_range_is_ignored(invalid: float) -> None:
    assert clears(scan([invalid, 1.0])) == []


def test_a_beam_without_return_counts_no_farther_than_it_may() -> None:
    assert clears(scan([90.0, 1.0], range_max=80.0)) == [(10.0, -90.0)]
    assert clears(scan([90.0, 1.0], range_max=80.0), clear_range=3.0) == [(3.0, -90.0)]
    assert clears(scan([math.inf], range_max=math.inf)) == [(10.0, -90.0)]
    assert clears(scan([math.inf, 5.0], range_max=math.nan)) == []


def test_beams_without_return_have_the_angles_of_their_beams() -> None:
    made = scan([5.0, 1.0, 5.0, 5.0, 1.0, 5.0], mount_angle=10.0)
    assert [angle for _, angle in clears(made)] == [-80.0, 10.0, 55.0, 145.0]
    assert [angle for _, angle in clears(made, every=3)] == [-80.0, 55.0]


def test_without_a_type_no_event_reports_free_cells() -> None:
    assert Laser(clear="eClear").generates() == ("eLaser", "eClear")
    assert hits(scan([5.0, math.inf])) == []


@pytest.mark.parametrize(
    ("options", "problem"),
    [({"clear_range": 0.0}, "clear_range is 0.0"), ({"clear": "eLaser"}, "both 'eLaser'")],
)
def test_invalid_options_for_beams_without_hits(options: Any, problem: str) -> None:
    with pytest.raises(MinervaError, match=f"laser: .*{problem}"):
        Laser(**options)


def test_every_so_many_th_beam() -> None:
    assert hits(scan([1, 2, 3, 4, 5, 4, 3]), every=3) == [(1, -90), (4, 45), (3, 180)]


def test_a_turned_sensor() -> None:
    assert hits(scan([1.0, 2.0], mount_angle=10.0)) == [(1.0, -80.0), (2.0, -35.0)]


def test_a_sensor_that_sits_elsewhere_is_seen_from_the_centre() -> None:
    (ahead, left) = hits(scan([1.0, 2.0], 0.0, 90.0, mount_x=0.25))
    assert ahead == (1.25, 0.0)
    assert left == pytest.approx((math.hypot(0.25, 2.0), math.degrees(math.atan2(2.0, 0.25))))
    (behind,) = hits(scan([1.0], 0.0, 1.0, mount_y=0.5, mount_angle=180.0))
    assert behind == pytest.approx((math.hypot(1, 0.5), math.degrees(math.atan2(0.5, -1))))


def test_a_scan_without_beams_is_no_event() -> None:
    assert hits(scan([])) == []


def test_a_marker_in_view_is_an_event() -> None:
    image = Sightings("r", (Sighting("A", 1.5, -3.0), Sighting("B", 2.5, 4.0)), 0.1)
    events = list(joined(Camera()).generate(tick(1, image, Sightings("s", (), 0.1))))
    declared = INFO.vocabulary.events["eCamera"]
    assert events == [
        declared(marker="A", dist=1.5, angle=-3.0, receivers=["r"]),
        declared(marker="B", dist=2.5, angle=4.0, receivers=["r"]),
    ]


@pytest.mark.parametrize("service", [Laser, Camera])
def test_topic_and_event_are_up_to_the_world(service: Any) -> None:
    made = service(topic="front", event="eFront")
    assert (made.topics, made.generates()) == (("front",), ("eFront",))
    assert (Laser.topics, Camera.topics) == (("scan",), ("sightings",))
    assert (Laser().generates(), Camera().generates()) == (("eLaser",), ("eCamera",))


@pytest.mark.parametrize(
    ("service", "reading"), [(Laser(), Sightings("r", (), 0.1)), (Camera(), scan([1.0]))]
)
def test_a_reading_of_another_kind_is_an_error(service: Any, reading: Any) -> None:
    with pytest.raises(MinervaError, match=r"expected s.* on 's.*', found S"):
        list(joined(service).generate(tick(1, reading)))


def test_data_may_be_declared_in_another_order_and_with_more_that_has_defaults() -> None:
    declared = EventType("eLaser", angle=Degrees, sensor=Default(str, "roof"), dist=Metres)
    (event,) = joined(Laser(), world_with(declared)).generate(tick(1, scan([1.5])))
    assert event == declared(angle=-90.0, dist=1.5, receivers=["r"])


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({"dist": Metres}, r"has no angle \(real deg\) among its data \(dist\)"),
        ({"dist": str, "angle": Degrees}, "declares dist as text; laser provides real m"),
        ({"dist": "real cm", "angle": Degrees}, "declares dist as real cm; laser provides real m"),
        ({"dist": Metres, "angle": Degrees, "beam": int}, r"needs beam \(int\)"),
    ],
)
def test_a_type_with_unsuitable_data_is_rejected(data: dict[str, Any], problem: str) -> None:
    with pytest.raises(MinervaError, match=f"laser: eLaser {problem}"):
        joined(Laser(), world_with(EventType("eLaser", **data)))


def test_numbers_without_a_unit_take_any() -> None:
    joined(Laser(), world_with(EventType("eLaser", dist=float, angle=float)))


def test_a_world_without_the_type_is_refused_with_a_hint() -> None:
    with pytest.raises(MinervaError, match="no event type eLazer; did you mean 'eLaser'"):
        joined(Laser(event="eLazer"))


def test_every_counts_from_one() -> None:
    with pytest.raises(MinervaError, match="laser: every is 0"):
        Laser(every=0)


def test_many_beams_are_events_in_columns_and_the_same_as_one_by_one() -> None:
    ranges = [0.5 + i / 100 for i in range(90)]
    for x, y, turn in ((0.0, 0.0, 0.0), (0.0, 0.0, 90.0), (0.1, -0.05, 30.0)):
        mount = {"mount_x": x, "mount_y": y, "mount_angle": turn}
        whole = scan(ranges, step=1.0, **mount)
        (batch,) = joined(Laser()).generate(tick(1, whole))
        few = [
            event
            for i in range(0, 90, 30)
            for event in joined(Laser()).generate(
                tick(1, scan(ranges[i : i + 30], first=i - 90.0, step=1.0, **mount))
            )
        ]
        assert len(batch) == len(few) == 90
        for sent, other in zip(single((batch,)), few, strict=True):
            assert (sent.type, sent.receivers) == (other.type, other.receivers)
            assert sent.values == pytest.approx(other.values, abs=1e-9)
