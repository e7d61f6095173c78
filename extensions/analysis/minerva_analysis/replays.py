"""Replays a record: in any view, or recomputed (`minerva replay FILE`).

In a view (`--view svg`), bus, views and launcher are those of any world; only the coordinator reads
its frames from a record. The world file provides the code of agents, which their views need.

A recomputed run (`--recompute`) feeds a frame algorithm with the logged inputs of each frame,
except those of members that take part here; the hosts here compute the evolution. Each frame is
compared with the recorded one. Time is simulated, and everything runs in this process.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from minerva_analysis.comparing import Difference, apart, same_events
from minerva_analysis.frame_texts import missing_frame
from minerva_analysis.replay_algorithm import ReplayAlgorithm
from minerva_bus.api.world import ContinuedRecord
from minerva_bus.errors import (
    MinervaError,
    MisuseError,
    ProtocolError,
    RecordError,
)
from minerva_bus.files import text_of_path
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.stimuli import AGENTS, Checkpoint, FrameInputs, RecordedFrame
from minerva_bus.frame.world_state import Phase, WorldSpec
from minerva_bus.grammar.events import AnyEvent, senders_of
from minerva_bus.launch.past import (
    WorldSource,
    completed,
    damage_of,
    differing_vocabulary,
    kinds_in,
    read_source,
)
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.log.record import Cursor, Record
from minerva_bus.runtime.coordinator import Coordinator, Watchers
from minerva_bus.runtime.questions import COMMANDS, WorldRun, status_of
from minerva_bus.runtime.runner import InProcessRunner, Notice
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.values import fast_dataclass, path_of
from minerva_bus.wire.keys import checked_name
from minerva_bus.wire.plain import as_int
from minerva_bus.wire.status_codec import plain_status
from minerva_bus.world.agent import Kinds
from minerva_bus.world.event_collection import collect
from minerva_bus.world.operator import FileStatus

if TYPE_CHECKING:
    from minerva_bus.log.entries import RecordHeader

CODE: Final = Overrides(only_code=True)
"""Recorded events take the place of the services, whose backends may be gone."""

SIDES: Final = ("the record", "this run")
RECORDED: Final = "~record"
"""Source of recorded events if the record does not have the inputs of each member."""

_HOST: Final = "~host"


def no_frame(record: Record) -> MisuseError:
    """The error of a record without frames, with the damage that took them."""
    return MisuseError("; ".join((f"{record.path}: there is no frame in it", *damage_of(record))))


def world_file_of(
    path: Path, world: WorldSource, description: RecordHeader, given: Overrides
) -> WorldFile:
    """The world file with the code of a record's agents."""
    wanted = f"as in minerva replay {path} WORLD, or minerva bisect {path} --world-a WORLD"
    file = read_source(world, description, wanted, completed(given, description))
    # Only the vocabulary must agree: seed, rules and norms are those of the record.
    what = differing_vocabulary(file.world.vocabulary, description.world.vocabulary)
    if what:
        raise MinervaError(f"{path}: it is the record of another world: {what}")
    return file


class Replay(NamedTuple):
    """A record to be replayed: its views as a world file, and the factory of its coordinator."""

    file: WorldFile
    coordinator: Callable[..., Coordinator]


