"""Plays and checks histories, for tests and the command."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.simulator.checks import wrong
from tests.simulator.decoding import decoding_once
from tests.simulator.history import History, drawn
from tests.simulator.playing import Played, play
from tests.simulator.shrinking import shortened

LINES: Final = 20
"""Lines of a failure's report, including the end of the trace."""

MEMORY: Final = Path("/dev/shm")
"""Folder for journals, if it exists: in memory, because they are temporary."""


@dataclass(frozen=True, slots=True)
class Tried:
    """A played history and the violated properties; `crash` is an internal error."""

    played: Played | None
    wrong: tuple[str, ...]
    history: History

    @property
    def frames(self) -> int:
        """Number of frames."""
        return 0 if self.played is None else self.played.frames

    @property
    def trace(self) -> list[str]:
        """The trace, one line per event."""
        return [] if self.played is None else self.played.trace


def tried(history: History) -> Tried:
    """Play a history and check it. An exception in the launcher is a failure, too."""
    folder = MEMORY if MEMORY.is_dir() else None
    temporary = tempfile.TemporaryDirectory(prefix="minerva-simulation-", dir=folder)
    with temporary as name, decoding_once():
        try:
            played = play(history, Path(name))
        # The launcher runs in this process, so its errors would end the search.
        except Exception as error:
            _pass_interruption(error)
            return Tried(None, (f"{type(error).__name__}: {error}",), history)
    return Tried(played, tuple(wrong(played)), history)


def _pass_interruption(error: BaseException) -> None:
    """Raise what has interrupted the play, such as a time-out of pytest, if it caused this error.

    Code that calls a member takes every exception for one of the member, so it wraps that, too.
    """
    cause = error.__cause__ or error.__context__
    while cause is not None:
        if not isinstance(cause, Exception | SystemExit):
            raise cause
        cause = cause.__cause__ or cause.__context__


def tried_seed(seed: int) -> Tried:
    """Play and check the history of a seed."""
    return tried(drawn(seed))


def shortest(failed: Tried) -> Tried:
    """A failure with the shortest history that still fails."""
    return tried(shortened(failed.history, lambda history: bool(tried(history).wrong)))


def report(failed: Tried, *, trace: bool = False) -> str:
    """Report of a failure: history, violated properties and the end of the trace."""
    lines = [*str(failed.history).split("\n"), *(f"! {problem}" for problem in failed.wrong[:5])]
    left = len(failed.trace) if trace else max(0, LINES - len(lines))
    return "\n".join([*lines, *failed.trace[len(failed.trace) - left :]])
