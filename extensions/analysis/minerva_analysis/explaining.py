"""Why a running world does not advance, and why a value is what it is (`minerva explain`).

The journal of a running world has the inputs of its latest frames, which have to be repeated, at
about a millisecond each. So the search for a change begins at the last keyframe of the journal and
goes back only as far as needed.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from minerva_analysis.causes import (
    MAX_LINKS,
    RECENT,
    Explanation,
    Observation,
    explain_value,
    observe_agent,
)
from minerva_analysis.halts import Halt, explain_halt
from minerva_analysis.past_frames import last_written, wait_for_frame
from minerva_analysis.replays import CODE, world_file_of
from minerva_bus.errors import MinervaError, MisuseError, RecordError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.child_processes import ENDS
from minerva_bus.launch.past import WorldSource, kinds_in
from minerva_bus.launch.registry import temporary_folder
from minerva_bus.log.entries import Kept
from minerva_bus.log.journal import keyframes_in, read_described, resume_from
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.world.agent import Kinds
from minerva_bus.world.operator import LogLine, Operator, WorldStatus

SAMPLE_SECONDS: Final = 0.5
"""Time between two states of the world."""

ANSWER_SECONDS: Final = 1.0
"""Time for a process to write its stacks."""

POLL_SECONDS: Final = 0.02
MAX_MEMBERS: Final = 3
"""Awaited members whose stacks are requested."""


def explain_world(operator: Operator) -> Halt:
    """Why a running world does not advance: who is awaited, in which call, and what to do.

    It takes about half a second. Raises BusError if the world does not answer.
    """
    first = operator.status()
    time.sleep(SAMPLE_SECONDS)
    last = operator.status()
    stacks: dict[str, Sequence[str]] = {}
    if last.frame == first.frame:
        for name in last.waiting[:MAX_MEMBERS]:
            stacks[name] = _stacks_of(operator, name, last)
    return explain_halt(first, last, stacks)


def explained_in(
    record: Record, world: WorldSource | None, name: str, attribute: str, frame: int | None
) -> Explanation | Observation:
    """How an agent's attribute got its value in an open record; without a world no code runs.

    Without an attribute, it is the agent with what it received; see `observe_agent`. Raises
    RecordError and WorldFileError, and ActivityError if user code fails.
    """
    kinds: Kinds = {} if world is None else _kinds_for(record, world)
    if not attribute:
        return observe_agent(record, kinds, name, frame)
    return explain_value(record, kinds, name, attribute, frame)


def _kinds_for(record: Record, world: WorldSource) -> Kinds:
    return kinds_in(world_file_of(record.path, world, record.description, CODE))


def explain_running_value(
    operator: Operator,
    code: WorldSource | None,
    agent: str,
    attribute: str,
    frame: int | None = None,
) -> Explanation | Observation:
    """How an agent's attribute got its value in a running world; see `explain_value`.

    Without an attribute, it is the agent with what it received; see `observe_agent`.

    The frames come from its record, if they are written, because those of the world's journal have
    to be repeated. The latest ones are in the journal only; for an older value, the record follows,
    or the frames between earlier keyframes of the journal. The world is not affected.

    Args:
        operator: the running world, on this machine.
        code: the world with the code of the agents; "": its own world file; None: run no code.
        agent: id of the agent, without #.
        attribute: name of the attribute, or "".
        frame: the value at the beginning of this frame is explained; None: the latest one.

    Raises:
        BusError: the world does not answer.
        MisuseError: neither its journal nor its record is on this machine.
        RecordError: there is no such frame, agent or attribute.

    """
    from minerva_bus.log.channels import check_installed

    check_installed()
    status = operator.status()
    files = {file.name: Path(file.path) for file in status.files if Path(file.path).is_file()}
    journal, path, explanation = files.get("journal"), files.get("record"), None
    wanted = status.frame if frame is None else min(frame, status.frame)
    written = -1 if path is None else last_written(path)
    if journal is not None and written < wanted:
        past = JournaledPast(journal, code, agent, attribute)
        try:
            explanation = past.explain(frame, wanted, written)
        except RecordError:
            if path is None:
                raise
    if path is not None and (explanation is None or explanation.is_older):
        explanation = _explained_by_file(path, code, agent, attribute, frame, wanted, explanation)
    if explanation is None:
        raise MisuseError(
            f"{status.world}: neither its journal nor a record of it is on this machine; run this"
            " where the world runs, or explain a record: minerva run --record FILE.mcap"
        )
    return explanation


def _explained_by_file(
    path: Path,
    code: WorldSource | None,
    agent: str,
    attribute: str,
    frame: int | None,
    wanted: int,
    latest: Explanation | Observation | None,
) -> Explanation | Observation:
    """The explanation by a record that is being written; `latest` is that by the journal."""
    from minerva_analysis.causes import Explanation
    from minerva_bus.log.record import Record

    # The value is the same since the beginning of the frames that were repeated. Without a journal,
    # the record alone has the latest frames.
    known = latest.first if isinstance(latest, Explanation) else None
    wait_for_frame(path, wanted if known is None else known)
    with Record(path) as record:
        older = explained_in(record, code, agent, attribute, frame if known is None else known)
    return older if latest is None else continued(latest, older)


def _stacks_of(operator: Operator, name: str, status: WorldStatus) -> Sequence[str]:
    """The stacks of a member of the world file; empty if it is another one or does not answer."""
    if not any(member.name == name and member.expected for member in status.members):
        return ()
    since = max((line.number for line in operator.logs(member=name)), default=0)
    try:
        operator.stack(name)
    except MinervaError:
        return ()  # It runs elsewhere, or this operator may only observe.
    until = time.monotonic() + ANSWER_SECONDS
    while time.monotonic() < until:
        lines = _texts(operator.logs(since, name))
        if any(line in ENDS for line in lines):
            return lines
        time.sleep(POLL_SECONDS)
    return ()


def _texts(lines: Sequence[LogLine]) -> list[str]:
    return [line.text for line in lines]


@dataclass(frozen=True, slots=True)
class JournaledPast:
    """The past of an agent's attribute in a journal; the fields are those of `explained_in`."""

    journal: Path
    code: WorldSource | None
    agent: str
    attribute: str

    def explain(self, frame: int | None, wanted: int, written: int) -> Explanation | Observation:
        """How the attribute got its value, or that it is older than the frames that were repeated.

        `wanted` is the number of the frame, `written` the last one of the world's record, which has
        the frames before the first keyframe that is not after it. Raises RecordError.
        """
        starts = starts_before(keyframes_in(self.journal), wanted)
        for begin in starts[:-1]:
            try:
                explanation, first = self._since(begin, frame)
            except RecordError:
                continue  # The agent may have disappeared before these frames.
            if isinstance(explanation, Observation) or explanation.since >= first + MAX_LINKS:
                return explanation
            if explanation.is_older and first <= written:
                return explanation
        return self._since(starts[-1], frame)[0]

    def _since(self, begin: int, frame: int | None) -> tuple[Explanation | Observation, int]:
        with (
            temporary_folder("explain") as folder,
            recent_record(self.journal, folder, begin) as record,
        ):
            explanation = explained_in(record, self.code, self.agent, self.attribute, frame)
            return explanation, record.initial.number


