"""`minerva explain WORLD`: why a running world does not advance, and why a value is what it is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.launch.child_processes import ENDS
from minerva_bus.launch.halts import Halt, explain_halt
from minerva_bus.launch.replays import explained_in
from minerva_bus.world.operator import LogLine, Operator, WorldStatus

if TYPE_CHECKING:
    from minerva_bus.launch.past import WorldSource
    from minerva_bus.log.explanation import Explanation
    from minerva_bus.log.observation import Observation

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
    from minerva_bus.errors import RecordError
    from minerva_bus.launch.journaled_past import JournaledPast
    from minerva_bus.launch.written_frames import last_written
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
    from minerva_bus.launch.journaled_past import continued
    from minerva_bus.launch.written_frames import wait_for_frame
    from minerva_bus.log.explanation import Explanation
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
