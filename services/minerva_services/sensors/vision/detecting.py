"""Which markers of a dictionary are in an image, and where their corners are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_services.sensors.vision.edges import refined
from minerva_services.sensors.vision.library import opencv

Grey: TypeAlias = NDArray[np.uint8]
"""An image as rows of pixels, shape (height, width)."""

DICTIONARIES: Final = (
    *(f"{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    *("ARUCO_ORIGINAL", "ARUCO_MIP_36h12"),
    *("APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A marker in an image: its number, and its corners clockwise as seen, (4, 2) in pixels."""

    id: int
    corners: NDArray[np.float64]


Detect: TypeAlias = Callable[[Grey], list[Found]]


def dictionary_of(name: str) -> str:
    """The name of a dictionary as OpenCV has it, `tag36h11` also. Raises MisuseError."""
    known = {one.lower(): one for one in DICTIONARIES}
    short = name.lower().removeprefix("dict_")
    found = known.get(short) or known.get(f"april{short.replace('tag', 'tag_', 1)}")
    if found is None:
        raise MisuseError(
            f"vision: no dictionary {name!r}{nearest(name, list(DICTIONARIES))}; expected the one"
            f" that the markers are of: 4X4_50 to 7X7_1000, {', '.join(DICTIONARIES[16:])}"
        )
    return found


def detector(dictionary: str) -> Detect:
    """A detector of the markers of one dictionary. Raises MisuseError without the library."""
    aruco: Any = opencv().aruco
    parameters = aruco.DetectorParameters()
    parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    words = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{dictionary}"))
    found_by = aruco.ArucoDetector(words, parameters)

    def detect(image: Grey) -> list[Found]:
        corners, ids, _ = found_by.detectMarkers(image)
        if ids is None:
            return []
        pairs = zip(ids.ravel().tolist(), corners, strict=True)
        found = [
            Found(one, refined(image, quad.reshape(4, 2).astype(np.float64))) for one, quad in pairs
        ]
        return sorted(found, key=lambda one: (one.id, *one.corners[0].tolist()))

    return detect
