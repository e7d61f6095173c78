"""A recorded run again with one member replaced: `minerva swap FILE MEMBER=SPEC`.

All agents run again, and the new member generates its own events; all other members repeat what was
recorded. Thus two planners, or two views, can be compared in the same world. Time is simulated, and
everything runs in this process.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from minerva_analysis.comparing import Difference
from minerva_analysis.replays import (
    RECORDED,
    Rerun,
    no_frame,
    no_progress,
    recorded_inputs,
    world_file_of,
)
from minerva_bus.api.world import World
from minerva_bus.errors import (
    MinervaError,
    MisuseError,
    WorldStopped,
    nearest,
)
from minerva_bus.files import check_ending
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.member_table import incompatibility
from minerva_bus.frame.messages import Readings
from minerva_bus.frame.stimuli import FrameInputs, RecordedFrame
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.past import WorldSource
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.run_outputs import recording
from minerva_bus.launch.specs import Factory, find_agent, find_service, folder_of, names_agents
from minerva_bus.launch.toml_tables import option_text, typed_options
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.log.record import Record
from minerva_bus.runtime.runner import InProcessRunner, Notice
from minerva_bus.settings.world_settings import Overrides, RecordSettings
from minerva_bus.values import path_of, text
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Generator, Service, Tick

READERS: Final = ("record", "recorded", "~record")
"""Names for the member that publishes recorded readings; the first free one is used."""


@dataclass(frozen=True, slots=True)
class Without:
    """The inputs that are not fed: those of `members`, and views that only they request.

    A record without inputs does not name the sender of an event, so `types` are left out.
    """

    members: frozenset[str] = frozenset()
    draws: frozenset[str] = frozenset()
    types: frozenset[str] = frozenset()

    def inputs(self, frame: RecordedFrame) -> FrameInputs:
        """The inputs of the algorithm for a recorded frame."""
        inputs = recorded_inputs(frame)
        if frame.inputs is None:
            events = inputs.taken.get(RECORDED, ())
            sent = [event for event in events if event.type not in self.types]
            return replace(inputs, taken={RECORDED: sent} if sent else {})
        return replace(
            inputs,
            due=tuple(name for name in inputs.due if name not in self.draws),
            ticked={k: reply for k, reply in inputs.ticked.items() if k not in self.members},
            taken={k: events for k, events in inputs.taken.items() if k not in self.members},
        )


@dataclass(frozen=True, slots=True)
class Swap:
    """The member to replace, its replacement, and the options of that.

    `spec` is a class, an installed name or `module:Class`; `options` are texts, as on a command
    line.
    """

    member: str
    spec: str | type[Agent] | type[Service]
    options: Mapping[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def read(cls, text: str, options: Mapping[str, str]) -> Swap:
        """`MEMBER=SPEC`. Raises MisuseError."""
        member, equals, spec = text.partition("=")
        if not (member and equals and spec):
            raise MisuseError(f"swap {text}: expected MEMBER=SPEC, such as planner=module:Class")
        return cls(member.strip(), spec.strip(), options)

    def __str__(self) -> str:
        return self.spec if isinstance(self.spec, str) else self.spec.__name__

    def find(self, folder: Path) -> type[Agent] | type[Service]:
        """The new class; the world file's `folder` is searched, too. Raises WorldFileError."""
        if not isinstance(self.spec, str):
            return _checked(self.spec)
        folder = folder_of(self.spec, folder)
        if names_agents(self.spec, folder):
            return find_agent(self.spec, folder)
        return find_service(self.spec, folder)


@dataclass(frozen=True, slots=True)
class Swapped:
    """Result of a run with a replaced member: its first difference, and its end."""

    difference: Difference
    frames: int
    digest: str
    ended: str
    recorded: int
    figures: Mapping[str, bool | int | float | str]

    def plain(self) -> dict[str, Any]:
        """The result as a JSON object."""
        ended = {"frames": self.frames, "digest": self.digest, "ended": self.ended}
        compared = {"recorded": self.recorded, "figures": dict(self.figures)}
        return {**ended, **compared, "difference": self.difference.plain()}

    def lines(self) -> list[str]:
        """The result as lines of text."""
        over = f"{self.ended}: {self.frames:,} frames of {self.recorded:,}, digest {self.digest}"
        figures = [f"{name} {value}" for name, value in self.figures.items()]
        return [*self.difference.lines(), over, *([", ".join(figures)] if figures else [])]


