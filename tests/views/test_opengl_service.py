"""The view as a service: its options, its files, and its errors."""

import importlib.util
import sys

import moderngl
import numpy as np
import pytest
from opengl_world import WORLD, floor, like, needs_driver
from sprites_world import ROBOT, PRobot, TPut, view

from minerva_bus.errors import MisuseError
from minerva_services.views.opengl import OpenGL

SCENE = floor() + TPut(6.0, 4.0)(PRobot("r1", 0.4))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"elevation": 5.0}, "elevation is 5; expected 8 to 90 degrees"),
        ({"azimuth": 500.0}, "azimuth is 500; expected -360 to 360 degrees"),
        ({"zoom": 0.0}, "zoom is 0; expected 0.01 to 1000"),
        ({"zoom": float("nan")}, "zoom is nan"),
        ({"width": 5}, "width is 5; expected 100"),
        ({"path": "a.jpg"}, "expected a name that ends in .png"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_line(options, words):
    with pytest.raises(MisuseError, match=words) as caught:
        OpenGL(**{"path": "a.png", **options})
    assert "\n" not in str(caught.value)


def test_a_missing_display_is_reported_with_a_remedy(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform not in ("win32", "darwin"):
        with pytest.raises(MisuseError, match=r"no display .* path=FILE\.png"):
            OpenGL()


def test_a_missing_library_names_the_extra(monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *a: None if name == "moderngl" else find_spec(name, *a),
    )
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[opengl\]'"):
        OpenGL(path="a.png")


def test_a_missing_driver_is_reported_with_packages(monkeypatch, tmp_path):
    def fails(*a, **options):
        raise Exception("(detect) libEGL.so: not loaded")

    monkeypatch.setattr(moderngl, "create_context", fails)
    device = OpenGL(path=str(tmp_path / "a.png"))
    with pytest.raises(MisuseError, match=r"libEGL.so: not loaded.* libgl1-mesa-dri") as caught:
        device.joined(WORLD)
    assert "\n" not in str(caught.value)
    device.close()


@needs_driver
def test_pictures_are_written_and_numbered(tmp_path):
    device = OpenGL(path=str(tmp_path / "a.png"), frames=True, width=300, height=200)
    assert (device.when, device.interactive, device.coupled) == ("each 10 frames", False, False)
    device.joined(WORLD)
    for frame in (0, 10):
        device.show(view(frame, SCENE))
    assert device.report() == {"picture": str(tmp_path / "a-000010.png")}
    device.close()
    device.close()
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    for name in ("a-000000.png", "a-000010.png"):
        with image.open(tmp_path / name) as picture:
            assert picture.size == (300, 200)
            assert len(like(np.asarray(picture.convert("RGB")), ROBOT)) > 10
