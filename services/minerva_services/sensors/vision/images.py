"""Decoding of image readings and files to grey pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from minerva_bus.world.readings import Image
from minerva_services.sensors.vision.detection import Grey
from minerva_services.sensors.vision.library import opencv

SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")


class NoImage(Exception):
    """Bytes that are not an image."""


def is_image(path: Path) -> bool:
    """True if a file has the suffix of an image."""
    return path.suffix.lower() in SUFFIXES


def grey_of(image: Image) -> Grey:
    """The grey pixels of a reading. Raises NoImage."""
    if image.encoding in ("jpeg", "png"):
        return decoded(image.data)
    depth = 3 if image.encoding == "rgb8" else 1
    pixels = np.frombuffer(image.data, np.uint8)
    if pixels.size != image.width * image.height * depth:
        raise NoImage(f"{pixels.size} bytes do not match a {image.encoding} image of this size")
    rows = pixels.reshape(image.height, image.width, depth)
    # OpenCV expects blue, green, red.
    return grey(rows[:, :, ::-1] if depth == 3 else rows)


def decoded(data: bytes) -> Grey:
    """Decode a file's bytes. Raises NoImage."""
    cv2 = opencv()
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise NoImage("not a readable image")
    return pixels


def grey(pixels: Any) -> Grey:
    """OpenCV pixels, (height, width) or (height, width, 1 or 3: blue, green, red), as grey."""
    cv2 = opencv()
    if pixels.ndim == 2:
        return cast("Grey", pixels)
    if pixels.shape[2] == 1:
        return cast("Grey", pixels[:, :, 0])
    # OpenCV rejects the negative strides of a reversed view.
    return cv2.cvtColor(np.ascontiguousarray(pixels), cv2.COLOR_BGR2GRAY)
