"""Camera calibration: the mapping of directions to pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_services.sensors.vision.library import opencv

MAX_FILE_BYTES: Final = 1 << 20
_MATRIX: Final = ("camera_matrix", "cameraMatrix", "camera_Matrix", "K")
_DISTORTION: Final = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "dist_coeff", "D")
# Relative difference up to which two aspect ratios are those of one camera.
_SAME_ASPECT: Final = 0.01


class WrongSize(Exception):
    """An image does not match the calibrated camera."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Focal lengths and centre in pixels, image size, and distortion (OpenCV's model).

    A centre of 0 means the image's centre; a size of 0 means any, without scaling.
    """

    fx: float
    fy: float
    cx: float = 0.0
    cy: float = 0.0
    distortion: tuple[float, ...] = ()
    width: int = 0
    height: int = 0

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not all(map(math.isfinite, numbers)) or self.fx <= 0 or self.fy <= 0:
            raise MisuseError(
                f"vision: fx, fy, cx, cy are {self.fx:g}, {self.fy:g}, {self.cx:g}, {self.cy:g};"
                " expected pixels, fx and fy above 0"
            )
        if len(self.distortion) not in (0, 4, 5, 8, 12, 14):
            raise MisuseError(
                f"vision: {len(self.distortion)} distortion coefficients; expected 4, 5, 8, 12, 14"
            )

    def matrix(self) -> NDArray[np.float64]:
        """The camera matrix, (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    def at(self, width: int, height: int) -> Lens:
        """The lens for images of another size of the same camera. Raises WrongSize."""
        scale = width / self.width if self.width else 1.0
        if self.height and abs(scale * self.height / height - 1) > _SAME_ASPECT:
            raise WrongSize(
                f"{width}×{height} pixels, but the calibration is for {self.width}×{self.height}"
            )
        return replace(
            self,
            fx=self.fx * scale,
            fy=self.fy * scale,
            # 0 stands for the centre, which is known only with an image.
            cx=self.cx * scale or width / 2,
            cy=self.cy * scale or height / 2,
            width=width,
            height=height,
        )


def read_lens(path: str) -> Lens:
    """Read a calibration file of OpenCV (YAML, JSON, XML) or ROS. Raises MisuseError."""
    try:
        # A large file is not a calibration. An empty text fails below with a message that says so.
        text = Path(path).read_text(encoding="utf-8") if _is_small(path) else ""
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise MisuseError(f"vision: calibration {path}: {reason}") from None
    cv2 = opencv()
    try:
        stored = cv2.FileStorage(_for_opencv(text), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        matrix = _numbers(stored, _MATRIX)
        distortion = _numbers(stored, _DISTORTION)
        size = [_number(stored.getNode(f"image_{side}")) for side in ("width", "height")]
    except (cv2.error, SystemError, ValueError, TypeError) as error:
        raise MisuseError(f"vision: {path} is not a calibration file of OpenCV or ROS") from error
    if len(matrix) != 9:
        raise MisuseError(f"vision: {path} lacks a camera_matrix of 3×3 numbers")
    return Lens(matrix[0], matrix[4], matrix[2], matrix[5], distortion, int(size[0]), int(size[1]))


def _is_small(path: str) -> bool:
    return Path(path).stat().st_size <= MAX_FILE_BYTES


def _for_opencv(text: str) -> str:
    """The text with the header line that OpenCV requires for YAML."""
    begin = text.lstrip()
    if begin.startswith(("%YAML", "{", "<")):
        return begin
    return f"%YAML:1.0\n---\n{begin.removeprefix('---')}\n"


def _numbers(stored: Any, names: tuple[str, ...]) -> tuple[float, ...]:
    for name in names:
        node = stored.getNode(name)
        if not node.empty():
            return tuple(_flat(node))
    return ()


def _flat(node: Any) -> list[float]:
    data = node.getNode("data") if node.isMap() else node
    if data.isSeq():
        return [number for i in range(data.size()) for number in _flat(data.at(i))]
    return [_number(data)]


def _number(node: Any) -> float:
    if node.empty():
        return 0.0
    if not (node.isReal() or node.isInt()):
        raise ValueError("not a number")
    return float(node.real())
