"""The page device: a world in three dimensions in the browser, and people who take part in it."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.semantics.picture import Lists, Picture
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types

if TYPE_CHECKING:
    from minerva_services.views.web.desk import Desk
    from minerva_services.views.web.panel import Panel
    from minerva_services.views.web.serving import Server
    from minerva_services.views.web.stage import Stage

_LAST_WORDS = 0.12
"""Seconds in which the last words reach the browsers."""


class Web(Device, draws=("ePicture",)):
    """Shows every world whose vocabulary declares forms, on a page that all browsers share.

    Args:
        host: the address to listen at; 0.0.0.0 lets others than this machine in, and whoever
            has the token may give orders.
        port: where to listen; 0: the first free port from 8080.
        rate: views a second, at most.
        draws: visual event types, separated by commas; their views lie over one another in this
            order.
        click: the event type that a click on a text sends; "": the first that people may send
            and whose only datum is a text.
        names: host names by which browsers may reach it beside its address, separated by commas:
            a proxy's, for example.
        shadows: whether things cast shadows; without, slow machines draw many times as fast.

    Raises MisuseError where viser is not installed and for options that cannot be.

    """

    interactive = True

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        rate: float = 25.0,
        draws: str = "ePicture",
        click: str = "",
        shadows: bool = True,
        names: str = "",
    ) -> None:
        if importlib.util.find_spec("viser") is None:
            raise MisuseError("web: a page needs viser: pip install 'minerva-bus[web]'")
        if not 0 <= port <= 65535:
            raise MisuseError(f"web: port is {port}; expected 1 to 65535, or 0 for a free one")
        if not 0 < rate <= 1000:
            raise MisuseError(f"web: rate is {rate:g}; expected up to 1000 views a second")
        self.rate = rate
        self.draws = event_types("web", draws)
        self._host = host
        self._port = port
        self._click = click
        self._shadows = shadows
        self._names = [name.strip() for name in names.split(",") if name.strip()]
        self._server: Server | None = None
        self._lists: dict[str, Lists] = {}
        self._pictures: dict[str, Picture] = {}
        self._skeletons: dict[str, Scene] = {}
        self._ended = False
        self._views = 0
        self._spent = 0.0

    def joined(self, world: WorldInfo) -> None:
        from minerva_services.views.web.desk import Desk
        from minerva_services.views.web.panel import Panel
        from minerva_services.views.web.serving import serve, url
        from minerva_services.views.web.stage import Stage

        self._check_click(world)
        self._lists = {one: Lists(world.vocabulary) for one in self.draws}
        self._server = server = serve(self._host, self._port, self._names)
        self._stage: Stage = Stage(server, shadows=self._shadows)
        self._desk: Desk = Desk(world, self._stage, self._click)
        self._panel: Panel = Panel(server, world.world, world.vocabulary, self._desk)
        self._desk.open(self._panel)

        @server.scene.on_click()
        def _(event: Any) -> None:
            found = self._stage.clicked(event.ray_origin, event.ray_direction)
            if found is not None:
                self._desk.click(found)

        sys.stdout.write(f"{url(server)}\n")
        sys.stdout.flush()

    def show(self, view: View) -> None:
        began = time.perf_counter()
        self._pictures[view.event_type] = self._lists[view.event_type].picture(
            view.skeleton, view.parts
        )
        items = [item for one in self.draws for item in self._items(one)]
        self._stage.show(Picture(tuple(items)))
        self._meet(view)
        self._views += 1
        self._spent += time.perf_counter() - began

    def report(self) -> Mapping[str, bool | int | float | str]:
        self._ended = True
        mean = self._spent / self._views if self._views else 0.0
        return {"page_views": self._views, "page_ms_per_view": round(1000 * mean, 3)}

    def close(self) -> None:
        if self._server is None:
            return
        from minerva_services.views.web.serving import stop

        self._desk.close()
        why = "the world has ended" if self._ended else "this page has left the world"
        self._panel.end(why)
        self._server.flush()
        time.sleep(_LAST_WORDS)
        stop(self._server)
        self._server = None

    def _items(self, event_type: str) -> tuple[Any, ...]:
        picture = self._pictures.get(event_type)
        return picture.items if picture is not None else ()

    def _meet(self, view: View) -> None:
        """Tell the desk who there is, where that has changed; populations have no names here."""
        if self._skeletons.get(view.event_type) is view.skeleton:
            return
        self._skeletons[view.event_type] = view.skeleton
        self._desk.meet(
            {
                one.id: one.symbol
                for skeleton in self._skeletons.values()
                for one in agents(skeleton)
            }
        )

    def _check_click(self, world: WorldInfo) -> None:
        if not self._click:
            return
        declared = world.vocabulary.events.get(self._click)
        kinds = [one.type.kind for one in declared.fields.all] if declared is not None else []
        if kinds != ["text"]:
            raise MisuseError(
                f"web: click is {self._click!r}; expected an event type of {world.world} whose"
                " only datum is a text"
            )
