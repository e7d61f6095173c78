"""What each browser looks at: the whole world, until a person moves the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from viser import CameraHandle, ClientHandle, ViserServer

from minerva_bus.semantics.bounds import Bounds
from minerva_services.views.web.camera import FIELD, Outlook, outlook

_USUAL = 1.25
_STILL = 1e-3


class Sight:
    """Points the cameras of all browsers, also of those whose windows change."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._bounds: Bounds | None = None
        self._height = 0.0
        self._aspects: dict[int, float] = {}
        self._places: dict[int, list[NDArray[np.float64]]] = {}
        server.initial_camera.fov = FIELD
        server.on_client_connect(self._meet)
        server.on_client_disconnect(self._forget)

    def fit(self, bounds: Bounds, height: float) -> None:
        """Look at a box of a height on a rectangle, metres."""
        self._bounds, self._height = bounds, height
        seen = outlook(bounds, height, _USUAL)
        self._begin(seen)
        self._server.initial_camera.far = max(1000.0, 10.0 * seen.position[2])
        for client in self._server.get_clients().values():
            self._look(client.client_id, client.camera)

    def _meet(self, client: ClientHandle) -> None:
        number, camera = client.client_id, client.camera
        self._places[number] = [camera.position]
        self._look(number, camera)
        camera.on_update(lambda moved: self._follow(number, moved))

    def _follow(self, number: int, camera: CameraHandle) -> None:
        """Look anew from a window of another shape, if nobody has moved the camera."""
        if abs(camera.aspect - self._aspects.get(number, 0.0)) > _STILL and self._is_still(
            number, camera
        ):
            self._look(number, camera)

    def _is_still(self, number: int, camera: CameraHandle) -> bool:
        place = camera.position
        near = _STILL * max(1.0, float(np.linalg.norm(place)))
        return any(np.allclose(place, one, atol=near) for one in self._places.get(number, []))

    def _look(self, number: int, camera: CameraHandle) -> None:
        if self._bounds is None:
            return
        seen = outlook(self._bounds, self._height, camera.aspect)
        self._aspects[number] = camera.aspect
        self._places.setdefault(number, []).append(np.array(seen.position))
        # A browser that is still opening may go where cameras begin after it was sent elsewhere.
        self._begin(seen)
        camera.position = seen.position
        camera.look_at = seen.look_at

    def _begin(self, seen: Outlook) -> None:
        """Let cameras begin there, and come back there when a person resets the view."""
        self._server.initial_camera.position = seen.position
        self._server.initial_camera.look_at = seen.look_at

    def _forget(self, client: ClientHandle) -> None:
        self._aspects.pop(client.client_id, None)
        self._places.pop(client.client_id, None)
