"""The Rerun view: a world as a file for the Rerun viewer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, check_file, text_of_path
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types, require
from minerva_services.views.overlay import Overlay
from minerva_services.views.svg.files import prepare_folder

if TYPE_CHECKING:
    from minerva_services.views.rerun.rrd_file import RrdFile


class RerunView(Device, draws=("ePicture",)):
    """Writes every world whose vocabulary declares forms to an .rrd file.

    The file has the timelines `frame` and `time`, in seconds of the world.

    Args:
        path: the output file; its folder is created if missing.
        every: frames between views.
        draws: visual event types, comma-separated; their views are drawn over each other in this
            order.

    Raises MisuseError if rerun-sdk is not installed and for invalid options.

    """

    # The file has every view, as a video does.
    coupled = True

    def __init__(self, path: str = "minerva.rrd", every: int = 1, draws: str = "ePicture") -> None:
        require("rerun", "rerun", "rerun-sdk", "rerun")
        if every < 1:
            raise MisuseError(f"rerun: every is {every}; expected a number of frames from 1")
        self.when = f"each {every} frames"
        self.draws = event_types("rerun", draws)
        self._path = Path(path)
        check_ending(self._path, (".rrd",), "rerun")
        self.writes = (self._path,)
        self._file: RrdFile | None = None
        check_file(self._path, "rerun")

    def joined(self, world: WorldInfo) -> None:
        # Imported here because Rerun takes a second to load.
        from minerva_services.views.rerun.rrd_file import RrdFile

        self._dt = world.dt
        self._overlay = Overlay(world, self.draws, space=True)
        prepare_folder(self._path)
        self._file = RrdFile(world.world, self._path)

    def show(self, view: View) -> None:
        self._overlay.add(view)
        if self._file is not None and self._overlay.is_complete:
            self._file.show(self._overlay.picture(), view.frame, view.frame * self._dt)

    def report(self) -> Mapping[str, bool | int | float | str]:
        return {"recording": text_of_path(self._path)} if self._file is not None else {}

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
