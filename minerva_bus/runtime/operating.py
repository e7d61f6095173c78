"""An operator who asks the world's coordinator: the same for commands, windows and pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.wire.plain import as_list, as_text
from minerva_bus.wire.status import read_lines, read_status
from minerva_bus.wire.values import plain_event
from minerva_bus.world.operator import LogLine, WorldStatus


class AskingOperator:
    """Puts each order into a question; `ask` carries it to the world and brings its answer."""

    def __init__(self, ask: Callable[..., Mapping[str, Any]]) -> None:
        self._ask = ask

    def status(self, since: int = 0) -> WorldStatus:
        """How the world is doing."""
        return read_status(self._ask("status", since=since).get("status"))

    def fragment(self, agent: str) -> str:
        """The text of one agent."""
        return as_text(self._ask("fragment", agent=agent).get("fragment"), "the fragment")

    def order(self, event: AnyEvent) -> None:
        """Send an event into the world."""
        self._ask("order", event=plain_event(event))

    def pause(self) -> None:
        """Begin no frame until `resume` or `step`."""
        self._ask("pause")

    def resume(self) -> None:
        """Go on."""
        self._ask("resume")

    def step(self, frames: int = 1) -> None:
        """Run so many frames and pause."""
        self._ask("step", frames=frames)

    def set_rate(self, rate: float) -> None:
        """Begin so many frames a second; 0: as many as go."""
        self._ask("rate", rate=rate)

    def restart(self, member: str) -> None:
        """Start a process of the world file anew."""
        self._ask("restart", member=member)

    def drain(self, member: str) -> tuple[str, ...]:
        """Let other hosts take over a host's agents; which hosts."""
        return tuple(
            [
                as_text(one, "a host")
                for one in as_list(self._ask("drain", member=member).get("to"), "hosts")
            ]
        )

    def logs(self, since: int = 0, member: str = "") -> tuple[LogLine, ...]:
        """What members have printed and what was said of them."""
        return read_lines(self._ask("logs", since=since, member=member).get("lines"))
