"""Checks a member's hello against the vocabulary of the world."""

from __future__ import annotations

from dataclasses import replace

from minerva_bus.errors import nearest
from minerva_bus.frame.messages import Hello
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.when import Participation, objection

PROTOCOL_VERSION = 7

_MAX_SHOWN = 500
"""Characters of the names of attributes in a reason: a hello may have thousands."""


def incompatibility(hello: Hello, vocabulary: Vocabulary) -> str:
    """Reason why a member cannot join a world of this vocabulary, or an empty string."""
    # The version is checked first, because in another version the
    # other fields may mean something else.
    if hello.version != PROTOCOL_VERSION:
        return (
            f"it speaks protocol {hello.version}, this world {PROTOCOL_VERSION}: install the same"
            " version of Minerva Bus on both sides"
        )
    for event_type in (*hello.generates, *hello.draws, *hello.orders):
        if event_type not in vocabulary.events:
            known = nearest(event_type, list(vocabulary.events))
            return f"the world's vocabulary has no event type {event_type}{known}"
    for event_type in hello.draws:
        if not vocabulary.events[event_type].visual:
            names = [name for name, each in vocabulary.events.items() if each.visual]
            visual = ", ".join(names) or "none"
            return f"it draws {event_type}, which is not visual; expected one of {visual}"
    # The coordinator generates such events itself and has no data for them.
    views = replace(hello.when, asked=Participation.NEVER)
    for event_type in hello.draws if hello.when.every or hello.when.rate else ():
        fields = vocabulary.events[event_type].fields.all
        required = [field.name for field in fields if field.default is None]
        if required:
            return (
                f"it cannot be the source of {event_type} itself, which needs {required[0]}; remove"
                f' "{views}" from its `when`, and use a generator for the event'
            )
    # Members in step count as publishers in step. A device that only draws answers its ticks
    # without readings, so the subscribers of its topics would wait for them forever.
    if hello.publishes and hello.coupled and not hello.when.is_awaited:
        return "it publishes readings but generates nothing: a publisher is a Generator too"
    reason = objection(
        hello.when,
        draws=bool(hello.draws) or hello.coupled,
        generates=bool(hello.generates),
        topics=bool(hello.topics),
        publishes=bool(hello.publishes),
        orders=bool(hello.orders),
    )
    if reason:
        return reason
    reasons = (_kind_mismatch(kind, vocabulary) for kind in hello.kinds)
    return next((reason for reason in reasons if reason), "")


def _kind_mismatch(kind: AgentKind, vocabulary: Vocabulary) -> str:
    expected = vocabulary.kinds.get(kind.name)
    if expected is None:
        return f"the world's vocabulary has no agents {kind.name}"
    mismatch = _state_mismatch(kind, expected)
    if mismatch:
        return f"{mismatch}: both must come from the same code"
    # Both affect the string. With other probabilities it would
    # depend on which host evolves an agent.
    if expected.chances != kind.chances:
        return f"its {kind.name} responds to events with other probabilities than in the world"
    if expected.rest != kind.rest:
        return f"its {kind.name} has other `rest` attributes than in the world"
    return ""


def _state_mismatch(kind: AgentKind, expected: AgentKind) -> str:
    """Difference between the attributes of a kind and the world's, or an empty string."""
    names, expected_names = kind.fields.names, expected.fields.names
    if names != expected_names:
        return (
            f"its {kind.name} has the state ({', '.join(names)[:_MAX_SHOWN]}),"
            f" the world's ({', '.join(expected_names)[:_MAX_SHOWN]})"
        )
    for field, other in zip(kind.fields.all, expected.fields.all, strict=True):
        if field.type != other.type:
            return (
                f"{field.name} of its {kind.name} is {_described(field.type, other.type)}, of the"
                f" world's {_described(other.type, field.type)}"
            )
    return ""


def _described(of: Type, other: Type) -> str:
    """A type as text; with all its parameters if the short texts of both are equal."""
    return str(of) if str(of) != str(other) else repr(of)
