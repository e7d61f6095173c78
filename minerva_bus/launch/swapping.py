"""A recorded run once more with one member replaced: `minerva replay FILE --swap MEMBER=SPEC`.

In simulated time and in one process: agents run again, the new member says what it says, and of
all other generators there is what was recorded. So two planners, or two views, meet the very same
world.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import MinervaError, MisuseError, WorldStopped, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.compatibility import incompatibility
from minerva_bus.frame.participant import Participant
from minerva_bus.launch.recording import recording
from minerva_bus.launch.replaying import world_file_of
from minerva_bus.launch.specs import AGENTS, bind, entries, find_agents, find_service, load
from minerva_bus.launch.typed import typed_options
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.settings.overrides import Overrides
from minerva_bus.settings.tables import RecordSettings
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Generator

if TYPE_CHECKING:
    from minerva_bus.log.comparison import Difference
    from minerva_bus.log.reader import Record

SIDES: Final = ("the record", "this run")
PLAYERS: Final = ("record", "recorded", "~record")
"""What the member is called that says what other generators have said: a name that is free."""


@dataclass(frozen=True, slots=True)
class Swap:
    """Which member is replaced by what, and the options of that."""

    member: str
    spec: str
    options: Mapping[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def read(cls, text: str, options: Mapping[str, str]) -> Swap:
        """`MEMBER=SPEC`. Raises MisuseError."""
        member, equals, spec = text.partition("=")
        if not (member and equals and spec):
            raise MisuseError(f"--swap {text}: expected MEMBER=SPEC, such as planner=module:Class")
        return cls(member.strip(), spec.strip(), options)


@dataclass(frozen=True, slots=True)
class Swapped:
    """How a run went with a member replaced: where it parts from the record, and how it ended."""

    difference: Difference
    frames: int
    digest: str
    ended: str
    recorded: int
    figures: Mapping[str, bool | int | float | str]

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        ended = {"frames": self.frames, "digest": self.digest, "ended": self.ended}
        told = {"recorded": self.recorded, "figures": dict(self.figures)}
        return {**ended, **told, "difference": self.difference.plain()}

    def lines(self) -> list[str]:
        """As a person reads it."""
        over = f"{self.ended}: {self.frames:,} frames of {self.recorded:,}, digest {self.digest}"
        figures = [f"{name} {value}" for name, value in self.figures.items()]
        return [*self.difference.lines(), over, *([", ".join(figures)] if figures else [])]


def replay_swapped(
    path: Path, world: str, swap: Swap, into: str, progress: Callable[[int, int], None]
) -> Swapped:
    """Run a record once more with one member replaced, and record that, where `into` is a name.

    Raises RecordError and WorldFileError; MisuseError where the member or what shall replace it
    cannot be; WorldStopped where user code failed.
    """
    from minerva_bus.log.reader import Record

    if into and Path(into).resolve() == path.resolve():
        raise MisuseError(f"--record {into}: it is the record that is replayed; name another file")
    with Record(path) as record:
        told = record.description
        file = world_file_of(path, world, told, Overrides())
        last = record.last()[0]
        if not last:
            raise MisuseError(f"{path}: there is no frame in it")
        members = list(_members(record, file, swap))
        wanted = frozenset(one.name for one in members)
        played = replace(told.world, frames=last, expected=wanted)
        settings = RecordSettings(into) if into else RecordSettings()
        if into and not into.endswith(".mcap"):
            raise MisuseError(f"a record is a file .mcap, not {into!r}")
        again = replace(file, world=played, record=settings, text=told.file, rate=told.rate)
        return _Rerun(record, again, members, last, progress).run()


# --- who takes part ---


def _members(record: Record, file: WorldFile, swap: Swap) -> Iterator[Participant]:
    """All hosts of agents, the new member, and one who says what was recorded of others."""
    from minerva_bus.log.played import Played

    old = _replaced(file, swap.member)
    others = [one for one in file.processes if one not in old]
    left_out = {event for one in old for event in _generated(one)}
    _check_alone(left_out, others, swap.member)
    player = Played(record, left_out)
    taken = {one.name for one in file.processes}
    yield Participant(next(one for one in PLAYERS if one not in taken), player)
    for one in old:
        new = _new_member(one, swap, file)
        _check_new(new, file, player.publishes, swap)
        yield new
    yield from (one.participant() for one in others if one.agents)


def _replaced(file: WorldFile, member: str) -> list[Process]:
    """The processes of that name, or NAME-1, NAME-2 ... Raises MisuseError for none."""
    found = [one for one in file.processes if one.name == member]
    found = found or [
        one
        for one in file.processes
        if one.name.rpartition("-")[0] == member and one.name.rpartition("-")[2].isdecimal()
    ]
    if not found:
        known = [one.name for one in file.processes]
        raise MisuseError(
            f"--swap {member}: {file.path.name} has no process {member!r}{nearest(member, known)};"
            f" it has {', '.join(known)}"
        )
    return found


def _new_member(old: Process, swap: Swap, file: WorldFile) -> Participant:
    folder = file.path.parent
    if not _names_agents(swap.spec, folder):
        service = find_service(swap.spec, folder)
        options = typed_options(service, swap.options)
        return Participant(old.name, bind(service, options, old.name)())
    if swap.options:
        raise MisuseError(f"--swap {swap.member}: {swap.spec} names agents, which have no options")
    (cls,) = find_agents(swap.spec, folder)
    kept = [one for one in old.agents if one.kind.name != cls.kind.name]
    if len(kept) == len(old.agents):
        kinds = ", ".join(one.kind.name for one in old.agents) or "no agents"
        raise MisuseError(f"--swap {swap.member}: {old.name} runs {kinds}, not {cls.kind.name}")
    return Participant(old.name, None, (*kept, cls))


def _names_agents(spec: str, folder: Path) -> bool:
    if ":" not in spec:
        return spec in entries(AGENTS)
    found = load(spec, folder)
    return isinstance(found, type) and issubclass(found, Agent)


def _generated(process: Process) -> tuple[str, ...]:
    return () if process.command else process.participant().hello().generates


def _check_alone(left_out: set[str], others: list[Process], member: str) -> None:
    """Complain where an event may have come from one who stays. Raises MisuseError."""
    for one in others:
        for event in sorted(left_out.intersection(_generated(one))):
            raise MisuseError(
                f"--swap {member}: {one.name} makes {event}, too, and a record does not say who"
                " has made which"
            )


def _check_new(new: Participant, file: WorldFile, topics: tuple[str, ...], swap: Swap) -> None:
    """Complain of a member that cannot take part. Raises MisuseError."""
    where, service = f"--swap {swap.member}", new.service
    reason = incompatibility(new.hello(), file.world.vocabulary)
    if reason:
        raise MisuseError(f"{where}: {swap.spec}: {reason}")
    if isinstance(service, Generator) and not service.lockstep:
        raise MisuseError(f"{where}: {swap.spec} runs freely, by the clock; here time is simulated")
    for topic in sorted(set(new.topics).difference(topics, new.hello().publishes)):
        raise MisuseError(
            f"{where}: {swap.spec} listens to {topic!r}, which is not in the record; record it with"
            " --record-topics"
        )


# --- the run ---


class _Rerun:
    """One run, frame by frame beside the record."""

    def __init__(
        self,
        record: Record,
        file: WorldFile,
        members: list[Participant],
        last: int,
        progress: Callable[[int, int], None],
    ) -> None:
        self._record = record
        self._strings = record.strings()
        self._file = file
        self._last = last
        self._progress = progress
        self._difference: Difference | None = None
        self._algorithm = FrameAlgorithm(file.world)
        self._members = members

    def run(self) -> Swapped:
        """Run it to its end."""
        from minerva_bus.log.comparison import Difference

        algorithm, said = self._algorithm, list[str]()
        record = self._recording = recording(self._file, algorithm, said.append)
        on_readings = record.sensed if record.topics else None
        runner = InProcessRunner(algorithm, self._members, self._watch, on_readings=on_readings)
        try:
            self._live(runner)
        finally:
            self._recording.close()
            for one in self._members:
                if one.service is not None:
                    one.service.close()
        if said:
            raise MinervaError(said[0])
        ended = runner.ended
        return Swapped(
            self._difference or Difference(None, algorithm.frame),
            algorithm.frame,
            algorithm.scene.digest.hex(),
            ended.reason if ended is not None else "",
            self._last,
            dict(ended.figures) if ended is not None else {},
        )

    def _live(self, runner: InProcessRunner) -> None:
        algorithm = self._algorithm
        try:
            runner.start()
            while runner.ended is None:
                frame = algorithm.frame
                runner.handle(s.Begin())
                if algorithm.frame == frame and runner.ended is None:
                    waited = ", ".join(algorithm.waiting_for()) or "agents that nobody here runs"
                    raise MinervaError(f"it waits for {waited}")
        except MinervaError as error:
            raise WorldStopped(f"frame {algorithm.frame}: {error}") from error
        except Exception as error:
            raise WorldStopped(
                f"frame {algorithm.frame}: {type(error).__name__}: {error}"
            ) from error

    def _watch(self, told: s.Instruction) -> None:
        if isinstance(told, s.Say):
            self._recording.said(told.member, told.text)
        elif isinstance(told, s.FrameDone):
            self._recording.frame(told)
            self._compare(told)
            self._progress(told.frame + 1, self._last)

    def _compare(self, done: s.FrameDone) -> None:
        from minerva_bus.log.comparison import apart, same_events

        if self._difference is not None:
            return
        frame, string = next(self._strings)
        scene = self._algorithm.scene
        if scene.digest != frame.digest or not same_events(frame.events, done.record.events):
            strings = (string, scene) if scene.digest != frame.digest else None
            events = frame.events, done.record.events
            vocabulary = self._file.world.vocabulary
            self._difference = apart(vocabulary, frame, strings, events, SIDES)
