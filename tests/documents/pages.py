"""The documentation's pages: their code blocks, and the shell commands in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = {
    str(path.relative_to(ROOT)): path
    for path in (
        ROOT / "README.md",
        *sorted((ROOT / "docs").rglob("*.md")),
        ROOT / "deploy" / "README.md",
        *sorted((ROOT / "worlds" / "minerva_worlds").glob("*/README.md")),
    )
}


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, and the line of the page where the text starts."""

    language: str
    text: str
    line: int


def blocks(page: str, *languages: str) -> list[Block]:
    """The fenced blocks of a page in the given languages, in order."""
    text = PAGES[page].read_text(encoding="utf-8")
    matches = re.finditer(r"^```(\w*)[^\n]*\n(.*?)^```", text, re.S | re.M)
    found = [Block(m[1], m[2], text.count("\n", 0, m.start(2)) + 1) for m in matches]
    return [block for block in found if not languages or block.language in languages]


def commands(block: Block) -> list[str]:
    """The command lines of a shell block as a reader types them, without prompts and comments.

    Lines joined by backslashes form one command, and so do a command and its here-document.
    """
    lines = block.text.splitlines()
    if block.language == "console":
        lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    text = re.sub(r"\\\n\s*", "", "\n".join(lines))
    found: list[str] = []
    end = ""
    for line in text.splitlines():
        if end:
            found[-1] += "\n" + line
            end = "" if line == end else end
            continue
        here = re.search(r"<<'(\w+)'", line)
        end = here[1] if here else ""
        plain = re.sub(r"(^|\s)#\s.*$", "", line).rstrip()
        found += [plain] if plain else []
    return found


def shell(page: str) -> list[list[str]]:
    """The shell commands of a page, by block."""
    return [commands(block) for block in blocks(page, "sh", "bash", "shell", "console")]
