"""Cameras in space: what they render, what a detector of real cameras makes of it, and errors."""

import numpy as np
import pytest

pytest.importorskip("moderngl", reason="needs the extra opengl")

from minerva_bodies import Box, Camera, Poster, euler
from minerva_bodies.cameras import Cameras, focal_length
from minerva_bodies.errors import BodiesError
from minerva_bodies.geometry import SpaceGeometry
from minerva_bus import (
    AgentKind,
    Cells,
    Default,
    Degrees,
    EventType,
    Metres,
    Primitive,
    Tick,
    Transformation,
    View,
    Vocabulary,
    parse,
    run,
)
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.fields import Fields
from minerva_bus.world.context import Frame
from minerva_bus.world.readings import Image, Mount, Odometry
from minerva_bus.world.services import WorldInfo
from minerva_services.views.opengl.canvas import without_window
from tests.runtime.running import here

NONE = Default(Metres, 0.0)
PCube = Primitive("PCube", Box(0.2, 0.2, 0.2, "#cc3311"))
PPoster = Primitive("PPoster", Poster("cells", "cell"), cells=Cells, cell=Metres)
PEye = Primitive(
    "PEye",
    Camera("width", 120, fov="fov", rate="rate", depth=True),
    width=Default(int, 160),
    fov=Default(float, 60.0),
    rate=Default(float, 0.0),
)
PNamed = Primitive("PNamed", Camera(8, 6, fov="fov"), fov=str)
TAt = Transformation(
    "TAt", euler("x", "y", "z", turn="turn"), x=Metres, y=NONE, z=NONE, turn=Default(Degrees, 0.0)
)
eBodies = EventType("eBodies", visual=True)
WORDS = Vocabulary.of(PCube, PPoster, PEye, PNamed, TAt, eBodies, AgentKind("AEye", Fields.of({})))
INFO = WorldInfo("yard", WORDS, 7, 0.1)


@pytest.fixture(scope="module", autouse=True)
def driver():
    """Skips where there is none; not at import, because a fork lacks the driver's threads."""
    try:
        without_window().release()
    except MisuseError as error:
        pytest.skip(str(error))


def joined(**options):
    service = Cameras(**options)
    service.joined(INFO)
    return service


def pictures(service, scenery, part, number=1, readings=()):
    """What is published of a view, by topic."""
    service.show(View(number - 1, "eBodies", scenery + parse("AEye#e"), {"e": part}))
    tick = Tick(Frame(number, 0.1, 7), "cameras", readings=readings)
    assert list(service.generate(tick)) == []
    return dict(tick.published)


def pixels(image):
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3).astype(int)


def depths(image):
    return np.frombuffer(image.data, "<f4").reshape(image.height, image.width)


def test_pictures_show_colours_and_metres_where_things_are():
    scenery, service = TAt(2.2, 0.5, 0.3)(PCube()), joined()
    mounted = TAt(0.0, 0.0, 0.2)(TAt(0.1, 0.0, 0.1, 5.0)(PEye()))
    seen = pictures(service, scenery, mounted)
    (color, depth), focal = (seen["image"], seen["depth"]), focal_length(160, 60)
    assert (color.encoding, depth.encoding, color.time) == ("rgb8", "32FC1", 0.0)
    assert color.mount == Mount(0.1, 0.0, pytest.approx(5.0))
    # The middle of the front face, 1.9 m ahead of the mount and 0.5 m to its left.
    cos, sin = np.cos(np.radians(5)), np.sin(np.radians(5))
    ahead, left = 1.9 * cos + 0.5 * sin, 0.5 * cos - 1.9 * sin
    at = 60, int(80 - focal * left / ahead)
    red, green, _ = pixels(color)[at]
    assert red > 3 * green
    assert depths(depth)[at] == pytest.approx(ahead, abs=0.02)
    assert np.isinf(depths(depth)[5, 5])
    # Another process renders the same bits, and a robot that is elsewhere sees something else.
    again = pictures(joined(poses="truth"), scenery, mounted)
    assert (again["image"].data, again["depth"].data) == (color.data, depth.data)
    there = Odometry("e", 0.0, 0.0, 180.0, 0.0, 0.0, 0.5)
    away = pictures(service, scenery, mounted, readings=(there,))
    assert away["image"].time == 0.5
    assert np.isinf(depths(away["depth"])).all()
    # A thing that has moved is drawn again.
    moved = TAt(2.2, -0.2, 0.3)(PCube())
    assert pictures(service, moved, mounted) == pictures(joined(), moved, mounted)


