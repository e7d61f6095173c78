"""The two things that a command writes to."""

from __future__ import annotations

import sys


def say(text: str) -> None:
    """Print what was asked for: on standard output, at once, where nothing else is."""
    print(text, flush=True)  # noqa: T201


def tell(text: str) -> None:
    """Print what people should know beside it: on standard error."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201
