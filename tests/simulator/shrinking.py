"""Shortens a failing history by delta debugging."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final, TypeVar

from tests.simulator.history import History

MAX_TRIES: Final = 400
Item = TypeVar("Item")


def shortened(history: History, fails: Callable[[History], bool], most: int = MAX_TRIES) -> History:
    """The shortest history found that still `fails`, within a number of tries.

    Removes halves of the faults and acts, then quarters, down to single ones; then frames.
    """
    tries = 0
    shorter: History | None = history
    while shorter is not None:
        history, shorter = shorter, None
        for candidate in _shorter(history):
            tries += 1
            if tries > most:
                return history
            if fails(candidate):
                # Begin again with the shorter history: removing one item may make others
                # unnecessary.
                shorter = candidate
                break
    return history


def _shorter(history: History) -> Iterator[History]:
    """Shorter histories, the shortest first."""
    for faults in _without(history.faults):
        yield replace(history, faults=faults)
    for acts in _without(history.acts):
        yield replace(history, acts=acts)
    if history.slow:
        yield replace(history, slow=0.0)
    if history.norms:
        yield replace(history, norms=False)
    if history.divided:
        yield replace(history, divided=0)
    for frames in range(1, history.frames):
        yield replace(history, frames=frames)


def _without(items: Sequence[Item]) -> Iterator[tuple[Item, ...]]:
    """The items without some of them: all, halves, quarters and so on to single ones."""
    size = len(items)
    while size:
        for begin in range(0, len(items), size):
            yield (*items[:begin], *items[begin + size :])
        size //= 2
