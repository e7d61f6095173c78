"""Locates markers in images: distances and angles from the robot's centre."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Mount, Sighting
from minerva_services.sensors.vision.detection import DetectedMarker, Grey, detector, dictionary_of
from minerva_services.sensors.vision.lens import Lens, WrongSize, read_lens
from minerva_services.sensors.vision.library import opencv

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
