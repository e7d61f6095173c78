"""A view in a window, in pictures or in a video: everything except the drawing."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types, names_in, takes_options
from minerva_services.views.fates import OrderEntry
from minerva_services.views.window.composer import Composer
from minerva_services.views.window.controls import WindowControls
from minerva_services.views.window.monitor import WorldMonitor
from minerva_services.views.window.options import Medium, WindowOptions
from minerva_services.views.window.order_types import check_named
from minerva_services.views.window.outputs import Output, PictureOutput, VideoOutput
from minerva_services.views.window.painter import Painter, Pixels
from minerva_services.views.window.screen import quiet


class WindowDevice(Device):
    """Base of views that a `Painter` draws; their common options are those of `WindowOptions`.

    A window is interactive: keys and mouse act on the world, and closing it leaves the world.
    Pictures are written by an observer, a video by a coupled device that receives every view.
    """

    topics = ("scan",)
    service: ClassVar[str]
    """Name of the view and of the extra with its libraries."""
    needs: ClassVar[tuple[str, ...]] = ("pygame",)
    """Modules that the painter imports."""
    space: ClassVar[bool] = False
    """Whether it draws copies of solids in space instead of their outlines."""

    @takes_options(WindowOptions, without=("service", "needs", "environment"))
    def __init__(self, draws: str = "ePicture", **window: Any) -> None:
        self.options = options = WindowOptions(self.service, self.needs, **window)
        self.draws = event_types(options.service, draws)
        self.when = options.when
        self.concerns = names_in(options.follow)
        self.writes = tuple([Path(file) for file in (options.path, options.video) if file])
        self.interactive = options.medium is Medium.WINDOW
        self.coupled = options.medium is Medium.VIDEO  # pyright: ignore
        self.pulse_every = 1 / 30 if self.interactive else 0.0
        self._painter: Painter | None = None
        self._monitor: WorldMonitor | None = None
        self._output: Output | None = None
        self._changed = True
        self._displayed: tuple[tuple[str, ...], tuple[OrderEntry, ...]] = (), ()

    @abstractmethod
    def painter(self) -> Painter:
        """The geometric system that draws, created when the world is joined."""

    # --- called by the world ---

    def check(self, world: WorldInfo) -> None:
        options = self.options
        check_named(options.service, world.vocabulary, options.click, options.slide)

    def joined(self, world: WorldInfo) -> None:
        """Open the window or file. Raises MisuseError."""
        options = self.options
        # Wrong options must fail before a window opens.
        self.check(world)
        self._composer = Composer(world, self.draws, self.space)
        self.controls = WindowControls(
            world.vocabulary, options.click, options.slide, options.follow
        )
        quiet()
        self._painter = painter = self.painter()
        if options.medium is Medium.WINDOW:
            from minerva_services.views.window.events import WindowInput

            painter.open(world.world, options.size)
            operator = world.operator.named(options.person)
            self._monitor = WorldMonitor(operator, world.vocabulary)
            self._input = WindowInput(self.controls, painter, self._monitor.do)
            return
        painter.offscreen(options.size)
        if options.medium is Medium.PICTURES:
            self._output = PictureOutput(options)
        else:
            self._output = VideoOutput(options, world.dt, options.asks_every)

    def heard(self, reading: Reading, frame: int) -> None:
        self._composer.add_reading(reading, frame)

    def show(self, view: View) -> None:
        if self._painter is None:
            raise MisuseError(f"{self.options.service}: a view arrived before the world was joined")
        self._composer.add_view(view)
        self._changed = True
        if self._output is not None and self._composer.is_complete:
            self._output.add(view.frame, self._drawn)

    def pulse(self) -> None:
        """Process keys and mouse, and redraw after changes."""
        if self._monitor is None:
            return
        # Queued actions are newer than the status, which would undo their display.
        if self._monitor.status is not None and not self._monitor.busy:
            self.controls.update(self._monitor.status)
        touched = self._input.process(self._composer.picture)
        displayed = self._text(), self._monitor.orders
        if touched or self._changed or displayed != self._displayed:
            self._displayed = displayed
            self._draw()

    def leaves(self) -> bool:
        return self._monitor is not None and self._input.closed

    def report(self) -> Mapping[str, bool | int | float | str]:
        return self._output.report() if self._output is not None else {}

    def close(self) -> None:
        """Close everything; further calls have no effect."""
        painter, self._painter = self._painter, None
        if painter is None:
            return
        if self._monitor is not None:
            self._monitor.close()
        painter.close()
        if self._output is not None:
            self._output.close()

    # --- drawing ---

    def _drawn(self) -> Pixels:
        self._draw()
        assert self._painter is not None
        return self._painter.pixels()

    def _draw(self) -> None:
        self._changed = False
        if self._painter is not None:
            monitor = self._monitor
            orders = monitor.orders if monitor is not None else ()
            sight = self._composer.compose(
                self.controls, self._text(), orders, keys=monitor is not None
            )
            self._painter.draw(sight)

    def _text(self) -> tuple[str, str, str]:
        status = self._monitor.status if self._monitor is not None else None
        notice = self._monitor.notice if self._monitor is not None else ""
        report = self._monitor.report if self._monitor is not None else ""
        return self._composer.text(self.controls, status, notice, report)
