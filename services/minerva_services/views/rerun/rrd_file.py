"""A recording of pictures, in which each entity is written only when it changes."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path
from typing import Final

import rerun as rr

from minerva_bus.errors import MisuseError
from minerva_bus.files import MARK, target_of
from minerva_bus.semantics.picture import Picture, Tiles
from minerva_services.views.floor_parts import Floor, named_floors
from minerva_services.views.rerun.archetypes import ENTITIES, archetypes, floor_archetypes

FRAME: Final = "frame"
TIME: Final = "time"
_END: Final = b"FOOT"
_END_BYTES: Final = 12
"""Mark in the last bytes of a complete file."""


def open_stream(world: str, path: Path, advice: str) -> rr.RecordingStream:
    """A new .rrd file with the timelines `frame` and `time`, to which entities are logged.

    Raises MisuseError, with the advice, if it cannot be written.
    """
    # The id is the part of the file's header by which a later run recognises the file. Its
    # random part keeps two recordings apart in a viewer.
    stream = rr.RecordingStream(
        world, recording_id=f"{MARK}, {secrets.token_hex(8)}", send_properties=False
    )
    path = target_of(path)
    try:
        if path.is_file():
            # The library writes into the file: through another name of the same file, it would
            # destroy that, such as the record that is being exported.
            path.unlink()
        stream.save(path)
    except Exception as error:  # the library raises RuntimeError
        raise MisuseError(f"rerun: cannot write {path}: {error}; {advice}") from None
    # The world has a time of its own; with the time of writing, no two files would be the same.
    stream.set_log_time_enabled(False)
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    return stream


def close_stream(stream: rr.RecordingStream, path: Path) -> None:
    """Finish an .rrd file. Raises MisuseError if it could not be written to its end."""
    problem = "its end could not be written"
    try:
        stream.flush()
    except Exception as error:  # the library raises RuntimeError
        problem = str(error)
    stream.disconnect()
    # If the end fails, the library only logs it.
    with contextlib.suppress(OSError), path.open("rb") as file:
        file.seek(-_END_BYTES, os.SEEK_END)
        if _END in file.read():
            return
    raise MisuseError(f"rerun: cannot write {path}: {problem}; is the disk full?")


class RrdFile:
    """Writes pictures to an .rrd file. Raises MisuseError if it cannot be written."""

    def __init__(self, world: str, path: Path) -> None:
        self._path = path
        self._stream = open_stream(world, path, "set path")
        self._floors: dict[str, tuple[Floor, frozenset[str]]] = {}
        self._shown: frozenset[str] = frozenset()

    def show(self, picture: Picture, frame: int, time: float) -> None:
        """Write the picture of a frame at a world time in seconds."""
        self._stream.set_time(FRAME, sequence=frame)
        self._stream.set_time(TIME, duration=time)
        self._show_floors(named_floors(picture.of(Tiles)))
        shown = archetypes(picture)
        for path in ENTITIES:
            if path in shown:
                self._stream.log(path, shown[path])
            elif path in self._shown:
                self._clear(path)
        self._shown = frozenset(shown)

    def close(self) -> None:
        """Finish the file."""
        close_stream(self._stream, self._path)

    def _show_floors(self, floors: dict[str, Floor]) -> None:
        for name in sorted(self._floors.keys() - floors.keys()):
            for path in sorted(self._floors.pop(name)[1]):
                self._clear(path)
        for name, floor in floors.items():
            before, paths = self._floors.get(name, (None, frozenset[str]()))
            if before is not None and before.is_same(floor):
                continue
            shown = floor_archetypes(f"world{name}", floor)
            for path in sorted(paths - shown.keys()):
                self._clear(path)
            for path, archetype in shown.items():
                self._stream.log(path, archetype)
            self._floors[name] = floor, frozenset(shown)

    def _clear(self, path: str) -> None:
        self._stream.log(path, rr.Clear(recursive=False))
