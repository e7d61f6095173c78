"""The page device: a world in 3D in the browser, and users who take part in it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import check_port, check_rate, event_types, names_in, require
from minerva_services.views.overlay import Overlay
from minerva_services.views.page_access import announce
from minerva_services.views.window.order_types import check_named
from minerva_services.web_access import forget_token

if TYPE_CHECKING:
    from minerva_services.views.web.controller import PageController
    from minerva_services.views.web.page_scene import PageScene
    from minerva_services.views.web.panel import Panel
    from minerva_services.views.web.serving import PageServer

_FLUSH_SECONDS = 0.12
"""Time for the last messages to reach the browsers."""


@dataclass(frozen=True, slots=True)
class _Address:
    """Where the page listens, and additional host names by which browsers reach it."""

    host: str
    port: int
    names: tuple[str, ...]


class Web(Device, draws=("ePicture",)):
    """Shows every world whose vocabulary declares forms, on a page shared by all browsers.

    Args:
        host: the address to listen at; 0.0.0.0 accepts connections from other machines, and
            whoever has the token may send orders.
        port: the port; 0: the first free one from 8080.
        rate: maximum views per second.
        draws: visual event types, comma-separated; their views are drawn over each other in this
            order.
        click: the event type sent by a click on a text; "": the first that users may send and
            whose only datum is a text.
        names: additional host names of the page, comma-separated: a proxy's, for example.
        person: the name under which the page gives orders; "": that of its process.
        shadows: whether objects cast shadows; without a graphics card, they take most of the time.

    Raises MisuseError if viser is not installed and for invalid options.

    """

    interactive = True

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        rate: float = 25.0,
        draws: str = "ePicture",
        click: str = "",
        shadows: bool = False,
        names: str = "",
        person: str = "",
    ) -> None:
        require("web", "viser", "viser", "web")
        check_port("web", port)
        check_rate("web", rate)
        self.when = f"at {rate:g} Hz"
        self.draws = event_types("web", draws)
        self._address = _Address(host, port, names_in(names))
        self._click = click
        self._person = person
        self._shadows = shadows
        self._server: PageServer | None = None
        self._skeletons: dict[str, Scene] = {}
        self._views = 0
        self._seconds = 0.0

    def check(self, world: WorldInfo) -> None:
        check_named("web", world.vocabulary, self._click)

    def joined(self, world: WorldInfo) -> None:
        # Imported here because viser takes long to load.
        from minerva_services.views.web.controller import PageController
        from minerva_services.views.web.page_scene import Eye, PageScene
        from minerva_services.views.web.panel import Panel
        from minerva_services.views.web.serving import serve, url

        self.check(world)
        self._ended = world.ended
        self._overlay = Overlay(world, self.draws, space=True)
        address = self._address
        self._server = server = serve(address.host, address.port, address.names, world.world)
        self._scene: PageScene = PageScene(server, shadows=self._shadows)
        self._controller: PageController = PageController(
            world, self._scene, self._click, self._person
        )
        self._panel: Panel = Panel(server, world.world, world.vocabulary, self._controller)
        self._controller.open(self._panel)

        @server.scene.on_click()
        def _(event: Any) -> None:
            eye = Eye.of(event.client.camera)
            hit = self._scene.clicked(event.ray_origin, event.ray_direction, eye)
            if hit is not None:
                self._controller.click(hit)

        announce(world, url(server))

    def show(self, view: View) -> None:
        began = time.perf_counter()
        self._overlay.add(view)
        picture = self._overlay.picture()
        self._scene.show(picture)
        self._panel.show_legend(picture.legend)
        self._update_agents(view)
        self._views += 1
        self._seconds += time.perf_counter() - began

    def report(self) -> Mapping[str, bool | int | float | str]:
        mean = self._seconds / self._views if self._views else 0.0
        return {"page_views": self._views, "page_ms_per_view": round(1000 * mean, 3)}

    def close(self) -> None:
        if self._server is None:
            return
        from minerva_services.views.web.serving import stop

        self._controller.close()
        why = "the world has ended" if self._ended() else "this page has left the world"
        self._panel.end(why)
        self._server.flush()
        time.sleep(_FLUSH_SECONDS)
        stop(self._server)
        # Until then, a page that was admitted connects again if this process is restarted.
        if self._ended():
            forget_token(self._server.access.port)
        self._server = None

    def _update_agents(self, view: View) -> None:
        """Pass the agents to the controller after changes; populations have no names here."""
        if self._skeletons.get(view.event_type) is view.skeleton:
            return
        self._skeletons[view.event_type] = view.skeleton
        self._controller.set_agents(
            {
                agent.id: agent.symbol
                for skeleton in self._skeletons.values()
                for agent in agents(skeleton)
            }
        )
