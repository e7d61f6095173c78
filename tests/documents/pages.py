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
        *sorted((ROOT / "extensions").glob("*/*.md")),
        ROOT / "deploy" / "README.md",
        *sorted((ROOT / "worlds" / "minerva_worlds").glob("*/README.md")),
    )
}


SHELL = ("sh", "bash", "shell", "console")
"""Languages of blocks that a reader types into a terminal."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, the line of the page where the text starts, and its title.

    The title is the line above the block; if it ends with a file name and a colon (`garden.py`:), the
    block is the content of that file.
    """

    language: str
    text: str
    line: int
    title: str = ""

    @property
    def file(self) -> str:
        """The name of the file that the block shows, or an empty text."""
        match = re.search(r"`([\w./-]+\.\w+)`:$", self.title)
        return match[1] if match and self.language not in SHELL else ""


def blocks(page: str, *languages: str) -> list[Block]:
    """The fenced blocks of a page in the given languages, in order."""
    text = PAGES[page].read_text(encoding="utf-8")
    blocks = []
    for m in re.finditer(r"^```(\w*)[^\n]*\n(.*?)^```", text, re.S | re.M):
        above = text[: m.start()].rstrip().rpartition("\n")[2]
        blocks.append(Block(m[1], m[2], text.count("\n", 0, m.start(2)) + 1, above))
    return [block for block in blocks if not languages or block.language in languages]


def written(block: Block, before: str) -> str:
    """The content of the block's file: the block, or with "Add to `garden.py`:" both."""
    if before and re.search(r"\badd to `", block.title, re.I):
        return f"{before.rstrip()}\n\n{block.text}"
    return block.text


@dataclass(frozen=True)
class Command:
    """A command and the output that the page shows of it; None: the page shows none."""

    line: str
    output: str | None


def transcript(block: Block) -> list[Command]:
    """The commands of a shell block, in a console block with their outputs."""
    if block.language != "console":
        return [Command(line, None) for line in commands(block)]
    parts = re.split(r"^\$ ((?:.*\\\n)*.*)\n", block.text, flags=re.M)[1:]
    return [
        Command(without_comment(re.sub(r"\\\n\s*", "", line)), output or None)
        for line, output in zip(parts[::2], parts[1::2], strict=True)
    ]


VARIES = (
    (r"[^\n]*(\x1b\[2K|\r(?!\n))", ""),  # a line that was erased or overwritten
    (r"\x1b\[[0-9;?]*[A-Za-z]|\r", ""),
    (r"^\S+ │ .* (waiting|waits|instead of|finishing) .*\n", ""),  # on a busy machine
    (r"\b\d+(\.\d+)?(?= ?s\b| per second\b| ms\b)", "N"),
    (r"\(imports and checks .*\)", "(imports)"),
    (r"127\.0\.0\.1:\d+", "127.0.0.1:PORT"),
    (r"[ \t]+$", ""),
    (r"(?<=\S) {2,}", "  "),  # widths of columns
)
"""What differs between two runs of a command: terminal codes, durations, rates and ports."""


def stable(text: str) -> str:
    """An output without what differs between two runs."""
    for pattern, to in VARIES:
        text = re.sub(pattern, to, text, flags=re.M)
    return text.strip("\n")


def pattern(output: str) -> str:
    """The regular expression of an output as a page shows it; an ellipsis stands for any text."""
    lines = []
    for line in stable(output).split("\n"):
        if line == "...":
            lines.append(r"(?:.*\n)*?")
        else:
            lines.append(".*?".join(map(re.escape, line.split("..."))) + r"\n")
    return "".join(lines)


def commands(block: Block) -> list[str]:
    """The command lines of a shell block as a reader types them, without prompts and comments.

    Lines joined by backslashes form one command, and so do a command and its here-document.
    """
    lines = block.text.splitlines()
    if block.language == "console":
        typed = re.findall(r"^\$ (.*(?:(?<=\\)\n.*)*)", block.text, re.M)
        lines = "\n".join(typed).splitlines()
    text = re.sub(r"\\\n\s*", "", "\n".join(lines))
    commands: list[str] = []
    end = ""
    for line in text.splitlines():
        if end:
            commands[-1] += "\n" + line
            end = "" if line == end else end
            continue
        here = re.search(r"<<'(\w+)'", line)
        end = here[1] if here else ""
        plain = without_comment(line)
        commands += [plain] if plain else []
    return commands


def without_comment(line: str) -> str:
    """A command line without the remark after it."""
    return re.sub(r"(^|\s)#\s.*$", "", line).rstrip()


def shell(page: str) -> list[list[str]]:
    """The shell commands of a page, by block."""
    return [commands(block) for block in blocks(page, *SHELL)]
