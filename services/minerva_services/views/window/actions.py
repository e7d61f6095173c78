"""Actions that a user performs on a world from a window."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.operator import Operator


class WorldAction(Protocol):
    """An action on a world."""

    def do(self, operator: Operator) -> str:
        """Perform it; returns a line to display. Raises MinervaError."""
        ...


@dataclass(frozen=True, slots=True)
class PauseAction:
    """Pause before the next frame."""

    def do(self, operator: Operator) -> str:
        """Pause."""
        operator.pause()
        return ""


@dataclass(frozen=True, slots=True)
class ResumeAction:
    """Resume."""

    def do(self, operator: Operator) -> str:
        """Resume."""
        operator.resume()
        return ""


@dataclass(frozen=True, slots=True)
class StepAction:
    """Run one frame and pause."""

    def do(self, operator: Operator) -> str:
        """Step."""
        operator.step(1)
        return ""


@dataclass(frozen=True, slots=True)
class OrderAction:
    """Send an event."""

    event: Event

    def do(self, operator: Operator) -> str:
        """Send it."""
        operator.order(self.event)
        return f"sent {self.event}"


@dataclass(slots=True)
class SentNumbers:
    """The numbers sent last, and the agents' values at that time."""

    known: dict[tuple[str, str], tuple[float, float]] = field(
        default_factory=dict[tuple[str, str], tuple[float, float]]
    )


# Change per key press: of some units, and of all others.
_STEPS = {"deg": 5.0}
_STEP = 0.1
# Speeds and durations cannot be negative.
_MINIMA = {"m/s": 0.0, "s": 0.0}


@dataclass(frozen=True, slots=True)
class AdjustAction:
    """Change the real number last sent with an event type, by steps.

    Without a previous value it starts from the attribute of that name of the agent `like`.
    """

    type: EventType
    steps: int
    like: str
    receivers: tuple[str, ...]
    vocabulary: Vocabulary
    settings: SentNumbers

    def do(self, operator: Operator) -> str:
        """Send the new value."""
        datum = self.type.fields.all[0]
        unit = datum.type.unit
        has = self._has(operator, datum.name)
        key = self.type.name, self.like
        ordered, had = self.settings.known.get(key, (has, has))
        # The last order may still be in transit; once it took effect, the agent's value counts.
        now = ordered if has == had else has
        value = round(now + self.steps * _STEPS.get(unit, _STEP), 6)
        value = max(value, _MINIMA.get(unit, value))
        line = OrderAction(self.type(value, receivers=self.receivers)).do(operator)
        self.settings.known[key] = value, has
        return line

    def _has(self, operator: Operator, name: str) -> float:
        default = self.type.fields.all[0].default
        fallback = float(default) if isinstance(default, float) else 0.0
        if not self.like:
            return fallback
        try:
            scene = self.vocabulary.read(operator.fragment(self.like))
        except MinervaError:
            return fallback
        node = scene.pieces[0] if scene.pieces else None
        value = node.state.get(name) if isinstance(node, AgentNode) else None
        return float(value) if isinstance(value, int | float) else fallback
