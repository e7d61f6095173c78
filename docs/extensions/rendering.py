"""Markdown that a directive makes, rendered as part of its page."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, cast

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

ESCAPED = str.maketrans({mark: f"\\{mark}" for mark in r"\|<>*_[]$#"})


class MarkdownDirective(SphinxDirective):
    """A directive that shows Markdown."""

    def rendered(self, text: str, folder: Path | None = None) -> list[nodes.Node]:
        """Add Markdown to the page; its links and images are relative to `folder`, or the page."""
        renderer = cast(Any, self.state)._renderer
        here = Path(self.env.doc2path(self.env.docname)).parent
        folder = folder or here
        renderer.md_env["relative-images"] = os.path.relpath(folder, here)
        renderer.md_env["relative-docs"] = ("", here, folder)  # "" is the prefix of all links.
        try:
            renderer.nested_render_text(text, 0, heading_offset=0)
        finally:
            del renderer.md_env["relative-images"], renderer.md_env["relative-docs"]
        return []


def table(titles: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines) + "\n"


def plain(text: str) -> str:
    """A text with its Markdown characters escaped, except in `code`."""
    parts = text.split("`")
    return "`".join(part if at % 2 else part.translate(ESCAPED) for at, part in enumerate(parts))
