"""Norms: what agents may do, where and how often, enforced while the world runs (section 1).

A norm is about events of the given types, or about new states of agents. Its condition, in the
language of grammar/condition.py, describes what is forbidden. Besides the attributes of the agent,
it may name

    was.x       the agent's attribute before the frame               norms on states
    event.x     a datum of the event                                 norms on events
    #id.x       the attribute of an agent at the start of the frame  both

An agent whose step is rejected is put at rest: its commands become neutral.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import VocabularyError
from minerva_bus.grammar.columns import Column, Columns, Rows
from minerva_bus.grammar.condition import Condition, Scope, parse_condition, sort_of_kind
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import (
    AgentNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
    Value,
    agents,
    of_pieces,
    rebuild,
    rescoped,
)
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.grammar.vocabulary import AgentKind, EventType, Vocabulary

SOURCE: Final = "~norms"
"""Source of sanctions, and the key of the violation counts in checkpoints."""

REFUSED: Final = "eRefused"
"""Event type, if declared by the world, that notifies an agent that its step was rejected."""

WAS: Final = "was."
EVENT: Final = "event."


class Then(Enum):
    """The consequence of a violation.

    REFUSE    reject it: the event is dropped, or the agent keeps its state in this frame
    SANCTION  allow it, and send the violator an event in the next frame
    COUNT     allow it, and count it
    """

    REFUSE = "refuse"
    SANCTION = "sanction"
    COUNT = "count"


@dataclass(frozen=True, slots=True)
class Norm:
    """One norm.

    It `applies` to agents of these kinds and to events from members of these names; if empty, to
    all. It is about events of the types `on`; if empty, about states of agents. An act that fulfils
    both `when` and `where` is forbidden, except `most` times in `per` frames for each agent. With
    `sanction`, a violator gets this event in the next frame, even if the violation is rejected.
    """

    name: str
    applies: tuple[str, ...] = ()
    on: tuple[str, ...] = ()
    when: str = ""
    where: str = ""
    most: int = 0
    per: int = 1
    then: Then = Then.REFUSE
    sanction: Event | None = None

    @property
    def refuses_steps(self) -> bool:
        """Whether it rejects new states of agents, who are told so by `eRefused`."""
        return self.refuses and not self.on

    @property
    def sends(self) -> tuple[str, ...]:
        """The event types that violators receive."""
        own = () if self.sanction is None else (self.sanction.type,)
        return (*own, REFUSED) if self.refuses_steps else own

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions of the norm; an act is forbidden if it fulfils all of them."""
        return tuple(
            [
                parse_condition(condition)
                for condition in (self.when, self.where)
                if condition.strip()
            ]
        )

    @property
    def named(self) -> frozenset[str]:
        """The attributes of certain agents on which it depends, as `#id.attribute`."""
        names = [name for condition in self.conditions for name in condition.names]
        return frozenset(name for name in names if name.startswith("#"))

    @property
    def refuses(self) -> bool:
        """Whether violations are rejected."""
        return self.then is Then.REFUSE

    def holds(self, state: Mapping[str, Any]) -> bool:
        """Whether the norm forbids this state."""
        return all(condition.holds(state) for condition in self.conditions)

    def holds_of_many(self, value: Callable[[str], Any], count: int) -> NDArray[np.bool_]:
        """Which of `count` states the norm forbids; `value` has an array, or one value, by name."""
        forbidden = np.ones(count, np.bool_)
        for condition in self.conditions:
            state = {name: value(name) for name in condition.names}
            forbidden &= condition.holds_of_many(state, count)
        return forbidden

    def concerns(self, *names: str) -> bool:
        """Whether the norm applies to a kind or a member with any of these names."""
        return not self.applies or any(name in self.applies for name in names)


def check_conditions(
    norm: Norm, vocabulary: Vocabulary, w: Scene, place: Callable[[str], str]
) -> None:
    """Raise VocabularyError, with a caret, if the conditions cannot hold for any agent together.

    `w` is the initial string; it must contain the agents that the conditions name by id. `place`
    is the source of "when" and of "where".
    """
    texts = {"when": norm.when, "where": norm.where}
    named = (
        {agent.id: agent.symbol for agent in agents(w)} if "#" in "".join(texts.values()) else {}
    )
    others = {agent_id: vocabulary.kinds[symbol] for agent_id, symbol in named.items()}
    scopes = [_scope(kind, about, others) for kind, about in _concerned(norm, vocabulary)]
    for key, text in texts.items():
        condition = parse_condition(text, place(key))
        condition.check(scopes, place(key))
        scopes = [scope for scope in scopes if condition.problem(scope.sort_of) is None]


def _concerned(
    norm: Norm, vocabulary: Vocabulary
) -> Iterator[tuple[AgentKind | None, EventType | None]]:
    """The kinds (None: generators) and event types (None: states) that a norm concerns."""
    kinds: list[AgentKind | None] = [
        kind for name, kind in vocabulary.kinds.items() if norm.concerns(name)
    ]
    if norm.on and any(name not in vocabulary.kinds for name in norm.applies):
        kinds.append(None)
    for about in [vocabulary.events[event_type] for event_type in norm.on] or [None]:
        for kind in kinds or [None]:
            yield kind, about


def _scope(
    kind: AgentKind | None, about: EventType | None, others: Mapping[str, AgentKind]
) -> Scope:
    """The names that a norm may use for an agent of a kind and for its event."""
    own = kind.fields.all if kind is not None else ()
    sorts = {field.name: field for field in own}
    if about is None:
        sorts |= {WAS + field.name: field for field in own}
    else:
        sorts |= {EVENT + field.name: field for field in about.fields.all}
    sorts |= {
        f"#{id}.{field.name}": field for id, other in others.items() for field in other.fields.all
    }
    who = kind.name if kind is not None else "a generator"

    def sort_of(name: str) -> str:
        return sort_of_kind(sorts[name].type.kind) if name in sorts else ""

    return Scope(f"{who} with {about.name}" if about is not None else who, list(sorts), sort_of)


