"""Outcomes of fragments, as norms judge them: the changes of agents, and how to undo them.

The unit of rejection is a result of λ: an agent with everything in its scope, with everything that
it leaves beside itself, and with the events that it sent. The exception are primitives that an
agent in columns leaves beside itself, because their author is unknown. A rejected unit is replaced
by its previous state, or by its outcome with fewer events. Outcomes of agents in columns are in
population_outcomes.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias, cast

from minerva_bus.frame.fragments import Fragment
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import AgentNode, Node, Scene, agents
from minerva_bus.world.norms import WAS, Norm

Sent: TypeAlias = tuple[AnyEvent, ...]
Elsewhere = Callable[[str], Any]
"""The value of `#id.attribute`, or None if there is no such agent."""


class FragmentOutcome:
    """One outermost agent and its outcome; base class of those of populations."""

    def __init__(self, old: Fragment, new: Scene) -> None:
        self._old = old
        self._new = new
        self._undone: dict[str, FragmentOutcome | None] = {}
        self._before = self._agents_before()

    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {agent.id: agent for agent in agents(Scene((self._old,)))}

    @property
    def rejected(self) -> bool:
        """Whether a unit of it has been undone."""
        return bool(self._undone)

    def offenders(self, norm: Norm, elsewhere: Elsewhere) -> Iterator[str]:
        """Agents whose new state violates a norm, in the order of the string.

        Only changed states are judged; for a newborn the parent is the offender.
        """
        for agent in agents(self._new):
            old = self._before.get(agent.id)
            unit = self.unit(agent.id)
            # A state undone by an earlier norm no longer exists, so later norms do not count it.
            if unit in self._undone or not norm.concerns(agent.symbol):
                continue
            # An agent that stays unchanged in a state that was forbidden
            # before does not offend again.
            if old is not None and same_values(old.values, agent.values):
                continue
            if norm.holds(state_of(norm, agent, old, elsewhere)):
                yield agent.id if old is not None else unit

    @property
    def halted(self) -> tuple[str, ...]:
        """All agents that have been undone, sorted."""
        return tuple(sorted(self._before)) if self._undone else ()

    def unit(self, who: str) -> str:
        """The unit of an agent: the agent whose λ returned it."""
        return cast("AgentNode", self._old).id

    def undo(self, who: str) -> None:
        """Replace an agent's unit by its previous state."""
        self._undone[self.unit(who)] = None

    def replace(self, unit: str, other: FragmentOutcome) -> None:
        """Replace a unit that was undone by its state in another outcome, by fewer events."""
        self._undone[unit] = other

    def was(self, who: str) -> AgentNode | None:
        """An agent as it was before the frame."""
        return self._before.get(who)

    def of_unit(self, unit: str) -> tuple[Node, ...]:
        """The nodes of a unit in this outcome."""
        return self._new.nodes

    @property
    def scene(self) -> Scene:
        """The final fragment."""
        if not self._undone:
            return self._new
        (other,) = self._undone.values()
        return Scene((self._old,)) if other is None else other.scene

    def left(self, sent: Sent, later: Sequence[tuple[FragmentOutcome, Sent]] = ()) -> Sent:
        """The events of the fragment that count, from this outcome and others."""
        if not self._undone:
            return sent
        (other,) = self._undone.values()
        return next((events for outcome, events in later if outcome is other), ())


def state_of(norm: Norm, now: AgentNode, old: AgentNode | None, elsewhere: Elsewhere) -> Any:
    """The values that the conditions of a norm on states can name."""
    state: dict[str, Any] = dict(now.state)
    for name in {name for condition in norm.conditions for name in condition.names}:
        if name.startswith("#"):
            state[name] = elsewhere(name)
        elif name.startswith(WAS) and old is not None:
            state[name] = old.state.get(name.removeprefix(WAS))
    return state
