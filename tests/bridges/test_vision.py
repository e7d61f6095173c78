"""Markers in photos, rendered images, files and topics."""

import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from minerva_bus import (
    Default,
    Degrees,
    EventType,
    Frame,
    Metres,
    MinervaError,
    Tick,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.world.readings import Image, Mount, Scan

cv2 = pytest.importorskip("cv2")
from recorded import Hurried  # noqa: E402
from rendered import FX, HEIGHT, SIZE, WIDTH, rendered, texture  # noqa: E402

from minerva_services.bridging import SourceError  # noqa: E402
from minerva_services.bridging.testing import RunningBridge  # noqa: E402
from minerva_services.sensors.vision import Markers, Vision  # noqa: E402
from minerva_services.sensors.vision.detection import (  # noqa: E402
    DICTIONARIES,
    detector,
    dictionary_of,
    refined,
)
from minerva_services.sensors.vision.images import grey_of, opencv  # noqa: E402
from minerva_services.sensors.vision.locator import (  # noqa: E402
    Lens,
    WrongSize,
    _place,
    from_centre,
    read_lens,
)

PHOTOS = Path(__file__).parents[3] / "shared" / "data" / "markers"
WORLD = WorldInfo("w", Vocabulary.of(), 0, 0.1)
SEEN = {"dictionary": "6X6_250", "size": SIZE, "fx": FX}


@pytest.fixture
def photos():
    if not PHOTOS.is_dir():
        pytest.skip("no photos: ../shared/data/markers is not there")
    return PHOTOS


class Told(list):
    """Collects the messages of a bridge."""

    def publish(self, topic, reading):
        self.append((topic, reading))


def vision(source, **options):
    service = Vision(str(source), **({"robot": "r"} | SEEN | options))
    service.joined(WORLD)
    return service


def run(service):
    published = Told()
    service.run(published, Hurried(math.inf))
    return published


def ids(photo, dictionary):
    image = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE)
    return [marker.id for marker in detector(dictionary_of(dictionary))(image)]


def exact(dictionary, pixels, turned, blur):
    """An antialiased image of a marker with sides of `pixels` pixels, and its true corners.

    Each pixel averages 4 x 4 samples; the image has some noise.
    """
    half, distance = SIZE / 2, FX * SIZE / pixels
    square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    roll, turn = np.radians(10.0), np.radians(turned)
    about_z = [[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    about_y = [[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]]

    def seen(points):
        placed = points @ about_z @ about_y + [0.0, 0.0, distance]
        return placed[:, :2] / placed[:, 2:] * FX + [WIDTH / 2 + 0.3, HEIGHT / 2 - 0.2]

    edge = np.array([[0, 0], [600, 0], [600, 600], [0, 600]], np.float32) - 0.5
    way = cv2.getPerspectiveTransform(edge, (seen(1.5 * square) * 4 - 0.5).astype(np.float32))
    large = np.full((HEIGHT * 4, WIDTH * 4), 200, np.uint8)
    picture = cv2.GaussianBlur(texture(cv2, dictionary, 7), (0, 0), max(0.1, 40 / pixels))
    cv2.warpPerspective(picture, way, large.shape[::-1], large, borderMode=cv2.BORDER_TRANSPARENT)
    image = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
    noise = np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8), seen(square) - 0.5


@pytest.mark.parametrize("dictionary", ["6X6_250", "APRILTAG_36h11", "4X4_50", "APRILTAG_16h5"])
@pytest.mark.parametrize("turned", [0.0, 50.0])
@pytest.mark.parametrize(("pixels", "blur"), [(24, 0.0), (40, 0.0), (40, 1.2), (160, 1.2)])
def test_a_marker_is_as_large_as_it_is(dictionary, turned, pixels, blur):
    image, corners = exact(dictionary, pixels, turned, blur)
    (marker,) = [seen for seen in detector(dictionary)(image) if seen.id == 7]
    area, wanted = (cv2.contourArea(at.astype(np.float32)) for at in (marker.corners, corners))
    assert (area / wanted) ** 0.5 == pytest.approx(1.0, abs=0.004)
    assert np.hypot(*(marker.corners - corners).T).max() < 0.3


def test_corners_that_are_off_by_half_a_cell_are_corrected():
    """OpenCV's are, in blurred images of markers seen at an angle."""
    image, corners = exact("6X6_250", 40, 0.0, 1.2)
    off = np.array([[1.4, 0.9], [-0.2, 2.2], [-1.0, -1.3], [0.2, -2.3]])
    assert np.hypot(*(refined(image, corners + off) - corners).T).max() < 0.3


def framed(margin, side=160, ground=0, dictionary="4X4_50"):
    """An image of a marker with a white margin on dark ground, and its true corners."""
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    image = np.full((HEIGHT, WIDTH), ground, np.uint8)
    y, x = (HEIGHT - side) // 2, (WIDTH - side) // 2
    image[y - margin : y + side + margin, x - margin : x + side + margin] = 255
    image[y : y + side, x : x + side] = cv2.aruco.generateImageMarker(words, 7, side)
    corners = np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]])
    return image, corners - 0.5


