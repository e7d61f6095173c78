"""Resources: what clients may read of a world, by URI."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from minerva_assistants.mcp.observing import (
    events_object,
    picture_of,
    string_object,
    vocabulary_object,
)
from minerva_assistants.mcp.tool import ToolCall
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import AGENT_ID
from minerva_bus.runtime.operator_client import status_object

_ROOT: Final = "minerva://world"
AGENT_TEMPLATE: Final = f"{_ROOT}/agents/{{id}}"
_JSON: Final = "application/json"


@dataclass(frozen=True, slots=True)
class Resource:
    """A resource; `changes`: in each frame."""

    name: str
    description: str
    read: Callable[[ToolCall], Any]
    media_type: str = _JSON
    changes: bool = True
    root: str = _ROOT

    @property
    def uri(self) -> str:
        """Its URI."""
        return f"{self.root}/{self.name}"


RESOURCES: Final = (
    Resource("string", "The string of the world, with its frame.", string_object),
    Resource(
        "vocabulary",
        "Kinds of agents, event types and other symbols, with units.",
        lambda call: vocabulary_object(call.link.vocabulary()),
        changes=False,
    ),
    Resource(
        "members",
        "State of the world and of its members.",
        lambda call: status_object(call.link.live().status),
    ),
    Resource("events", "The latest events, in their order.", events_object),
    Resource("picture", "The string, drawn.", lambda call: picture_of(call, ""), "image/svg+xml"),
)


def read(uri: str, call: ToolCall, resources: Sequence[Resource] = RESOURCES) -> tuple[str, str]:
    """Media type and text of a resource. Raises MinervaError."""
    for resource in resources:
        if resource.uri == uri:
            return resource.media_type, _text(resource.read(call))
    agent = uri.removeprefix(AGENT_TEMPLATE.partition("{")[0])
    if agent != uri and AGENT_ID.fullmatch(agent):
        return _JSON, _text(string_object(call, agent))
    known = ", ".join([*(resource.uri for resource in resources), AGENT_TEMPLATE])
    raise MisuseError(f"there is no resource {uri[:200]!r}; there are {known}")


def _text(content: Any) -> str:
    return content if isinstance(content, str) else json.dumps(content, ensure_ascii=False)
