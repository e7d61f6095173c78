"""A live world in a notebook: its picture, and buttons that run frames.

It needs `pip install 'minerva-bus[notebook]'`. Everything passes through the notebook's own
connection to its kernel, so it works in JupyterLab and in VS Code, also with a remote kernel, where
a page of the view `web` would need a port of its own.
"""

from __future__ import annotations

import sys
import time
from importlib import resources
from typing import TYPE_CHECKING, Any, Final
from weakref import ref

from minerva_bus.api.pictures import PictureSeries
from minerva_bus.collect.data_tables import needed
from minerva_bus.errors import MinervaError

if TYPE_CHECKING:
    from minerva_bus.api.live import Live

REFRESH_SECONDS: Final = 0.1
"""Shortest time between two pictures of a long step."""


class LiveDisplay:
    """Shows a live world by a widget, as its follower.

    Raises MisuseError without anywidget, and MinervaError if the world has no pictures.
    """

    def __init__(self, live: Live) -> None:
        # Widgets exist as long as their kernel, but a world ends with its last reference.
        self._live = ref(live)
        self._pictures: PictureSeries = live.views.pictures()
        self._refreshed = 0.0
        self.widget = _widget_class()()
        self.widget.on_msg(self._received)
        self.refresh()

    def mimebundle(self) -> dict[str, Any]:
        """The representations of the widget, by type."""
        bundle: Any = self.widget._repr_mimebundle_()
        # Data, or a pair of data and their metadata.
        return bundle if hasattr(bundle, "keys") else bundle[0]

    def between_frames(self) -> None:
        """Show a new picture, unless the last one is too recent."""
        if time.monotonic() - self._refreshed >= REFRESH_SECONDS:
            self.refresh()

    def refresh(self) -> None:
        """Show the current string."""
        live = self._live()
        if live is None:
            self._fail("the world has ended: no variable refers to it any more")
            return
        try:
            ended = live.ended
            frame, scene = live.frame, live.scene
            picture = live.views.drawn(self._pictures, scene, frame).svg
        except MinervaError as error:
            self._fail(str(error))
            return
        why = " · the world has ended" if ended else ""
        with self.widget.hold_sync():
            self.widget.picture = picture
            self.widget.status = f"{live.views.name} · frame {frame:,}{why}"
            self.widget.ended = ended
            if ended:
                self.widget.playing = False
        self._refreshed = time.monotonic()

    def _fail(self, problem: str) -> None:
        with self.widget.hold_sync():
            self.widget.problem = problem
            self.widget.ended = True
            self.widget.playing = False

    def _received(self, _: object, content: Any, buffers: object) -> None:
        """Run a frame for a button."""
        live = self._live()
        try:
            if live is not None:
                live.step()
        except MinervaError as error:
            self._fail(str(error))
        except KeyboardInterrupt:
            self._fail("interrupted")
        else:
            self.refresh()
        # The browser requests the next frame when this arrives.
        self.widget.send({"frame": 0})


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    # Not imported: without IPython this is none.
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def _widget_class() -> Any:
    anywidget = needed("anywidget", "notebook")
    traitlets = needed("traitlets", "notebook")

    def synced(trait: Any) -> Any:
        return trait.tag(sync=True)

    source = resources.files("minerva_notebook").joinpath("live_widget.js")
    members = {
        "_esm": source.read_text(encoding="utf-8"),
        "picture": synced(traitlets.Unicode()),
        "status": synced(traitlets.Unicode()),
        "problem": synced(traitlets.Unicode()),
        "playing": synced(traitlets.Bool(False)),
        "ended": synced(traitlets.Bool(False)),
    }
    return type("LiveWidget", (anywidget.AnyWidget,), members)
