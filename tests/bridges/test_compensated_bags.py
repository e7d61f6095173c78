"""Bags and ROS 2 robots with rotating lidars: the bridges publish motion-compensated scans."""

import math
import threading
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
from recorded import messages, write_bag
from sweeping import drive, place_at, spread, without_path

from minerva_agents.robot.map_recording import map_recording
from minerva_agents.robot.maps import OCCUPIED, load_map
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Odometry, Scan, hits
from minerva_services.bridges.ros2 import Ros2, Ros2Robot
from minerva_services.bridges.ros2.driver import OdometryTrack
from minerva_services.bridges.ros2.sensors import _Listening
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.rosbag import Rosbag
from minerva_services.bridging.testing import RunningBridge

PLACE = partial(place_at, speed=0.3, turn=80.0)


def said_of(ros, recorded, late=0.0, turn=0.2):
    """The ROS messages of a drive.

    The stamps of scans are `late` seconds late; their time increments correspond to a revolution of
    `turn` seconds.
    """
    for sample in recorded:
        reading = sample.reading
        if isinstance(reading, Odometry):
            message = ros.odometry(
                reading.x, reading.y, math.radians(reading.angle), time=reading.time
            )
            yield sample.stamp, "/odom", message
            continue
        message = ros.scan(
            reading.ranges, reading.time + late, angle_min=math.radians(reading.first),
            angle_max=0.0, angle_increment=math.radians(reading.step),
            time_increment=turn / len(reading.ranges), range_max=reading.range_max,
        )  # fmt: skip
        yield sample.stamp, "/scan", message


def bag(folder, step=1.0, late=0.0, odometry=True, turn=0.2):
    folder.mkdir(exist_ok=True)
    ros, store = messages()
    recorded = drive(PLACE, step=step, odometry=odometry)
    return write_bag(folder / "drive.mcap", store, list(said_of(ros, recorded, late, turn)))


def worst(scans):
    """Largest error of a scan before and after compensation, in cm beside the walls."""
    both = [
        [spread(scan, PLACE(scan.time), *hits(seen)) for seen in (without_path(scan), scan)]
        for scan in scans
    ]
    return np.max(both, axis=0).tolist()


def played(path, **options):
    with RunningBridge(Rosbag(str(path), speed=0.0, **options)) as running:
        running.wait_for(running.ended, "the end of the bag")
    return [published for _, published in running.published if isinstance(published, Scan)], running


@pytest.mark.parametrize(("step", "late"), [(1.0, 0.0), (-1.0, 0.0), (1.0, 0.2)])
def test_a_bag_is_played_with_sharp_walls(tmp_path, step, late):
    scans, running = played(bag(tmp_path, step, late), time_offset=-late)
    before, after = worst(scans)
    assert (before > 15.0, after < 0.3) == (True, True)
    assert running.counted("scans not corrected") == 0


def test_a_bag_without_odometry_reports_uncorrected_scans(tmp_path, capsys):
    scans, running = played(bag(tmp_path, odometry=False))
    assert running.counted("scans not corrected") == len(scans) > 3
    assert "not corrected for the robot's motion: no odometry covers" in capsys.readouterr().out


@pytest.mark.parametrize("poses", ["published", "odometry", "matched"])
def test_a_map_of_a_bag_has_thin_walls(tmp_path, capsys, poses):
    walls = []
    for turn in (0.0, 0.2):
        path = bag(tmp_path / f"{turn:g}", late=0.2, turn=turn)
        map_recording(path, path.parent / "map.pgm", 0.05, 0.0, 0.0, None, poses, -0.2)
        walls.append(int((load_map(path.parent / "map.yaml").cells == OCCUPIED).sum()))
    assert walls[1] < 0.8 * walls[0]
    assert "not corrected" not in capsys.readouterr().err


def test_a_map_names_the_scans_it_cannot_correct(tmp_path, capsys):
    path = bag(tmp_path, late=1.5)
    map_recording(path, tmp_path / "map.pgm", 0.05, 0.0, 0.0, None, "odometry")
    said = capsys.readouterr().err
    assert "scans not corrected for the robot's motion" in said
    assert "--time-offset" in said


class Session:
    connected = True

    def advise(self, heard):
        """The robot has what is expected."""


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_a_ros_2_robot_gives_a_map_with_sharp_walls(late):
    """Messages arrive live: each scan after its last beam, odometry 50 times a second."""
    store = types.messages()
    bridge = Ros2("tcp/127.0.0.1:1", mount="0, 0, 0", time_offset=-late)
    session: Any = Session()
    source, scans = _Listening(session, bridge), []
    readings: Iterator[Any] = source.read(threading.Event())
    heard = {"/odom": source.receiver(types.ODOMETRY), "/scan": source.receiver(types.LASER_SCAN)}
    ros, _ = messages()
    for _, topic, message in said_of(ros, drive(PLACE), late):
        heard[topic](_encoded(store, topic, message))
        reading = next(readings)
        while reading is not None and not isinstance(reading[1], Odometry):
            scans.append(reading[1])
            reading = next(readings)
    before, after = worst(scans)
    assert (before > 15.0, after < 0.3, len(scans) > 5) == (True, True, True)


def _encoded(store, topic, message):
    return store.encode(types.ODOMETRY if topic == "/odom" else types.LASER_SCAN, message)


def test_the_track_of_a_robot_corrects_its_scans():
    track = OdometryTrack(fastest=2.0, turning=360.0)
    recorded = drive(PLACE)
    for message in recorded:
        if isinstance(message.reading, Odometry):
            at = message.reading
            track.add(at.time, Pose(at.x, at.y, at.angle))
            track.add(at.time, Pose(at.x, at.y, at.angle))
    scans = [
        track.corrected(message.reading)
        for message in recorded
        if isinstance(message.reading, Scan)
    ]
    before, after = worst(scans)
    assert (before > 15.0, after < 0.3) == (True, True)


@pytest.mark.parametrize("service", [Ros2, Ros2Robot])
def test_a_time_offset_that_is_no_number(service):
    with pytest.raises(MisuseError, match="time_offset is nan"):
        service("tcp/127.0.0.1:1", time_offset=math.nan)
