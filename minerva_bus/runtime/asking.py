"""Queries to a world's coordinator, and an operator that controls the world through them."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from minerva_bus.errors import BusError, MisuseError
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.keys import ANY_WORLD, asking_key, control_key
from minerva_bus.wire.plain import as_int, as_list, as_map, as_text, pack, unpack
from minerva_bus.wire.status_codec import read_lines, read_orders, read_series, read_status
from minerva_bus.wire.strings_codec import plain_event
from minerva_bus.world.operator import CollectedSeries, LogLine, OrderStatus, WorldStatus


def question_key(world: str, own: Credentials | None) -> str:
    """Key for questions to a world by name; an empty name stands for any world at the endpoint."""
    name = world or ANY_WORLD
    if own is None:
        return control_key(name)
    return control_key(name, own.name) if own.operates else asking_key(name, own.name)


def ask(
    session: zenoh.Session, key: str, question: str, seconds: float, details: Mapping[str, Any]
) -> Mapping[str, Any] | None:
    """The world's answer to a question, or None if none arrives within `seconds`.

    Raises BusError if the world rejects the question.
    """
    try:
        replies = session.get(key, payload=pack({"ask": question, **details}), timeout=seconds)
    except zenoh.ZError as error:
        raise BusError(f"the question cannot be sent: {error}") from None
    # A key for any world may have several answers; the first one counts.
    for reply in replies:
        if reply.ok is not None:
            answer = as_map(unpack(reply.ok.payload.to_bytes()), "an answer")
            if "error" in answer:
                raise BusError(as_text(answer["error"], "an error"))
            return answer
    return None


class AskingOperator:
    """Operates a world through questions, as commands, windows and pages do.

    Args:
        ask: sends a question and returns the coordinator's answer.
        by: name of the person or window that gives orders.

    """

    def __init__(self, ask: Callable[..., Mapping[str, Any]], by: str = "") -> None:
        self._ask = ask
        self._by = by

    def named(self, by: str) -> AskingOperator:
        """The same operator for another person; an empty name leaves that of the process."""
        return AskingOperator(self._ask, by or self._by)

    def status(self, since: int = 0) -> WorldStatus:
        """State of the world, with the log entries since a number."""
        return read_status(self._ask("status", since=since).get("status"))

    def fragment(self, agent: str) -> str:
        """The text of one agent."""
        return as_text(self._ask("fragment", agent=agent).get("fragment"), "the fragment")

    def order(self, event: AnyEvent) -> int:
        """Send an event to the world; returns the number of the order.

        Raises MisuseError for anything but events, such as its type.
        """
        if not isinstance(event, Event | Events):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise MisuseError(f"expected an event, such as eSun(heat=0.5), not {event!r:.60}")
        answer = self._ask("order", event=plain_event(event), by=self._by)
        return as_int(answer.get("number", 0), "the number of an order")

    def pause(self) -> None:
        """Pause the world until `resume` or `step`."""
        self._ask("pause", by=self._by)

    def resume(self) -> None:
        """Resume a paused world."""
        self._ask("resume", by=self._by)

    def step(self, frames: int = 1) -> None:
        """Run a number of frames, then pause."""
        self._ask("step", frames=frames, by=self._by)

    def seek(self, frame: int) -> None:
        """Continue the replay of a record at a frame."""
        self._ask("seek", frame=frame)

    def set_rate(self, rate: float) -> None:
        """Set the frames per second; 0: as many as possible."""
        self._ask("rate", rate=rate, by=self._by)

    def restart(self, member: str) -> None:
        """Restart a process of the world file."""
        self._ask("restart", member=member, by=self._by)

    def stack(self, member: str) -> None:
        """Write the stacks of a process of the world file to its log."""
        self._ask("stack", member=member)

    def drain(self, member: str) -> tuple[str, ...]:
        """Move a host's agents to other hosts; returns the names of these hosts."""
        hosts = as_list(self._ask("drain", member=member, by=self._by).get("to"), "hosts")
        return tuple([as_text(host, "a host") for host in hosts])

    def logs(self, since: int = 0, member: str = "") -> tuple[LogLine, ...]:
        """Lines that members printed, and warnings about them."""
        return read_lines(self._ask("logs", since=since, member=member).get("lines"))

    def orders(self, since: int = 0) -> tuple[OrderStatus, ...]:
        """Orders of people that have changed."""
        return read_orders(self._ask("orders", since=since).get("orders"))

    def series(self) -> tuple[CollectedSeries, ...]:
        """Collected series."""
        return read_series(self._ask("series").get("series"))
