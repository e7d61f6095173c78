"""The device without a window: the files it writes, and its errors."""

import io

import numpy as np
import pytest

pytest.importorskip("pygame")

from PIL import Image
from sprites_world import DOT, ROBOT, WORLD, PDot, PRobot, TPut, floor, middle_of, view

from minerva_bus import Device, MinervaError
from minerva_services.views.sprites import Sprites


def joined(path, **options):
    made = Sprites(path=str(path), **options)
    made.joined(WORLD)
    return made


def pixels(path):
    with Image.open(io.BytesIO(path.read_bytes())) as image:
        return np.asarray(image.convert("RGB"))


def test_a_view_becomes_a_png(tmp_path):
    device = joined(tmp_path / "deep" / "w.png", width=640, height=480)
    device.show(view(30, floor() + TPut(4.0, 2.5)(PRobot("r1", 0.3))))
    image = pixels(tmp_path / "deep" / "w.png")
    assert image.shape == (480, 640, 3)
    assert middle_of(image, ROBOT) is not None
    assert device.report() == {"picture": str(tmp_path / "deep" / "w.png")}
    device.close()
    device.close()


def test_all_pictures_are_kept_where_one_wants_them(tmp_path):
    device = joined(tmp_path / "w.png", frames=True, width=200, height=150)
    for frame in (0, 10):
        device.show(view(frame, PDot(1.0)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["w-000000.png", "w-000010.png"]


def test_the_same_view_is_the_same_picture(tmp_path):
    for name in ("a.png", "b.png"):
        joined(tmp_path / name).show(view(3, floor() + PDot(0.5)))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_views_lie_over_one_another(tmp_path):
    device = joined(tmp_path / "w.png", draws="eOverlay, ePicture", width=400, height=300)
    assert device.draws == ("eOverlay", "ePicture")
    device.show(view(0, floor() + TPut(4.0, 2.5)(PRobot("r1", 0.3))))
    device.show(view(0, TPut(2.0, 2.5)(PDot(0.3)), "eOverlay"))
    image = pixels(tmp_path / "w.png")
    assert middle_of(image, ROBOT) is not None
    assert middle_of(image, DOT) is not None
    device.show(view(1, TPut(4.0, 2.5)(PDot(0.3))))
    assert np.array_equal(pixels(tmp_path / "w.png"), image)  # not yet the other view of frame 1


def test_how_it_takes_part(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":7")
    window, pictures = Sprites(), Sprites(path="a.png")
    assert isinstance(window, Device)
    assert (window.interactive, window.coupled, window.when) == (True, False, "at 30 Hz")
    assert (pictures.interactive, pictures.coupled, pictures.when) == (
        False,
        False,
        "each 10 frames",
    )
    assert (window.pulse_every > 0, pictures.pulse_every) == (True, 0)
    assert Sprites.draws == window.draws == ("ePicture",)


def test_a_video_misses_no_frame(tmp_path):
    av = pytest.importorskip("av")
    device = Sprites(video=str(tmp_path / "a.mp4"), width=320, height=240)
    assert (device.interactive, device.coupled, device.when) == (False, True, "each 1 frames")
    device.joined(WORLD)
    for frame in range(12):
        device.show(view(frame, floor() + TPut(1.5 + 0.4 * frame, 2.5)(PRobot("r1", 0.4))))
    assert device.report() == {"video": str(tmp_path / "a.mp4")}
    device.close()
    with av.open(str(tmp_path / "a.mp4")) as file:
        assert float(file.streams.video[0].average_rate) == pytest.approx(10)
        frames = [
            middle_of(frame.to_ndarray(format="rgb24"), ROBOT, 40)[0] for frame in file.decode()
        ]
    assert len(frames) == 12
    assert (np.diff(frames) > 5).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"draws": " , "}, "expected visual event types"),
        ({"path": "a.png", "click": "eNothing"}, "not an event type of the world"),
        ({"path": "/proc/none/a.png"}, "cannot write"),
    ],
)
def test_invalid_input_is_reported_in_one_line(options, words):
    with pytest.raises(MinervaError, match=words) as caught:
        Sprites(**{"path": "a.png", **options}).joined(WORLD)
    assert "\n" not in str(caught.value)


def test_a_missing_display_is_reported_with_a_remedy(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(MinervaError, match=r"path=FILE\.png"):
        Sprites()
