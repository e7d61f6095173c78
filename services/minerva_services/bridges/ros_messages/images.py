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

_CENTRE: Final = SensorMount()
_WITH_ALPHA: Final = ("rgba8", "bgra8")
_MAX_PIXELS: Final = 100_000_000


def image_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Image:
    """sensor_msgs/Image as rgb8 or mono8. Raises GarbageError."""
    name, width, height = str(message.encoding), int(message.width), int(message.height)
    channels = _CHANNELS.get(name)
    if channels is None:
        raise GarbageError(f"the encoding {name[:20]!r} is not one of {', '.join(_CHANNELS)}")
    pixels = _pixels(message, width, height, 4 if name in _WITH_ALPHA else len(channels))
    data = np.ascontiguousarray(pixels[:, :, channels]).tobytes()
    kind = "rgb8" if len(channels) == 3 else "mono8"
    time = stamp_of(message) if time is None else time
    return Image(robot, data, kind, width, height, time, mounting.mount)


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
    try:
        from PIL import Image as Pillow  # late: optional dependency (extra "ros")
    except ImportError:
        raise RecordingError(
            f"compressed images need Pillow; install it with: {install('ros')}"
        ) from None

    data = bytes(message.data)
    try:
        with Pillow.open(io.BytesIO(data), formats=("JPEG", "PNG")) as opened:
            (width, height), encoding = opened.size, str(opened.format).lower()
    except Exception as error:  # decoders raise many types for damaged files
        kind = str(message.format)[:20]
        raise GarbageError(f"{kind!r} of {len(data)} bytes is not a JPEG or PNG") from error
    time = stamp_of(message) if time is None else time
    return Image(robot, data, encoding, width, height, time, mounting.mount)
