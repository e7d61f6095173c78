"""Sensors in space: what lidars, inertial units and distance sensors measure."""

import math

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")

from minerva_bodies import Ball, Box, Command, Distance, Gps, Imu, Lidar, Matter, euler
from minerva_bodies.errors import BodiesError
from minerva_bodies.service import RigidBodies
from minerva_bus import Default, EventType, Primitive, Scene, Tick, Transformation, View, Vocabulary
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.context import Frame
from minerva_bus.world.services import WorldInfo

ZERO = Default(float, 0.0)
PBall = Primitive("PBall", Ball(0.1, matter=Matter(friction=0.0)))
PFloor = Primitive("PFloor", Box(20, 20, 0.5))
PRound = Primitive(
    "PRound",
    Lidar(rings=2, beams=4, low=-30, high="high", reach=8, noise="noise"),
    high=ZERO,
    noise=ZERO,
)
PImu = Primitive("PImu", Imu(noise="noise", bias="bias"), noise=ZERO, bias=ZERO)
PBeam = Primitive("PBeam", Distance("reach"), reach=Default(float, 5.0))
PReceiver = Primitive("PReceiver", Gps(52.5, 13.4, 34.0, noise="noise"), noise=ZERO)
PLost = Primitive("PLost", Gps(91.0, 0.0))
TAt = Transformation(
    "TAt",
    euler("x", "y", "z", turn="turn", pitch="pitch"),
    **dict.fromkeys(("x", "y", "z", "turn", "pitch"), ZERO),
)
TSpin = Transformation("TSpin", Command("spin", 0, 0, "z"), z=float)
eLidar = EventType("eLidar", sensor=str, ranges=tuple[float, ...], intensities=tuple[float, ...])
eImu = EventType("eImu", **dict.fromkeys(("ax", "ay", "az", "wx", "wy", "wz"), float))
eDistance = EventType("eDistance", dist=float)
eFix = EventType("eFix", latitude=float, longitude=float, altitude=float, accuracy=float)
eBodies = EventType("eBodies", visual=True)
INFO = WorldInfo(
    "yard",
    Vocabulary.of(
        *(PBall, PFloor, PRound, PImu, PBeam, PReceiver, PLost, TAt, TSpin),
        *(eLidar, eImu, eDistance, eFix, eBodies),
    ),
    7,
    0.02,
)
FLOOR = TAt(z=-0.5)(PFloor())
ALL = {"lidar": "eLidar", "imu": "eImu", "distance": "eDistance", "gps": "eFix"}


def joined(**options):
    service = RigidBodies(pose="", **(ALL | options))
    service.joined(INFO)
    return service


def step(service, number, **parts):
    slots = [AgentNode("ABody", name, (), (), Scene(())) for name in parts]
    service.show(View(number - 1, "eBodies", Scene((*FLOOR.pieces, *slots)), parts))
    return list(single(service.generate(Tick(Frame(number, 0.02, 7), "bodies"))))


def test_a_lidar_measures_rings_and_the_angles_of_surfaces():
    service, wall = joined(gravity=0.0), TAt(3.1, 0, 1)(PBall())
    at = TAt(0, 0, 1, turn=90)(PBall() + TAt(0, 0, 0.5)(PRound()))
    (event,) = step(service, 1, a=at, b=wall)
    assert (event.receivers, event.sensor) == (("a",), "PRound")
    low, level = event.ranges[:4], event.ranges[4:]
    assert low == pytest.approx([1.5 / math.sin(math.radians(30))] * 4, rel=1e-5)
    assert level == (8.0,) * 4
    assert event.intensities[:4] == pytest.approx([0.5] * 4, rel=1e-5)
    assert event.intensities[4:] == (0.0,) * 4
    # The wall is to the right of a sensor that faces along y: the last beam.
    (event,) = step(service, 2, a=TAt(0, 0, 1, turn=90)(PBall() + PRound()), b=wall)
    assert event.ranges[4:] == pytest.approx([8.0, 8.0, 8.0, 3.0])


