"""Operating a running world: pace, processes, logs, and events that people send."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final

from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import (
    FAILED,
    Done,
    print_answer,
    print_error,
    print_json,
    print_message,
    print_result,
)
from minerva_bus.cli.places import client
from minerva_bus.errors import MinervaError, nearest
from minerva_bus.launch.console import json_line
from minerva_bus.runtime.operator_client import Client
from minerva_bus.world.operator import LogLine, OrderStatus

POLL_SECONDS: Final = 0.1
COORDINATOR: Final = ("coordinator", "norms", "orders")
"""Names under which the coordinator logs lines that are about no member."""

MAX_LINES: Final = 1000
"""Lines in one answer of the world."""

NOT_DONE: Final = ("rejected", "dropped", "failed", "replaced")
"""States of orders that end `pub --wait` with FAILED."""


def operate(
    ask: Callable[[Client], object], text: str, target: WorldTarget, as_json: bool, **fields: Any
) -> None:
    """Ask a world to do something; print the text, or an object with the fields."""
    with client(target) as world:
        ask(world)
        print_done(world, as_json, text, **fields)


def pause_after(ask: Callable[[Client], object], target: WorldTarget, as_json: bool) -> None:
    """Ask a world for something that pauses it, and wait for the pause."""
    with client(target) as world:
        ask(world)
        frame = _paused_before(world)
        print_done(world, as_json, f"paused before frame {frame}", frame=frame)


def drain_member(member: str, by: str, target: WorldTarget, as_json: bool) -> None:
    """Move the agents of a host to other hosts."""
    with client(target) as world:
        hosts = world.operator.named(by).drain(member)
        text = f"the agents of {member} move to {', '.join(hosts)}"
        print_done(world, as_json, text, member=member, hosts=hosts)


def print_done(world: Client, as_json: bool, text: str, **fields: Any) -> None:
    """Print what a command has done to a world, with the fields of its JSON object."""
    done = Done(f"{world.world}: {text}", {"world": world.world, **fields})
    print_answer(done, as_json)


def _paused_before(world: Client) -> int:
    """Wait until the world has paused and return its frame; report members it waits for."""
    reported: tuple[str, ...] = ()
    while True:
        status = world.operator.status()
        # Another operator may resume the world meanwhile, so this must not wait for a pause.
        resumed = not status.paused and not status.left
        if resumed or (status.paused and status.phase == "between frames"):
            return status.frame
        if status.waited > 1 and status.waiting != reported:
            reported = status.waiting
            print_message(f"waiting for {', '.join(reported)}")
        time.sleep(POLL_SECONDS)


def show_logs(member: str, follow: bool, target: WorldTarget, as_json: bool) -> None:
    """Print the logs of members, with the messages of the world about them."""
    with client(target) as world:
        _check_member(world, member)
        since, answered = 0, False
        while True:
            try:
                lines = world.operator.logs(since, member)
            except MinervaError:
                # A world that has never answered cannot have ended: the problem is the connection.
                if not (follow and answered):
                    raise
                return  # The followed world has ended.
            answered = True
            for line in lines:
                print_result(_json(line, world.world) if as_json else _shown(line))
                since = line.number
            # A full answer may not be the last one.
            if not follow and len(lines) < MAX_LINES:
                return
            if follow:
                time.sleep(POLL_SECONDS)


def _check_member(world: Client, member: str) -> None:
    known = [each.name for each in world.operator.status().members]
    if member and member not in [*known, *COORDINATOR]:
        raise MinervaError(f"{world.world} has no member {member!r}{nearest(member, known)}")


def _json(line: LogLine, world: str) -> str:
    return json_line(line.time, line.level, world, line.frame, line.member, line.text)


def _shown(line: LogLine) -> str:
    clock = time.strftime("%H:%M:%S", time.localtime(line.time))
    return f"{clock}  {line.member} │ {line.text}"


@dataclass(frozen=True, slots=True)
class OrderToSend:
    """An event to send: its type, data as KEY=VALUE, receivers, condition and the sender's name."""

    type: str
    data: tuple[str, ...] = ()
    to: tuple[str, ...] = ()
    condition: str = ""
    by: str = ""


def publish(order: OrderToSend, wait: float | None, target: WorldTarget, as_json: bool) -> int:
    """Send an event as a person; returns the exit code.

    `wait`: longest time to wait for the fate of the order, seconds; 0: no limit, None: do not wait.
    Raises MisuseError for data that are not KEY=VALUE, and BusError if the world rejects the event
    or ends.
    """
    pairs = _pairs(order.data)
    with client(target) as world:
        answer = world.ask(
            "pub",
            type=order.type,
            data=pairs,
            receivers=list(order.to),
            condition=order.condition,
            by=order.by,
        )
        if not as_json:
            through = f" through {', '.join(answer['through'])}" if answer["through"] else ""
            sender = f" by {answer['by']}" if answer["by"] else ""
            # It counts in this frame or in the next one, which the log says.
            print_result(f"{answer['event']} sent{sender}{through}")
            if "note" in answer:
                print_message(f"warning: {answer['note']}")
        fate = None if wait is None else _fate(world, int(answer["number"]), wait)
    if as_json:
        print_json({**answer, "order": None if fate is None else asdict(fate)})
    elif fate is not None:
        print_result(fate.fate)
    ended = wait is None or (fate is not None and not fate.open and fate.state not in NOT_DONE)
    return 0 if ended else FAILED


def _pairs(data: tuple[str, ...]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for word in data:
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise MinervaError(f"{word!r}: expected data as KEY=VALUE")
        pairs[name] = value
    return pairs


def _fate(world: Client, number: int, wait: float) -> OrderStatus | None:
    """The last known state of an order, open if it has not ended in time; prints earlier ones."""
    until = time.monotonic() + wait if wait else float("inf")
    since, order = 0, None
    while True:
        for changed in world.operator.orders(since):
            since = changed.change
            if changed.number != number:
                continue
            order = changed
            if not order.open:
                return order
            print_message(_expected(order, world.operator.status().paused))
        if time.monotonic() > until:
            known = "unknown" if order is None else order.fate
            print_error(f"the order is still open after {wait:g} s: {known}")
            return order
        time.sleep(POLL_SECONDS)


def _expected(order: OrderStatus, is_paused: bool) -> str:
    """The state of an open order, and what `pub` waits for."""
    if order.state == "waiting":
        return "the world is paused: minerva resume" if is_paused else "waiting for the next frame"
    follows = "what becomes of it" if order.state == "accepted" else "another agent to complete it"
    return f"{order.fate}; waiting for {follows}"