def starts_before(keyframes: Sequence[int], frame: int) -> list[int]:
    """The keyframes from which the frames up to `frame` are repeated, in turn.

    Each time twice as many, so all attempts take at most twice the time of the last. An answer
    needs some frames before its own.
    """
    near = [number for number in reversed(keyframes) if number + RECENT <= frame]
    picked: list[int] = [near[2**n - 1] for n in range((len(near) + 1).bit_length() - 1)]
    first = keyframes[0] if keyframes else 0
    return [*picked, *([] if picked[-1:] == [first] else [first])]


def continued(
    recent: Explanation | Observation, older: Explanation | Observation
) -> Explanation | Observation:
    """An explanation of a value that is the same since the frames of `recent`, by `older` ones."""
    if isinstance(recent, Observation) or isinstance(older, Observation):
        return recent
    return replace(older, frame=recent.frame, value=recent.value, rejected=recent.rejected)


@contextmanager
def recent_record(journal: Path, folder: Path, begin: int = 0) -> Generator[Record]:
    """A record of the frames in a journal, made in a folder: the frame algorithm repeats them.

    It starts at the last keyframe that is not after frame `begin`, or at the first. The journal may
    be that of a running world; it is only read.

    Raises:
        RecordError: there is no such journal, it is damaged, or no frame is in it.

    """
    # A device would be read forever; the name may be from another machine.
    if not journal.is_file():
        raise RecordError(f"{journal}: there is no journal on this machine")
    described, journaled = read_described(journal, begin)
    if not journaled.inputs:
        raise RecordError(f"{journal}: no frame has ended since it was begun; try again")
    description = replace(described, world=journaled.world, frame=journaled.keyframe.number)
    path = folder / f"{description.world.name}.mcap"
    algorithm = FrameAlgorithm(journaled.world)
    with path.open("wb") as stream:
        writer = RecordWriter(stream, description)

        def write(done: s.FrameDone) -> None:
            writer.frame(done, algorithm.scene, 0.0, {}, Kept.of(algorithm.checkpoint))

        resume_from(journaled, algorithm, write)
        writer.finish()
    with Record(path) as record:
        # Messages name the world, not a file that is removed.
        record.path = Path(description.world.name)
        yield record
