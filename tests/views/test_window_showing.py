"""Options that views in a window share: accepted, or rejected in one line."""

import importlib.util

import pytest

from minerva_bus.errors import MisuseError
from minerva_services.views.window.options import Medium, WindowOptions, has_display
from minerva_services.views.window.screen import drivers

SCREEN = {"DISPLAY": ":3"}


def showing(environment=SCREEN, **options):
    return WindowOptions("sprites", ("numpy",), environment=environment, **options)


def test_a_window_draws_by_the_clock():
    made = showing()
    assert (made.medium, made.when) == (Medium.WINDOW, "at 30 Hz")
    assert showing(every=5).when == "each 5 frames"


def test_pictures_and_videos_go_by_frames_and_need_no_display():
    pictures, video = showing({}, path="a.png"), showing({}, video="a.mp4", width=301, height=201)
    assert (pictures.medium, pictures.when) == (Medium.PICTURES, "each 10 frames")
    assert (video.medium, video.asks_every, video.when) == (Medium.VIDEO, 1, "each 1 frames")
    assert video.size == (300, 200)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"width": 20}, "width is 20; expected 100 to 7680 pixels"),
        ({"height": 9000}, "height is 9000"),
        ({"path": "a.jpg"}, r"expected a name that ends in \.png"),
        ({"video": "a.avi"}, r"expected a name that ends in \.mp4 or \.gif"),
        ({"path": "a.png", "video": "a.gif"}, "use one"),
        ({"path": "a.png", "every": -1}, "a number of frames from 0"),
        ({"video": "a.gif", "fps": -1.0}, "fps must be 0 to 120"),
        ({"video": "a.gif", "speed": 0.0}, "speed above 0"),
        ({"environment": {}}, r"no display .* path=FILE\.png, or a video with video=FILE\.mp4"),
    ],
)
def test_invalid_values_are_rejected_in_one_line(options, words):
    with pytest.raises(MisuseError, match=words) as caught:
        showing(**options)
    assert str(caught.value).startswith("sprites: ")
    assert "\n" not in str(caught.value)


def test_a_missing_package_is_named_with_its_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MisuseError, match=r"install .*'minerva-bus\[sprites\]'"):
        showing()
    with pytest.raises(MisuseError, match=r"install .*'minerva-bus\[sprites,video\]'"):
        showing(video="a.mp4")


def test_displays_by_the_environment():
    assert not has_display({}, "linux")
    assert not has_display({"DISPLAY": ""}, "linux")
    assert has_display({"WAYLAND_DISPLAY": "wayland-0"}, "linux")
    assert has_display({"SDL_VIDEODRIVER": "dummy"}, "linux")
    assert has_display({}, "darwin")
    assert drivers({}) == ""
    assert drivers(SCREEN) == "x11"
    assert drivers({**SCREEN, "WAYLAND_DISPLAY": "w"}) == "x11,wayland"