@pytest.mark.parametrize("dictionary", ["4X4_50", "6X6_250", "APRILTAG_36h11"])
@pytest.mark.parametrize("margin", [1, 2, 4, 8, 12, 20, 40])
@pytest.mark.parametrize("ground", [0, 60])
def test_a_narrow_margin_on_dark_ground_is_not_the_marker(dictionary, margin, ground):
    image, corners = framed(margin, ground=ground, dictionary=dictionary)
    (marker,) = detector(dictionary)(image)
    assert np.hypot(*(marker.corners - corners).T).max() < 0.3


@pytest.mark.parametrize("margin", [3, 5, 8, 12])
def test_a_narrow_margin_in_a_blurred_picture_with_noise(margin):
    image, corners = framed(margin, side=100)
    noise = np.random.default_rng(1).normal(0.0, 4.0, image.shape)
    image = np.clip(cv2.GaussianBlur(image, (0, 0), 1.0) + noise, 0, 255).astype(np.uint8)
    (marker,) = detector("4X4_50")(image)
    sides = [np.hypot(*(np.roll(at, -1, 0) - at).T).mean() for at in (marker.corners, corners)]
    assert sides[0] / sides[1] == pytest.approx(1.0, abs=0.01)


def test_corners_stay_where_there_are_no_edges():
    corners = np.array([[20.0, 20.0], [40.0, 20.0], [40.0, 40.0], [20.0, 40.0]])
    for image in (np.full((60, 60), 128, np.uint8), np.zeros((60, 60), np.uint8)):
        assert np.array_equal(refined(image, corners), corners)
    at_border = corners - 20.0
    assert np.isfinite(refined(np.full((60, 60), 128, np.uint8), at_border)).all()


# --- detection ------------------------------------------------------------------------------------


def test_a_photo_of_aruco_markers(photos):
    photo = photos / "aruco_singlemarkersoriginal.jpg"
    assert ids(photo, "6X6_250") == [23, 40, 62, 98, 124, 203]
    assert ids(photo, "DICT_6x6_1000") == [23, 40, 62, 98, 124, 203]
    assert ids(photo, "tag36h11") == []


def test_a_photo_of_apriltags(photos):
    """All tags of the list, and one on the shaded side that the list omits."""
    photo = next(photos.glob("apriltag_*.jpg"))
    image = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE)
    markers = detector(dictionary_of("tag36h11"))(image)
    lines = photo.with_suffix(".txt").read_text().splitlines()
    numbers = [[float(number) for number in re.findall(r"[\d.]+", line)] for line in lines]
    assert {marker.id for marker in markers} == {int(line[0]) for line in numbers} == {0}
    wanted = [np.reshape(line[1:], (4, 2)).mean(0) for line in numbers] + [np.array([370, 356])]
    assert len(markers) == len(wanted) == 13
    for middle in wanted:
        assert min(np.hypot(*(marker.corners.mean(0) - middle)) for marker in markers) < 3.0
    assert ids(photo, "6X6_250") == []


@pytest.mark.parametrize("name", DICTIONARIES)
def test_every_dictionary_is_one(name):
    assert detector(dictionary_of(name))(np.full((50, 50), 255, np.uint8)) == []


PLACES = [
    (1.0, 0.0, 0.0, 0.0),
    (2.0, 20.0, 0.0, 0.0),
    (2.0, -20.0, 0.3, 0.0),
    (1.5, 10.0, -0.3, 40.0),
    (1.5, -10.0, 0.1, -50.0),
    (4.0, 5.0, 0.0, 20.0),
]


