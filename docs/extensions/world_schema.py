"""Tables of the JSON Schema of world files, from the schema that `minerva schema` prints."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from rendering import MarkdownDirective, table
from sphinx.application import Sphinx

from minerva_authoring.world_schema import world_schema

REFERENCE = r"\$\{"
"""How the pattern of `${option}` begins; the page mentions it once."""


def tables() -> Iterator[str]:
    """The Markdown of a section for each table of a world file."""
    for name, described in world_schema()["properties"].items():
        each = "properties" not in described and isinstance(
            described.get("additionalProperties"), dict
        )
        yield f"## {f'{name}.NAME' if each else name}\n"
        yield from section(described["additionalProperties"] if each else described)


def section(described: dict[str, Any]) -> Iterator[str]:
    """The keys of a table of a world file, and what else it accepts."""
    required = described.get("required", [])
    rows = [
        [f"`{key}`", values(item), default(item, key in required)]
        for key, item in described.get("properties", {}).items()
    ]
    if rows:
        yield table(["key", "values", "default"], rows)
    if choice := [each["required"][0] for each in described.get("oneOf", [])]:
        yield f"Exactly one of {', '.join(f'`{key}`' for key in choice)} is required.\n"
    other = described.get("additionalProperties", True)
    if isinstance(other, dict):
        yield f"Each other key: {values(other)}.\n"
    else:
        keys = "Other keys" if rows else "All keys"
        yield f"{keys} are {'allowed' if other else 'errors'}.\n"


def values(item: dict[str, Any]) -> str:
    """The values that a key accepts, such as `integer, 1 or more`; all if it says nothing."""
    kinds = [kind for kind in item.get("anyOf", [item]) if REFERENCE not in kind.get("pattern", "")]
    return " or ".join(dict.fromkeys(map(value, kinds)))


def value(kind: dict[str, Any]) -> str:
    """One kind of value."""
    if "enum" in kind or "const" in kind:
        return ", ".join(f"`{json.dumps(each)}`" for each in kind.get("enum", [kind.get("const")]))
    if kind.get("type") == "array":
        return f"array of {values(kind['items'])}" if "items" in kind else "array"
    if kind.get("type") == "object" and "properties" in kind:
        return f"table with {', '.join(f'`{key}`' for key in kind['properties'])}"
    name = {"object": "table", None: "any"}.get(kind.get("type"), kind.get("type"))
    limits = [
        f"{word} {kind[bound]:g}"
        for bound, word in BOUNDS.items()
        if bound in kind and abs(kind[bound]) < LARGEST
    ]
    pattern = [f"matches `{kind['pattern']}`"] if "pattern" in kind else []
    return ", ".join([str(name), *limits, *pattern])


BOUNDS = {
    "minimum": "at least",
    "exclusiveMinimum": "more than",
    "maximum": "at most",
    "exclusiveMaximum": "less than",
}
LARGEST = 2**63 - 1
"""The largest integer of TOML, which limits all integers."""


def default(item: dict[str, Any], required: bool) -> str:
    """The cell for the default of a key."""
    if required:
        return "required"
    return f"`{json.dumps(item['default'])}`" if "default" in item else ""


class SchemaTables(MarkdownDirective):
    """All tables of the schema."""

    def run(self) -> list[nodes.Node]:
        return self.rendered("\n".join(tables()))


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_directive("schema-tables", SchemaTables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
