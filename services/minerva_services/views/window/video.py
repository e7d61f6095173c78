"""Videos at the speed of simulated time, as MP4 or GIF files."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.files import MARK, check_file, ending_of, gif_comment
from minerva_services.views.svg.files import prepare_folder
from minerva_services.views.window.painter import Pixels

_MAX_RATES = {".mp4": 60.0, ".gif": 25.0}
_MIN_RATE = 10.0
"""Minimum views per second: slower worlds are sped up, or the video would be a series of stills."""
# Maximum denominator of the frame rate.
_MAX_RATIO = 1000
_ENCODERS = {"mp4": "libx264", "gif": "gif"}
# Fragments keep an unfinished file playable; closing turns it into an ordinary MP4.
_OPTIONS = {"mp4": {"movflags": "+hybrid_fragmented", "flush_packets": "1"}, "gif": {}}


class Timing:
    """How many pictures of a video show each view.

    `seconds` is the video time per frame of the world.
    """

    def __init__(self, fps: float, seconds: float) -> None:
        self.fps = fps
        self.seconds = seconds
        self._first: int | None = None
        self._written = 0

    @staticmethod
    def of(dt: float, speed: float, every: int, fps: float, suffix: str) -> Timing:
        """Simulated time scaled by `speed`; slow worlds are sped up to 10 views per second.

        `dt` is the duration of a frame in seconds; `fps` 0: as many pictures as views, within
        limits.
        """
        seconds = dt / speed
        if speed == 1.0 and not fps:
            seconds = min(seconds, 1 / (_MIN_RATE * every))
        return Timing(fps or min(1 / (seconds * every), _MAX_RATES[suffix]), seconds)

    def times(self, frame: int) -> int:
        """Number of pictures to write for the view of a frame."""
        if self._first is None:
            self._first = frame
        # The addend absorbs products that rounding puts just below a whole number.
        until = int((frame - self._first) * self.seconds * self.fps + 1e-6) + 1
        times, self._written = max(0, until - self._written), max(until, self._written)
        return times


class VideoWriter:
    """Writes a video file incrementally. Raises MisuseError.

    An MP4 stays playable however its writer ends.
    """

    def __init__(self, path: str, size: tuple[int, int], fps: float) -> None:
        self.pictures = 0
        self._path = Path(path)
        self._size = size
        self._rate = Fraction(fps).limit_denominator(_MAX_RATIO)
        self._palette: Any = None
        prepare_folder(self._path)
        check_file(self._path, "video")
        try:
            # Reports an unwritable path when the world begins, not with the first picture.
            self._path.write_bytes(b"")
        except OSError as error:
            raise self._unwritable(error) from None

    def add(self, pixels: Pixels) -> None:
        """Add a picture of shape (height, width, 3)."""
        import av

        if not self.pictures:  # an encoder without input cannot be closed
            self._begin()
        frame: Any = av.VideoFrame.from_ndarray(pixels, format="rgb24")
        frame.pts, frame.time_base = self.pictures, 1 / self._rate
        self.pictures += 1
        if self._palette is None:
            self._write(frame)
        else:
            self._palette.push(frame)
            self._write(self._palette.pull())

    def close(self) -> None:
        """Finish the file; without any picture, remove it."""
        if not self.pictures:
            self._path.unlink(missing_ok=True)
            return
        self._write(None)
        try:
            self._file.close()
            if self._palette is not None:  # the library cannot write GIF comments
                self._path.write_bytes(gif_comment(self._path.read_bytes()))
        except OSError as error:
            raise self._unwritable(error) from None

    def _begin(self) -> None:
        import av

        kind = ending_of(self._path)[1:]
        try:
            self._file: Any = av.open(self._path, "w", format=kind, options=_OPTIONS[kind])
        except OSError as error:
            raise self._unwritable(error) from None
        self._file.metadata["comment"] = MARK
        self._stream: Any = self._file.add_stream(_ENCODERS[kind], rate=self._rate)
        self._stream.width, self._stream.height = self._size
        if kind == "gif":
            self._stream.pix_fmt = "pal8"
            self._palette = _palette(self._size, self._rate)
        else:
            # The format that all players support.
            self._stream.pix_fmt = "yuv420p"
            self._stream.options = {"crf": "20", "preset": "veryfast"}
            # A key frame per second, for seeking.
            self._stream.gop_size = max(1, round(self._rate))

    def _write(self, frame: Any) -> None:
        try:
            self._file.mux(self._stream.encode(frame))
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: Exception) -> MisuseError:
        reason = getattr(error, "strerror", None) or error
        return MisuseError(f"video: cannot write {self._path}: {reason}")


def _palette(size: tuple[int, int], rate: Fraction) -> Any:
    """A filter graph that gives each picture of a GIF its own 256 colours."""
    from av.filter import Graph

    graph: Any = Graph()
    source = graph.add_buffer(width=size[0], height=size[1], format="rgb24", time_base=1 / rate)
    split, generate, use = (
        graph.add("split"),
        graph.add("palettegen", "stats_mode=single"),
        (graph.add("paletteuse", "new=1:dither=none")),
    )
    sink = graph.add("buffersink")
    source.link_to(split)
    split.link_to(generate, 0, 0)
    split.link_to(use, 1, 0)
    generate.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    return graph
