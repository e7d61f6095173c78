"""What a person does to a world from a window. Each deed can be done, and says what it did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import Operator


class Deed(Protocol):
    """Something to be done to a world."""

    def do(self, operator: Operator) -> str:
        """Do it; what is to be told of it. Raises MinervaError."""
        ...


@dataclass(frozen=True, slots=True)
class Pause:
    """Begin no more frames."""

    def do(self, operator: Operator) -> str:
        """Pause."""
        operator.pause()
        return ""


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on."""

    def do(self, operator: Operator) -> str:
        """Resume."""
        operator.resume()
        return ""


@dataclass(frozen=True, slots=True)
class Step:
    """Run one frame and pause."""

    def do(self, operator: Operator) -> str:
        """Step."""
        operator.step(1)
        return ""


@dataclass(frozen=True, slots=True)
class Order:
    """Send an event."""

    event: Event

    def do(self, operator: Operator) -> str:
        """Send it."""
        operator.order(self.event)
        return f"sent {self.event}"


@dataclass(slots=True)
class Settings:
    """What numbers were ordered last, and what agents had at that time."""

    known: dict[tuple[str, str], tuple[float, float]] = field(
        default_factory=dict[tuple[str, str], tuple[float, float]]
    )


_STEPS = {"deg": 5.0}
_STEP = 0.1
_NO_LESS = {"m/s": 0.0, "s": 0.0}


@dataclass(frozen=True, slots=True)
class Nudge:
    """Change the real number that agents were sent by an event of some type, by steps.

    Where nothing was sent yet, it begins at the state of `like`: its attribute of that name.
    """

    type: EventType
    steps: int
    like: str
    receivers: tuple[str, ...]
    vocabulary: Vocabulary
    settings: Settings

    def do(self, operator: Operator) -> str:
        """Send the new value."""
        datum = self.type.fields.all[0]
        unit = datum.type.unit
        has = self._has(operator, datum.name)
        key = self.type.name, self.like
        ordered, had = self.settings.known.get(key, (has, has))
        # What was ordered last may be under way still; else the agent's own value counts.
        now = ordered if has == had else has
        value = round(now + self.steps * _STEPS.get(unit, _STEP), 6)
        value = max(value, _NO_LESS.get(unit, value))
        told = Order(self.type(value, receivers=self.receivers)).do(operator)
        self.settings.known[key] = value, has
        return told

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
