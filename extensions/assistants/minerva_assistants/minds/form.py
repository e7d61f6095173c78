"""JSON Schema of an event type, and the data of an event from JSON.

`topic` is left out of both: it is repeated from the request.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, cast

from minerva_assistants.schemas import schema_of_type
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType

TOPIC: Final = "topic"
MAX_SHOWN: Final = 80


def answer_fields(declared: EventType) -> tuple[Field, ...]:
    """The fields that an answer has to fill."""
    return tuple([field for field in declared.fields.all if field.name != TOPIC])


def schema_of(declared: EventType) -> dict[str, Any]:
    """JSON Schema of the data of an event type.

    Raises MisuseError if a field is a matrix or a string, which have no form in JSON.
    """
    properties: dict[str, Any] = {}
    for field in answer_fields(declared):
        schema = schema_of_type(field.type)
        if schema is None:
            raise MisuseError(f"{declared.name}.{field.name} is a {field.type}, not a JSON value")
        properties[field.name] = schema
    return {
        "type": "object",
        "properties": properties,
        "required": [*properties],
        "additionalProperties": False,
    }


def event_of(declared: EventType, text: str, topic: str) -> Event:
    """The event in a JSON object, or in free text if the type has a single text.

    Text around the object, such as a code fence, is ignored. Raises MisuseError if the data do not
    fit the type.
    """
    data = json_object(text)
    if data is None:
        fields = answer_fields(declared)
        if len(fields) != 1 or fields[0].type != Type("text"):
            raise MisuseError(f"expected a JSON object, not {text.strip()[:MAX_SHOWN]!r}")
        data = {fields[0].name: text.strip()}
    if TOPIC in declared.fields.names:
        data = {**data, TOPIC: topic}
    try:
        event: Event = declared(**cast("dict[str, Any]", data))
    except TypeError as error:
        raise MisuseError(str(error)) from None
    return event


def json_object(text: str) -> Mapping[str, Any] | None:
    """The JSON object in a text, or None; text around it is ignored."""
    start, end = text.find("{"), text.rfind("}")
    if start < 0 or end < start:
        return None
    try:
        data = json.loads(text[start : end + 1])
    # A few kilobytes of nested lists exhaust the stack of the decoder.
    except (ValueError, RecursionError):
        return None
    return cast("dict[str, Any]", data) if isinstance(data, dict) else None