@pytest.mark.parametrize("dictionary", ["6X6_250", "APRILTAG_36h11", "4X4_50"])
@pytest.mark.parametrize(("distance", "angle", "up", "turned"), PLACES)
def test_a_marker_at_a_known_place(tmp_path, dictionary, distance, angle, up, turned):
    image = rendered(cv2, (7, distance, angle, up, turned), dictionary=dictionary)
    cv2.imwrite(str(tmp_path / "one.png"), image)
    ((topic, seen),) = run(vision(tmp_path / "one.png", dictionary=dictionary, names={"7": "door"}))
    assert (topic, seen.robot, seen.time) == ("sightings", "r", 0.0)
    (sighting,) = seen.seen
    assert sighting.marker == "door"
    assert sighting.distance == pytest.approx(distance, rel=0.02)
    assert sighting.angle == pytest.approx(angle, abs=0.4)


def test_a_marker_that_is_seen_as_an_exact_square():
    """IPPE has no finite solution for these corners, which are from a rendered image."""
    corners = np.array(
        [[117.4995, 198.4995], [200.5005, 198.4995], [200.5005, 281.5005], [117.4995, 281.5005]]
    )
    ahead, left = _place(corners, SIZE, Lens(FX, FX, WIDTH / 2, HEIGHT / 2))
    assert (ahead, left) == (
        pytest.approx(600 * 0.2 / 83.001, rel=0.01),
        pytest.approx(0.388, abs=0.01),
    )


def test_many_markers_of_which_some_have_names(tmp_path):
    image = rendered(cv2, (1, 1.5, 15, 0, 0), (2, 1.5, 0, 0, 0), (3, 1.5, -15, 0, 0))
    cv2.imwrite(str(tmp_path / "one.png"), image)
    service = vision(tmp_path / "one.png", names={"1": "left", "3": "right"}, robot="x")
    ((_, seen),) = run(service)
    assert [sighting.marker for sighting in seen.seen] == ["left", "right"]
    assert service.report()["unknown markers"] == 1
    ((_, seen),) = run(vision(tmp_path / "one.png"))
    assert [sighting.marker for sighting in seen.seen] == ["1", "2", "3"]


def test_a_camera_that_sits_elsewhere(tmp_path):
    cv2.imwrite(str(tmp_path / "one.png"), rendered(cv2, (1, 1.0, 0, 0, 0)))
    mount = {"mount_x": 0.5, "mount_y": -0.1, "mount_angle": 90.0}
    ((_, seen),) = run(vision(tmp_path / "one.png", **mount))
    assert seen.seen[0].distance == pytest.approx(math.hypot(0.5, 0.9), rel=0.02)
    assert seen.seen[0].angle == pytest.approx(math.degrees(math.atan2(0.9, 0.5)), abs=0.5)


def test_from_the_centre():
    assert from_centre(2.0, 0.0, Mount(0.5, 0.0, 0.0)) == (2.5, 0.0)
    assert from_centre(1.0, 1.0, Mount()) == pytest.approx((math.sqrt(2), 45.0))
    assert from_centre(1.0, 1.0, Mount(0.0, 0.0, 90.0)) == pytest.approx((math.sqrt(2), 135.0))
    assert from_centre(1.0, 0.0, Mount(0.0, 0.0, -90.0)) == pytest.approx((1.0, -90.0))
    assert from_centre(1.0, 0.5, Mount(0.0, -0.5, 0.0)) == pytest.approx((1.0, 0.0))


# --- calibration ----------------------------------------------------------------------------------

MATRIX = [610.0, 0, 322, 0, 605, 241, 0, 0, 1]
ROS = f"""image_width: 640
image_height: 480
camera_name: webcam
camera_matrix:
  rows: 3
  cols: 3
  data: {MATRIX}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.0]
"""
READ = Lens(610.0, 605.0, 322.0, 241.0, (0.1, -0.2, 0.001, 0.002, 0.0), 640, 480)


@pytest.mark.parametrize("kind", ["yaml", "json", "xml"])
def test_calibrations_of_opencv(tmp_path, kind):
    path = str(tmp_path / f"lens.{kind}")
    stored = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    stored.write("image_width", 640)
    stored.write("image_height", 480)
    stored.write("camera_matrix", np.array(MATRIX).reshape(3, 3))
    stored.write("distortion_coefficients", np.array([READ.distortion]))
    stored.release()
    assert read_lens(path) == READ