def _checked(cls: object) -> type[Agent] | type[Service]:
    """A class that was given in Python. Raises MisuseError if it is not that of a member."""
    if inspect.isclass(cls) and issubclass(cls, Agent | Service):
        return cls
    raise MisuseError(f"{cls!r:.60} is not a class of agents, generators or devices")


def replay_swapped(
    record: str | Path,
    member: str,
    replacement: type[Agent] | type[Service] | str,
    world: World | str | Path = "",
    *,
    options: Mapping[str, Any] | None = None,
    into: str | Path = "",
    progress: Callable[[int, int], None] | None = None,
) -> Swapped:
    """Run a recorded world again with one member replaced, up to the end of its record.

    All agents run again; all other members repeat what was recorded. Time is simulated, and
    everything runs in this process.

    Args:
        record: the file, .mcap.
        member: the name of a process; `rabbits` is `rabbits-1`, `rabbits-2` and so on.
        replacement: a class of agents, generators or devices, an installed name, or
            `module:Class`. Of several kinds of agents, it replaces that with the same symbol.
        world: the world with the code of all other members; "": the world file that the record
            names.
        options: of the new generator or device.
        into: records this run in another file, .mcap; default: none.
        progress: called with the number of completed frames and the total.

    Returns:
        The end of the run (`frames`, `digest`, `ended`, `figures`), and the first `difference` from
        the record.

    Raises:
        RecordError: the record cannot be read.
        MisuseError: the member or its replacement cannot be used.
        WorldFileError: there is no such class, option or world file.
        WorldStopped: code of a member failed.

    Example:
        `replay_swapped("run.mcap", "weather", Storm, options={"wind": 20.0}).difference.frame`

    """
    texts = {name: option_text(value) for name, value in (options or {}).items()}
    swap, path = Swap(text("member", member), replacement, texts), path_of("record", record)
    source = world.read if isinstance(world, World) else str(world)
    return run_swapped(path, source, swap, str(into), progress or no_progress)


def run_swapped(
    path: Path, world: WorldSource, swap: Swap, into: str, progress: Callable[[int, int], None]
) -> Swapped:
    """Compute a recorded run again with one member replaced; `into` names a record of it.

    Raises RecordError and WorldFileError; MisuseError if the member or its replacement cannot be
    used; WorldStopped if user code fails.
    """
    return _again(path, world, into, progress, lambda record, file: _members(record, file, swap))


def run_again(
    path: Path, world: WorldSource, into: str, progress: Callable[[int, int], None]
) -> Swapped:
    """Compute a recorded run with today's code, up to the first difference.

    Agents run again, and generators in step unless they need readings that were not recorded. What
    people and all others sent is repeated. Raises as `run_swapped`.
    """
    return _again(path, world, into, progress, _members_again, to_difference=True)


def _again(
    path: Path,
    world: WorldSource,
    into: str,
    progress: Callable[[int, int], None],
    members_of: Callable[[Record, WorldFile], tuple[list[Member], Without]],
    *,
    to_difference: bool = False,
) -> Swapped:
    # The new record would replace the file while it is read.
    if into and Path(into).resolve() == path.resolve():
        raise MisuseError(f"--record {into}: it is the record that is replayed; name another file")
    with Record(path) as record:
        description = record.description
        file = world_file_of(path, world, description, Overrides())
        last = record.last()[0]
        if not last:
            raise no_frame(record)
        members, without = members_of(record, file)
        expected = frozenset(member.name for member in members)
        played = replace(description.world, frames=last, expected=expected)
        settings = RecordSettings(into) if into else RecordSettings()
        if into:
            check_ending(Path(into), (".mcap",), "record")
        again = replace(
            file, world=played, record=settings, text=description.file, rate=description.rate
        )
        return _run(record, again, members, without, progress, to_difference)


