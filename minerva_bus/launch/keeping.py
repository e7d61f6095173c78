"""What a world file and a command line say of a run's record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.launch.table import Table
from minerva_bus.wire.keys import checked_name

ALL: Final = "*"


@dataclass(frozen=True, slots=True)
class RecordSettings:
    """Where a run is recorded ("": nowhere), and how often it reaches the disk, seconds.

    `durable`: a frame counts once it is on the disk. `topics` are the sensor topics that are
    recorded, too; `*` means all.
    """

    path: str = ""
    flush: float = 2.0
    durable: bool = False
    topics: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RecordOverrides:
    """What a command line says of the record; None and "" leave it to the world file."""

    path: str = ""
    flush: float | None = None
    durable: bool | None = None
    topics: str = ""


def read_recording(world: Table, given: RecordOverrides) -> RecordSettings:
    """Where and how a run is recorded, of the table [world]; `record` is a name or a table.

    Raises WorldFileError, and MisuseError for what the command line says.
    """
    plain = RecordSettings()
    if isinstance(world.data.get("record"), dict):
        table = world.table("record")
        path, topics = table.text("file"), _own_topics(table)
        table.done()
    else:
        path, topics = world.text("record"), ()
    flush = world.number("flush", plain.flush, 0.0)
    if given.flush is not None:
        if not 0 <= given.flush < float("inf"):
            raise MisuseError(f"--flush must be a number of seconds from 0, not {given.flush:g}")
        flush = given.flush
    durable = world.truth("durable", plain.durable)
    settings = RecordSettings(
        given.path or path,
        flush,
        durable if given.durable is None else given.durable,
        _given_topics(given.topics) if given.topics else topics,
    )
    if settings.path and not settings.path.endswith(".mcap"):
        raise WorldFileError(f"a record is a file .mcap, not {settings.path!r}")
    if settings.topics and not settings.path:
        raise MisuseError("topics are recorded in a record: name one, --record FILE.mcap")
    return settings


def _own_topics(table: Table) -> tuple[str, ...]:
    if isinstance(table.data.get("topics"), bool):
        return (ALL,) if table.truth("topics", False) else ()
    topics = table.texts("topics")
    for one in topics:
        try:
            _checked(one)
        except MisuseError as error:
            table.wrong("topics", f"must be true or a list of topics: {error}")
    return topics


def _given_topics(words: str) -> tuple[str, ...]:
    if words in (ALL, "all"):
        return (ALL,)
    return tuple([_checked(one.strip()) for one in words.split(",")])


def _checked(topic: str) -> str:
    return checked_name(topic, "a topic")
