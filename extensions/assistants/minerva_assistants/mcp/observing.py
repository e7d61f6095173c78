"""Tools that change nothing: status, string, events, agents by condition, waiting, pictures."""

from __future__ import annotations

import importlib
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any, Final

from minerva_assistants.mcp.tool import AGENT_ID, Result, Tool, ToolCall, ToolImage, text, whole
from minerva_bus.cli.operation import COORDINATOR
from minerva_bus.errors import BusError, MisuseError, nearest
from minerva_bus.grammar.condition import Condition, Scope, parse_condition
from minerva_bus.grammar.scene import AgentNode, Scene, agents
from minerva_bus.grammar.text_and_digest import json_value
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.installed import installed_worlds
from minerva_bus.launch.registry import running
from minerva_bus.runtime.operator_client import status_object
from minerva_bus.wording import install

MAX_TEXT: Final = 100_000
"""Characters of the longest text in a result."""

USUAL_TEXT: Final = 20_000
"""Characters of a text of which no other length is asked."""

MAX_WAIT: Final = 300
POLL_SECONDS: Final = 0.1


MAX_VALUE: Final = 2000
"""Characters of the longest value of an attribute in a list of agents."""


def _part(long: str, offset: int, length: int) -> dict[str, Any]:
    """A part of a string; `next` is the offset of the one after it, if there is more."""
    if offset > len(long):
        raise MisuseError(f"the string has {len(long)} characters; offset is {offset}")
    end = offset + length
    more = {"next": end, "characters": len(long)} if end < len(long) else {}
    return {"string": long[offset:end], **more}


def vocabulary_object(vocabulary: Vocabulary) -> dict[str, Any]:
    """Symbols with the types of their parameters, attributes and data."""

    def typed(name: str) -> dict[str, str]:
        return {field.name: str(field.type) for field in vocabulary.fields(name).all}

    return {
        "agents": {
            kind.name: {
                "attributes": typed(kind.name),
                "responds_to": sorted(kind.subscribes),
                "drawn_for": sorted(kind.views),
            }
            for kind in vocabulary.kinds.values()
        },
        "primitives": {name: typed(name) for name in vocabulary.primitives},
        "transformations": {name: typed(name) for name in vocabulary.transformations},
        "events": {
            event.name: {
                "data": {field.name: str(field.type) for field in event.fields.all},
                "visual": event.visual,
            }
            for event in vocabulary.events.values()
        },
    }


def _list_worlds(call: ToolCall) -> Result:
    return {"running": [asdict(world) for world in running()], "installed": installed_worlds()}


def _status(call: ToolCall) -> Result:
    return status_object(call.link.live().status)


def _vocabulary(call: ToolCall) -> Result:
    return vocabulary_object(call.link.vocabulary())


def string_object(
    call: ToolCall, agent: str = "", offset: int = 0, length: int = MAX_TEXT
) -> dict[str, Any]:
    """The string of the world, or the text of one agent, from a character on."""
    live = call.link.live()
    if agent:
        return {"agent": agent, **_part(live.operator.fragment(agent), offset, length)}
    return {"frame": live.frame, **_part(str(live.scene), offset, length)}


def _string(call: ToolCall) -> Result:
    arguments = call.arguments
    agent, offset = arguments.get("agent", "").removeprefix("#"), arguments.get("offset", 0)
    return string_object(call, agent, offset, arguments.get("length", USUAL_TEXT))


def events_object(call: ToolCall, since: int = 0) -> dict[str, Any]:
    """The latest events, each with a number."""
    entries = call.link.live().operator.status(since).happenings
    return {"events": [asdict(entry) for entry in entries]}


def _events(call: ToolCall) -> Result:
    return events_object(call, call.arguments.get("since", 0))


