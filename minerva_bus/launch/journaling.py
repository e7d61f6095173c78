"""The journal of a run, from which a coordinator goes on when the one before it was killed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.members import MemberIndex
from minerva_bus.launch.runtime_folder import runtime_folder
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.log.journal import Journal, Journaled, read_journal
from minerva_bus.runtime.coordinator import Coordinator


def journal_path(file: WorldFile) -> Path:
    """Where a world's journal is: in the folder that was asked for, or with what runs here."""
    place = Path(file.bus.journal) if file.bus.journal else runtime_folder()
    return place / f"{file.world.name}.journal"


def find_past(file: WorldFile, *, again: bool) -> Journaled | None:
    """What a world goes on from: `again`, or where a journal was asked for and is there.

    Raises RecordError where that journal cannot be gone on from.
    """
    wanted = again or file.bus.journal
    return read_journal(journal_path(file), file.world) if wanted else None


def next_epoch(past: Journaled | None, now: float) -> int:
    """The epoch of a coordinator: seconds since 1970, but always above the one before it."""
    return int(now) if past is None else max(past.epoch + 1, int(now))


class Keeping:
    """Writes the journal of a running world; `say` hears when it cannot be written any more.

    One that nobody asked for is gone when its world has ended, however it did; one that was asked
    for only where the world came to its own end. Raises BusError where it cannot be begun.
    """

    def __init__(
        self,
        file: WorldFile,
        coordinator: Coordinator,
        past: Journaled | None,
        say: Callable[[str], None],
    ) -> None:
        self._coordinator = coordinator
        self._say = say
        self._asked_for = bool(file.bus.journal)
        self._attending: MemberIndex | None = None
        self._journal: Journal | None = Journal(
            journal_path(file), coordinator.transport.epoch, coordinator.algorithm
        )
        if past is not None:
            self._journal.members(past.members)
            if past.rate is not None:
                coordinator.schedule.pace.rate, coordinator.schedule.pace.left = (
                    past.rate,
                    past.left,
                )
        self._note_pace(self._journal)

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over. Raises Followed."""
        if self._journal is None or done.inputs is None:
            return
        try:
            self._note_members(self._journal)
            self._journal.frame(done.inputs)
        except OSError as error:
            self._give_up(self._journal, error)

    def operated(self) -> None:
        """A person may have changed the pace, or sent an event. Raises Followed."""
        if self._journal is None:
            return
        try:
            self._note_pace(self._journal)
            self._journal.waiting(self._coordinator.algorithm.ordered)
        except OSError as error:
            self._give_up(self._journal, error)

    def close(self) -> None:
        """The run is over."""
        if self._journal is not None:
            over = self._coordinator.algorithm.over or not self._asked_for
            self._journal.close(over=over)

    def _note_members(self, journal: Journal) -> None:
        members = self._coordinator.algorithm.members
        if members.index is not self._attending:
            self._attending = members.index
            journal.members(member.name for member in members.active())

    def _note_pace(self, journal: Journal) -> None:
        """The pace, with the frame that is under way among those left: it is not written yet."""
        pace, begun = self._coordinator.schedule.pace, self._coordinator.algorithm.in_frame
        journal.pace(pace.rate, None if pace.left is None else pace.left + begun)

    def _give_up(self, journal: Journal, error: OSError) -> None:
        journal.close(over=True)
        self._journal = None
        self._say(
            f"{journal.path}: cannot be written: {error.strerror}; the world goes on, but a"
            " coordinator that is killed now ends it"
        )
