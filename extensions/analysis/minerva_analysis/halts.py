"""Why a running world does not advance: rules over its status and stacks of processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.launch import child_processes
from minerva_bus.launch.child_processes import NOT_STARTED, STOPPED, blocked_at, own_frames
from minerva_bus.user_code import SourceLine
from minerva_bus.wording import counted
from minerva_bus.world.norms import Then
from minerva_bus.world.operator import MemberStatus, WorldStatus

COMPILERS: Final = ("/numba/", "/llvmlite/")
LOCKS: Final = (("threading.py", "queue.py", "connection.py", "_base.py"), (".acquire(", ".join("))
MIND: Final = "Llm"
"""Service that asks language models."""

SLOW_SHARE: Final = 0.5
"""Share of the duration of frames that a slow member takes at least."""

MICRO: Final = 1e-6
UNWRITTEN: Final = {
    "record": (
        "frames are not recorded",
        "free space on the disk, then minerva recover FILE",
    ),
    "journal": ("the world ends if its coordinator is killed", "free space on the disk"),
}
"""What follows from a file that cannot be written, and what to do, by its name."""


@dataclass(frozen=True, slots=True)
class HaltCause:
    """One cause: its `kind`, the member, what happens, what follows by itself, and what to do.

    `place` is the line of code that the member executes, if known.
    """

    kind: str
    member: str
    what: str
    then: str
    advice: str
    place: SourceLine | None = None

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        shown = {name: getattr(self, name) for name in ("kind", "member", "what", "then")}
        place = None if self.place is None else self.place.plain()
        return {**shown, "advice": self.advice, "place": place}

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = [f"{self.kind}: {self.what}"]
        shown += self.place.lines() if self.place is not None else []
        shown += [f"  then: {self.then}"] if self.then else []
        return [*shown, f"  do: {self.advice}"]


@dataclass(frozen=True, slots=True)
class Halt:
    """Why a world does not advance, or what holds it up; `causes` is empty if nothing does."""

    world: str
    frame: int
    phase: str
    advances: bool
    waited: float
    causes: tuple[HaltCause, ...]

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        own = {name: getattr(self, name) for name in self.__slots__}
        return {**own, "causes": [cause.plain() for cause in self.causes]}

    def lines(self) -> list[str]:
        """As lines of text."""
        state = "advances" if self.advances else f"does not advance ({self.phase})"
        waited = f", it has been waiting for {self.waited:.1f} s" if self.waited else ""
        shown = [f"{self.world}: frame {self.frame} {state}{waited}"]
        shown += [line for cause in self.causes for line in cause.lines()]
        return shown if self.causes else [*shown, "nothing holds it up"]


Stacks = Mapping[str, Sequence[str]]


def explain_halt(first: WorldStatus, last: WorldStatus, stacks: Stacks) -> Halt:
    """Why a world does not advance, from two states of it.

    Args:
        first: the state of the world.
        last: its state about half a second later.
        stacks: what the awaited processes have written, by member; see `traces`.

    """
    advances = last.frame > first.frame
    finder = _CauseFinder(last, stacks)
    if advances:
        causes = [*finder.in_slow_frames(), *finder.in_norms(), *finder.in_files()]
        causes += finder.in_events()
    else:
        causes = [*finder.in_members(), *finder.in_pace(), *finder.in_norms()]
        causes += finder.in_files()
    waited = last.waited if last.waiting else 0.0
    return Halt(last.world, last.frame, last.phase, advances, waited, tuple(causes))


@dataclass(frozen=True, slots=True)
class _CauseFinder:
    """The rules, each for one group of causes."""

    status: WorldStatus
    stacks: Stacks

    # --- a world that stands still ---

    def in_members(self) -> Iterator[HaltCause]:
        """Members that the frame waits for."""
        members = {member.name: member for member in self.status.members}
        for name in self.status.waiting:
            yield self._awaited(members.get(name) or MemberStatus(name, "absent"))

    def _awaited(self, member: MemberStatus) -> HaltCause:
        name, then = member.name, member.outlook
        answer = self.stacks.get(name, ())
        if STOPPED in answer:
            what = f"the process of {name} is stopped, by SIGSTOP or a debugger"
            return HaltCause("stopped process", name, what, then, f"kill -CONT {member.pid}")
        if not member.joins:
            advice = f"start it (minerva attach, or on its machine); minerva logs {name}"
            return HaltCause("missing member", name, f"{name} has not joined", then, advice)
        if member.state in ("lost", "left") or NOT_STARTED in answer:
            what = f"the link to {name} is lost, or its process has ended"
            advice = f"minerva logs {name}; minerva restart {name}, or the network to {member.host}"
            return HaltCause("lost link", name, what, then, advice)
        if member.service == MIND:
            what = f"{name} waits for answers of its backend, because its table has wait = true"
            advice = "wait, or set a shorter `timeout`; without wait = true no frame waits for it"
            return HaltCause("pending request", name, what, then, advice)
        return self._blocked(name, then, answer)

    def _blocked(self, name: str, then: str, answer: Sequence[str]) -> HaltCause:
        """A member whose process runs, by the stack that it has written."""
        frames, place = (
            own_frames(answer, child_processes.__file__),
            blocked_at(answer, child_processes.__file__),
        )
        source = " ".join(place.shown) if place is not None else ""
        restart = f"minerva restart {name} starts the process again"
        if any(part in frame.file for frame in frames for part in COMPILERS):
            what = f"{name} compiles machine code, which takes seconds in its first frame"
            return HaltCause("compilation", name, what, then, "wait: it is kept in a cache", place)
        if "sleep(" in source:
            what = f"{name} sleeps in a call"
            return HaltCause(
                "sleeping call", name, what, then, f"remove the call; {restart}", place
            )
        if frames and (
            frames[0].file.endswith(LOCKS[0]) or any(word in source for word in LOCKS[1])
        ):
            what = f"{name} waits for a lock or a thread that is never released, a deadlock"
            return HaltCause("deadlock", name, what, then, f"find its holder; {restart}", place)
        if not frames:
            what = f"{name} does not answer; its stack is not known here"
            return HaltCause("no answer", name, what, then, f"minerva logs {name}, where it runs")
        what = f"{name} computes, or is blocked, in a call"
        return HaltCause("long call", name, what, then, restart, place)

    def in_pace(self) -> Iterator[HaltCause]:
        """A world between two frames that nothing holds up but its pace."""
        status = self.status
        if status.waiting:
            return
        if status.paused:
            what = f"the world is paused before frame {status.frame}"
            advice = f"minerva resume {status.world}, or minerva step {status.world}"
            yield HaltCause("paused world", "", what, "it waits without limit", advice)
        elif 0 < status.rate < 2:
            what = f"a frame begins only every {1 / status.rate:.1f} s"
            yield HaltCause("low rate", "", what, "the next frame begins in time", "minerva rate")

    # --- a world that advances ---

    def in_slow_frames(self) -> Iterator[HaltCause]:
        """A member that takes most of the time of frames which are late."""
        status = self.status
        late = status.rate > 0 and status.hz < 0.8 * status.rate
        seconds = 1 / status.hz if status.hz > 0 else 0.0
        slowest = max(status.members, key=lambda member: member.wait, default=None)
        if slowest is None or not late or slowest.wait * MICRO < SLOW_SHARE * seconds:
            return
        what = (
            f"{slowest.name} takes {slowest.wait * MICRO:.2f} s of a frame's {seconds:.2f} s; the"
            f" world runs at {status.hz:.1f} of {status.rate:g} frames per second"
        )
        more, less = "give its table more processes", "couple, draw or ask it less often"
        remedy = more if slowest.kinds else less
        advice = f"minerva run --profile-member {slowest.name}; {remedy}"
        yield HaltCause("slow consumer", slowest.name, what, "frames stay late", advice)

    def in_events(self) -> Iterator[HaltCause]:
        """A world in which nothing happens."""
        # Visual events are requests of devices; no agent evolves by them.
        drawn = {event for member in self.status.members for event in member.draws}
        rates = [rate for event, rate in self.status.events.items() if event not in drawn]
        if not self.status.paused and not any(rates):
            what = "frames advance without any event, so no agent evolves"
            advice = "add a clock or a sensor ([process.NAME] service), or send one: minerva pub"
            if any(member.generates for member in self.status.members):
                advice = "minerva logs shows what its generators lack; or send one: minerva pub"
            yield HaltCause("no events", "", what, "agents keep their state", advice)

    def in_norms(self) -> Iterator[HaltCause]:
        """Norms that have rejected something."""
        for norm in self.status.norms:
            if norm.then != Then.REFUSE.value:
                continue
            last = f", the last by {norm.by} in frame {norm.frame}" if norm.by else ""
            what = (
                f"the norm {norm.name} rejects: it was broken {counted(norm.broken, 'time')}{last}"
            )
            advice = f"change [norm.{norm.name}], or minerva explain RECORD shows what it rejected"
            yield HaltCause("norm", norm.name, what, "rejected agents keep their state", advice)

    def in_files(self) -> Iterator[HaltCause]:
        """The record or the journal, if it cannot be written."""
        for file in self.status.files:
            if not file.problem:
                continue
            lost = f"; it lacks {counted(file.lost, 'frame')}" if file.lost else ""
            what = f"the {file.name} {file.path}: {file.problem}{lost}"
            yield HaltCause("full disk", file.name, what, *UNWRITTEN.get(file.name, ("", "")))
