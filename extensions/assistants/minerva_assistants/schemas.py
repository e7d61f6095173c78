"""JSON Schemas of types and fields, for models and clients that fill in data."""

from __future__ import annotations

import math
from typing import Any, Final

from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.types import Type

_JSON_TYPES: Final = {"bool": "boolean", "int": "integer", "real": "number", "text": "string"}


def schema_of_type(kind: Type) -> dict[str, Any] | None:
    """JSON Schema of the values of a type; None for matrices and strings, which JSON lacks."""
    if kind.item is not None:
        items = schema_of_type(kind.item)
        return None if items is None else {"type": "array", "items": items}
    if kind.kind not in _JSON_TYPES:
        return None
    schema: dict[str, Any] = {"type": _JSON_TYPES[kind.kind]}
    if kind.words:
        schema["enum"] = list(kind.words)
    if kind.unit:
        schema["description"] = f"in {kind.unit}"
    if kind.of is not None:
        schema["description"] = f"a {kind.of.parameter} of a {kind.of.symbol} in the string"
    if kind.range is not None:
        ends = {"minimum": kind.range.least, "maximum": kind.range.most}
        schema |= {name: end for name, end in ends.items() if math.isfinite(end)}
    return schema


def schema_of_fields(fields: Fields) -> dict[str, Any] | None:
    """JSON Schema of an object with these fields; None if a required one has no form in JSON."""
    properties = {field.name: _with_default(field) for field in fields.all}
    required = [field.name for field in fields.all if field.default is None]
    if any(properties[name] is None for name in required):
        return None
    return {
        "type": "object",
        "properties": {name: schema for name, schema in properties.items() if schema is not None},
        "required": required,
        "additionalProperties": False,
    }


def _with_default(field: Field) -> dict[str, Any] | None:
    schema = schema_of_type(field.type)
    if schema is not None and isinstance(field.default, bool | int | float | str):
        schema["default"] = field.default
    return schema
