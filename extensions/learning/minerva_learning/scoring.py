"""Rewards, and the conditions under which the episode of an agent ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.plans import in_double_quotes
from minerva_bus.errors import MisuseError, VocabularyError, nearest
from minerva_bus.grammar.condition import Scope, parse_condition
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_learning.states import KindStates

Reward: TypeAlias = "str | Callable[[AgentNode, AgentNode | None], float] | None"
"""An attribute whose increase counts, or a function of an agent before and after a step (None: it
has died); None: 1 for each step survived."""

Done: TypeAlias = "str | Callable[[AgentNode], bool] | None"
"""A condition about attributes, or a function of an agent; None: agents only end by their death."""

Rewarding: TypeAlias = Callable[[KindStates, KindStates, list[str]], NDArray[np.float64]]
"""The rewards of agents for a step, from the states before and after it."""

Ending: TypeAlias = Callable[[KindStates], NDArray[np.bool_]]
"""Which agents' episodes end, in the order of `ids`."""


def rewarding_of(reward: Reward, kind: AgentKind) -> Rewarding:
    """The rewards of agents for a step. Raises MisuseError for an unknown attribute."""
    if reward is None:
        return lambda before, after, ids: (after.rows_of(ids) >= 0).astype(np.float64)
    if not isinstance(reward, str):
        return lambda before, after, ids: np.array(
            [_number(reward(before.nodes[each], after.nodes.get(each)), each) for each in ids]
        )
    types = {field.name: field.type for field in kind.fields.all}
    if reward not in types or types[reward].kind not in ("real", "int", "bool"):
        raise MisuseError(
            f"reward: {kind.name} has no number {reward}{nearest(reward, [*types])}; a function is"
            " called with the agent before and after the step"
        )
    return lambda before, after, ids: _increase(reward, before, after, ids)


def _number(value: Any, agent: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise MisuseError(
            f"reward: the function returned {value!r:.60} for {agent}; expected a number"
        ) from None


def _increase(
    name: str, before: KindStates, after: KindStates, ids: list[str]
) -> NDArray[np.float64]:
    """The increase of an attribute; 0 for agents that have died."""
    old, new = before.rows_of(ids), after.rows_of(ids)
    alive = new >= 0
    increase = np.zeros(len(ids))
    increase[alive] = after.column(name)[new[alive]].astype(np.float64)
    increase[alive] -= before.column(name)[old[alive]]
    return increase


def ending_of(done: Done, kind: AgentKind) -> Ending:
    """The agents whose episode ends. Raises VocabularyError for a wrong condition."""
    if done is None:
        return lambda states: np.zeros(len(states.ids), np.bool_)
    if not isinstance(done, str):
        return lambda states: np.array([done(states.nodes[each]) for each in states.ids], np.bool_)
    condition = parse_condition(in_double_quotes(done), "done")
    condition.check([Scope(kind.name, list(kind.fields.names), kind.sort_of)], "done")
    if not condition.comparisons:
        raise VocabularyError("done: the condition is empty", source="done")

    def ending(states: KindStates) -> NDArray[np.bool_]:
        columns = {name: states.column(name) for name in condition.names}
        return condition.holds_of_many(columns, len(states.ids))

    return ending
