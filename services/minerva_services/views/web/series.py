"""Charts of collected series beside the page's scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from viser import GuiApi, GuiUplotHandle, uplot

from minerva_bus.semantics.colors import OKABE_ITO
from minerva_bus.world.operator import CollectedSeries

_HEIGHT: Final = 140
_PADDING: Final = (14, 12, 0, 0)
"""Top, right, bottom and left, pixels: the greatest label of an axis is not cut off."""


class ChartFolder:
    """A small chart for each series, in a folder that is visible once there is one."""

    def __init__(self, gui: GuiApi) -> None:
        self._gui = gui
        self._folder = gui.add_folder("Collected", visible=False)
        self._charts: dict[str, GuiUplotHandle] = {}
        self._shown: tuple[CollectedSeries, ...] = ()

    def show(self, series: Sequence[CollectedSeries]) -> None:
        """Show series over the frames."""
        shown = tuple([each for each in series if each.frames])
        # Each change is sent to all browsers.
        if shown == self._shown:
            return
        self._shown = shown
        self._folder.visible = bool(shown)
        for gone in self._charts.keys() - {each.name for each in shown}:
            self._charts.pop(gone).remove()
        for number, each in enumerate(shown):
            data = np.array(each.frames, float), np.array(each.values, float)
            if each.name in self._charts:
                self._charts[each.name].data = data
            else:
                self._charts[each.name] = self._add(each, data, OKABE_ITO[number % len(OKABE_ITO)])

    def _add(
        self, series: CollectedSeries, data: tuple[np.ndarray, ...], color: str
    ) -> GuiUplotHandle:
        name = f"{series.name}, {series.unit}" if series.unit else series.name
        with self._folder:
            return self._gui.add_uplot(
                data,
                (
                    uplot.Series(label="frame"),
                    uplot.Series(label=name, stroke=color, width=2, spanGaps=False),
                ),
                title=name,
                scales={"x": uplot.Scale(time=False)},
                legend=uplot.Legend(show=False),
                height=_HEIGHT,
                padding=_PADDING,
            )
