"""What the launcher logs about processes: on the console, and in the coordinator's log."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Final

from minerva_bus.launch import forking
from minerva_bus.launch.console import Console
from minerva_bus.launch.traces import blocked_at
from minerva_bus.launch.worldfile import Process
from minerva_bus.runtime.member import RAISED_BY_CHANCE
from minerva_bus.wording import duration

IN_A_FRAME: Final = re.compile(r"failed in frame \d+: ")
"""Beginning of the report about an error that the same frame would cause again."""

FAILURE_REPORT: Final = re.compile(r"failed(?: in frame \d+)?: ")
"""Beginning of a member's report about an error in its user code."""

GONE: Final = re.compile(r"is gone\b")
"""Beginning of the coordinator's line about a member whose process has ended."""

MAX_LINE_LENGTH: Final = 2000


class FailureLog:
    """The failures of user code in a run: the reports shown, and the causes.

    A process that is restarted several times would otherwise print the same report each time.
    `explained`: processes that have not joined again since the log named the reason for their end.
    """

    def __init__(self) -> None:
        self.explained: set[str] = set()
        self._shown: set[str] = set()
        self._before: set[tuple[str, str]] = set()

    def abbreviate(self, text: str) -> str:
        """A report without the lines that were shown before; empty if no line is new."""
        # The first line has the frame, so that the same error in another frame differs in it only.
        first, _, rest = text.partition("\n")
        seen, self._shown = self._shown, self._shown | {first, rest}
        if first in seen and rest in seen:
            return ""
        return f"{first} (as above)" if rest and rest in seen else text

    def is_new(self, place: str) -> bool:
        """Whether a line of code was not logged before; from now on it counts as logged."""
        known = place in self._shown
        self._shown.add(place)
        return not known

    def repeated(self, process: Process, code: int, cause: str) -> bool:
        """Whether this process, or another host, has failed for the same cause before.

        The cause names the frame and the event: the same input fails again.
        """
        # A member in another language may end with any code after its report.
        if code <= 0 or code == RAISED_BY_CHANCE or not IN_A_FRAME.match(cause):
            return False
        key = ("" if process.agents else process.name, cause)
        repeated = key in self._before
        self._before.add(key)
        return repeated


class ProcessLog:
    """Logs lines about the processes of a world; `command` sends a command to its coordinator."""

    def __init__(self, world: str, console: Console, command: Callable[[str], None]) -> None:
        self._world = world
        self._console = console
        self._command = command
        self.failures = FailureLog()

    def note(self, text: str) -> None:
        """Show a line about the world, which is not kept."""
        self._console.note(f"{self._world}: {text}")

    def add(self, name: str, line: str, level: str = "warning") -> None:
        """Log a line about a process on the console and in the coordinator's log."""
        self._console.log(name, line, level)
        self.keep(name, line, level)

    def keep(self, name: str, text: str, level: str) -> None:
        """Log lines about a process in the coordinator's log only."""
        # A command to the coordinator is one line.
        for line in text.split("\n"):
            self._command(f"log {level} {name} {line[:MAX_LINE_LENGTH]}")

    def reported(self, name: str, text: str, details: str) -> None:
        """Show a line that the coordinator has logged about a member, unless it is known."""
        if name in self.failures.explained and GONE.match(text):
            return  # The reason and the line about its restart say more.
        if FAILURE_REPORT.match(text):
            text = self.failures.abbreviate(text)
        if text:
            self._console.log(name, text, "warning")
        self._console.details(name, details)

    def blocked(self, name: str, stacks: Sequence[str], waited: float) -> str:
        """Log that a process does not respond, with the line of user code that it executes.

        If this line was logged before, the line about the restart is enough; returns how it
        begins, otherwise an empty text. `waited`: seconds.
        """
        place, how = blocked_at(stacks, forking.__file__), ""
        if place is not None and not self.failures.is_new("\n".join(place.lines())):
            how = f"did not answer for {duration(waited)} (blocked as above)"
        else:
            text = f"no answer for {duration(waited)}: killing it"
            shown = [text] if place is None else [f"{text}; it is blocked in", *place.lines()]
            self.add(name, "\n".join(shown))
        if stacks:
            self._console.details(name, "\n".join(stacks))
            self.keep(name, "\n".join(stacks), "warning")
        return how
