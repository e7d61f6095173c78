"""Lines of code of a folder or file of the repository, counted when the site is built."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxRole

SUFFIXES = {".py": "Python", ".toml": "TOML"}


def lines_of(path: Path) -> dict[str, int]:
    """Lines by language, without blank lines and comments."""
    files = [path] if path.is_file() else sorted(path.iterdir())
    counts: dict[str, int] = {}
    for file in files:
        if language := SUFFIXES.get(file.suffix):
            lines = file.read_text(encoding="utf-8").splitlines()
            code = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
            counts[language] = counts.get(language, 0) + len(code)
    return counts


class Lines(SphinxRole):
    """The lines of a path relative to the repository, such as `90 lines of Python`."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        counts = lines_of(Path(self.env.srcdir).parent / self.text)
        text = ", ".join(f"{count} lines of {language}" for language, count in counts.items())
        return [nodes.Text(text)], []


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_role("lines", Lines())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
