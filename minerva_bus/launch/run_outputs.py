"""Outputs of a run: record, journal, tables of the data that it collects, and metrics over HTTP."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.files import reason_of, text_of_path
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_table import MemberIndex
from minerva_bus.frame.messages import Readings
from minerva_bus.frame.world_state import StateToRecord
from minerva_bus.launch.past import Resumed, differing
from minerva_bus.launch.registry import runtime_folder
from minerva_bus.launch.toml_tables import option_text
from minerva_bus.launch.world_files import Collecting, WorldFile
from minerva_bus.log.entries import RecordHeader, encode_header
from minerva_bus.log.journal import Journal, Journaled, read_journal
from minerva_bus.runtime.runner import Sink
from minerva_bus.settings.kinds import ALL
from minerva_bus.world.operator import FileStatus, PersonOperation

if TYPE_CHECKING:
    from minerva_bus.collect.data_tables import DataTable, Writer
    from minerva_bus.collect.plans import TablePlan
    from minerva_bus.collect.table_parts import TableParts
    from minerva_bus.log.record import Record
    from minerva_bus.log.recorder import Recorder
    from minerva_bus.runtime.coordinator import Coordinator

SAVE_SECONDS: Final = 5.0
"""Time after which rows are written that still wait for more."""

MONITORS: Final = "minerva.monitors"
"""The entry points of servers of metrics; the first one by name serves those of `--metrics`."""


def monitored(
    file: WorldFile, ask: Callable[..., Mapping[str, Any]], note: Callable[[str], None]
) -> AbstractContextManager[None]:
    """Serve metrics of a run during the block if its file has an address for them.

    `ask` sends a question of an operator to the coordinator, from any thread; `note` logs the
    address. Raises MisuseError without an extension that serves metrics.
    """
    if not file.watch.metrics:
        return nullcontext()
    for _, monitor in sorted(entries(MONITORS).items()):
        return monitor.load()(file.world.name, file.watch.metrics, ask, note)
    raise MisuseError(
        f"metrics at {file.watch.metrics} need an extension that serves them ({MONITORS}); install"
        " it, or leave out --metrics and [metrics]"
    )


class RunRecord(Sink):
    """The record of a run; records nothing until `open` is called.

    `topics` are the sensor topics to record.
    """

    topics: tuple[str, ...] = ()
    _recorder: Recorder | None = None
    _failed: FileStatus | None = None

    def open(
        self, file: WorldFile, algorithm: StateToRecord, log: Callable[[str], None], again: bool
    ) -> None:
        """Record in a file; `again`: continue the record of a coordinator that was killed.

        Raises RecordError, and MisuseError if mcap is not installed.
        """
        from minerva_bus.log.record import Record

        self._algorithm = algorithm
        self._log = log
        self._next = algorithm.frame
        origin = _origin(file, again)
        if origin is None:
            self._record(file, description_of(file))
        else:
            with Record(origin) as past:
                # With a configured journal, the file may be an earlier run's record, for example
                # with another seed. A resumed run has been checked when it was read
                # (`read_resumed`).
                for what in differing(file.world, past.description.world) if again else ():
                    raise RecordError(f"{origin}: it is the record of another world: {what}")
                self._next = past.end()[0].frame
                description = _continued(past.description, file)
                # A resumed run has reported it when it was read.
                past.reported = True
                if again and (damage := past.damage()):
                    log(damage)
                # The new record contains everything of the killed coordinator's, so that is not
                # kept; a copy could overwrite the one that the user has of an earlier run.
                self._record(file, description, past, keep_old=not again)
        self.topics = file.record.topics

    def _record(
        self,
        file: WorldFile,
        description: RecordHeader,
        past: Record | None = None,
        *,
        keep_old: bool = True,
    ) -> None:
        from minerva_bus.log.recorder import Recorder

        # Seconds count from the beginning of the record, also after a succession or resumption; the
        # clock itself is monotonic, because the system's clock may be set in between.
        self._began = time.monotonic() - max(0, _wall_time() - description.began) / 1e9
        self._recorder = Recorder(
            Path(file.record.path),
            description,
            flush_seconds=file.record.flush,
            durable=file.record.durable,
            say=self._log,
            past=past,
            keep_old=keep_old,
        )

    def frame_done(self, notice: s.FrameDone) -> None:
        """Record a frame that has ended."""
        if self._recorder is None or notice.frame < self._next:
            return  # Recorded by the previous coordinator.
        if notice.frame > self._next:
            self._log(f"frames {self._next} to {notice.frame - 1} are not in the record")
        self._next = notice.frame + 1
        scene, checkpoint = self._algorithm.scene, self._algorithm.checkpoint
        self._recorder.frame(notice, scene, self._seconds(), checkpoint=checkpoint)

    def save(self) -> None:
        """Write all frames up to the last one to the disk."""
        if self._recorder is not None:
            self._recorder.flush()

    def idle(self) -> None:
        """Do pending work while the caller of `frame_done` waits for members."""
        if self._recorder is not None:
            self._recorder.idle()

    def said(self, member: str, text: str) -> None:
        """Record a log line about a member, or a line that it printed."""
        if self._recorder is not None:
            self._recorder.log(member, text, self._seconds())

    def noted(self, operation: PersonOperation) -> None:
        """Record what a person did to the world."""
        if self._recorder is not None:
            self._recorder.noted(operation, self._seconds())

    def sensed(self, readings: Readings) -> None:
        """Record readings of a sensor topic; like `heard` callable from any thread."""
        wanted = ALL in self.topics or readings.topic in self.topics
        if self._recorder is not None and wanted:
            self._recorder.sensed(readings, self._seconds())

    def heard(self, topic: str, member: str, data: bytes) -> None:
        """Record readings of a sensor topic as received from the bus."""
        if self._recorder is not None:
            self._recorder.received(topic, member, data, self._seconds())

    def fail(self, path: str, problem: str) -> None:
        """Note that the world runs without the record that it should have."""
        self._failed = FileStatus("record", text_of_path(path), problem)

    @property
    def files(self) -> tuple[FileStatus, ...]:
        """The state of the record; empty if none is wanted."""
        if self._failed is not None:
            return (self._failed,)
        recorder = self._recorder
        if recorder is None:
            return ()
        path = text_of_path(recorder.path.absolute())
        return (FileStatus("record", path, recorder.problem, recorder.lost),)

    def close(self) -> None:
        """Finish the record."""
        if self._recorder is not None:
            self._recorder.close()

    def _seconds(self) -> float:
        return time.monotonic() - self._began


def description_of(file: WorldFile) -> RecordHeader:
    """The description of a run that begins now."""
    options = {name: option_text(value) for name, value in file.options.items()}
    began, path = _wall_time(), text_of_path(file.path)
    return RecordHeader(file.world, file.text, file.rate, options, began=began, path=path)


def _wall_time() -> int:
    """Nanoseconds since 1970; 0 for a clock before it, as of a machine without a battery."""
    # Times in a record are unsigned (MCAP specification, Timestamp).
    return max(0, time.time_ns())


def _origin(file: WorldFile, again: bool) -> Path | None:
    """The record that this one continues."""
    if again:
        return Path(file.record.path)
    return file.origin if isinstance(file, Resumed) else None


def _continued(description: RecordHeader, file: WorldFile) -> RecordHeader:
    """Description of a continued record; name and end of the world may have changed."""
    now = file.world
    world = replace(
        description.world, name=now.name, frames=now.frames, until=now.until, expected=now.expected
    )
    began, frame = description.began, description.frame
    return replace(
        description_of(file), world=world, versions=description.versions, began=began, frame=frame
    )


def recording(
    file: WorldFile, algorithm: StateToRecord, log: Callable[[str], None], *, again: bool = False
) -> RunRecord:
    """The record that the settings request.

    `again`: continue the record of a coordinator that was killed, if possible.
    """
    record = RunRecord()
    if file.record.path:
        try:
            record.open(file, algorithm, log, again)
        except RecordError as error:
            # A world does not begin without its record, but a running one continues without it.
            if not again:
                raise
            log(f"{error}; the world continues without a record")
            record.fail(file.record.path, str(error))
    return record


def check_record(file: WorldFile) -> None:
    """Raises MisuseError if a record is requested but mcap is not installed."""
    if file.record.path:
        from minerva_bus.log.channels import check_installed

        check_installed()


class CollectSink(Sink):
    """Collects the frames of an algorithm, beginning with the string that it has now.

    `say` is called with a line for the user. `again`: this coordinator succeeds one that was
    killed, and is going to repeat the frames of its journal: it continues the tables. Raises
    MisuseError and VocabularyError.
    """

    def __init__(
        self,
        collecting: Collecting,
        algorithm: StateToRecord,
        say: Callable[[str], None],
        *,
        again: bool = False,
    ) -> None:
        from minerva_bus.collect.collector import Collector, SeriesHistory
        from minerva_bus.collect.data_tables import Gathered
        from minerva_bus.collect.plans import plans_of

        world = algorithm.world
        plans = plans_of(collecting.entries, world.vocabulary)
        self._gathered: dict[str, Gathered] = {}
        into, frame = collecting.into, algorithm.frame
        self._parts = _parts(Path(into), plans, frame, say, again=again) if into else None

        self.history = SeriesHistory(plans, world.vocabulary)

        def open_table(plan: TablePlan) -> Writer:
            if self._parts is not None:
                return self._parts.open(plan)
            gathered = self._gathered[plan.name] = Gathered(plan.name, plan.columns)
            return gathered

        self._algorithm = algorithm
        self._say = say
        self.files: tuple[FileStatus, ...] = ()
        self._saved_at = time.monotonic()
        self.collector = Collector(plans, world.vocabulary, world.dt, open_table, self.history.add)
        self.collector.begin(algorithm.frame, algorithm.scene)

    def frame_done(self, notice: s.FrameDone) -> None:
        """Collect the data of a frame that has ended."""
        events, scene = notice.events, self._algorithm.scene
        self._carefully(lambda: self.collector.done(notice.frame, events, scene))
        if time.monotonic() >= self._saved_at + SAVE_SECONDS:
            self.save()

    def save(self) -> None:
        """Write the rows so far, so that they survive this process."""
        if self._parts is not None:
            self._carefully(self._parts.save)
        self._saved_at = time.monotonic()

    def close(self) -> None:
        """Finish all tables."""
        self._carefully(lambda: self.collector.close(self._algorithm.closing_events))
        if self._parts is not None:
            self._carefully(self._parts.join)

    def _carefully(self, work: Callable[[], object]) -> None:
        """Give the tables up if they cannot be written: they must not end their world."""
        try:
            if not self.files:
                work()
        except (OSError, MisuseError) as error:
            if self._parts is None:
                raise
            path = text_of_path(self._parts.path)
            problem = str(error).removeprefix(f"{path}: ")
            if isinstance(error, OSError):
                lost = f"rows of the last {SAVE_SECONDS:g} s before frame {self._algorithm.frame}"
                problem = f"{reason_of(error)}; it may lack {lost}, and has no later ones"
            self.files = (FileStatus("tables", path, problem),)
            self._say(f"{path}: {problem}")

    @property
    def tables(self) -> dict[str, DataTable]:
        """The tables in memory, by name; empty if they go into a file."""
        return {name: gathered.table for name, gathered in self._gathered.items()}


def _parts(
    path: Path, plans: Sequence[TablePlan], frame: int, say: Callable[[str], None], *, again: bool
) -> TableParts:
    """The parts of a run's tables, or those of the killed coordinator `again`."""
    from minerva_bus.collect.table_parts import TableParts, has_parts

    tables = {plan.name: plan.columns for plan in plans}
    if again and has_parts(path, tables):
        return TableParts(path, tables, again=True)
    # A world that was stopped and continues has finished its former tables.
    if again and frame:
        path = path.with_name(f"{path.stem}-from-{frame}{path.suffix}")
        say(f"the data collected from frame {frame} on are in {path}")
        return TableParts(path, tables, again=has_parts(path, tables))
    return TableParts(path, tables)


