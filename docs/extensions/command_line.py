"""The commands of `minerva`, and the options of worlds, from the program itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer
from docutils import nodes
from rendering import MarkdownDirective, plain, table
from sphinx.application import Sphinx

from minerva_bus.cli.main import app, topics
from minerva_bus.launch.installed import declared_options

ADDITION = re.compile(r"\s*\[(default|env var|required)[^\]]*\]")


def page() -> str:
    """The Markdown of all commands, by topic."""
    program: Any = typer.main.get_command(app)
    return "\n".join(
        line
        for topic, names in topics().items()
        for line in (f"## {topic}\n", *(text for n in names for text in command(program, n)))
    )


def command(group: Any, name: str, prefix: str = "minerva") -> Iterator[str]:
    """The Markdown of a command and its subcommands."""
    declared = group.commands[name]
    yield f"### {prefix} {name}\n"
    context = declared.make_context(name, ["--help"], resilient_parsing=True)
    if not hasattr(declared, "commands"):
        usage = " ".join(declared.collect_usage_pieces(context))
        yield f"```text\n{prefix} {name} {usage}\n```\n"
    yield plain(declared.help or "") + "\n"
    records = [each.get_help_record(context) for each in declared.params if not each.hidden]
    rows = [[f"`{names}`", *meaning(text)] for names, text in filter(None, records)]
    if rows:
        yield table(["argument or option", "meaning", "default"], rows)
    lines = [line.strip() for line in (declared.epilog or "").splitlines()]
    examples = [line for line in lines if line.startswith("minerva ")]
    if examples:
        yield "\n".join(["```console", *(f"$ {line}" for line in examples), "```", ""])
    for inner in getattr(declared, "commands", {}):
        yield from command(declared, inner, f"{prefix} {name}")


def meaning(text: str) -> list[str]:
    """The cells for the help of an option: its meaning and its default."""
    additions = [each[0].strip(" []") for each in ADDITION.finditer(text)]
    default = "; ".join(each.removeprefix("default: ") for each in additions)
    return [plain(ADDITION.sub("", text)), f"`{default}`" if default else ""]


class Commands(MarkdownDirective):
    """All commands."""

    def run(self) -> list[nodes.Node]:
        return self.rendered(page())


class WorldOptions(MarkdownDirective):
    """A table of the options of a world."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        lines = [option.help_line() for option in declared_options(self.arguments[0])]
        # Not a new cell: the choices of an option are separated by a vertical bar.
        rows = [[f"`{name}`".replace("|", r"\|"), *meaning(text)] for name, text in lines]
        return self.rendered(table(["option", "meaning", "default"], rows))


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_directive("commands", Commands)
    app.add_directive("world-options", WorldOptions)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
