"""Policies: how equation 3 is read for an agent with several events in a frame, or none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from minerva_bus.grammar.events import single
from minerva_bus.world.addressing import Addressed

Division: TypeAlias = Callable[[Addressed], Sequence[Addressed]]


@dataclass(frozen=True, slots=True)
class PolicyRules:
    """Everything that depends on the policy of a world.

    Args:
        divide: the events that each copy of an agent processes, from the events of a frame. The
            first copy is the agent. There is one copy, or there are at most as many as events.
        makes_copies: whether there may be several copies, or none. Each agent is then a fragment
            of its own, ids of copies derive from its id (world/lineage.py), and one host evolves
            all agents.
        without_events: whether agents may change in a frame without events that concern them. The
            host then evolves them in every frame, and the world never rests.

    """

    divide: Division
    makes_copies: bool = False
    without_events: bool = False


def _together(events: Addressed) -> Sequence[Addressed]:
    return (events,)


def _each(events: Addressed) -> Sequence[Addressed]:
    return [Addressed((event,)) for event in single(events.events)]


class Policy(Enum):
    """Reading of equation 3 for an agent with several events in a frame, or none.

    - SEQUENTIAL: the agent processes its events in order; without events it does not change.
    - LITERAL: the equation to the letter: one copy of the agent for each event of the frame,
      whether or not the event concerns it, and no copy in a frame without events.

    A policy is a name with its rules; no other code compares policies.
    """

    _value_: str
    rules: PolicyRules

    SEQUENTIAL = "sequential", PolicyRules(_together)
    LITERAL = "literal", PolicyRules(_each, makes_copies=True, without_events=True)

    def __new__(cls, name: str, rules: PolicyRules) -> Policy:
        """A member whose value is its name."""
        policy = object.__new__(cls)
        policy._value_ = name
        policy.rules = rules
        return policy