def replay_coordinator(
    path: Path, kinds: Kinds, stay: bool, world: WorldSpec, watchers: Watchers, **options: Any
) -> Coordinator:
    """A coordinator that takes its frames from a record. Raises RecordError."""

    def listening(endpoint: str) -> None:
        watchers.listening(endpoint)
        coordinator.inbox.put(s.Begin())  # There may be no view to wait for.

    def seek(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
        frame, algorithm = as_int(asked.get("frame"), "the frame"), running.algorithm
        if frame > cursor.end:
            raise ProtocolError(f"the record ends before frame {cursor.end}, not {frame}")
        if algorithm.phase is not Phase.READY:
            raise ProtocolError(f"not now: {algorithm.phase.value}")
        running.runner.handle(s.Seek(frame))
        return {"frame": algorithm.frame}

    def status(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
        now = status_of(running, as_int(asked.get("since", 0), "since"))
        return {"status": plain_status(replace(now, end=cursor.end))}

    cursor = Cursor(Record(path))
    cursor.seek(world.past.frame)
    options["algorithm"] = ReplayAlgorithm(world, cursor, kinds, stay=stay)
    # Recorded frames are fixed, so commands that would change them are rejected.
    commands = {**COMMANDS, **dict.fromkeys(("pub", "order", "restart"), _reject), "seek": seek}
    commands["status"] = status
    record = FileStatus("record", text_of_path(path.absolute()))
    watching = replace(watchers, listening=listening, files=lambda: (record,))
    coordinator = Coordinator(world, watching, commands=commands, **options)
    return coordinator


def _reject(_: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    raise ProtocolError("this is a replay: recorded frames cannot change")


def read_replay(
    path: Path, world: WorldSource, overrides: Overrides, *, begin: int = 0, speed: float = 1.0
) -> Replay:
    """A replay from frame `begin`, `speed` times as fast as real time; 0: as fast as possible.

    `world` names the world file if it has moved. Raises RecordError and WorldFileError, and
    MinervaError if the file is of another world or the frame does not exist.
    """
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
            raise MisuseError(missing_frame(path, cursor.end, begin))
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


@fast_dataclass
class ReplayedRecord(ContinuedRecord):
    """The record that a run shows from frame `begin`; see `read_replay`."""

    begin: int = 0
    speed: float = 1.0

    def read(self, world: WorldSource, overrides: Overrides) -> Replay:
        """Its replay. Raises as `read_replay`."""
        path = path_of("record", self.record)
        return read_replay(path, world, overrides, begin=self.begin, speed=self.speed)


def _name(overrides: Overrides, description: RecordHeader) -> str:
    # Another name, because the original world may run on this machine.
    return checked_name(
        overrides.values.get("name") or f"{description.world.name}-replay", "a world"
    )


def recorded_inputs(frame: RecordedFrame) -> FrameInputs:
    """The inputs of the algorithm for a recorded frame, of any version of records.

    A record without the inputs of each member has the events of all: those that no agent sent are
    inputs, because agents run again.
    """
    if frame.inputs is not None:
        return frame.inputs
    sent = [rest for event in frame.events for rest in _of_members(event)]
    return FrameInputs(frame.number, (), {}, {RECORDED: sent} if sent else {}, (), (), {})


def _of_members(event: AnyEvent) -> Collection[AnyEvent]:
    """The part of an event, or batch, that no agent sent."""
    if senders_of(event) is None:
        return (event,)
    return [row for row in event if not row.sender]


class Rerun:
    """A recorded run that is computed again, frame by frame, from its beginning.

    `compare` is a sink of the runner that runs `algorithm`, which gets the `inputs` of each frame.
    `difference` describes the first frame that differs. Raises RecordError if a frame is missing.
    """

    def __init__(
        self,
        record: Record,
        algorithm: FrameAlgorithm,
        inputs: Callable[[RecordedFrame], FrameInputs] = recorded_inputs,
    ) -> None:
        self.algorithm = algorithm
        self.difference: Difference | None = None
        self._record = record
        self._cursor = Cursor(record, state=True, inputs=True)
        self._inputs = inputs

    def run(self, runner: InProcessRunner, *, to_difference: bool = False) -> None:
        """Compute all frames, or those up to the first that differs; raises as `step`."""
        runner.start()
        while not (to_difference and self.difference is not None) and self.step(runner):
            pass

    def step(self, runner: InProcessRunner) -> bool:
        """Compute one frame; False if the run is over. Raises any exception of user code."""
        algorithm, frame = self.algorithm, self._cursor.ahead
        if runner.ended is not None or frame is None:
            return False
        if frame.number != algorithm.frame:
            raise RecordError(
                f"{self._record.path}: frame {algorithm.frame} is not in the record, so the run"
                " cannot be computed beyond it"
            )
        runner.handle(s.Begin(inputs=self._inputs(frame)))
        # All members reply within `handle`, so a frame that is incomplete now stays incomplete.
        if algorithm.frame == frame.number and runner.ended is None:
            awaited = ", ".join(algorithm.waiting_for()) or "agents that no process here runs"
            raise MinervaError(f"it waits for {awaited}")
        return True

    def result(self) -> Difference:
        """The first difference; if there is none, what of the record could not be compared."""
        damage = self._record.damage()
        frames = self.algorithm.frame
        return self.difference or Difference(None, frames, damage=(damage,) if damage else ())

    def compare(self, notice: Notice) -> None:
        """Compare digest, events, and the events that agents sent for the next frame."""
        frame, cursor = self._cursor.ahead, self._cursor
        if frame is None or not isinstance(notice, s.FrameDone):
            return
        # Also after a difference, because `step` takes the inputs of the next frame from the
        # cursor.
        recorded, scene = cursor.advance(), self.algorithm.scene
        if self.difference is not None:
            return
        events = frame.events, notice.events
        if same_events(*events) and cursor.checkpoint is not None:
            sent = cursor.checkpoint.emitted, self.algorithm.checkpoint.emitted
            # In the order of a frame's collection: a difference in the order before it has no
            # effect, and records of earlier versions may have one.
            order = self._record.description.world.order
            first, second = (collect(order, {AGENTS: each}) for each in sent)
            events = first, second
        # Events that agents emit reach the string in the next frame only; comparing them finds the
        # cause a frame earlier.
        same = scene.digest == frame.digest
        if not same or not same_events(*events):
            strings = None if same else (recorded, scene)
            vocabulary = self._record.description.world.vocabulary
            self.difference = apart(vocabulary, frame, strings, events, SIDES)


def recompute(record: Record, kinds: Kinds, progress: Callable[[int], None]) -> Difference:
    """Run λ again on the recorded inputs, up to the first frame that differs.

    `progress` receives the number of frames done. Raises RecordError, and ActivityError if user
    code fails.
    """
    world = record.description.world
    world = replace(world, frames=record.last()[0], expected=frozenset((_HOST,)))
    algorithm = FrameAlgorithm(world)
    rerun = Rerun(record, algorithm)

    def watch(notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            progress(notice.frame + 1)

    runner = InProcessRunner(
        algorithm,
        [Member(_HOST, None, kinds.values())],
        rerun.compare,
        watch,
        deliver=_deliver_without_views,
    )
    rerun.run(runner, to_difference=True)
    return rerun.result()


def _deliver_without_views(
    member: Member, message: m.ToMember | m.Readings
) -> Iterable[m.FromMember | m.Readings]:
    """Let a host evolve its agents without views, because there is no device."""
    if isinstance(message, m.EvolveRequest):
        message = replace(message, visual=())
    return member.receive(message)


def no_progress(done: int, total: int) -> None:
    """Report no progress."""
