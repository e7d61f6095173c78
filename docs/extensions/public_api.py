"""The public interface from its docstrings: the names of `minerva_bus`, by their modules."""

from __future__ import annotations

import re
from types import FunctionType
from typing import Any

from docutils import nodes
from rendering import MarkdownDirective
from sphinx.application import Sphinx

import minerva_bus

INTERNAL = {
    "Agent": "activities, batches, counted, freeze, kind, population, population_views, thaw,"
    " views",
    "Context": "batch, shared_streams, answers, emitted, streams, row",
    "Events": "columns, concatenated, distinct, repeated",
    "Ids": "consecutive, differs, in_common, known, put, row_of, rows_of, since, sound_like,"
    " strange, text_of, turned",
    "Tick": "batch, shared_streams, answers, emitted, streams, row",
    "Vocabulary": "check_any, check_events, fields",
}
"""Methods and attributes for engines, not for worlds."""
DATA = {"EMPTY", "Cells", "Degrees", "Metres", "MetresPerSecond", "Reals", "Seconds"}
"""Names that are described on their page, because values and types have no docstrings."""


def public_names(modules: set[str]) -> list[str]:
    """The public names of these modules, in the order of the modules."""
    homes = minerva_bus._HOMES
    if unknown := modules - set(homes):
        raise ValueError(f"minerva_bus has no public names from {', '.join(sorted(unknown))}")
    return [n for home, names in homes.items() if home in modules for n in names.split()]


def described(name: str) -> str:
    """The autodoc directive of one name."""
    item = getattr(minerva_bus, name, None)
    if name in DATA:
        return f".. py:data:: minerva_bus.{name}\n   :no-contents-entry:\n"
    if isinstance(item, FunctionType):
        return f".. autofunction:: minerva_bus.{name}\n"
    hidden = f"   :exclude-members: {INTERNAL[name]}\n" if name in INTERNAL else ""
    # Contexts inherit the time of the frame; all else is described with the class that has it.
    whole = "   :inherited-members:\n" if name in ("Context", "BatchContext", "Tick") else ""
    return f".. autoclass:: minerva_bus.{name}\n   :members:\n{hidden}{whole}"


class Public(MarkdownDirective):
    """The public names of modules, such as `{public} api.world api.running`."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        names = public_names(set(self.arguments[0].split()))
        text = "\n".join(described(name) for name in names)
        return self.rendered(f"```{{eval-rst}}\n{text}\n```\n")


def with_code_blocks(
    app: Sphinx, what: str, name: str, item: object, options: object, lines: list[str]
) -> None:
    """Make indented code of a docstring a code block; docstrings do not mark it with `::`."""
    text = "\n".join(lines)
    code = re.compile(r"(?<=\n\n)((?: {4,}(?!>>>).*\n|\n)+)", re.M)
    if what in ("class", "module") and not re.search(
        r"^(Args|Attributes|Raises|Returns|Example):", text, re.M
    ):
        text = code.sub(lambda match: f".. code-block:: python\n\n{match[0]}\n", text + "\n")
        lines[:] = text.split("\n")


def with_dashes(app: Sphinx, document: nodes.document) -> None:
    """Make the hyphens between a parameter and its description a dash, as typography would."""
    for text in list(document.findall(nodes.Text)):
        if text == " -- ":
            text.parent.replace(text, nodes.Text(" – "))


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_directive("public", Public)
    app.connect("autodoc-process-docstring", with_code_blocks, priority=100)
    app.connect("doctree-read", with_dashes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