def test_an_inertial_unit_feels_support_and_spin_but_no_fall():
    service, free = joined(), TAt(z=9.0)(PBall() + PImu())
    assert step(service, 1, a=free) == []
    (event,) = step(service, 2, a=free)
    assert (event.ax, event.ay, event.az) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    service, rest = joined(), TAt(z=0.1, pitch=90)(PBall() + PImu())
    for number in range(1, 40):
        events = step(service, number, a=rest)
    (event,) = events
    # Its x axis points down.
    assert (event.ax, event.ay, event.az) == pytest.approx((-9.81, 0.0, 0.0), abs=0.05)
    for number in range(40, 42):
        (event,) = step(service, number, a=TSpin(2.0)(rest))
    assert (event.wx, event.wy, event.wz) == pytest.approx((-2.0, 0.0, 0.0), abs=0.05)


def test_errors_follow_seed_sensor_and_frame_and_outlive_the_service():
    noisy = TAt(z=5.0)(PBall() + PImu(0.3, 0.1) + PRound(0.0, 0.05) + PReceiver(2.0))
    first, second = joined(), joined()
    for number in range(1, 9):
        events = step(first, number, a=noisy)
        step(second, number, a=noisy)
        if number == 5:
            saved, second = second.save(), joined()
            second.restore(saved)
    successor = step(second, 9, a=noisy)
    assert successor == step(first, 9, a=noisy)
    assert successor[0].data != events[0].data


def test_a_beam_ends_where_it_meets_something():
    service = joined(gravity=0.0)
    (event,) = step(service, 1, a=TAt(z=2.0)(PBall() + TAt(pitch=90)(PBeam())))
    assert event.dist == pytest.approx(2.0)


def test_a_receiver_tells_where_on_the_earth_it_is():
    service = joined(gravity=0.0)
    # By pyproj 3.7, from topocentric to geodetic coordinates.
    for number, (place, fix) in enumerate(
        (
            ((1000.0, 0.0, 0.0), (52.499999083844045, 13.414725242546655, 34.07822705153376)),
            ((-300.0, 2000.0, 50.0), (52.51797284569837, 13.39558065955622, 84.32072730734944)),
        ),
        1,
    ):
        (event,) = step(service, number, **{f"a{number}": TAt(*place)(PBall() + PReceiver())})
        degrees = (event.latitude, event.longitude)
        assert degrees == pytest.approx(fix[:2], abs=1e-9)
        assert event.altitude == pytest.approx(fix[2], abs=1e-4)
    noisy = TAt(z=1.0)(PBall() + PReceiver(2.0))
    events = [step(service, number, b=noisy)[0] for number in range(3, 43)]
    assert 1.4 < np.std([event.latitude for event in events]) * 111e3 < 2.6
    assert events[0].accuracy == 2.0


@pytest.mark.parametrize(
    ("options", "shown", "text"),
    [
        ({"imu": ""}, PBall() + PImu(), "give it the option imu"),
        ({}, PBeam(), "shows none"),
        ({}, PBall() + PBeam(0.0), "above 0"),
        ({}, PBall() + PImu(-1.0), "from 0"),
        ({}, PBall() + PReceiver(-1.0), "from 0"),
        ({}, PBall() + PLost(), "degrees"),
    ],
)
def test_a_sensor_that_cannot_measure_is_an_error(options, shown, text):
    with pytest.raises(BodiesError, match=text):
        step(joined(**options), 1, a=TAt(z=1.0)(shown))


def test_a_sensor_of_nobody_and_without_beams_are_errors():
    service = joined()
    with pytest.raises(BodiesError, match="the view of an agent"):
        service.show(View(0, "eBodies", PBeam(), {}))
    with pytest.raises(BodiesError, match="beams"):
        Lidar(beams=0)
