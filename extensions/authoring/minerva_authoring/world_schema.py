"""The JSON Schema of world files, for editors that validate and complete them.

It follows from the declarations in world_settings.py. It accepts every valid file; references
between tables, names of modules and numbers like NaN are left to `minerva check`.
"""

from __future__ import annotations

from typing import Any, Final

from minerva_bus.settings.kinds import TOPICS, Setting, settings_of, whole
from minerva_bus.settings.world_settings import TABLES, PatienceSettings
from minerva_bus.wire.plain import DEFAULT, configurable_limits

_TEXT: Final = {"type": "string"}
_REFERENCE: Final = {"type": "string", "pattern": r"\$\{[^}]+\}"}
"""`${option}`, which stands for a value of any type."""

_RECORD: Final = {
    "type": "object",
    "properties": {"file": {"type": "string"}, "topics": TOPICS.schema},
    "additionalProperties": False,
}
_HOSTS: Final = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
_PLACES: Final = {
    "type": "object",
    "properties": {"only": _HOSTS, "near": {"type": "string"}},
    "additionalProperties": False,
}


def world_schema() -> dict[str, Any]:
    """The JSON Schema, draft 2020-12, of a world file."""
    tables: dict[str, dict[str, Any]] = {}
    for cls in TABLES:
        for setting in settings_of(cls).values():
            if setting.key:
                tables.setdefault(setting.table, {})[setting.key] = _property(setting)
    tables["world"]["record"]["anyOf"].append(_RECORD)
    for setting in settings_of(PatienceSettings).values():
        tables["process.NAME"][setting.key] = _property(setting)
    tables["limits"] = {
        name: {**whole(least).schema, "default": getattr(DEFAULT, name)}
        for name, least in configurable_limits().items()
    }
    choices = {"type": "array", "minItems": 1}
    properties: dict[str, Any] = {
        "options": {"type": "object"},
        "choices": {"type": "object", "additionalProperties": choices},
    }
    for name, settings in sorted(tables.items()):
        group, _, each = name.partition(".")
        table = {"type": "object", "properties": settings, "additionalProperties": False}
        properties[group] = {"type": "object", "additionalProperties": table} if each else table
    properties["world"]["required"] = ["vocabulary"]
    properties["placement"]["additionalProperties"] = {"anyOf": [*_HOSTS["anyOf"], _PLACES]}
    # Other keys of a process are arguments of its service.
    properties["process"]["additionalProperties"]["additionalProperties"] = True
    properties["process"]["additionalProperties"]["oneOf"] = [
        {"required": [key]} for key in ("agents", "service", "command")
    ]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A world of Minerva Bus",
        "type": "object",
        "properties": properties,
        "required": ["world"],
        "additionalProperties": False,
    }


def _property(setting: Setting) -> dict[str, Any]:
    accepted = setting.kind.schema
    text = f"{setting.help} {setting.more}".strip()
    described: dict[str, Any] = {"description": text}
    if accepted:
        kinds = accepted.get("anyOf", [accepted])
        # A text may contain a reference anyway.
        described["anyOf"] = [*kinds, *([_REFERENCE] if _TEXT not in kinds else [])]
    if setting.default not in (None, "", ()):
        described["default"] = setting.default
    return described
