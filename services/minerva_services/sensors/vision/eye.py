"""What an image shows of the world's markers, as distances and angles from the robot's centre."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Mount, Sighting
from minerva_services.sensors.vision.detecting import Found, Grey, detector, dictionary_of
from minerva_services.sensors.vision.lens import Lens, WrongSize, read_lens
from minerva_services.sensors.vision.library import opencv

_SQUARE: Final = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], np.float64) / 2
"""A marker's corners of side 1, in the order that IPPE_SQUARE wants."""


@dataclass(frozen=True, slots=True)
class Look:
    """What there is to see: markers of a dictionary and a size in metres, and their names.

    Without names a marker is called by its number. Raises MisuseError.
    """

    dictionary: str
    size: float
    names: Mapping[int, str] = field(default_factory=dict[int, str])
    calibration: str = ""
    fx: float = 0.0
    fy: float = 0.0
    cx: float = 0.0
    cy: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "dictionary", dictionary_of(self.dictionary))
        if not 0 < self.size < math.inf:
            raise MisuseError(
                f"vision: size is {self.size:g}; expected metres, the side of a marker's square"
            )
        if bool(self.calibration) == any((self.fx, self.fy, self.cx, self.cy)):
            raise MisuseError("vision: give calibration, a file, or fx, fy, cx and cy")
        if not self.calibration:
            self._given()

    def lens(self) -> Lens:
        """The camera's lens, read where it is in a file. Raises MisuseError."""
        return read_lens(self.calibration) if self.calibration else self._given()

    def _given(self) -> Lens:
        return Lens(self.fx, self.fy or self.fx, self.cx, self.cy)


def names_of(given: Mapping[str, Any] | None) -> Mapping[int, str]:
    """Names by marker number, from a table. Raises MisuseError."""
    found: dict[int, str] = {}
    for number, name in (given or {}).items():
        if not str(number).isdecimal() or not isinstance(name, str):
            raise MisuseError(
                f'vision: names has {number} = {name!r}; expected "23" = "kitchen", a marker\'s'
                " number and its name"
            )
        found[int(number)] = name
    return found


class Eye:
    """Sees markers in images. Raises MisuseError where a library or a file is missing."""

    def __init__(self, look: Look, count: Callable[[str], None]) -> None:
        self._look = look
        self._count = count
        self._detect = detector(look.dictionary)
        self._calibrated = look.lens()
        self._lens = self._calibrated

    def sees(self, image: Grey, mount: Mount) -> tuple[Sighting, ...]:
        """The markers of an image, as seen from the robot. Raises WrongSize."""
        height, width = image.shape
        if (self._lens.width, self._lens.height) != (width, height):
            self._lens = self._calibrated.at(width, height)
        seen = [self._sighting(found, mount) for found in self._detect(image)]
        return tuple([one for one in seen if one is not None])

    def _sighting(self, found: Found, mount: Mount) -> Sighting | None:
        names = self._look.names
        name = names.get(found.id) if names else str(found.id)
        if name is None:
            self._count("unknown markers")
            return None
        place = _place(found.corners, self._look.size, self._lens)
        if place is None:
            self._count("garbage")
            return None
        distance, angle = from_centre(*place, mount)
        return Sighting(name, distance, angle)


def _place(corners: NDArray[np.float64], size: float, lens: Lens) -> tuple[float, float] | None:
    """How far ahead and to the left of the camera a marker's middle is, in metres.

    By IPPE for squares (Collins and Bartoli 2014): of its two solutions the one that fits better.
    Their orientations may differ by much, their places hardly do.
    """
    cv2 = opencv()
    distortion = np.array(lens.distortion, np.float64) if lens.distortion else None
    # IPPE divides by zero where a marker is seen as an exact square; the iterative way does not.
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
            _, right, _, ahead = min(fits)
            return (ahead, -right) if ahead > 0 else None
    return None


def from_centre(ahead: float, left: float, mount: Mount) -> tuple[float, float]:
    """Distance (m) and angle (deg) from a robot's centre of what is so far ahead of its camera."""
    cos, sin = portable.cos(math.radians(mount.angle)), portable.sin(math.radians(mount.angle))
    x = mount.x + ahead * cos - left * sin
    y = mount.y + ahead * sin + left * cos
    return portable.hypot(x, y), math.degrees(portable.atan2(y, x))


__all__ = ["Eye", "Look", "WrongSize", "from_centre", "names_of"]
