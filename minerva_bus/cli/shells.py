"""Commands that start fast, also to complete a line of a shell."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, Final

from typer.core import TyperCommand, TyperGroup

from minerva_bus.cli.conversions import use_plain_conversions

ASKED: Final = "_MINERVA_COMPLETE"


def answer_fast() -> None:
    """Answer a shell that asks for completions without formatted descriptions."""
    if ASKED in os.environ:
        # Typer formats them with rich if it is installed, which takes longer than all the rest.
        sys.modules.setdefault("rich", None)  # pyright: ignore[reportArgumentType]


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