def sanction_of(norm: str, declared: EventType, data: Mapping[str, Any]) -> Event:
    """The event that a violator gets; its datum `norm` defaults to the name of the norm.

    Raises MisuseError and VocabularyError.
    """
    given = {"norm": norm, **data} if "norm" in declared.fields.names else data
    if declared.visual:
        raise VocabularyError(f"{declared.name} is visual, and no agent evolves by it")
    return cast("Event", declared(**given))


class ViolationCounts:
    """The number of violations of each norm, and the recent acts that norms limit, by agent."""

    def __init__(self, saved: Mapping[str, Any]) -> None:
        """Continue from the state that `saved` returned."""
        self.broken: dict[str, int] = dict(saved.get("broken", {}))
        self._lately: dict[str, dict[str, list[int]]] = {
            norm: {who: list(frames) for who, frames in of.items()}
            for norm, of in saved.get("lately", {}).items()
        }

    def breaks(self, norm: Norm, who: str, frame: int) -> bool:
        """Count an act that a norm forbids or limits; True if it is a violation."""
        if norm.most:
            lately = self._lately.setdefault(norm.name, {})
            frames = [past for past in lately.get(who, ()) if past > frame - norm.per]
            broken = len(frames) >= norm.most
            # A rejected act has not happened, so it does not count towards the limit.
            if not (broken and norm.refuses):
                frames.append(frame)
            # Older acts cannot decide any later frame, and the checkpoint stays small.
            lately[who] = frames[-norm.most :]
            if not broken:
                return False
        self.broken[norm.name] = self.broken.get(norm.name, 0) + 1
        return True

    def exceeds(self, norm: Norm, who: str, frame: int) -> bool:
        """Whether an act in this frame would be a violation; does not count it."""
        lately = self._lately.get(norm.name, {}).get(who, ())
        # Acts of this frame are excluded: the agent is judged again for this frame, after it has
        # evolved by fewer events.
        count = sum(frame - norm.per < past < frame for past in lately)
        return count >= norm.most

    def saved(self, norms: tuple[Norm, ...], frame: int) -> dict[str, Any]:
        """The counts needed to continue from a frame, as plain data; expired ones are dropped."""
        lately: dict[str, dict[str, list[int]]] = {}
        for norm in norms:
            of = self._lately.get(norm.name, {})
            # Sorted, so that equal states have equal checkpoints.
            kept = {who: of[who] for who in sorted(of) if of[who][-1:] > [frame - norm.per]}
            if kept:
                lately[norm.name] = kept
        self._lately = {norm: dict(of) for norm, of in lately.items()}
        return {"broken": dict(sorted(self.broken.items())), "lately": lately}


# --- agents at rest, after a refused step ---

Kinds = Mapping[str, AgentKind]


def rested(scene: Scene, who: Collection[str], kinds: Kinds) -> Scene:
    """The string with the agents of these ids at rest; the same object if they already are.

    The attributes that a kind declares as `rest` become 0, false, "" or (); a string loses its
    transformations, so that its primitives remain without motion.
    """
    if not who or not any(kind.rest for kind in kinds.values()):
        return scene
    return of_pieces(scene, [node for piece in scene.pieces for node in _piece(piece, who, kinds)])


def _piece(piece: Piece, who: Collection[str], kinds: Kinds) -> tuple[Piece, ...]:
    if piece.ids is not None:
        return (_columns(piece, who, kinds),)
    # Nothing to do, so the piece remains the same object and is not sent again.
    if not any(agent.id in who and kinds[agent.symbol].rest for agent in agents(Scene((piece,)))):
        return (piece,)

    def leave(node: Node, scope: Scene) -> Scene | Node:
        node = rescoped(node, scope)
        selected = isinstance(node, AgentNode) and node.id in who
        return _agent(cast("AgentNode", node), kinds[node.symbol].rest) if selected else node

    return rebuild(Scene((piece,)), leave).pieces


def _agent(node: AgentNode, rest: Collection[str]) -> AgentNode:
    pairs = zip(node.names, node.values, strict=True)
    values = tuple([at_rest(value) if name in rest else value for name, value in pairs])
    return node if same_values(node.values, values) else replace(node, values=values)


def _columns(part: Columns, who: Collection[str], kinds: Kinds) -> Columns:
    rest = kinds[part.symbol].rest if part.ids is not None else ()
    if not rest or part.ids is None:
        return part
    rows = part.ids.rows_of(Ids.of(sorted(who)))
    # Ids that are not in these columns have the row -1.
    rows = np.sort(rows[rows >= 0])
    columns = [
        _still(column, rows) if name in rest else column
        for name, column in zip(part.names, part.columns, strict=True)
    ]
    return part.with_columns(columns)


def _still(column: Column, rows: Rows) -> Column:
    values = tuple(column.array[rows].tolist())
    still = tuple([at_rest(value) for value in values])
    # As for single agents: 0.0 == -0.0, but they print differently.
    return column if same_values(still, values) else column.put(rows, Column.of(still).array)


def at_rest(value: Value) -> Value:
    """The neutral value for an attribute with this value."""
    if isinstance(value, Scene):
        still = rebuild(value, _without_motion)
        return value if still == value else still
    # 0, 0.0, False, "" or ().
    return type(value)()  # pyright: ignore[reportCallIssue]


def _without_motion(node: Node, scope: Scene) -> Scene | Node:
    return scope if isinstance(node, TransformationNode) else rescoped(node, scope)