def _logs(call: ToolCall) -> Result:
    live, member = call.link.live(), call.arguments.get("member", "")
    lines = live.operator.logs(call.arguments.get("since", 0), member)
    known = [each.name for each in live.status.members]
    # A member that has left may have lines, and one without lines may be present.
    if member and not lines and member not in (*COORDINATOR, *known):
        hint = nearest(member, known, f"there are {', '.join(known)}")
        raise MisuseError(f"there is no member {member!r}{hint}")
    return {"lines": [asdict(line) for line in lines]}


def fitting(tool: Tool, node: AgentNode | None) -> Tool:
    """A tool whose example is about an agent of the world, if it is about one."""
    example = dict(tool.example)
    if node is None or example.keys().isdisjoint({"kind", "agent"}) or "file" in example:
        return tool
    number = next((name for name, value in node.state.items() if type(value) in (int, float)), "")
    about = {"kind": node.symbol, "agent": node.id, "condition": f"{number} >= 0" if number else ""}
    return replace(tool, example=example | {name: about[name] for name in about if name in example})


class _Query:
    """Agents of a kind that fulfil a condition. Raises MisuseError and VocabularyError."""

    def __init__(self, vocabulary: Vocabulary, kind: str, condition: str) -> None:
        declared = vocabulary.kinds.get(kind)
        if declared is None:
            known = [*vocabulary.kinds]
            hint = nearest(kind, known) or f"; there are {', '.join(known)}"
            raise MisuseError(f"the world has no agents of kind {kind!r}{hint}")
        self._kind = kind
        self._condition: Condition = parse_condition(condition, "condition")
        scope = Scope(kind, declared.fields.names, declared.sort_of)
        self._condition.check([scope], "condition")

    def of(self, scene: Scene) -> list[AgentNode]:
        """The agents in a string, in its order."""
        return [
            node
            for node in agents(scene)
            if node.symbol == self._kind and self._condition.holds(node.state)
        ]


def _shown(node: AgentNode) -> dict[str, Any]:
    return {"id": node.id, **{name: _brief(value, node.id) for name, value in node.state.items()}}


def _brief(value: Any, agent: str) -> Any:
    """A value for JSON; a long one as the beginning of its text, and how to read all of it."""
    plain = json_value(value)
    long = json.dumps(plain, ensure_ascii=False)
    if len(long) <= MAX_VALUE:
        return plain
    return f"{long[:100]}… ({len(long)} characters; read_string with agent={agent!r} has all)"


def _find_agents(call: ToolCall) -> Result:
    live, arguments = call.link.live(), call.arguments
    query = _Query(live.vocabulary, arguments["kind"], arguments.get("condition", ""))
    frame, nodes = live.frame, query.of(live.scene)
    shown = nodes[: arguments.get("limit", 20)]
    return {"frame": frame, "count": len(nodes), "agents": [_shown(node) for node in shown]}


def _wait(call: ToolCall) -> Result:
    arguments = call.arguments
    if ("kind" in arguments) == ("event" in arguments):
        raise MisuseError("wait_for needs either `kind` with a condition, or `event`")
    moments = _agents_awaited(call) if "kind" in arguments else _event_awaited(call)
    until = time.monotonic() + arguments.get("seconds", 30)
    for state in moments:
        if state["fulfilled"] or time.monotonic() >= until or call.stop.wait(POLL_SECONDS):
            return {**state, "paused": call.link.live().status.paused}
    raise AssertionError("the states never end")


def _agents_awaited(call: ToolCall) -> Iterator[dict[str, Any]]:
    live, arguments = call.link.live(), call.arguments
    query = _Query(live.vocabulary, arguments["kind"], arguments.get("condition", ""))
    while True:
        frame, nodes = live.frame, query.of(live.scene)
        enough = len(nodes) >= arguments.get("count", 1)
        yield {"fulfilled": enough, "frame": frame, "count": len(nodes)}