# --- members ---


def _members(record: Record, file: WorldFile, swap: Swap) -> tuple[list[Member], Without]:
    """Hosts, the new member and recorded readings; and the inputs that they replace."""
    old = _replaced(file, swap.member)
    reader = _reader(record, file)
    new = [_new_member(process, swap, file) for process in old]
    for member in new:
        _check_new(member, file, reader.hello().publishes, swap)
    return _beside(file, old, reader, new)


def _members_again(record: Record, file: WorldFile) -> tuple[list[Member], Without]:
    """All members that can run again, and the inputs that they replace."""
    reader, generators = _reader(record, file), list[tuple[ProcessSpec, Member]]()
    for process in file.processes:
        member = None if process.command else process.make_member()
        if member is None or not isinstance(member.service, Generator):
            continue
        if member.when.is_awaited and set(member.topics) <= set(reader.hello().publishes):
            generators.append((process, member))
    return _beside(file, [process for process, _ in generators], reader, [m for _, m in generators])


def _responding(vocabulary: Vocabulary, members: Iterable[Member]) -> Vocabulary:
    """The vocabulary with the events that the agents of these members respond to."""
    kinds = dict(vocabulary.kinds)
    for kind in (kind for member in members for kind in member.hello().kinds):
        if kind.name in kinds:
            kinds[kind.name] = replace(
                kinds[kind.name], subscribes=kind.subscribes, views=kind.views, chances=kind.chances
            )
    return replace(vocabulary, kinds=kinds)


def _reader(record: Record, file: WorldFile) -> Member:
    """The member that publishes recorded readings; it needs a name that no process has."""
    names = {process.name for process in file.processes}
    return Member(next(name for name in READERS if name not in names), RecordedReadings(record))


def _beside(
    file: WorldFile, old: list[ProcessSpec], reader: Member, new: list[Member]
) -> tuple[list[Member], Without]:
    """The members of a run in which `new` take the places of `old`, and the inputs not to feed."""
    others = [process for process in file.processes if process not in old]
    # A command has none of these: what it offers is known only when it joins.
    hellos = [process.make_member().hello() for process in old]
    hosts = [process.make_member() for process in others if process.agents]
    drawn = {event for process in others for event in process.make_member().hello().draws}
    without = Without(
        frozenset(process.name for process in old),
        frozenset(event for hello in hellos for event in hello.draws) - drawn,
        frozenset(event for hello in hellos for event in hello.generates),
    )
    return [reader, *new, *hosts], without


def _replaced(file: WorldFile, member: str) -> list[ProcessSpec]:
    """The processes of that name, or NAME-1, NAME-2 ... Raises MisuseError if there are none."""
    processes = [process for process in file.processes if process.name == member]
    processes = processes or [
        process
        for process in file.processes
        if process.name.rpartition("-")[0] == member and process.name.rpartition("-")[2].isdecimal()
    ]
    if not processes:
        known = [process.name for process in file.processes]
        hint = nearest(member, known, f"it has {', '.join(known)}")
        raise MisuseError(f"swap {member}: {file.path.name} has no process {member!r}{hint}")
    return processes


def _new_member(old: ProcessSpec, swap: Swap, file: WorldFile) -> Member:
    cls = swap.find(file.path.parent)
    if issubclass(cls, Service):
        options = typed_options(cls, swap.options)
        return replace(old, make_service=Factory(cls, options, old.name)).make_member()
    if swap.options:
        raise MisuseError(f"swap {swap.member}: {swap} names agents, which have no options")
    kept = [agent for agent in old.agents if agent.kind.name != cls.kind.name]
    if len(kept) == len(old.agents):
        kinds = ", ".join(agent.kind.name for agent in old.agents) or "no agents"
        raise MisuseError(f"swap {swap.member}: {old.name} runs {kinds}, not {cls.kind.name}")
    return Member(old.name, None, (*kept, cls))


