"""The Foxglove view: a world in the 3D panel of Foxglove or Lichtblick, while it runs."""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING

from minerva_bus.errors import MisuseError
from minerva_bus.world.service_inputs import View, WorldInfo
from minerva_bus.world.services import Device
from minerva_services.options import check_port, check_rate, event_types, require
from minerva_services.views.overlay import Overlay
from minerva_services.views.page_address import listen

if TYPE_CHECKING:
    from foxglove.websocket import WebSocketServer

    from minerva_services.views.foxglove.scene import SceneChannels

FIRST_PORT = 8765
"""The port that Foxglove proposes when it opens a connection."""
_NANO = 1_000_000_000


class Foxglove(Device, draws=("ePicture",)):
    """Serves every world whose vocabulary declares forms to Foxglove, Lichtblick and other clients.

    Clients only read: they can neither send events nor pause the world.

    Args:
        host: the address to listen at; 0.0.0.0 accepts connections from other machines, and whoever
            connects sees the world.
        port: the port; 0: the first free one from 8765.
        rate: maximum views per second.
        draws: visual event types, comma-separated; their views are drawn over each other in this
            order.

    Raises MisuseError if foxglove-sdk is not installed and for invalid options.

    """

    interactive = True
    # So that a client that connects to a paused world receives a picture.
    pulse_every = 0.2

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        rate: float = 15.0,
        draws: str = "ePicture",
    ) -> None:
        require("foxglove", "foxglove", "foxglove-sdk", "foxglove")
        check_port("foxglove", port)
        check_rate("foxglove", rate)
        self.rate = rate
        self.draws = event_types("foxglove", draws)
        self._address = host, port
        self._subscribed = threading.Event()
        self._server: WebSocketServer | None = None
        self._views = 0

    def joined(self, world: WorldInfo) -> None:
        # Imported here because a view that is only checked need not load it.
        import foxglove

        from minerva_services.views.foxglove.scene import SceneChannels, SubscriptionListener

        self._dt = world.dt
        self._overlay = Overlay(world.vocabulary, self.draws)
        context = foxglove.Context()
        self._scene: SceneChannels = SceneChannels(context)
        host, wanted = self._address

        def start(port: int) -> WebSocketServer | None:
            try:
                return foxglove.start_server(
                    name=world.world,
                    host=host,
                    port=port,
                    capabilities=[foxglove.Capability.Time],
                    server_listener=SubscriptionListener(self._subscribed),
                    context=context,
                )
            except Exception as error:  # the library raises RuntimeError or its own class
                if "in use" in str(error):
                    return None
                raise MisuseError(f"foxglove: cannot listen at {host}:{port}: {error}") from None

        self._server = listen("foxglove", host, wanted, start, FIRST_PORT)
        sys.stdout.write(f"ws://{host}:{self._server.port}\n")
        sys.stdout.flush()

    def show(self, view: View) -> None:
        self._overlay.add(view)
        self._views += 1
        self._send()

    def pulse(self) -> None:
        if self._subscribed.is_set():
            self._send()

    def report(self) -> Mapping[str, bool | int | float | str]:
        return {"foxglove_views": self._views}

    def close(self) -> None:
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _send(self) -> None:
        if self._server is None or self._overlay.frame < 0:
            return
        if self._subscribed.is_set():
            self._subscribed.clear()
            self._scene.forget()
        time = round(self._overlay.frame * self._dt * _NANO)
        self._server.broadcast_time(time)
        self._scene.show(self._overlay.picture(), time)
