"""Locates markers in images: distances and angles from the robot's centre."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Mount, Sighting
from minerva_services.sensors.vision.detection import DetectedMarker, detector, dictionary_of
from minerva_services.sensors.vision.images import Grey, opencv

_SQUARE: Final = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], np.float64) / 2
"""Corners of a marker with side 1, in the order required by IPPE_SQUARE."""


@dataclass(frozen=True, slots=True)
class VisionOptions:
    """The markers to recognise and the camera's lens. Raises MisuseError.

    Args:
        dictionary: the markers' dictionary, such as `6X6_250` or `APRILTAG_36h11`.
        size: side of a marker's black square in metres.
        names: the world's names of markers by their numbers; by default the numbers.
        calibration: a calibration file of OpenCV or ROS.
        fx: focal length in pixels, instead of a file.
        fy: in pixels; 0: as fx.
        cx: optical centre in pixels; 0: the image's centre.
        cy: in pixels, likewise.

    """

    # Required and never guessed: a wrong dictionary yields false markers.
    dictionary: str
    size: float
    names: Mapping[str, Any] | None = None
    calibration: str = ""
    fx: float = 0.0
    fy: float = 0.0
    cx: float = 0.0
    cy: float = 0.0

    def __post_init__(self) -> None:
        dictionary_of(self.dictionary)
        names_of(self.names)
        if not 0 < self.size < math.inf:
            raise MisuseError(
                f"vision: size is {self.size:g}; expected metres, the side of a marker's square"
            )
        if bool(self.calibration) == any((self.fx, self.fy, self.cx, self.cy)):
            raise MisuseError("vision: set calibration (a file), or fx, fy, cx and cy")
        if not self.calibration:
            self._given()

    def lens(self) -> Lens:
        """The camera's lens, read from its file if given. Raises MisuseError."""
        return read_lens(self.calibration) if self.calibration else self._given()

    def _given(self) -> Lens:
        return Lens(self.fx, self.fy or self.fx, self.cx, self.cy)


def names_of(table: Mapping[str, Any] | None) -> Mapping[int, str]:
    """Names by marker number, from a table. Raises MisuseError."""
    names: dict[int, str] = {}
    for number, name in (table or {}).items():
        if not str(number).isdecimal() or not isinstance(name, str):
            raise MisuseError(
                f'vision: names has {number} = {name!r}; expected "23" = "kitchen", a marker\'s'
                " number and its name"
            )
        names[int(number)] = name
    return names


class MarkerLocator:
    """Recognises markers in images. Raises MisuseError if a library or file is missing."""

    def __init__(self, options: VisionOptions, count: Callable[[str], None]) -> None:
        self._options = options
        self._count = count
        self._detect = detector(dictionary_of(options.dictionary))
        self._names = names_of(options.names)
        self._calibrated = options.lens()
        self._lens = self._calibrated

    def locate(self, image: Grey, mount: Mount) -> tuple[Sighting, ...]:
        """The markers of an image, relative to the robot. Raises WrongSize."""
        height, width = image.shape
        if (self._lens.width, self._lens.height) != (width, height):
            self._lens = self._calibrated.at(width, height)
        seen = [self._sighting(marker, mount) for marker in self._detect(image)]
        return tuple([sighting for sighting in seen if sighting is not None])

    def _sighting(self, marker: DetectedMarker, mount: Mount) -> Sighting | None:
        name = self._names.get(marker.id) if self._names else str(marker.id)
        if name is None:
            self._count("unknown markers")
            return None
        place = _place(marker.corners, self._options.size, self._lens)
        if place is None:
            self._count("garbage")
            return None
        distance, angle = from_centre(*place, mount)
        return Sighting(name, distance, angle)


def _place(corners: NDArray[np.float64], size: float, lens: Lens) -> tuple[float, float] | None:
    """Position of a marker's centre in metres ahead and to the left of the camera.

    IPPE for squares (Collins and Bartoli 2014): the better fitting of its two solutions. Their
    orientations may differ much, their positions hardly do.
    """
    cv2 = opencv()
    distortion = np.array(lens.distortion, np.float64) if lens.distortion else None
    # IPPE divides by zero for a marker seen as an exact square; the iterative method does not.
    for method in (cv2.SOLVEPNP_IPPE_SQUARE, cv2.SOLVEPNP_ITERATIVE):
        _, _, places, errors = cv2.solvePnPGeneric(
            _SQUARE * size, corners, lens.matrix(), distortion, flags=method
        )
        fits = [
            (float(error[0]), *place.ravel().tolist())
            for place, error in zip(places, errors, strict=True)
        ]
        fits = [fit for fit in fits if all(map(math.isfinite, fit))]
        if fits:
            # Each fit begins with its error. OpenCV's x points right, y down and z ahead.
            _, right, _, ahead = min(fits)
            return (ahead, -right) if ahead > 0 else None
    return None


def from_centre(ahead: float, left: float, mount: Mount) -> tuple[float, float]:
    """Distance (m) and angle (deg) from the robot's centre of a point seen by its camera."""
    cos, sin = portable.cos_sin(math.radians(mount.angle))
    x = mount.x + ahead * cos - left * sin
    y = mount.y + ahead * sin + left * cos
    return portable.hypot(x, y), math.degrees(portable.atan2(y, x))


__all__ = ["MarkerLocator", "VisionOptions", "WrongSize", "from_centre"]


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
