"""Access to OpenCV, an optional dependency."""

from __future__ import annotations

import os
from functools import cache
from typing import Any

from minerva_services.options import require

_QUIET = {
    "OPENCV_LOG_LEVEL": "SILENT",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(1 << 26),
}


@cache
def opencv() -> Any:
    """The module cv2, silenced and limited to images of 64 megapixels.

    Raises MisuseError if it is not installed.
    """
    # OpenCV reads these variables when it is imported.
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    require("vision", "cv2", "OpenCV", "vision")
    import cv2

    library: Any = cv2
    # Set again in case cv2 was imported earlier; version 5 has another name for it.
    quieten = getattr(library, "setLogLevel", None) or library.utils.logging.setLogLevel
    quieten(0)
    return library
