"""When a member takes part in frames: the text `when` of its class and of its hello, as a value.

    in step          a generator: each frame asks it and waits for its events
    on orders        a generator: its first frame asks it, and frames with orders for it
    freely           a generator: no frame asks it, it sends events at any time
    each frame       a device: its view is made in each frame
    each N frames    a device: its view is made in each frame that N divides;
                     a generator in step that draws nothing: only these frames ask it
    at N Hz          a device: its view is made at most N times per second

A generator without a term of the first three is in step. A device without a term of the last three
gets a view when another member or an agent sends the visual event.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from minerva_bus.errors import MisuseError

_POSSIBLE: Final = (
    '"in step", "on orders", "freely", "each frame", "each N frames" and "at N Hz", with a comma'
    ' between two of them, as in "freely, each 2 frames"'
)
_EACH: Final = re.compile(r"each (?:frame|([0-9]{1,18}) frames)")
_RATE: Final = re.compile(r"at ([0-9]+(?:\.[0-9]+)?(?:e[+-]?[0-9]+)?) Hz")


class Participation(StrEnum):
    """When frames ask a generator for its events; `NEVER` if the member is none."""

    NEVER = ""
    IN_STEP = "in step"
    ON_ORDERS = "on orders"
    FREELY = "freely"


@dataclass(frozen=True, slots=True)
class When:
    """When a member takes part in frames; `str` makes its text.

    `asked`: when it is asked for events. `every` > 0: the frames from one view of a device to the
    next, or from one request of a generator that draws nothing to the next. `rate` > 0: the most
    views of a device per second.
    """

    asked: Participation = Participation.NEVER
    every: int = 0
    rate: float = 0.0

    def __str__(self) -> str:
        terms = [str(self.asked)] if self.asked else []
        if self.every:
            terms.append("each frame" if self.every == 1 else f"each {self.every} frames")
        if self.rate:
            short = f"{self.rate:g}"
            terms.append(f"at {short if float(short) == self.rate else repr(self.rate)} Hz")
        return ", ".join(terms)

    @classmethod
    def read(cls, text: str) -> When:
        """The value of a text. Raises MisuseError."""
        when = cls()
        for term in text.split(", ") if text else ():
            when = when._with(term, text)
        return when

    def _with(self, term: str, text: str) -> When:
        where = f'when = "{text:.80}"'
        if term in (Participation.IN_STEP, Participation.ON_ORDERS, Participation.FREELY):
            if self.asked:
                raise MisuseError(f'{where}: choose one of "{self.asked}" and "{term}"')
            return replace(self, asked=Participation(term))
        each, at = _EACH.fullmatch(term), _RATE.fullmatch(term)
        if (each or at) and (self.every or self.rate):
            before = replace(self, asked=Participation.NEVER)
            raise MisuseError(f'{where}: choose one of "{before}" and "{term}"')
        every, rate = int(each[1] or 1) if each else 0, float(at[1]) if at else 0.0
        if every or 0 < rate < math.inf:
            return replace(self, every=every, rate=rate)
        if each or at:
            raise MisuseError(f'{where}: expected a number above 0 in "{term}"')
        raise MisuseError(f'{where}: "{term:.80}" is not possible; it may have {_POSSIBLE}')

    @property
    def is_awaited(self) -> bool:
        """Whether frames wait for the events of this generator."""
        return self.asked in (Participation.IN_STEP, Participation.ON_ORDERS)


def objection(
    when: When, *, draws: bool, generates: bool, topics: bool, publishes: bool, orders: bool
) -> str:
    """Why a member with these abilities cannot take part at these times, or an empty string."""
    if when.rate and not draws:
        return f'its `when` is "{when}", but it draws no views'
    if generates and not when.asked:
        return 'it sends events, so its `when` needs "in step", "on orders" or "freely"'
    if when.every and not draws and when.asked is not Participation.IN_STEP:
        return f'its `when` is "{when}", but it draws no views and is not in step'
    reasons = {"subscribes to topics": topics, "publishes on topics": publishes}
    if when.asked is Participation.ON_ORDERS:
        needs = {"draws views": draws, **reasons}
        what = "so it has events on orders only"
    elif when.every and not draws:
        needs, what = {**reasons, "takes orders": orders}, "so some frames do not ask it"
    else:
        return ""
    reason = next((reason for reason, applies in needs.items() if applies), "")
    return reason and f'its `when` is "{when}", {what}, but it {reason}'
