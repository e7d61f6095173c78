"""Tools: their declaration, one call, and its result."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from minerva_assistants.mcp.connection import WorldConnection

AGENT_ID: Final = "^#?[A-Za-z0-9_][A-Za-z0-9_:-]*$"
"""Pattern of the id of an agent; messages write it with #, the string is without."""


@dataclass(frozen=True, slots=True)
class ToolImage:
    """An image as the result of a tool."""

    content: bytes
    media_type: str


Result: TypeAlias = dict[str, Any] | ToolImage


@dataclass(frozen=True, slots=True)
class ToolCall:
    """One call of a tool.

    `arguments` fit the schema of the tool. `person` is the caller's name,
    under which the world logs, records and judges orders. `stop` is set when the result is no
    longer wanted.
    """

    arguments: Mapping[str, Any]
    link: WorldConnection
    folder: Path
    person: str = ""
    stop: threading.Event = field(default_factory=threading.Event)


@dataclass(frozen=True, slots=True)
class Tool:
    """A tool: `run` executes a call in a thread and raises MinervaError.

    `permission` is one of PERMISSIONS, or empty for a tool that changes nothing; `example` are
    arguments of a call.
    """

    name: str
    description: str
    run: Callable[[ToolCall], Result]
    properties: Mapping[str, Any] = field(default_factory=dict[str, Any])
    required: tuple[str, ...] = ()
    permission: str = ""
    example: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def allowed(self, permissions: frozenset[str]) -> bool:
        """Whether a server with these permissions offers the tool."""
        return not self.permission or self.permission in permissions

    @property
    def schema(self) -> dict[str, Any]:
        """JSON Schema of the arguments."""
        return {
            "type": "object",
            "properties": dict(self.properties),
            "required": list(self.required),
            "additionalProperties": False,
            "examples": [dict(self.example)],
        }


def shortened(shown: str, most: int = 200) -> str:
    """The beginning of a long text, and its length; a short one as it is."""
    return shown if len(shown) <= most else f"{shown[:100]}… ({len(shown)} characters)"


def text(description: str, longest: int = 200, **more: Any) -> dict[str, Any]:
    """JSON Schema of a text."""
    return {"type": "string", "description": description, "maxLength": longest, **more}


def whole(description: str, least: int, most: int, **more: Any) -> dict[str, Any]:
    """JSON Schema of an integer."""
    return {
        "type": "integer", "description": description, "minimum": least, "maximum": most, **more
    }  # fmt: skip
