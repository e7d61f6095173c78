"""Cameras of the browsers: the whole world, until a user moves the camera."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from viser import CameraHandle, ClientHandle, ViserServer

from minerva_bus.semantics.plane import Bounds
from minerva_services.geometry.picture import Picture
from minerva_services.views.layout import extremes

FIELD = math.radians(40.0)
_ELEVATION = math.radians(66.0)
_MARGIN = 1.06

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Position and target of a camera in metres."""

    position: Point
    look_at: Point


def bounds_of(picture: Picture) -> Bounds | None:
    """Bounds of everything that a picture shows; None if it is empty."""
    pairs = [extremes(item) for item in picture.items]
    boxes = [
        Bounds(float(x.min()), float(y.min()), float(x.max()), float(y.max()))
        for x, y in pairs
        if len(x)
    ]
    return reduce(Bounds.around, boxes) if boxes else None


def camera_pose(bounds: Bounds, height: float, aspect: float) -> CameraPose:
    """The nearest position from which a box on these bounds is completely visible."""
    width, depth = bounds.right - bounds.left, bounds.top - bounds.bottom
    middle = np.array([(bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2, 0.0])
    ahead = np.array([0.0, math.cos(_ELEVATION), -math.sin(_ELEVATION)])
    above = np.array([0.0, math.sin(_ELEVATION), math.cos(_ELEVATION)])
    tall, wide = math.tan(FIELD / 2), math.tan(FIELD / 2) * max(aspect, 0.1)
    distance = 0.1
    for x in (-width / 2, width / 2):
        for y in (-depth / 2, depth / 2):
            for z in (0.0, height):
                corner = np.array([x, y, z])
                # A corner is visible if its offset is within the field of view at its own depth.
                needed = max(abs(x) / wide, abs(float(corner @ above)) / tall)
                distance = max(distance, needed - float(corner @ ahead))
    place = middle - ahead * distance * _MARGIN
    return CameraPose(_point(place), _point(middle))


def _point(vector: np.ndarray) -> Point:
    x, y, z = vector.tolist()
    return x, y, z


_DEFAULT_ASPECT = 1.25
_TOLERANCE = 1e-3


class CameraControl:
    """Positions the cameras of all browsers, and adapts to changed windows.

    viser calls from several threads, while a camera follows its window in another one.
    """

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._bounds: Bounds | None = None
        self._height = 0.0
        self._aspects: dict[int, float] = {}
        self._places: dict[int, list[NDArray[np.float64]]] = {}
        server.initial_camera.fov = FIELD
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)

    def fit(self, bounds: Bounds, height: float) -> None:
        """Show a box of a height on these bounds, in metres."""
        with self._lock:
            self._bounds, self._height = bounds, height
            seen = camera_pose(bounds, height, _DEFAULT_ASPECT)
            self._begin(seen)
            self._server.initial_camera.far = max(1000.0, 10.0 * seen.position[2])
            for client in self._server.get_clients().values():
                self._look(client.client_id, client.camera)

    def _on_connect(self, client: ClientHandle) -> None:
        number, camera = client.client_id, client.camera
        with self._lock:
            self._places[number] = [camera.position]
            self._look(number, camera)
        camera.on_update(lambda moved: self._follow(number, moved))

    def _follow(self, number: int, camera: CameraHandle) -> None:
        """Reposition for a changed window shape, unless the user has moved the camera."""
        with self._lock:
            change = abs(camera.aspect - self._aspects.get(number, 0.0))
            if change > _TOLERANCE and self._is_still(number, camera):
                self._look(number, camera)

    def _is_still(self, number: int, camera: CameraHandle) -> bool:
        place = camera.position
        near = _TOLERANCE * max(1.0, float(np.linalg.norm(place)))
        # Positions that this program has set; at any other one, a user has moved the camera.
        return any(np.allclose(place, known, atol=near) for known in self._places.get(number, []))

    def _look(self, number: int, camera: CameraHandle) -> None:
        if self._bounds is None:
            return
        # Read once: the aspect for which the camera is positioned is the one to compare with.
        aspect = camera.aspect
        seen = camera_pose(self._bounds, self._height, aspect)
        self._aspects[number] = aspect
        self._places.setdefault(number, []).append(np.array(seen.position))
        # A browser that is still opening may apply the initial camera after this position.
        self._begin(seen)
        camera.position = seen.position
        camera.look_at = seen.look_at

    def _begin(self, seen: CameraPose) -> None:
        """Set the initial camera, which is also where a view reset leads."""
        self._server.initial_camera.position = seen.position
        self._server.initial_camera.look_at = seen.look_at

    def _on_disconnect(self, client: ClientHandle) -> None:
        with self._lock:
            self._aspects.pop(client.client_id, None)
            self._places.pop(client.client_id, None)
