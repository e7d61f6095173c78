"""Mermaid blocks as drawings, made when the site is built: pages need no script.

The first line of a block after its type is `accTitle: TEXT`, the alternative text of the drawing.
"""

from __future__ import annotations

import hashlib
import re
from html import escape
from pathlib import Path
from typing import Any

import mermaidx
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.osutil import relative_uri

FOLDER = "_images"
TITLE = re.compile(r"^\s*accTitle: *(.+)$", re.M)


def sized(svg: str) -> str:
    """An SVG with the size of its view box; Mermaid makes it as wide as its page."""
    width, height = re.search(r'viewBox="\S+ \S+ (\S+) (\S+)"', svg).groups()
    return svg.replace('width="100%"', f'width="{width}" height="{height}"', 1)


class Drawings(SphinxPostTransform):
    """Replaces Mermaid blocks with drawings. Raises ValueError for a block without `accTitle`."""

    default_priority = 200
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        for block in list(self.document.findall(nodes.literal_block)):
            if block.get("language") == "mermaid":
                block.replace_self(self.drawing(block.astext()))

    def drawing(self, source: str) -> nodes.raw:
        """Write the drawing of a block as a file; the element that shows it."""
        title = TITLE.search(source)
        if title is None:
            raise ValueError(f"{self.env.docname}: a Mermaid block needs a line accTitle: {source}")
        name = f"mermaid-{hashlib.sha256(source.encode()).hexdigest()[:16]}.svg"
        path = Path(self.app.outdir, FOLDER, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(sized(mermaidx.render(source, theme="neutral").svg()), encoding="utf-8")
        page = self.app.builder.get_target_uri(self.env.docname)
        uri = relative_uri(page, f"{FOLDER}/{name}")
        image = f'<img alt="{escape(title[1])}" src="{uri}">'
        html = f'<p class="drawing"><a href="{uri}">{image}</a></p>'
        return nodes.raw("", html, format="html")


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_post_transform(Drawings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
