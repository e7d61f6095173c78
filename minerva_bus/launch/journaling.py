"""Journal of a running world, from which another coordinator continues after a crash."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.members import MemberIndex
from minerva_bus.launch.recording import description_of
from minerva_bus.launch.runtime_folder import runtime_folder
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.log.description import encode_description
from minerva_bus.log.errors import RecordError
from minerva_bus.log.journal import Journal
from minerva_bus.log.journaled import Journaled, read_journal
from minerva_bus.path_text import text_of_path
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.world.operator import FileStatus


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
            encode_description(description_of(file), string=False),
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

        `save` is called before it is rewritten: it saves what a successor could not compute again
        afterwards.
        """
        if self._journal is None:
            return
        is_long = self._journal.is_long
        if is_long:
            save()
        try:
            if is_long:
                self._journal.rewrite()
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
            self._journal.close(over=self._coordinator.algorithm.over)

    def _note_members(self, journal: Journal) -> None:
        members = self._coordinator.algorithm.members
        # The index is a new object whenever the members have changed.
        if members.index is not self._members:
            self._members = members.index
            journal.members(member.name for member in members.active())

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
