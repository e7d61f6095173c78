"""Shell completion: adapts what shells send and receive, and keeps it fast."""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, redirect_stdout
from typing import Any, Final

from typer.core import TyperCommand, TyperGroup

from minerva_bus.cli.conversions import use_plain_conversions

ASKED: Final = "_MINERVA_COMPLETE"
_WITH_VALUE: Final = re.compile(r"(--[\w-]+)=([^'\"]*)")
"""An option and its value in one word, which is completed as two words."""
_BEGINNINGS: Final = {
    # The first line is `_arguments '*: :(("VALUE":"HELP"`, the others are `"VALUE":"HELP"`.
    "zsh": re.compile(r"""^((?:_arguments '\*: :\(\()?")"""),
    "fish": re.compile(r"^()(?=.)"),
}
"""What is before the value in a line of the answer."""
_BREAKS: Final = re.compile(r"[:=]+")
"""Characters at which bash divides words; `svg:path=a.svg` is five of them."""


def completing() -> bool:
    """Whether a shell asks for completions."""
    return ASKED in os.environ


@contextmanager
def adapted() -> Generator[None]:
    """Answer a shell; of other commands nothing changes."""
    if not completing():
        yield
        return
    # Typer formats descriptions with rich if it is installed, which takes longer than all the rest.
    sys.modules.setdefault("rich", None)  # pyright: ignore[reportArgumentType]
    shell = os.environ[ASKED].removeprefix("complete_")
    adapt = _adapt_bash() if shell == "bash" else _adapt_line(shell)
    output = io.StringIO()
    try:
        with redirect_stdout(output):
            yield
    finally:
        sys.stdout.write("".join(f"{line}\n" for line in adapt(output.getvalue().splitlines())))


def _adapt_bash() -> Callable[[list[str]], list[str]]:
    """Change the words that bash passes; returns what to do with the lines of the answer."""
    words, at = joined(os.environ.get("COMP_WORDS", ""), int(os.environ.get("COMP_CWORD", "0")))
    if at < len(words) and (match := _WITH_VALUE.fullmatch(words[at])):
        words[at : at + 1] = match.groups()
        at += 1
    os.environ["COMP_WORDS"] = "\n".join(words)
    os.environ["COMP_CWORD"] = str(at)
    word = words[at] if at < len(words) else ""
    return lambda lines: _remaining(word, lines)


def _adapt_line(shell: str) -> Callable[[list[str]], list[str]]:
    """As `_adapt_bash`: zsh and fish pass a line, and replace the whole of its last word."""
    before, space, last = os.environ.get("_TYPER_COMPLETE_ARGS", "").rpartition(" ")
    match = _WITH_VALUE.fullmatch(last)
    if match is None or shell not in _BEGINNINGS:
        return lambda lines: lines
    option, value = match.groups()
    os.environ["_TYPER_COMPLETE_ARGS"] = f"{before}{space}{option} {value}"
    begin = _BEGINNINGS[shell]
    return lambda lines: [begin.sub(rf"\g<1>{option}=", line) for line in lines]


def joined(words: str, at: int) -> tuple[list[str], int]:
    """The words of a bash command line without divisions at `:` and `=`, and the current one."""
    # bash separates them by newlines, and keeps their quotes.
    parts = words.split("\n") if "\n" in words else words.split(" ")
    made: list[str] = []
    current, joins = at, False
    for number, part in enumerate(parts):
        is_break = _BREAKS.fullmatch(part) is not None
        if len(made) > 1 and (is_break or joins):
            made[-1] += part
            current -= number <= at
        else:
            made.append(part)
        joins = is_break
    return made, current


def _remaining(word: str, lines: list[str]) -> list[str]:
    """What bash shall insert: it replaces only the part of a word after the last break."""
    ends = [0, *(match.end() for match in _BREAKS.finditer(word))]
    start = "" if word[:1] in ("'", '"') else word[: ends[-1]]
    lines = [line.removeprefix(start) for line in lines]
    # bash appends a space to a single result; a key still needs its value.
    if len(lines) == 1 and lines[0].endswith(("=", "(")):
        lines.append(f"{lines[0]}VALUE")
    return lines


class QuickParsing:
    """Parses words with plain conversions, and takes them as they are for completions.

    Typer converts values with pydantic, whose import takes longer than all the rest.
    """

    get_params: Callable[[Any], list[Any]]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for parameter in self.get_params(ctx):
            if ctx.resilient_parsing:
                parameter.process_value = _as_given
            else:
                use_plain_conversions(parameter)
        return super().parse_args(ctx, args)  # pyright: ignore


def _as_given(ctx: Any, value: Any) -> Any:
    return value


class Command(QuickParsing, TyperCommand):
    """A command."""


class Group(QuickParsing, TyperGroup):
    """A group of commands."""