@pytest.mark.parametrize("text", [ROS, f"---\n{ROS}", json.dumps({
    "image_width": 640, "image_height": 480, "distortion_coefficients": READ.distortion,
    "camera_matrix": [[610, 0, 322], [0, 605, 241], [0, 0, 1]]})])  # fmt: skip
def test_calibrations_of_ros_and_by_hand(tmp_path, text):
    (tmp_path / "lens").write_text(text)
    assert read_lens(str(tmp_path / "lens")) == READ


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"", "not a calibration file|lacks a camera_matrix"),
        (b"nonsense", "not a calibration file|lacks a camera_matrix"),
        (b"{ 1", "not a calibration file"),
        (b"%YAML:1.0\n---\na: 1\n", "lacks a camera_matrix of 3×3 numbers"),
        (b"\xff\xfe\x00", "not text"),
        (ROS.replace("610.0, ", "").encode(), "lacks a camera_matrix"),
        (ROS.replace("610.0", "-1").encode(), "fx and fy above 0"),
        (ROS.replace("610.0", "x").encode(), "not a calibration file"),
        (ROS.replace("0.1, -0.2", "0.1").encode()[:-5] + b"1, 1, 1]", "distortion coefficients"),
    ],
)
def test_invalid_calibrations(tmp_path, data, problem):
    (tmp_path / "lens").write_bytes(data)
    with pytest.raises(MinervaError, match=problem):
        read_lens(str(tmp_path / "lens"))
    with pytest.raises(MinervaError, match="No such file"):
        read_lens(str(tmp_path / "nowhere"))


def test_images_of_another_size():
    assert READ.at(640, 480) == READ
    double = READ.at(1280, 960)
    assert double == Lens(1220.0, 1210.0, 644.0, 482.0, READ.distortion, 1280, 960)
    with pytest.raises(WrongSize, match="640×360 pixels, but the calibration is for 640×480"):
        READ.at(640, 360)
    assert Lens(600.0, 600.0).at(640, 360).matrix()[:2, 2].tolist() == [320.0, 180.0]


def test_distortion_counts(tmp_path):
    (tmp_path / "lens").write_text(ROS)
    cv2.imwrite(str(tmp_path / "one.png"), rendered(cv2, (1, 1.5, 20, 0, 0)))
    options = {"fx": 0.0, "calibration": str(tmp_path / "lens")}
    ((_, seen),) = run(vision(tmp_path / "one.png", **options))
    ((_, plain),) = run(vision(tmp_path / "one.png"))
    assert abs(seen.seen[0].angle - plain.seen[0].angle) > 0.1


# --- files and folders ----------------------------------------------------------------------------


def walk(count):
    """Images of a marker that approaches."""
    return [rendered(cv2, (5, 3.0 - 0.1 * i, 0, 0, 0)) for i in range(count)]


def write_video(path, images, fps=20.0):
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (WIDTH, HEIGHT), False)
    assert video.isOpened()
    for image in images:
        video.write(image)
    video.release()


def test_a_video(tmp_path, capfd):
    write_video(tmp_path / "walk.avi", walk(6))
    service = vision(tmp_path / "walk.avi", speed=0.0, topic="front")
    assert service.publishes == ("front",)
    published = run(service)
    assert [topic for topic, _ in published] == ["front"] * 6
    assert [seen.time for _, seen in published] == pytest.approx([i / 20 for i in range(6)])
    distances = [seen.seen[0].distance for _, seen in published]
    assert distances == pytest.approx([3.0 - 0.1 * i for i in range(6)], rel=0.03)
    assert "walk.avi has ended\n" in capfd.readouterr().out


def test_a_video_without_end(tmp_path):
    write_video(tmp_path / "walk.avi", walk(2))
    source = vision(tmp_path / "walk.avi", speed=0.0, loop=True).open()
    seen = source.read(Hurried(math.inf))
    assert [next(seen)[1].time for _ in range(5)] == [0.0, 0.05, 0.0, 0.05, 0.0]
    source.close()


