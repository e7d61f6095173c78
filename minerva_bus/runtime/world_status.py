"""The status of a running world for people and tools: its activity, its members, as an object.

Commands, windows, pages and tools show the same facts; only their form differs.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

from minerva_bus.world.operator import MemberStatus, WorldStatus

LONG_WAIT: Final = 0.5
"""Seconds after which it is shown that a frame waits for members; shorter waits are normal."""


def awaited(status: WorldStatus) -> tuple[str, ...]:
    """The members for which the frame has waited for LONG_WAIT seconds or more."""
    return status.waiting if status.waited >= LONG_WAIT else ()


def activity(status: WorldStatus, most: int = 4) -> str:
    """What the world does: it runs, is paused, or waits for members, of which `most` are named."""
    if names := awaited(status):
        others = " …" if len(names) > most else ""
        return f"waiting for {', '.join(names[:most])}{others}"
    # A paused world may still run the frames of a step.
    return "paused" if status.paused and not status.left else "running"


def types_of(member: MemberStatus) -> str:
    """The kinds that a member hosts, and the event types that it generates and draws."""
    return " ".join([*member.kinds, *member.generates, *member.draws])


def status_object(status: WorldStatus) -> dict[str, Any]:
    """The status as a JSON object, without its log entries."""
    return {**asdict(status), "happenings": []}
