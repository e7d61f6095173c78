"""Properties that must hold for every history, regardless of its faults."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import chain

from minerva_bus.grammar.events import Event
from tests.simulator.observing import Observed, ObservedFrame
from tests.simulator.operations import wrong_operations
from tests.simulator.playing import Played
from tests.simulator.reference import cries_in, orders_in, undisturbed


def wrong(played: Played) -> list[str]:
    """Violated properties, one line each."""
    observed = played.observed
    return [
        *observed.problems,
        *_wrong_end(played),
        *_wrong_frames(observed),
        *_wrong_answers(observed),
        *_wrong_strings(played),
        *_wrong_cries(observed),
        *wrong_operations(played),
    ]


def _wrong_end(played: Played) -> Iterator[str]:
    """A world ends and leaves no processes behind."""
    if played.waits:
        yield f"it hangs: {played.waits}"
        return
    if played.failure and not played.listened:
        return  # A process killed before the world is registered ends it.
    if played.failure:
        yield f"the world stopped: {played.failure}"
    elif played.result is not None:
        yield from _wrong_summary(played)
    if played.left:
        yield f"still alive after the end: {', '.join(played.left)}"


def _wrong_summary(played: Played) -> Iterator[str]:
    result, frames = played.result, played.observed.frames
    assert result is not None
    stopped = any(asked.act.ask == "stop" and asked.sent for asked in played.observed.asked)
    # A person may have stopped the world before its last frame.
    if result.frames != played.history.frames and not stopped:
        yield f"it ended after {result.frames} frames: {result.ended}"
    if result.frames != len(frames):
        yield f"its summary has {result.frames} frames, not {len(frames)}"
    elif frames and result.digest != frames[-1].digest:
        yield f"its summary's digest is {result.digest[:8]}, not {frames[-1].digest[:8]}"


def _wrong_frames(observed: Observed) -> Iterator[str]:
    """Frames are consecutive across coordinators, and epochs only increase."""
    numbers = [frame.number for frame in observed.frames]
    if numbers != list(range(len(numbers))):
        yield f"frames are not consecutive: {numbers}"
    epochs = [frame.epoch for frame in observed.frames]
    if epochs != sorted(epochs):
        yield f"an older coordinator went on: epochs {epochs}"


def _wrong_answers(observed: Observed) -> Iterator[str]:
    """Only replies to the frame count, and one host replies for each fragment."""
    for frame in observed.frames:
        inputs = frame.inputs
        stale = [
            reply
            for reply in (*inputs.ticked.values(), *inputs.replies)
            if reply.frame != frame.number
        ]
        for reply in stale:
            yield f"a reply of {reply.member} to frame {reply.frame} counts in frame {frame.number}"
        # A fragment that two hosts have changed would have two futures.
        changed = Counter(chain.from_iterable(reply.changed for reply in inputs.replies))
        twice = sorted(name for name, times in changed.items() if times > 1)
        if twice:
            yield f"in frame {frame.number} several hosts answered for {', '.join(twice)}"


def _wrong_strings(played: Played) -> Iterator[str]:
    """Strings, events and views equal those of the undisturbed run with the same orders."""
    observed = played.observed
    # Reported by `_wrong_frames`; without consecutive frames there is nothing to compare.
    if [frame.number for frame in observed.frames] != list(range(len(observed.frames))):
        return
    ordered = ((frame.number, orders_in(_single(frame))) for frame in observed.frames)
    due = tuple((number, orders) for number, orders in ordered if orders)
    history = played.history
    # One process has all agents in the undisturbed run.
    divided = min(history.divided, 1)
    same = undisturbed(history.frames, due, norms=history.norms, divided=divided)
    for frame in observed.frames:
        number = frame.number
        # A free-running generator emits by the clock, so its events may be in other frames than
        # in the undisturbed run. No agent responds to them, so the strings must be equal
        # nevertheless.
        events = tuple(str(event) for event in frame.events if event.type != "eCry")
        if events != same.events[number]:
            yield f"frame {number} has the events {_differing(events, same.events[number])}"
        if frame.digest != same.digests[number]:
            yield f"frame {number} has another digest, {frame.digest[:8]}"
            # All later frames would differ as a consequence.
            return
    for number, text in sorted(observed.shown.items()):
        if text != same.shown.get(number):
            yield f"the screen has drawn another view of frame {number}"


def _differing(events: tuple[str, ...], wanted: tuple[str, ...]) -> str:
    more, less = Counter(events) - Counter(wanted), Counter(wanted) - Counter(events)
    lines = [f"+{line}" for line in sorted(more)] + [f"-{line}" for line in sorted(less)]
    return " ".join(lines) or "in another order"


def _single(frame: ObservedFrame) -> Iterator[Event]:
    return (event for event in frame.events if isinstance(event, Event))


def _wrong_cries(observed: Observed) -> Iterator[str]:
    """An event of a free-running generator counts at most once."""
    cries = Counter(chain.from_iterable(cries_in(_single(frame)) for frame in observed.frames))
    for number, times in sorted(cries.items()):
        if times > 1:
            yield f"eCry {number} is in {times} frames"
