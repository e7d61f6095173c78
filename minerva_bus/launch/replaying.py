"""Replays a record in any view: `minerva replay FILE --view svg`.

Bus, views and launcher are those of any world; only the coordinator reads its frames from a
record. The world file provides the code of agents, which is needed for their views.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import MinervaError, MisuseError, ProtocolError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.description import World
from minerva_bus.frame.phases import Phase
from minerva_bus.frame.replaying import RecordedSource
from minerva_bus.launch.resuming import (
    WorldSource,
    completed,
    damage_of,
    differing_vocabulary,
    kinds_in,
    no_frame,
    read_source,
)
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.path_text import text_of_path
from minerva_bus.runtime.control import COMMANDS
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.operated import Operated
from minerva_bus.runtime.watchers import Watchers
from minerva_bus.runtime.world_status import status_of
from minerva_bus.settings.overrides import Overrides
from minerva_bus.wire.keys import checked_name
from minerva_bus.wire.plain import as_int
from minerva_bus.wire.status import plain_status
from minerva_bus.wording import frames_up_to
from minerva_bus.world.kinds import Kinds
from minerva_bus.world.operator import FileStatus

if TYPE_CHECKING:
    from minerva_bus.log.comparison import Difference
    from minerva_bus.log.description import Description
    from minerva_bus.log.explanation import Explanation
    from minerva_bus.log.observation import Observation
    from minerva_bus.log.reader import Record


CODE: Final = Overrides(only_code=True)
"""Recorded events take the place of the services, whose backends may be gone."""


@dataclass(frozen=True, slots=True)
class Replay:
    """A record to be replayed: its views as a world file, and the factory of its coordinator."""

    file: WorldFile
    coordinator: Callable[..., Coordinator]


def replay_coordinator(
    path: Path, kinds: Kinds, stay: bool, world: World, watchers: Watchers, **options: Any
) -> Coordinator:
    """A coordinator that takes its frames from a record. Raises RecordError."""
    from minerva_bus.log.cursor import Cursor
    from minerva_bus.log.reader import Record

    def listening(endpoint: str) -> None:
        watchers.listening(endpoint)
        coordinator.inbox.put(s.Begin())  # There may be no view to wait for.

    def seek(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
        frame, algorithm = as_int(asked.get("frame"), "the frame"), running.algorithm
        if frame > cursor.end:
            raise ProtocolError(f"the record ends before frame {cursor.end}, not {frame}")
        if algorithm.phase is not Phase.READY:
            raise ProtocolError(f"not now: {algorithm.phase.value}")
        running.runner.handle(s.Seek(frame))
        return {"frame": algorithm.frame}

    def status(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
        now = status_of(running, as_int(asked.get("since", 0), "since"))
        return {"status": plain_status(replace(now, end=cursor.end))}

    cursor = Cursor(Record(path))
    cursor.seek(world.past.frame)
    source = partial(RecordedSource, cursor=cursor, kinds=kinds, stay=stay)
    options["algorithm"] = FrameAlgorithm(world, source)
    # Recorded frames are fixed, so commands that would change them are rejected.
    commands = {**COMMANDS, **dict.fromkeys(("pub", "order", "restart"), _reject), "seek": seek}
    commands["status"] = status
    record = FileStatus("record", text_of_path(path.absolute()))
    watching = replace(watchers, listening=listening, files=lambda: (record,))
    coordinator = Coordinator(world, watching, commands=commands, **options)
    return coordinator


def _reject(_: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    raise ProtocolError("this is a replay: recorded frames cannot change")


def read_replay(
    path: Path, world: WorldSource, overrides: Overrides, *, begin: int = 0, speed: float = 1.0
) -> Replay:
    """A replay from frame `begin`, `speed` times as fast as real time; 0: as fast as possible.

    `world` names the world file if it has moved. Raises RecordError and WorldFileError, and
    MinervaError if the file is of another world or the frame does not exist.
    """
    from minerva_bus.log.cursor import Cursor
    from minerva_bus.log.reader import Record

    if not 0 <= speed < float("inf"):
        raise MisuseError(f"--speed must be a number from 0, not {speed:g}")
    with Record(path) as record:
        description = record.description
        damage = tuple(damage_of(record))
        file = world_file_of(path, world, description, CODE.over(overrides))
        cursor = Cursor(record)
        if not cursor.end:
            raise no_frame(record)
        if not 0 <= begin < cursor.end:
            raise MisuseError(f"{path}: it has {frames_up_to(cursor.end)}, not {begin}")
        played = replace(description.world, scene=cursor.seek(begin), past=Checkpoint(begin))
    # The record ends the replay, not the world's goal, which its last string may not have reached.
    played = replace(played, frames=cursor.end, until="", name=_name(overrides, description))
    # `read_processes` puts the views of the command line last.
    views = file.processes[len(file.processes) - len(overrides.views) :]
    # Such a view can still be used at the end of the record, for example to seek.
    stay = any(view.make_service is not None and view.make_service().interactive for view in views)
    shown = replace(
        file,
        world=replace(played, expected=frozenset(view.name for view in views)),
        rate=speed / played.dt,
        processes=views,
        record=replace(file.record, path=""),
        notes=(f"replays {path} from frame {begin}", *damage),
    )
    return Replay(shown, partial(replay_coordinator, path, kinds_in(file), stay))


def _name(overrides: Overrides, description: Description) -> str:
    # Another name, because the original world may run on this machine.
    return checked_name(
        overrides.values.get("name") or f"{description.world.name}-replay", "a world"
    )


def recomputed(path: Path, world: WorldSource, progress: Callable[[int, int], None]) -> Difference:
    """Run λ again on a record; `progress` receives the number of frames done and their total.

    Raises RecordError and WorldFileError, and ActivityError if user code fails.
    """
    from minerva_bus.launch.rerunning import recompute
    from minerva_bus.log.reader import Record

    with Record(path) as record:
        file = world_file_of(path, world, record.description, CODE)
        last = record.last()[0]
        return recompute(record, kinds_in(file), lambda done: progress(done, last))


def explained(
    path: Path, world: WorldSource, name: str, attribute: str, frame: int | None
) -> Explanation:
    """How an agent's attribute got its value in a recorded run; see `explain_value`.

    Raises RecordError and WorldFileError, and ActivityError if user code fails.
    """
    from minerva_bus.log.causes import explain_value
    from minerva_bus.log.reader import Record

    with Record(path) as record:
        return explain_value(record, _kinds_for(record, world), name, attribute, frame)


def explained_in(
    record: Record, world: WorldSource | None, name: str, attribute: str, frame: int | None
) -> Explanation | Observation:
    """As `explained`, of an open record; without a world no code runs.

    Without an attribute, it is the agent with what it received; see `observe_agent`.
    """
    from minerva_bus.log.causes import explain_value
    from minerva_bus.log.observation import observe_agent

    kinds: Kinds = {} if world is None else _kinds_for(record, world)
    if not attribute:
        return observe_agent(record, kinds, name, frame)
    return explain_value(record, kinds, name, attribute, frame)


def _kinds_for(record: Record, world: WorldSource) -> Kinds:
    return kinds_in(world_file_of(record.path, world, record.description, CODE))


def world_file_of(
    path: Path, world: WorldSource, description: Description, given: Overrides
) -> WorldFile:
    """The world file with the code of a record's agents."""
    wanted = f"minerva replay {path} WORLD"
    file = read_source(world, description, wanted, completed(given, description))
    # Only the vocabulary must agree: seed, rules and norms are those of the record.
    what = differing_vocabulary(file.world.vocabulary, description.world.vocabulary)
    if what:
        raise MinervaError(f"{path}: it is the record of another world: {what}")
    return file
