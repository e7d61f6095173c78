"""Payloads of messages: JSON, or plain text and numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, cast

LONGEST: Final = 64 * 1024
VALUE: Final = "value"
"""Name of a payload that is not a JSON object."""


class InvalidPayload(Exception):
    """A message cannot become an event; the text gives the reason."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A payload as text and as parsed JSON; text that is not JSON stands for itself."""

    text: str
    content: Any

    @staticmethod
    def of(data: bytes) -> Payload:
        """Decode a payload. Raises InvalidPayload."""
        if len(data) > LONGEST:
            raise InvalidPayload(f"{len(data)} bytes, the limit is {LONGEST}")
        try:
            text = data.decode()
        except UnicodeDecodeError:
            raise InvalidPayload("not UTF-8 text") from None
        try:
            return Payload(text, json.loads(text))
        except (ValueError, RecursionError):
            return Payload(text, text)

    @property
    def fields(self) -> Mapping[str, Any]:
        """The fields of a JSON object; otherwise the payload itself as `value`."""
        if isinstance(self.content, dict):
            return cast("dict[str, Any]", self.content)
        return {VALUE: self.content}

    def at(self, path: str) -> Any:
        """The value at a path such as `sensors.0.celsius`; None if absent."""
        value: Any = self.fields
        for step in path.split("."):
            if isinstance(value, Mapping):
                value = cast("Mapping[str, Any]", value).get(step)
            elif isinstance(value, list) and step.isdecimal():
                items = cast("list[Any]", value)
                value = items[int(step)] if int(step) < len(items) else None
            else:
                return None
        return value