def check_tables(into: str) -> None:
    """Raise MisuseError if there are tables of a killed run, which this one would not continue."""
    if not into:
        return
    from minerva_bus.collect.table_parts import check_no_parts

    check_no_parts(Path(into))


def complete_tables(into: str, say: Callable[[str], None]) -> None:
    """Join the parts that a run has left because its last coordinator failed, or the disk is full.

    Such a run has failed already, so an error is only logged.
    """
    if not into:
        return
    from minerva_bus.collect.table_parts import has_parts, parts_of, read_parts

    path = Path(into)
    if has_parts(path):
        try:
            files = read_parts(parts_of(path)).join()
        except MisuseError as error:
            say(str(error))
        else:
            say(f"the rows that were saved are in {', '.join(map(str, files.values()))}")


def collect_sink(
    collecting: Collecting,
    algorithm: StateToRecord,
    say: Callable[[str], None],
    *,
    again: bool = False,
) -> CollectSink | None:
    """The sink that collects data; None if there are none to collect."""
    if not collecting.entries:
        return None
    return CollectSink(collecting, algorithm, say, again=again)


# --- the journal ---


def journal_path(file: WorldFile) -> Path:
    """Path of a world's journal: in the configured folder, or in the runtime folder."""
    place = Path(file.bus.journal) if file.bus.journal else runtime_folder()
    return place / f"{file.world.name}.journal"