def test_a_camera_takes_as_many_pictures_as_its_rate_says():
    service = joined(depths="")
    taken = [
        len(pictures(service, PCube(), TAt(-1.0)(PEye(rate=4.0)), number)) for number in range(1, 7)
    ]
    assert taken == [1, 0, 1, 0, 1, 0]
    # A successor gets an old view again, of which there has been a picture.
    tick = Tick(Frame(9, 0.1, 7), "cameras")
    assert list(service.generate(tick)) == tick.published == []


def test_the_detector_of_real_cameras_recognises_rendered_markers():
    pytest.importorskip("cv2", reason="needs the extra vision")
    from minerva_services.sensors.vision import Markers
    from minerva_services.sensors.vision.detection import marker_cells

    cells = marker_cells("4X4_50", 7)
    size = {"dictionary": "4X4_50", "size": 0.3, "names": {"7": "dock"}}
    markers = Markers(**size, fx=focal_length(320, 60))
    markers.joined(INFO)
    service = joined(depths="")
    for x, y, turn in ((1.5, 0.3, 180.0), (3.0, -0.8, 150.0), (2.0, 0.5, 225.0)):
        poster = TAt(x, y, 0.4, turn)(PPoster(cells, 0.05))
        seen = pictures(service, poster, TAt(0.0, 0.0, 0.3)(PEye(width=320)))
        tick = Tick(Frame(1, 0.1, 7), "markers", readings=(seen["image"],))
        assert list(markers.generate(tick)) == []
        ((_, sightings),) = tick.published
        ((marker, distance, angle),) = [(s.marker, s.distance, s.angle) for s in sightings.seen]
        assert marker == "dock"
        assert distance == pytest.approx(np.hypot(x, y), rel=0.02)
        assert angle == pytest.approx(np.degrees(np.arctan2(y, x)), abs=0.5)
    with pytest.raises(MisuseError, match="no marker 50; expected 0 to 49"):
        marker_cells("4X4_50", 50)


def test_physics_feels_neither_cameras_nor_posters():
    space = SpaceGeometry(WORDS)
    poster = TAt(1.0)(PPoster(np.ones((2, 2), np.int16), 0.1))
    space.read(View(0, "eBodies", poster + parse("AEye#e"), {"e": TAt(0.0)(PEye())}))
    assert not space.seen
    assert not space.sensors


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (PEye(width=0), "agent e, PEye: pictures of 0 x 120 pixels; expected whole"),
        (PEye(width=1 << 20), "8388608 pixels at most"),
        (PEye(fov=180.0), "agent e, PEye: fov is 180; expected 1 to 170 degrees"),
        (PEye(rate=-1.0), "agent e, PEye: rate is -1; expected pictures per second"),
        (PNamed("wide"), "agent e, PNamed: fov is 'wide'; expected a number"),
        (PEye() + PEye(), "agent e, PEye: the agent has another camera"),
    ],
)
def test_impossible_cameras_are_errors_that_name_their_agents(part, text):
    with pytest.raises(BodiesError, match=text):
        pictures(joined(), PCube(), part)


def test_cameras_in_the_scenery_unknown_symbols_and_missing_drivers_are_errors(monkeypatch):
    with pytest.raises(BodiesError, match="PEye: a camera has no agent; put it in the view"):
        joined().show(View(0, "eBodies", PEye(), {}))
    with pytest.raises(BodiesError, match="Poster: squares of 0 m; expected metres above 0"):
        Poster("cells", 0)
    with pytest.raises(BodiesError, match="expected odometry on 'truth', found Image"):
        pictures(
            joined(poses="truth"), PCube(), PEye(), readings=(Image("e", b"", "png", 1, 1, 0.0),)
        )
    with pytest.raises(
        BodiesError, match="PEyes is no camera of the vocabulary; expected PEye, PNamed"
    ):
        joined(camera="PEyes")

    def fails(**_):
        raise RuntimeError("libEGL.so is not there")

    monkeypatch.setattr("moderngl.create_context", fails)
    with pytest.raises(MisuseError, match=r"no driver for OpenGL 3.3 \(libEGL.so .* apt install"):
        pictures(joined(), PCube(), PEye())


def test_the_rover_reaches_a_marker_that_it_sees_in_pixels(tmp_path):
    pytest.importorskip("rapier3d", reason="needs the extra space")
    pytest.importorskip("cv2", reason="needs the extra vision")
    pytest.importorskip("mcap", reason="needs the extra record")
    options = {"camera": "rendered", "start": "15.3, 9.7, 90", "beams": 45, "frames": 60}
    done = run("rover", **options, record=tmp_path / "seen.mcap")
    assert done.frames < 40
    # What it has seen is in the record, so nothing is rendered again.
    replayed = here(tmp_path, "replay", "seen.mcap", "--recompute")
    assert replayed.returncode == 0, replayed.stdout
