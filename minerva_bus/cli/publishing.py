"""`minerva pub`: sends an event into a running world as a person, and waits for its fate."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Final

from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import FAILED, print_json, print_message, print_result
from minerva_bus.cli.places import client
from minerva_bus.errors import BusError, MinervaError, MisuseError
from minerva_bus.runtime.operator_client import Client
from minerva_bus.world.operator import OrderStatus

POLL_SECONDS: Final = 0.1
NOT_DONE: Final = ("rejected", "dropped", "failed", "replaced")
"""States of orders that end `pub --wait` with FAILED."""


@dataclass(frozen=True, slots=True)
class OrderToSend:
    """An event to send: its type, data as KEY=VALUE, receivers, condition and the sender's name."""

    type: str
    data: tuple[str, ...] = ()
    to: tuple[str, ...] = ()
    condition: str = ""
    by: str = ""


@dataclass(frozen=True, slots=True)
class Waiting:
    """Whether to wait for the fate of an order, at most for this many seconds; 0: no limit."""

    fate: bool = False
    seconds: float = 0.0


def publish(order: OrderToSend, waiting: Waiting, target: WorldTarget, as_json: bool) -> int:
    """Send an event as a person; returns the exit code.

    Raises MisuseError for data that are not KEY=VALUE, and BusError if the world rejects the event
    or ends, or if its fate is not known in time.
    """
    if waiting.seconds and not waiting.fate:
        raise MisuseError("pub: --timeout limits --wait, which is missing")
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
            sent = f"sent{sender}{through}, after frame {answer['frame']} began"
            print_result(f"{answer['event']} {sent}")
            if "note" in answer:
                print_message(f"warning: {answer['note']}")
        fate = _fate(world, int(answer["number"]), waiting) if waiting.fate else None
    if as_json:
        print_json({**answer, "order": None if fate is None else asdict(fate)})
    elif fate is not None:
        print_result(fate.fate)
    return FAILED if fate is not None and fate.state in NOT_DONE else 0


def _pairs(data: tuple[str, ...]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for word in data:
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise MinervaError(f"{word!r}: expected data as KEY=VALUE")
        pairs[name] = value
    return pairs


def _fate(world: Client, number: int, waiting: Waiting) -> OrderStatus:
    """The last state of an order; prints earlier ones as messages."""
    until = time.monotonic() + waiting.seconds if waiting.seconds else float("inf")
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
            raise BusError(f"the order has not ended within {waiting.seconds:g} s: {known}")
        time.sleep(POLL_SECONDS)


def _expected(order: OrderStatus, is_paused: bool) -> str:
    """The state of an open order, and what `pub` waits for."""
    if order.state == "waiting":
        return "the world is paused: minerva resume" if is_paused else "waiting for the next frame"
    return f"{order.fate}; waiting for what becomes of it"
