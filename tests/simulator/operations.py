"""Checks that operations of a person took effect: once if confirmed, else at most once.

A single person acts in sequence, so possible orders of operations differ only in unconfirmed ones.
While one of these could still take effect, the pace is not checked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import chain, zip_longest

from minerva_bus.grammar.events import Event
from tests.simulator.observing import Asked, Observed
from tests.simulator.person import SETTLED
from tests.simulator.playing import Played
from tests.simulator.reference import orders_in
from tests.simulator.worlds import eMark

PACE = ("pause", "step", "resume", "stop")


def wrong_operations(played: Played) -> Iterator[str]:
    """Violated properties of a person's operations."""
    yield from _wrong_orders(played.observed)
    yield from _wrong_pace(played.observed, played.history.frames)


def _wrong_orders(observed: Observed) -> Iterator[str]:
    events = (
        orders_in(event for event in frame.events if isinstance(event, Event))
        for frame in observed.frames
    )
    times = Counter(chain.from_iterable(events))
    last = observed.frames[-1].number if observed.frames else -1
    for asked in observed.asked:
        word, _, event_type = asked.act.ask.partition(" ")
        if word != "pub":
            continue
        effects = times.pop((event_type, asked.act.number), 0)
        answer = asked.answer or {}
        # A confirmed order belongs to the frame of its answer, if the world has run it. The clerk
        # takes marks, and may be away, or have answered this frame to a former coordinator.
        latest = last - (event_type == eMark.name)
        due = asked.confirmed and int(answer["frame"]) < latest
        # Without an answer it may or may not have arrived.
        at_most = 0 if not asked.sent or "error" in answer else 1
        if effects > at_most or (due and not effects):
            yield f"{asked.act.ask} {asked.act.number} took effect {effects} times: {_said(asked)}"
    for (event_type, number), effects in sorted(times.items()):
        yield f"{event_type} {number} took effect {effects} times but was not sent"


def _said(asked: Asked) -> str:
    if not asked.sent:
        return "it was not sent"
    if asked.answer is None:
        return "it was not confirmed"
    if "error" in asked.answer:
        return f"it was refused, {asked.answer['error']}"
    return f"it was confirmed in frame {asked.answer['frame']}"


def _wrong_pace(observed: Observed, frames: int) -> Iterator[str]:
    """No frame begins after a confirmed pause; after a confirmed step, the requested number do.

    No device of these worlds has a rate, which would allow one more frame after a pause.
    A frame in progress when its coordinator died begins again and counts as the same frame.
    """
    paced = [asked for asked in observed.asked if asked.act.ask in PACE and asked.sent]
    for asked, then in zip_longest(paced, paced[1:]):
        until = float("inf") if then is None else then.at
        before = {frame for at, frame in observed.begun if at <= asked.done}
        # Without frames that had begun before: a successor begins them again.
        begun = {frame for at, frame in observed.begun if asked.done < at < until} - before
        ended = {frame.number for frame in observed.frames if frame.time < until}
        if not asked.confirmed or asked.answer is None:
            continue
        name = f"{asked.act.ask} {asked.act.number or ''}".rstrip()
        if asked.act.ask in ("pause", "stop") and begun:
            yield f"frames {sorted(begun)} began after {name} was confirmed"
        if asked.act.ask == "step":
            follows = int(asked.answer["frame"])
            over = sorted(frame for frame in ended if frame >= follows)
            if over:
                yield f"frames {over} ended after {name}, which was to end before {follows}"
            settled = then is not None and then.at - asked.done >= SETTLED
            if settled and follows <= frames and follows - 1 not in ended:
                yield f"frame {follows - 1} has not ended {SETTLED:g} s after {name}"
