"""The settings of a run's record."""

from __future__ import annotations

from typing import Any

from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.launch.table import Table
from minerva_bus.settings.kinds import TEXT, TOPICS
from minerva_bus.settings.tables import RecordSettings


def read_recording(top: Table) -> RecordSettings:
    """Where and how a run is recorded; `record` in [world] is a file or a table.

    Raises WorldFileError, and MisuseError for topics without a record.
    """
    world, defaults = top.table("world"), RecordSettings()
    nested: Any = world.data.get("record")
    if isinstance(nested, dict):
        table = world.table("record")
        defaults = RecordSettings(table.get("file", TEXT, ""), table.get("topics", TOPICS, ()))
        table.done()
        del world.data["record"]
    settings = top.read(RecordSettings, defaults)
    if settings.path and not settings.path.endswith(".mcap"):
        raise WorldFileError(f"a record is a file .mcap, not {settings.path!r}")
    if settings.topics and not settings.path:
        raise MisuseError("topics are recorded in a record: name one, --record FILE.mcap")
    return settings
