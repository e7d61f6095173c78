"""Output and exit codes of commands."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Final

FAILED: Final = 1
"""A check or a world failed."""
WRONG: Final = 2
"""The input is wrong."""
INTERRUPTED: Final = 130
"""Interrupted by Ctrl-C: the convention of shells for SIGINT."""


def print_result(text: str) -> None:
    """Print a result on standard output, where nothing else is printed, and flush it."""
    print(text, flush=True)  # noqa: T201


def print_message(text: str) -> None:
    """Print a message for the user on standard error."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201


def print_table(rows: Iterable[Sequence[str]]) -> None:
    """Print rows, the first one with the titles, in columns."""
    from minerva_bus.wire.plain import on_screen

    # Names and figures come from members, whose escape sequences must not reach the terminal.
    rows = [[on_screen(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        print_result("  ".join(cells).rstrip())
