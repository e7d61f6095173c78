"""Deaths of a member at every message of a frame, in one process.

A frame is a fixed sequence of deliveries to members: greetings, ticks, fragments, views. At each
of them the receiver dies in the ways of WHEN. The strings must be those of a run without deaths.
The same member code runs as on the bus; only the processes are missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

from minerva_bus.errors import MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import Phase
from minerva_bus.launch.in_process import close_services
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.runner import InProcessRunner, Notice
from minerva_bus.runtime.runner import deliver as deliver_alive

BEFORE: Final = "before"
AFTER: Final = "after"
LATE: Final = "for long after"
WHEN: Final = (BEFORE, AFTER, LATE)
"""A member dies before it has processed a message, or after it has answered. Its successor joins
at once, or only when nothing goes on without it.
"""


@dataclass(frozen=True, slots=True)
class Delivery:
    """A delivery of a run, counted from 0, in a frame; -1 is before the first frame."""

    number: int
    frame: int
    member: str
    message: str

    def __str__(self) -> str:
        return f"{self.message} to {self.member} in frame {max(self.frame, 0)}"


class Killed:
    """A run of a world in which the receiver of one delivery dies; `digests` of its frames.

    `at` is the number of the delivery, -1 for a run without deaths, and `when` one of WHEN.
    """

    def __init__(self, file: WorldFile, at: int = -1, when: str = BEFORE) -> None:
        self.digests: list[bytes] = []
        self.positions: list[Delivery] = []
        self._at, self._when = at, when
        self._away = ""
        self._specs = {process.name: process for process in file.processes}
        self._members = [process.make_member() for process in file.processes]
        algorithm = FrameAlgorithm(file.world)
        self._runner = InProcessRunner(
            algorithm, self._members[:], self._note, deliver=self._deliver
        )

    def run(self) -> list[bytes]:
        """The digests of all frames. Raises MinervaError if the world fails."""
        runner = self._runner
        try:
            runner.start()
            while runner.ended is None:
                if runner.algorithm.phase is Phase.READY:
                    runner.handle(s.Begin())
                else:
                    self._return()
        finally:
            close_services(self._members, lambda name, text: None)
        return self.digests

    def _return(self) -> None:
        """Let the member that is away return; the world has gone on as far as it can."""
        if not self._away:
            waiting = self._runner.algorithm.waiting_for()
            raise MinervaError(f"the world waits for {', '.join(waiting)} for ever")
        name, self._away = self._away, ""
        self._runner.handle(s.Appeared(name))

    def _note(self, notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            self.digests.append(self._runner.algorithm.scene.digest)

    def _deliver(
        self, member: Member, message: m.ToMember | m.Readings
    ) -> Iterator[m.FromMember | m.Readings | s.Vanished | s.Appeared]:
        number, frame = len(self.positions), self._runner.algorithm.frame
        self.positions.append(Delivery(number, frame, member.name, type(message).__name__))
        if number != self._at:
            yield from deliver_alive(member, message)
            return
        if self._when != BEFORE:
            yield from deliver_alive(member, message)
        successor = self._specs[member.name].make_member()
        self._members.append(successor)
        self._runner.direct.add(successor)
        yield s.Vanished(member.name)
        if self._when == LATE:
            self._away = member.name
        else:
            yield s.Appeared(member.name)


def deaths(file: WorldFile, frames: Iterable[int]) -> Iterator[tuple[Delivery, str, int | None]]:
    """A death at each delivery of these frames; each with the first frame that it changes, or None.

    Raises MinervaError if the world fails without a death, or in one of these runs.
    """
    alive = Killed(file)
    expected = alive.run()
    wanted = {*frames}
    for position in alive.positions:
        for when in WHEN if position.frame in wanted else ():
            digests = Killed(file, position.number, when).run()
            pairs = enumerate(zip_longest(expected, digests))
            yield position, when, next((frame for frame, (a, b) in pairs if a != b), None)
