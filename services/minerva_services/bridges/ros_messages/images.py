"""Conversion of ROS images: sensor_msgs/Image and sensor_msgs/CompressedImage."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.log.recordings import RecordingError
from minerva_bus.wording import install
from minerva_bus.world.readings import Image
from minerva_services.bridges.ros_messages.frames import GarbageError, SensorMount
from minerva_services.bridges.ros_messages.readings import stamp_of

_CHANNELS: Final[Mapping[str, tuple[int, ...]]] = {
    "rgb8": (0, 1, 2),
    "bgr8": (2, 1, 0),
    "8UC3": (2, 1, 0),
    "rgba8": (0, 1, 2),
    "bgra8": (2, 1, 0),
    "mono8": (0,),
    "8UC1": (0,),
}
"""Channels of a pixel that are red, green and blue, or grey, by encoding."""

_DEPTHS: Final[Mapping[str, tuple[str, float]]] = {
    "16UC1": ("u2", 1.0),
    "mono16": ("u2", 1.0),
    "32FC1": ("f4", 1000.0),
}
"""Number of a pixel, and its millimetres, by encoding [REP 118]; in `mono16` they are shades."""

_CENTRE: Final = SensorMount()
_WITH_ALPHA: Final = ("rgba8", "bgra8")
_MAX_PIXELS: Final = 100_000_000


def image_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Image:
    """sensor_msgs/Image as rgb8, mono8 or, if it has 16 bits or distances, as a PNG of 16 bits.

    A distance is in millimetres, 0 if unknown, at most 65.535 m. Raises GarbageError, and
    RecordingError if Pillow is missing.
    """
    name, width, height = str(message.encoding), int(message.width), int(message.height)
    time = stamp_of(message) if time is None else time
    if name in _DEPTHS:
        depths = _depth_file(message, width, height, *_DEPTHS[name])
        return Image(robot, depths, "png", width, height, time, mounting.mount)
    channels = _CHANNELS.get(name)
    if channels is None:
        known = ", ".join((*_CHANNELS, *_DEPTHS))
        raise GarbageError(f"the encoding {name[:20]!r} is not one of {known}")
    pixels = _pixels(message, width, height, 4 if name in _WITH_ALPHA else len(channels))
    data = np.ascontiguousarray(pixels[:, :, channels]).tobytes()
    kind = "rgb8" if len(channels) == 3 else "mono8"
    return Image(robot, data, kind, width, height, time, mounting.mount)


def _depth_file(message: Any, width: int, height: int, number: str, scale: float) -> bytes:
    """A PNG file of one channel of 16 bits."""
    order = ">" if message.is_bigendian else "<"
    pixels = _pixels(message, width, height, np.dtype(number).itemsize)
    numbers = np.ascontiguousarray(pixels).view(order + number)[:, :, 0] * scale
    known = np.nan_to_num(numbers, nan=0.0, posinf=0.0, neginf=0.0)
    file = io.BytesIO()
    _pillow().fromarray(np.clip(np.rint(known), 0, 65535).astype("<u2")).save(file, "PNG")
    return file.getvalue()


def _pillow() -> Any:
    """Raises RecordingError if it is missing."""
    try:
        from PIL import Image as Pillow  # late: optional dependency (extra "ros")
    except ImportError:
        raise RecordingError(
            f"images of files and distances need Pillow; install it with: {install('ros')}"
        ) from None
    return Pillow


def _pixels(message: Any, width: int, height: int, depth: int) -> NDArray[np.uint8]:
    """The pixels without row padding, (height, width, depth)."""
    data, step = np.asarray(message.data, np.uint8), int(message.step)
    if not (0 < width * height <= _MAX_PIXELS and step >= width * depth):
        raise GarbageError(f"{width}×{height} pixels in rows of {step} bytes are not an image")
    if data.size < step * height:
        raise GarbageError(f"{data.size} bytes are too few for {height} rows of {step}")
    rows = data[: step * height].reshape(height, step)
    return rows[:, : width * depth].reshape(height, width, depth)


def file_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Image:
    """sensor_msgs/CompressedImage: a JPEG or PNG, unchanged.

    Raises GarbageError, and RecordingError if Pillow is missing.
    """
    pillow = _pillow()
    data = bytes(message.data)
    try:
        with pillow.open(io.BytesIO(data), formats=("JPEG", "PNG")) as opened:
            (width, height), encoding = opened.size, str(opened.format).lower()
    except Exception as error:  # decoders raise many types for damaged files
        kind = str(message.format)[:20]
        raise GarbageError(f"{kind!r} of {len(data)} bytes is not a JPEG or PNG") from error
    time = stamp_of(message) if time is None else time
    return Image(robot, data, encoding, width, height, time, mounting.mount)
