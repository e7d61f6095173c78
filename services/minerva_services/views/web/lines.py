"""Lines on the page, solid or dashed."""

from __future__ import annotations

import numpy as np
from viser import LineSegmentsHandle, SceneApi

from minerva_bus.semantics.colors import rgb
from minerva_bus.semantics.picture import Polyline
from minerva_services.views.line_segments import segments


class LineNodes:
    """The nodes of all lines."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._shown: dict[str, tuple[Polyline, LineSegmentsHandle]] = {}

    def show(self, lines: list[Polyline]) -> None:
        """Show exactly these."""
        names: dict[str, Polyline] = {}
        counts: dict[str, int] = {}
        for line in lines:
            counts[line.owner] = counts.get(line.owner, 0) + 1
            if len(line.points) > 1:
                names[f"/lines/{line.owner or 'world'}/{counts[line.owner]}"] = line
        for name in [name for name in self._shown if name not in names]:
            self._shown.pop(name)[1].remove()
        for name, line in names.items():
            self._show(name, line)

    def _show(self, name: str, line: Polyline) -> None:
        before, node = self._shown.get(name, (None, None))
        if before is line:
            return
        if node is not None and before is not None and before.form == line.form:
            node.points = segments(line)
        else:
            node = self._scene.add_line_segments(
                name, segments(line), np.array(rgb(line.form.color)), thickness=line.form.width
            )
        self._shown[name] = line, node