def _event_awaited(call: ToolCall) -> Iterator[dict[str, Any]]:
    live, event = call.link.live(), call.arguments["event"]
    if event not in live.vocabulary.events:
        known = [*live.vocabulary.events]
        hint = nearest(event, known) or f"; there are {', '.join(known)}"
        raise MisuseError(f"the world has no event type {event!r}{hint}")
    since = max((entry.number for entry in live.operator.status().happenings), default=0)
    while True:
        status = live.operator.status(since)
        happened = [entry for entry in status.happenings if entry.about == event]
        events = [asdict(entry) for entry in happened]
        yield {"fulfilled": bool(happened), "frame": status.frame, "events": events}


def picture_of(call: ToolCall, event: str, width: int = 600) -> str:
    """An SVG document of the string. Raises MisuseError if the world has no pictures."""
    live = call.link.live()
    try:
        return (live.picture(event, width) if event else live.picture(width=width)).svg
    except BusError:
        raise
    except ImportError as error:
        raise MisuseError(f"the picture cannot be drawn: {error}") from None


def _picture(call: ToolCall) -> Result:
    svg = picture_of(call, call.arguments.get("event", ""), call.arguments.get("width", 600))
    try:
        rendering: Any = importlib.import_module("minerva_services.views.svg.rendering")
    except ImportError:
        # Few models read it.
        if len(svg) > MAX_TEXT:
            raise MisuseError(f"the picture is too large for SVG; {install('picture')}") from None
        return ToolImage(svg.encode(), "image/svg+xml")
    return ToolImage(rendering.png(svg), "image/png")


_KIND = text("Kind of agents, such as ARobot; see `vocabulary`.")
_CONDITION = text(
    "Condition on the attributes of an agent, such as 'energy < 5 and mood == \"calm\"'; units are"
    " those of the vocabulary. Empty: all agents.",
    longest=4000,
)
_SINCE = whole("Only entries after this number.", 0, 2**53)

TOOLS: Final = (
    Tool(
        "list_worlds", "List the running worlds of this machine, and installed ones.", _list_worlds
    ),
    Tool("status", "State of the world: frame, pace, members, who is awaited.", _status),
    Tool("vocabulary", "Kinds of agents, event types and other symbols, with units.", _vocabulary),
    Tool(
        "read_string",
        "Read the string of the world, or the text of one agent. With `next` in the result there is"
        " more: read on with this offset; pause the world before, because its string changes.",
        _string,
        {
            "agent": text("Id of an agent.", pattern=AGENT_ID),
            "offset": whole("Character to begin at.", 0, 2**53, default=0),
            "length": whole("Characters to return.", 1, MAX_TEXT, default=USUAL_TEXT),
        },
        example={"agent": "r1"},
    ),
    Tool(
        "recent_events",
        "List the latest events, in their order.",
        _events,
        {"since": _SINCE},
        example={"since": 120},
    ),
    Tool(
        "logs",
        "Read log lines of members.",
        _logs,
        {"member": text("Only this member."), "since": _SINCE},
        example={"member": "orders"},
    ),
    Tool(
        "find_agents",
        "Find agents of a kind that fulfil a condition.",
        _find_agents,
        {
            "kind": _KIND,
            "condition": _CONDITION,
            "limit": whole("Number of agents to return.", 1, 200, default=20),
        },
        ("kind",),
        example={"kind": "AFox", "condition": "energy < 50", "limit": 5},
    ),
    Tool(
        "wait_for",
        "Wait until agents fulfil a condition, or until an event of a type happens.",
        _wait,
        {
            "kind": _KIND,
            "condition": _CONDITION,
            "count": whole("Number of agents that must fulfil it.", 1, 10**9, default=1),
            "event": text("Event type to wait for, instead of agents."),
            "seconds": {
                "type": "number",
                "description": "Longest time to wait, in seconds.",
                "minimum": 0,
                "maximum": MAX_WAIT,
                "default": 30,
            },
        },
        example={"kind": "AFox", "condition": "energy < 5", "seconds": 60},
    ),
    Tool(
        "picture",
        "Draw the string, as PNG.",
        _picture,
        {
            "event": text("Visual event type; default: ePicture."),
            "width": whole("Width in pixels.", 100, 2000, default=600),
        },
        example={"width": 800},
    ),
)
