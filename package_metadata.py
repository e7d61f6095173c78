"""Metadata of the package for an index: the long description and the project's addresses.

`MINERVA_PROJECT_URL` is the base address of the files of this repository in a browser, such as
`https://example.org/minerva-bus/raw/main`, when a package is built. Relative links and images of
README.md then lead there. Without it links become plain text and images are left out, because an
index page shows neither.
"""

import os
import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

VARIABLE = "MINERVA_PROJECT_URL"
# Code stays as it is. A link or an image whose target has no scheme and is no anchor is relative.
PART = re.compile(
    r"(?P<code>^```.*?^```|`[^`\n]+`)|(?P<image>!?)\[(?P<text>[^\]]*)\]\((?P<path>(?!\w+:|#)[^)\s]+)\)",
    re.S | re.M,
)
PAGES = {
    "Documentation": "docs/index.md",
    "Changelog": "CHANGELOG.md",
    "Source": "README.md",
}


def described(text: str, base: str) -> str:
    """A Markdown text for readers elsewhere: relative targets are below `base`, or left out."""

    def part(match: re.Match[str]) -> str:
        if match["code"]:
            return match[0]
        if base:
            return f"{match['image']}[{match['text']}]({base}/{match['path']})"
        return "" if match["image"] else match["text"]

    return re.sub(r"\n{3,}", "\n\n", PART.sub(part, text))


def addresses(base: str) -> dict[str, str]:
    """The project's addresses; none without a base."""
    return {name: f"{base}/{path}" for name, path in PAGES.items()} if base else {}


class PackageMetadata(MetadataHookInterface):
    """Called by hatchling when it builds a package or installs it for development."""

    def update(self, metadata: dict) -> None:
        base = os.environ.get(VARIABLE, "").rstrip("/")
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": described(text, base)}
        metadata["urls"] = addresses(base)
