"""Videos: same speed as the world, playable in any case, with the colours that were drawn."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.errors import MisuseError
from minerva_services.views.window.video import Timing, VideoWriter


def test_a_video_goes_as_fast_as_the_world():
    assert Timing.of(0.1, 1.0, 1, 0.0, ".mp4").fps == pytest.approx(10)
    assert Timing.of(0.1, 2.0, 1, 0.0, ".mp4").fps == pytest.approx(20)
    assert Timing.of(0.1, 1.0, 2, 0.0, ".mp4").fps == pytest.approx(10)  # slow worlds: faster
    assert Timing.of(0.01, 1.0, 1, 0.0, ".mp4").fps == 60
    assert Timing.of(0.01, 1.0, 1, 0.0, ".gif").fps == 25
    assert Timing.of(1.0, 1.0, 1, 0.0, ".mp4").fps == pytest.approx(10)
    assert Timing.of(0.1, 1.0, 1, 24.0, ".mp4").fps == 24


@given(
    st.floats(0.001, 2.0), st.floats(0.1, 20.0), st.integers(1, 7), st.sampled_from([0.0, 12, 50]),
    st.integers(0, 1000), st.integers(1, 60),
)  # fmt: skip
def test_a_video_lasts_as_long_as_what_it_shows(dt, speed, every, fps, first, views):
    timing = Timing.of(dt, speed, every, fps, ".mp4")
    written = sum(timing.times(first + at * every) for at in range(views))
    lasts = (views - 1) * every * timing.seconds
    assert written == pytest.approx(lasts * timing.fps + 1, abs=1.01)
    assert timing.times(first) == 0  # a frame that was shown before


def test_one_picture_per_view_by_default():
    timing = Timing.of(0.1, 1.0, 1, 0.0, ".mp4")
    assert [timing.times(frame) for frame in range(3, 40)] == [1] * 37


def striped(step, size=(64, 48)):
    """A picture with a red left part and a blue right part; the boundary moves."""
    pixels = np.zeros((size[1], size[0], 3), np.uint8)
    pixels[:, : 16 + 4 * step, 0] = 220
    pixels[:, 16 + 4 * step :, 2] = 220
    return pixels


def frames_of(path):
    av = pytest.importorskip("av")
    frames = []
    with av.open(str(path)) as file, suppress(av.error.InvalidDataError):
        for frame in file.decode(video=0):  # up to the point at which its writer was killed
            frames.append(frame.to_ndarray(format="rgb24"))
    return frames


@pytest.mark.parametrize("count", [1, 8])
@pytest.mark.parametrize("suffix", ["mp4", "gif"])
def test_drawn_frames_are_in_the_video(tmp_path, suffix, count):
    pytest.importorskip("av")
    film = VideoWriter(str(tmp_path / f"a.{suffix}"), (64, 48), 10)
    for step in range(count):
        film.add(striped(step))
    film.close()
    frames = frames_of(tmp_path / f"a.{suffix}")
    assert len(frames) == count
    for step, frame in enumerate(frames):
        wanted = striped(step).astype(int)
        inside = np.ones(64, bool)
        inside[12 + 4 * step : 20 + 4 * step] = False
        assert np.abs(frame.astype(int) - wanted)[:, inside].max() < 40


def test_a_video_that_was_not_finished_can_be_played(tmp_path):
    pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    film = VideoWriter(str(path), (64, 48), 10)
    for step in range(90):
        film.add(striped(step % 8))
    (tmp_path / "copy.mp4").write_bytes(path.read_bytes())
    assert 10 <= len(frames_of(tmp_path / "copy.mp4")) < 90
    film.close()
    assert len(frames_of(path)) == 90


@pytest.mark.parametrize("suffix", ["mp4", "gif"])
def test_without_a_picture_there_is_no_video(tmp_path, suffix):
    pytest.importorskip("av")
    VideoWriter(str(tmp_path / f"a.{suffix}"), (64, 48), 10).close()
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    pytest.importorskip("av")
    (tmp_path / "a.mp4").mkdir()
    with pytest.raises(MisuseError, match=r"video: cannot write .*a\.mp4") as caught:
        VideoWriter(str(tmp_path / "a.mp4"), (64, 48), 10)
    assert "\n" not in str(caught.value)
