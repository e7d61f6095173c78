"""`minerva explain WORLD`: asks a running world why it does not advance."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Final

from minerva_bus.errors import MinervaError
from minerva_bus.launch.halts import Halt, explain_halt
from minerva_bus.launch.traces import ENDS
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
