"""Detection of a dictionary's markers and their corners in an image."""

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
class DetectedMarker:
    """A marker in an image: its number, and its corners clockwise in pixels, (4, 2)."""

    id: int
    corners: NDArray[np.float64]


Detect: TypeAlias = Callable[[Grey], list[DetectedMarker]]


def dictionary_of(name: str) -> str:
    """OpenCV's name of a dictionary; also accepts `tag36h11`. Raises MisuseError."""
    known = {candidate.lower(): candidate for candidate in DICTIONARIES}
    short = name.lower().removeprefix("dict_")
    # AprilTag's own names, such as tag36h11, are accepted as well.
    match = known.get(short) or known.get(f"april{short.replace('tag', 'tag_', 1)}")
    if match is None:
        there = f"4X4_50 to 7X7_1000, {', '.join(DICTIONARIES[16:])}"
        hint = nearest(name, list(DICTIONARIES), f"expected that of the markers: {there}")
        raise MisuseError(f"vision: unknown dictionary {name!r}{hint}")
    return match


def detector(dictionary: str) -> Detect:
    """A detector for the markers of one dictionary. Raises MisuseError without OpenCV."""
    aruco: Any = opencv().aruco
    parameters = aruco.DetectorParameters()
    # This method finds more markers than the exact one for AprilTags; `refined` corrects its
    # corners.
    parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    words = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{dictionary}"))
    aruco_detector = aruco.ArucoDetector(words, parameters)

    def detect(image: Grey) -> list[DetectedMarker]:
        corners, ids, _ = aruco_detector.detectMarkers(image)
        if ids is None:
            return []
        pairs = zip(ids.ravel().tolist(), corners, strict=True)
        markers = [
            DetectedMarker(id, refined(image, quad.reshape(4, 2).astype(np.float64)))
            for id, quad in pairs
        ]
        return sorted(markers, key=lambda marker: (marker.id, *marker.corners[0].tolist()))

    return detect
