"""Point clouds, single ranges and positions as readings, and sensors on joints that move."""

import io
import math

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_bus import (
    Disc,
    EventType,
    Metres,
    Motion,
    Primitive,
    Reals,
    Seconds,
    Transformation,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.errors import MisuseError
from minerva_bus.log.recordings import RecordingError
from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.ros_messages.ranges import MAX_KEPT
from minerva_services.bridges.rosbag import Rosbag, open_bag
from minerva_services.bridging.testing import RunningBridge
from minerva_services.geometry.picture import Discs, Lists
from tests.bridges.recorded import write_bag
from tests.bridges.ros2_peers import Node
from tests.bridges.ros2_rig import network, scan, transforms
from tests.patience import eventually

ROUTER = "tcp/h:7447"
FLOAT32, FLOAT64, UINT8 = 7, 8, 2
eCloud = EventType("eCloud", points=Reals, at=float)
CLOUD = {"type": types.POINTS, "event": "eCloud", "data": {"at": "header.stamp"}}


def cloud(points, kind=FLOAT32, order="<", padding=4, names="xyz", frame="laser"):
    """A PointCloud2 of one row, with bytes between its coordinates and after its row."""
    make, size = messages(), {FLOAT32: 4, FLOAT64: 8, UINT8: 1}[kind]
    field = "sensor_msgs/msg/PointField"
    fields = [
        make.make(field, name=name, offset=number * (size + padding), datatype=kind, count=1)
        for number, name in enumerate(names)
    ]
    step = 3 * (size + padding)
    data = np.zeros((len(points), step), np.uint8)
    coded = np.array(points, f"{order}f{size}") if size > 1 else np.array(points, np.uint8)
    for number in range(3):
        place = number * (size + padding)
        column = np.ascontiguousarray(coded[:, number])
        data[:, place : place + size] = column.view(np.uint8).reshape(-1, size)
    return make.make(
        types.POINTS,
        header=make.header(frame, 1_500_000_000), height=1, width=len(points), fields=fields,
        is_bigendian=order == ">", point_step=step, row_step=step * len(points) + 8,
        data=np.concatenate([data.ravel(), np.zeros(8, np.uint8)]), is_dense=False,
    )  # fmt: skip


def bridge(**options):
    """A bridge that knows where the laser is: 0.04 m behind the centre, turned to the left."""
    made = Ros2(ROUTER, scan="", **options)
    assert made.reading(types.TRANSFORMS, encoded(types.TRANSFORMS, transforms(90.0))) is None
    return made


def encoded(kind, message):
    return messages().encode(kind, message)


def read(made, kind, message):
    return made.reading(kind, encoded(kind, message))


@pytest.mark.parametrize(("kind", "order"), [(FLOAT32, "<"), (FLOAT64, "<"), (FLOAT32, ">")])
def test_points_in_a_band_of_heights_are_a_scan(kind, order):
    points = [
        (2.0, 0.0, 0.5), (3.0, 0.0, 0.5),  # ahead of the sensor, so to the left of the robot
        (0.0, 1.5, 0.2), (1.0, 1.0, 0.0), (1.0, -1.0, 2.0), (math.nan, 0.0, 0.5), (0.0, -11.0, 0.5),
    ]  # fmt: skip
    topic, reading = read(bridge(points="points"), types.POINTS, cloud(points, kind, order))
    hits = {
        reading.first + reading.step * beam: far for beam, far in enumerate(reading.ranges) if far
    }
    assert topic == "scan"
    assert hits == {90.0: pytest.approx(2.0), -180.0: pytest.approx(1.5)}
    assert (reading.mount_x, reading.mount_angle, reading.time) == (pytest.approx(-0.04), 0.0, 1.5)


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_bag_plays_points_as_a_network_does(tmp_path, suffix):
    said, store = [], messages().store
    points = cloud([(2.0, 0.0, 0.5), (3.0, 0.0, 0.5), (0.0, 1.5, 3.0)])
    placed = [(0.0, "/tf_static", transforms(90.0)), (0.1, "/a_points", points)]
    path = write_bag(tmp_path / f"points{suffix}", store, placed)
    _, expected = read(bridge(points="points"), types.POINTS, points)
    (played,) = open_bag(path, said.append).readings()
    assert (played.topic, played.reading.ranges.tolist()) == ("scan", expected.ranges.tolist())
    assert (played.reading.mount_x, played.reading.time) == (pytest.approx(-0.04), 1.5)
    # Scans of the same bag are preferred; another band needs the topic's own name.
    path = write_bag(tmp_path / f"both{suffix}", store, [*placed, (0.2, "/scan", scan())])
    (played,) = open_bag(path, lambda *line: said.append(line)).readings()
    assert len(played.reading.ranges) == 6
    bridged = Rosbag(str(path), topics={"/a_points": "cloud"}, points_low=1.0, points_high=4.0)
    (played,) = bridged.recording().readings()
    assert (played.topic, sum(played.reading.ranges > 0)) == ("cloud", 1)


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_bag_makes_the_events_of_a_network(tmp_path, suffix):
    points, fix = cloud([(2.0, 0.0, 0.5), (0.0, 1.5, 3.0)]), types.CLOCK
    tables = {"depth": CLOUD | {"rate": 1.0}, "fix": {"type": fix, "event": "eFix"}}
    passing = [(0.1 * step, "/depth", points) for step in range(15)]
    placed = (0.0, "/tf_static", transforms(90.0))
    clock = (2.0, "/fix", messages().make(fix, clock=messages().time(7_000_000_000)))
    path = write_bag(tmp_path / f"points{suffix}", messages().store, [placed, *passing, clock])
    world = WorldInfo("w", Vocabulary.of(eCloud, EventType("eFix", clock=Seconds)), 0, 0.1)
    player, live = Rosbag(str(path), events=tables, speed=0.0), bridge(events=tables)
    live.check(world)
    with RunningBridge(player, world) as running:
        running.wait_for(lambda: running.state == "ended", "the end")
    first, second, last = running.emitted
    # The second is a second after the first, by the clock of the bag.
    assert first == second == live.reading("depth", encoded(types.POINTS, points))
    assert (last.type, last.values, running.published) == ("eFix", (7.0,), [])
    assert player.generates() == live.generates() == ("eCloud", "eFix")


@pytest.mark.parametrize(
    ("topic", "kind", "why"),
    [("dept", types.POINTS, "no topic dept; available: /depth"), ("depth", types.FIX, f"of {types.POINTS}; expected {types.FIX}")],
)  # fmt: skip
def test_events_of_topics_that_a_bag_does_not_have(tmp_path, topic, kind, why):
    path = write_bag(
        tmp_path / "points.db3", messages().store, [(0.0, "/depth", cloud([(1, 1, 1)]))]
    )
    with pytest.raises(RecordingError, match=why):
        Rosbag(str(path), events={topic: CLOUD | {"type": kind}}).recording()


def test_points_of_a_bag_without_transforms_say_so(tmp_path):
    path = write_bag(
        tmp_path / "points.db3", messages().store, [(0.0, "/points", cloud([(1, 1, 1)]))]
    )
    with pytest.raises(RecordingError, match="no transform from laser to base_link"):
        list(open_bag(path, lambda *line: None).readings())


def test_clouds_that_are_none():
    made, short, far = bridge(points="points"), cloud([(1, 2, 3)]), cloud([(1, 2, 3)])
    short.data, far.point_step = short.data[:20], 6
    for each in (cloud([(1, 2, 3)], UINT8), cloud([(1, 2, 3)], names="xyi"), short, far):
        assert read(made, types.POINTS, each) is None
    assert made.report()["garbage"] == 4


TAt = Transformation("TAt", Motion(x="x", y="y"), x=Metres, y=Metres)
PPoint = Primitive("PPoint", Disc(0.03, "viridis(z, 0, 2)"), z=float)


def of_points(message, reach=10.0, **table):
    """The points of the event of a cloud, and the bridge that makes it."""
    made = bridge(events={"depth": CLOUD | table}, points_range=reach)
    made.check(WorldInfo("w", Vocabulary.of(eCloud), 0, 0.1))
    event = made.reading("depth", encoded(types.POINTS, message))
    return event and dict(zip(event.names, event.values, strict=True))["points"], made


def test_points_are_a_matrix_on_the_robot():
    points = [
        (2.0, 0.0, 0.5), (2.01, 0.01, 0.5), (0.0, 1.0, -3.0), (math.nan, 0.0, 0.5), (0.0, 0.0, 11.0),
    ]  # fmt: skip
    event, _ = of_points(cloud(points))
    assert event == pytest.approx(np.array([[-0.04, 2.0, 0.5], [-1.04, 0.0, -3.0]]))
    assert of_points(cloud(points), cube=0.001)[0].shape == (3, 3)
    assert of_points(cloud(points[3:4]))[0].shape == (0, 3)


@pytest.mark.parametrize("reach", [10.0, 1e12])
def test_points_are_bounded_and_spread(reach):
    noise = np.random.default_rng(1).uniform(-4.0, 4.0, (40_000, 3))
    event, _ = of_points(cloud(noise), reach, cube=1e-9)
    assert event.shape == (len(event), 3)
    assert 1 <= len(event) <= MAX_KEPT
    assert reach > 10 or (len(event) > MAX_KEPT / 10 and np.ptp(event, axis=0).min() > 7.0)


@pytest.mark.filterwarnings("error")
def test_points_beyond_all_measure_are_left_out():
    far = cloud([(1e200, 0.0, 0.0), (math.inf, 0.0, 0.0), (0.0, 2.0, 0.5)], FLOAT64)
    assert len(of_points(far)[0]) == 1
    _, reading = read(bridge(points="points"), types.POINTS, far)
    assert sum(reading.ranges > 0) == 1


def test_points_that_are_none_are_counted():
    assert of_points(cloud([(1, 2, 3)], frame="arm"))[1].report()["without a transform"] == 1
    assert of_points(cloud([(1, 2, 3)], UINT8))[1].report()["garbage"] == 1
    with pytest.raises(MisuseError, match="cube is 0"):
        of_points(cloud([(1, 2, 3)]), cube=0)


def test_a_view_shows_points_as_discs_coloured_by_height():
    points = np.array([[1.0, 2.0, 0.5], [3.0, 4.0, -1.0]])
    shown = TAt(points[:, 0], points[:, 1])(PPoint(points[:, 2]))
    (discs,) = Lists(Vocabulary.of(TAt, PPoint)).picture(shown, {}).of(Discs)
    assert [discs.x.tolist(), discs.y.tolist()] == points[:, :2].T.tolist()
    assert discs.color[0].tolist() != discs.color[1].tolist()


def test_a_band_without_height():
    with pytest.raises(MisuseError, match="points_low, points_high"):
        Ros2(ROUTER, points="points", points_low=1.0)


@pytest.mark.parametrize(
    ("measured", "expected"), [(1.5, 1.5), (math.inf, 4.0), (0.05, 0.0), (math.nan, 0.0)]
)
def test_a_range_is_a_scan_of_one_beam(measured, expected):
    make = messages()
    header = make.header("laser", 0)
    told = {"range": measured, "min_range": 0.1, "max_range": 4.0, "field_of_view": 0.3}
    known = make.store.fielddefs[types.RANGE][1]
    rest = {name: 0 for name, _ in known if name not in {*told, "header"}}
    message = make.make(types.RANGE, header=header, **told, **rest)
    topic, reading = read(bridge(ranges="sonar"), types.RANGE, message)
    assert (topic, reading.mount_angle) == ("range", pytest.approx(90.0))
    assert reading.ranges.tolist() == [pytest.approx(expected)]


def test_a_fix_is_a_position():
    make = messages()
    status = make.make("sensor_msgs/msg/NavSatStatus", status=0, service=1)
    message = make.make(
        types.FIX,
        header=make.header("gps", 2_000_000_000), status=status, latitude=52.5, longitude=13.4,
        altitude=34.0, position_covariance=np.zeros(9), position_covariance_type=0,
    )  # fmt: skip
    topic, reading = read(bridge(fix="fix"), types.FIX, message)
    assert (topic, reading.latitude, reading.longitude, reading.time) == (
        "position",
        52.5,
        13.4,
        2.0,
    )


def test_a_sensor_on_a_joint_that_moves_has_its_latest_mount():
    with network() as (endpoint, _), Node(endpoint) as robot:
        tf = robot.publisher("/tf", types.TRANSFORMS)
        put = robot.publisher("/scan", types.LASER_SCAN)
        with RunningBridge(Ros2(endpoint)) as running:

            def turned(degrees):
                tf(transforms(degrees))
                put(scan())
                return [each.mount_angle for _, each in running.published][-1:] == [degrees]

            eventually(lambda: turned(30.0), "the first mount")
            eventually(lambda: turned(-60.0), "the second mount")


@pytest.mark.parametrize(
    ("encoding", "values"),
    [
        ("16UC1", np.array([[0, 1500], [40, 65535]], "<u2")),
        ("16UC1", np.array([[0, 1500], [40, 65535]], ">u2")),
        ("32FC1", np.array([[np.nan, 1.5], [0.04, 90.0]], "<f4")),
    ],
)
def test_distances_of_a_camera_are_a_file_of_millimetres(encoding, values):
    pillow, make = pytest.importorskip("PIL.Image"), messages()
    message = make.make(
        types.IMAGE,
        header=make.header("laser", 0), height=2, width=2, encoding=encoding,
        is_bigendian=values.dtype.byteorder == ">", step=2 * values.itemsize,
        data=np.frombuffer(values.tobytes(), np.uint8),
    )  # fmt: skip
    topic, reading = read(bridge(image="depth"), types.IMAGE, message)
    assert (topic, reading.encoding, reading.width, reading.height) == ("image", "png", 2, 2)
    pixels = np.asarray(pillow.open(io.BytesIO(reading.data)))
    assert pixels.tolist() == [[0, 1500], [40, 65535]]
