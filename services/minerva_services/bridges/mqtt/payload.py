"""What a message says: JSON, or a plain text or number."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, cast

LONGEST: Final = 64 * 1024
VALUE: Final = "value"
"""What a payload is called that is no JSON object."""


class Garbage(Exception):
    """A message is none that could become an event; the message says why."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A payload as a text, and as the JSON that it is; a text that is no JSON is itself."""

    text: str
    content: Any

    @staticmethod
    def of(data: bytes) -> Payload:
        """The payload of a message. Raises Garbage."""
        if len(data) > LONGEST:
            raise Garbage(f"{len(data)} bytes, more than {LONGEST}")
        try:
            text = data.decode()
        except UnicodeDecodeError:
            raise Garbage("no text in UTF-8") from None
        try:
            return Payload(text, json.loads(text))
        except (ValueError, RecursionError):
            return Payload(text, text)

    @property
    def fields(self) -> Mapping[str, Any]:
        """The fields of a JSON object; else the payload itself, as `value`."""
        if isinstance(self.content, dict):
            return cast("dict[str, Any]", self.content)
        return {VALUE: self.content}

    def at(self, path: str) -> Any:
        """What stands at a path such as `sensors.0.celsius`; None where nothing does."""
        found: Any = self.fields
        for step in path.split("."):
            if isinstance(found, Mapping):
                found = cast("Mapping[str, Any]", found).get(step)
            elif isinstance(found, list) and step.isdecimal():
                items = cast("list[Any]", found)
                found = items[int(step)] if int(step) < len(items) else None
            else:
                return None
        return found
