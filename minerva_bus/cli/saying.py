"""Output of commands."""

from __future__ import annotations

import sys


def say(text: str) -> None:
    """Print a result on standard output and flush it; nothing else is printed there."""
    print(text, flush=True)  # noqa: T201


def tell(text: str) -> None:
    """Print a message for the user on standard error."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201