def _check_new(new: Member, file: WorldFile, topics: tuple[str, ...], swap: Swap) -> None:
    """Raises MisuseError if a member cannot take part."""
    where, service = f"swap {swap.member}", new.service
    reason = incompatibility(new.hello(), _responding(file.world.vocabulary, [new]))
    if reason:
        raise MisuseError(f"{where}: {swap}: {reason}")
    if isinstance(service, Generator) and not new.when.is_awaited:
        raise MisuseError(f"{where}: {swap} runs freely, by the clock; here time is simulated")
    for topic in sorted(set(new.topics).difference(topics, new.hello().publishes)):
        raise MisuseError(
            f"{where}: {swap} listens to {topic!r}, which is not in the record; record it with"
            " --record-topics"
        )


# --- the run ---


def _run(
    record: Record,
    file: WorldFile,
    members: list[Member],
    without: Without,
    progress: Callable[[int, int], None],
    to_difference: bool,
) -> Swapped:
    # A record of this run keeps the vocabulary of the world file, with which it is replayed.
    vocabulary = _responding(file.world.vocabulary, members)
    algorithm = FrameAlgorithm(replace(file.world, vocabulary=vocabulary))
    rerun = Rerun(record, algorithm, without.inputs)
    problems: list[str] = []
    again = recording(file, algorithm, problems.append)

    def watch(notice: Notice) -> None:
        if isinstance(notice, s.Notify):
            again.said(notice.member, notice.text)
        elif isinstance(notice, s.FrameDone):
            progress(notice.frame + 1, file.world.frames)

    on_readings = again.sensed if again.topics else None
    runner = InProcessRunner(
        algorithm, members, rerun.compare, again, watch, on_readings=on_readings
    )
    try:
        rerun.run(runner, to_difference=to_difference)
    except Exception as error:
        own = isinstance(error, MinervaError)
        problem = error if own else f"{type(error).__name__}: {error}"
        raise WorldStopped(f"frame {algorithm.frame}: {problem}") from error
    finally:
        # Services may hold files or devices, so they are closed after a failure, too.
        again.close()
        for member in members:
            if member.service is not None:
                member.service.close()
    # The run and its comparison are complete, but the requested record is not.
    if problems:
        raise MinervaError(problems[0])
    ended = runner.ended
    return Swapped(
        rerun.result(),
        algorithm.frame,
        algorithm.scene.digest.hex(),
        ended.reason if ended is not None else "",
        file.world.frames,
        dict(ended.figures) if ended is not None else {},
    )


# --- recorded readings as a generator ---


class RecordedReadings(Generator):
    """Publishes the recorded readings of each frame, by topic and member; makes no events."""

    def __init__(self, record: Record) -> None:
        self._readings = _by_frame(record)
        self._ahead = next(self._readings, None)
        sensed = (message for _, message in record.sensed())
        self.publishes = tuple(sorted({m.topic for m in sensed if isinstance(m, Readings)}))

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        """Publish the readings up to this frame."""
        due: list[Readings] = []
        while self._ahead is not None and self._ahead[0] <= tick.number:
            due.append(self._ahead[1])
            self._ahead = next(self._readings, None)
        # By topic and publisher, the order in which members process
        # readings (PROTOCOL.md, section 11).
        for message in sorted(due, key=lambda message: (message.topic, message.member)):
            for reading in message.readings:
                tick.publish(message.topic, reading)
        return ()


def _by_frame(record: Record) -> Iterator[tuple[int, Readings]]:
    """Recorded readings with their frames, in the order of frames."""
    dt = record.description.world.dt
    sensed = [
        (round(time / dt), place, message)
        for place, (time, message) in enumerate(record.sensed())
        if isinstance(message, Readings)
    ]
    sensed.sort(key=lambda item: item[:2])
    return ((frame, message) for frame, _, message in sensed)