def test_a_folder_of_images_some_of_which_are_none(tmp_path, capfd):
    for number, image in enumerate(walk(3)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    (tmp_path / "1.png").write_bytes(b"nonsense")
    (tmp_path / "1b.jpg").touch()
    (tmp_path / "3.png").mkdir()
    (tmp_path / "notes.txt").write_text("none of these")
    service = vision(tmp_path, speed=0.0, fps=5.0)
    published = run(service)
    assert [seen.time for _, seen in published] == pytest.approx([0.0, 0.6])
    assert service.report()["garbage"] == 3
    assert capfd.readouterr().out.count("not a readable image") == 1


@pytest.mark.parametrize("world", [None, WORLD])
def test_a_test_needs_no_world(world, tmp_path):
    cv2.imwrite(str(tmp_path / "one.png"), rendered(cv2, (5, 2.0, 0, 0, 0)))
    camera = Vision(str(tmp_path / "one.png"), robot="r", loop=True, **SEEN)
    with RunningBridge(camera, world) as running:
        first, *_ = running.readings(2)
    assert running.error is None
    assert [seen.marker for seen in first.seen] == ["5"]


def test_a_still_that_loops_is_seen_in_each_frame(tmp_path):
    """Two readings per frame in real time; the bridge analyses the file again after a change."""
    cv2.imwrite(str(tmp_path / "one.png"), rendered(cv2, (5, 2.0, 0, 0, 0)))
    service = vision(tmp_path / "one.png", loop=True)
    service.joined(WorldInfo("w", Vocabulary.of(), 0, 1 / 60))
    looked, sees = [], service._locator.locate
    service._locator.locate = lambda *of: looked.append(of) or sees(*of)
    source, stop = service.open(), Hurried(120)
    count = len(list(source.read(stop)))
    assert stop.asked[-1] == pytest.approx(count / 120, abs=0.1)
    assert count > 50
    assert len(looked) == 1
    cv2.imwrite(str(tmp_path / "one.png"), rendered(cv2, (5, 1.0, 0, 0, 0)))
    _, seen = next(source.read(Hurried(9)))
    assert (seen.seen[0].distance, len(looked)) == (pytest.approx(1.0, rel=0.01), 2)


def test_a_video_of_a_still_has_the_given_frame_rate(tmp_path):
    cv2.imwrite(str(tmp_path / "one.png"), rendered(cv2, (5, 2.0, 0, 0, 0)))
    stop = Hurried(20)
    count = len(list(vision(tmp_path / "one.png", loop=True, fps=5.0).open().read(stop)))
    assert stop.asked[-1] == pytest.approx(count / 5, abs=0.3)


def test_an_image_without_markers_is_reported_too(tmp_path):
    cv2.imwrite(str(tmp_path / "one.png"), np.full((48, 64), 255, np.uint8))
    ((_, seen),) = run(vision(tmp_path / "one.png"))
    assert seen.seen == ()


def test_images_that_are_not_the_calibrated_camera_s_are_counted(tmp_path):
    (tmp_path / "lens").write_text(ROS)
    cv2.imwrite(str(tmp_path / "one.png"), np.zeros((360, 640), np.uint8))
    service = vision(tmp_path / "one.png", fx=0.0, calibration=str(tmp_path / "lens"))
    with pytest.raises(SourceError, match=r"nothing to play; .* is for 640×480"):
        run(service)
    assert service.report()["wrong size"] == 1


@pytest.mark.parametrize("data", [b"", b"nonsense" * 100, b"RIFF\x00\x00\x00\x00AVI LIST"])
def test_a_video_that_is_none(tmp_path, data):
    (tmp_path / "bad.avi").write_bytes(data)
    with pytest.raises(MinervaError, match=r"bad.avi is not a readable video"):
        vision(tmp_path / "bad.avi")


def test_a_video_that_was_cut_off(tmp_path):
    write_video(tmp_path / "walk.avi", walk(6))
    whole = (tmp_path / "walk.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    assert 0 < len(run(vision(tmp_path / "cut.avi", speed=0.0))) < 6


def test_a_folder_without_images(tmp_path):
    with pytest.raises(MinervaError, match="no image in"):
        vision(tmp_path)


# --- images on a topic ----------------------------------------------------------------------------


def markers(**options):
    service = Markers(**(SEEN | options))
    service.joined(WORLD)
    return service


def image_of(pixels, encoding, **rest):
    data = {
        "png": lambda: cv2.imencode(".png", pixels)[1].tobytes(),
        "jpeg": lambda: cv2.imencode(".jpg", pixels)[1].tobytes(),
        "mono8": pixels.tobytes,
        "rgb8": lambda: np.repeat(pixels[:, :, None], 3, 2).tobytes(),
    }[encoding]()
    return Image("r7", data, encoding, pixels.shape[1], pixels.shape[0], 1.5, **rest)


def asked(service, *readings):
    tick = Tick(Frame(3), "markers", readings=readings)
    assert list(service.generate(tick)) == []
    return tick.published


@pytest.mark.parametrize("encoding", ["png", "jpeg", "mono8", "rgb8"])
def test_images_of_others(encoding):
    image = image_of(rendered(cv2, (5, 1.0, 10, 0, 0)), encoding, mount=Mount(0.2, 0.0, 0.0))
    service = markers(topic="found", images="front", names={"5": "door"})
    assert (service.topics, service.publishes) == (("front",), ("found",))
    ((topic, seen),) = asked(service, image)
    wanted = from_centre(math.cos(math.radians(10)), math.sin(math.radians(10)), Mount(0.2))
    assert (topic, seen.robot, seen.time) == ("found", "r7", 1.5)
    assert seen.seen[0].marker == "door"
    assert (seen.seen[0].distance, seen.seen[0].angle) == pytest.approx(wanted, rel=0.03)


def test_red_is_darker_than_green():
    pixels = bytes([255, 0, 0, 0, 255, 0, 0, 0, 255])
    assert grey_of(Image("r", pixels, "rgb8", 3, 1, 0.0)).tolist() == [[76, 150, 29]]


def test_an_image_that_cannot_be_read_is_counted():
    service = markers()
    bad = [Image("r", data, "jpeg", 4, 4, 0.0) for data in (b"", b"\xff\xd8nonsense")]
    assert asked(service, *bad, Image("r", b"abc", "rgb8", 4, 4, 0.0)) == []
    assert service.report() == {"images": 3, "garbage": 3}
    with pytest.raises(MinervaError, match="expected images on 'image', found Scan"):
        asked(service, Scan("r", np.ones(1, np.float32), 0.0, 1.0, 5.0, 0.0))


def test_a_marker_becomes_the_robot_s_event():
    from minerva_services.sensors.camera import Camera

    event = EventType("eCamera", marker=str, dist=Metres, angle=Default(Degrees, 0.0))
    camera = Camera()
    camera.joined(WorldInfo("w", Vocabulary.of(event), 0, 0.1))
    ((_, seen),) = asked(markers(), image_of(rendered(cv2, (5, 1.0, 0, 0, 0)), "png"))
    (made,) = camera.generate(Tick(Frame(4), "camera", readings=(seen,)))
    assert (made.marker, made.receivers) == ("5", ("r7",))
    assert made.dist == pytest.approx(1.0, rel=0.02)


# --- rejected options and images ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"dictionary": "6X6_251"}, "unknown dictionary '6X6_251'; did you mean '6X6_250'"),
        ({"dictionary": ""}, "expected that of the markers"),
        ({"size": 0.0}, "size is 0; expected metres"),
        ({"size": math.nan}, "size is nan"),
        ({"fx": 0.0}, "set calibration"),
        ({"calibration": "x"}, "set calibration"),
        ({"fx": -3.0}, "fx and fy above 0"),
        ({"names": {"door": "1"}}, "a marker's number and its name"),
        ({"names": {"1": 3}}, "a marker's number and its name"),
    ],
)
def test_wrong_options(tmp_path, options, problem):
    for make in (lambda **o: Vision(str(tmp_path), **o), Markers):
        with pytest.raises(MinervaError, match=problem):
            make(**(SEEN | options))


def test_wrong_sources(tmp_path):
    with pytest.raises(MinervaError, match="does not exist"):
        Vision(str(tmp_path / "nowhere.avi"), **SEEN)
    for option in ({"fps": -1.0}, {"width": -1}, {"mount_x": math.inf}, {"speed": -1.0}):
        with pytest.raises(MinervaError):
            Vision(str(tmp_path), **(SEEN | option))


def test_its_library_is_loaded_before_it_joins(monkeypatch, tmp_path):
    """Otherwise OpenCV would load while frames pass; and `check` constructs services."""
    opencv.cache_clear()
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MinervaError, match=r"pip install 'minerva-bus\[vision\]'"):
        Vision(str(tmp_path), **SEEN)


def test_without_the_library(monkeypatch):
    opencv.cache_clear()
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MinervaError, match=r"pip install 'minerva-bus\[vision\]'"):
        markers()
