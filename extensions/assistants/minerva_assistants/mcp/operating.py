"""Tools that operate a world: its pace, and events of people."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, Final, TypeAlias

from minerva_assistants.mcp.tool import AGENT_ID, Result, Tool, ToolCall, shortened, text, whole
from minerva_assistants.schemas import schema_of_fields
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.types import Of
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.operator import WorldStatus

PREFIX: Final = "publish_"
"""Begins the name of the tool of an event type."""

Known: TypeAlias = Callable[[Of], Iterable[Any]]
"""The values of a parameter of a symbol in the string."""

MAX_EVENT: Final = 2000
"""Characters of the longest event that a result repeats."""


def _pause(call: ToolCall) -> Result:
    live = call.link.live()
    live.operator.named(call.person).pause()
    return _state(live.status)


def _resume(call: ToolCall) -> Result:
    live = call.link.live()
    live.operator.named(call.person).resume()
    return _state(live.status)


def _step(call: ToolCall) -> Result:
    live = call.link.live()
    live.step(call.arguments.get("frames", 1), call.stop.is_set, call.person)
    return _state(live.status)


def _set_rate(call: ToolCall) -> Result:
    live = call.link.live()
    live.operator.named(call.person).set_rate(call.arguments["rate"])
    return _state(live.status)


def _state(status: WorldStatus) -> dict[str, Any]:
    return {"world": status.world, "frame": status.frame, "paused": status.paused}


def _publish(call: ToolCall) -> Result:
    return _send(call, call.arguments["type"], call.arguments.get("data", {}))


def _send(call: ToolCall, name: str, data: Mapping[str, Any]) -> dict[str, Any]:
    live = call.link.live()
    declared = live.vocabulary.events.get(name)
    if declared is None:
        known = [*live.vocabulary.events]
        hint = nearest(name, known) or f"; there are {', '.join(known)}"
        raise MisuseError(f"the world has no event type {name!r}{hint}")
    condition = call.arguments.get("condition", "")
    live.vocabulary.check_condition(name, condition, name)
    # Not `declared(**data)`: a datum must not become a receiver or a sender.
    values = declared.fields.bind(name, (), dict(data))
    receivers = tuple(sorted({id.removeprefix("#") for id in call.arguments.get("to", ())}))
    event = Event(name, declared.fields.names, values, condition, receivers=receivers)
    live.publish(event, call.person)
    return {"event": shortened(str(event), MAX_EVENT), "frame": live.frame}


_TO: Final = {
    "type": "array",
    "items": text("Id of an agent.", pattern=AGENT_ID),
    "maxItems": 1000,
    "description": "Receiving agents; default: all that respond to the type.",
}
_IF: Final = text("Condition on the receivers, such as 'energy < 5'.", longest=4000)

CONTROL: Final = (
    Tool("pause", "Pause the world before its next frame.", _pause, permission="control"),
    Tool("resume", "Resume the paused world.", _resume, permission="control"),
    Tool(
        "step",
        "Run a number of frames, then pause.",
        _step,
        {"frames": whole("Number of frames.", 1, 100_000, default=1)},
        permission="control",
        example={"frames": 10},
    ),
    Tool(
        "set_rate",
        "Change the number of frames per second.",
        _set_rate,
        {
            "rate": {
                "type": "number",
                "description": "Frames per second; 0: as fast as possible.",
                "minimum": 0,
                "maximum": 1_000_000,
            }
        },
        ("rate",),
        permission="control",
        example={"rate": 10},
    ),
)

PUBLISH: Final = Tool(
    "publish",
    "Send an event as a person. Types that people may send have tools of their own, too.",
    _publish,
    {
        "type": text("Event type, such as eObjective; see `vocabulary`."),
        "data": {"type": "object", "description": "Data by name.", "maxProperties": 100},
        "to": _TO,
        "condition": _IF,
    },
    ("type",),
    permission="publish",
    example={"type": "eObjective", "data": {"marker": "kitchen"}, "to": ["r1"]},
)


def event_tools(
    vocabulary: Vocabulary, status: WorldStatus, known: Known = lambda of: ()
) -> Iterator[Tool]:
    """A tool for each event type that people may send and whose data JSON can express.

    A type with a datum called `to` or `condition` has none, since these are arguments of each tool.
    `known` returns values that the string has, for examples that the world accepts.
    """
    made = {event for member in status.members for event in member.generates}
    answered = {event for kind in vocabulary.kinds.values() for event in kind.subscribes}
    for name in sorted(answered.difference(made).union(status.orders)):
        declared = vocabulary.events[name]
        data = schema_of_fields(declared.fields)
        if data is not None and not {"to", "condition"}.intersection(declared.fields.names):
            yield _event_tool(declared, data, known)


_SAMPLES: Final[Mapping[str, Any]] = {
    "boolean": True,
    "integer": 1,
    "number": 1.0,
    "string": "text",
    "array": [],
}
"""Values of JSON's types in examples."""


def _sample(field: Field, schema: Mapping[str, Any], known: Known) -> Any:
    """A value that fits the schema of a datum, and the string where the datum is a name in it."""
    source = field.type.source
    values = list(islice(known(source), 1)) if source is not None else []
    if values:
        return values if schema["type"] == "array" else values[0]
    if "enum" in schema:
        return schema["enum"][0]
    return schema.get("minimum", schema.get("maximum", _SAMPLES[schema["type"]]))


def _event_tool(declared: EventType, data: dict[str, Any], known: Known) -> Tool:
    def send(call: ToolCall) -> Result:
        names = declared.fields.names
        given = {name: value for name, value in call.arguments.items() if name in names}
        return _send(call, declared.name, given)

    return Tool(
        f"{PREFIX}{declared.name}",
        f"Send an event {declared.name} as a person.",
        send,
        {**data["properties"], "to": _TO, "condition": _IF},
        tuple(data["required"]),
        permission="publish",
        example={
            field.name: _sample(field, data["properties"][field.name], known)
            for field in declared.fields.all
            if field.name in data["required"]
        },
    )
