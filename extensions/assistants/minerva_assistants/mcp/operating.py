"""Tools that operate a world: its pace, and events of people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from minerva_assistants.mcp.tool import AGENT_ID, Result, Tool, ToolCall, text, whole
from minerva_assistants.schemas import schema_of_fields
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.operator import WorldStatus

PREFIX: Final = "publish_"
"""Begins the name of the tool of an event type."""


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
    receivers = tuple(sorted(set(call.arguments.get("to", ()))))
    event = Event(name, declared.fields.names, values, condition, receivers=receivers)
    live.publish(event, call.person)
    return {"event": str(event), "frame": live.frame}


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
    ),
)

PUBLISH: Final = Tool(
    "publish",
    "Send an event as a person. Each event type also has a tool of its own, with its data.",
    _publish,
    {
        "type": text("Event type, such as eObjective; see `vocabulary`."),
        "data": {"type": "object", "description": "Data by name.", "maxProperties": 100},
        "to": _TO,
        "condition": _IF,
    },
    ("type",),
    permission="publish",
)


def event_tools(vocabulary: Vocabulary) -> Iterator[Tool]:
    """A tool for each event type whose data JSON can express."""
    for declared in vocabulary.events.values():
        data = schema_of_fields(declared.fields)
        if data is not None:
            yield _event_tool(declared, data)


def _event_tool(declared: EventType, data: dict[str, Any]) -> Tool:
    def send(call: ToolCall) -> Result:
        return _send(call, declared.name, call.arguments.get("data", {}))

    properties = {"data": data} if declared.fields.all else {}
    return Tool(
        f"{PREFIX}{declared.name}",
        f"Send an event {declared.name} as a person. The world rejects types that only sensors or"
        " clocks may send.",
        send,
        {**properties, "to": _TO, "condition": _IF},
        ("data",) if data["required"] else (),
        permission="publish",
    )