def find_past(file: WorldFile, *, again: bool) -> Journaled | None:
    """The journal to continue from, if it exists, and `again` is set or it is configured.

    Raises RecordError if the journal cannot be used, or if `again` is set and there is none.
    """
    if not (again or file.bus.journal):
        return None
    path = journal_path(file)
    past = read_journal(path, file.world)
    if past is None and again:
        # From its beginning the world would run once more, without a word to those who watch it.
        raise RecordError(
            f"{path}: there is no journal, so no other coordinator can continue the world"
        )
    return past


def discard_journal(file: WorldFile) -> None:
    """Delete the journal of a run that nothing continues, unless it is configured."""
    if not file.bus.journal:
        with suppress(OSError):
            journal_path(file).unlink()


def next_epoch(past: Journaled | None, now: float) -> int:
    """Epoch of a coordinator: seconds since 1970, but always greater than the previous one.

    Members follow the highest epoch, so neither a clock that was set back nor a start within the
    same second may repeat one. With a clock before 1970 the first epoch is 0, since all are from 0.
    """
    return max(0, int(now), 0 if past is None else past.epoch + 1)


class RunJournal:
    """Writes the journal of a running world; `log` receives a failure to do so.

    It is deleted when the world has ended by itself. After any other end a successor may need it,
    so only the launcher knows when nothing does (`discard_journal`). Raises BusError if it cannot
    be created.
    """

    def __init__(
        self,
        file: WorldFile,
        coordinator: Coordinator,
        past: Journaled | None,
        log: Callable[[str], None],
    ) -> None:
        self._coordinator = coordinator
        self._log = log
        self._members: MemberIndex | None = None
        self._failed: FileStatus | None = None
        self._journal: Journal | None = Journal(
            journal_path(file),
            coordinator.transport.epoch,
            coordinator.algorithm,
            encode_header(description_of(file), string=False),
        )
        # This journal replaces the earlier one, so it takes over its contents besides the frames.
        if past is not None:
            self._journal.members(past.members)
            pace = coordinator.schedule.pace
            pace.rate, pace.left = past.rate_for(file.rate), past.left
        self._note_pace(self._journal)

    @property
    def files(self) -> tuple[FileStatus, ...]:
        """The state of the journal."""
        if self._failed is not None:
            return (self._failed,)
        if self._journal is None:
            return ()
        return (FileStatus("journal", text_of_path(self._journal.path)),)

    def frame(self, done: s.FrameDone) -> None:
        """Write a frame that has ended. Raises Followed."""
        if self._journal is None or done.inputs is None:
            return
        try:
            self._note_members(self._journal)
            self._journal.frame(done.inputs)
        except OSError as error:
            self._give_up(self._journal, error)

    def shorten(self, save: Callable[[], None]) -> None:
        """Rewrite a long journal after a frame, or add a keyframe if it is due. Raises Followed.

        `save` saves what a successor could not compute again from the new journal.
        """
        if self._journal is None:
            return
        try:
            if self._journal.is_long:
                self._journal.rewrite(save)
            elif self._journal.is_keyframe_due:
                self._journal.add_keyframe()
        except OSError as error:
            self._give_up(self._journal, error)

    def operated(self) -> None:
        """Write the pace and waiting events, after a person's request. Raises Followed."""
        if self._journal is None:
            return
        try:
            self._note_pace(self._journal)
            self._journal.waiting(self._coordinator.algorithm.ordered)
        except OSError as error:
            self._give_up(self._journal, error)

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close(over=bool(self._coordinator.algorithm.why_over()))

    def _note_members(self, journal: Journal) -> None:
        members = self._coordinator.algorithm.members
        # The index is a new object whenever the members have changed.
        if members.index is not self._members:
            self._members = members.index
            journal.members(member.name for member in members.index.active)

    def _note_pace(self, journal: Journal) -> None:
        """Write the pace; a frame in progress counts as left, because the journal lacks it."""
        pace, begun = self._coordinator.schedule.pace, self._coordinator.algorithm.in_frame
        journal.pace(pace.rate, None if pace.left is None else pace.left + begun)

    def _give_up(self, journal: Journal, error: OSError) -> None:
        # Deleted, because a successor must not continue from an outdated frame.
        journal.close(over=True)
        self._journal = None
        problem = f"cannot be written: {error.strerror}"
        self._failed = FileStatus("journal", text_of_path(journal.path), problem)
        self._log(
            f"{journal.path}: {problem}; the world continues, but ends if its coordinator is killed"
        )
