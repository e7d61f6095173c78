"""A progress bar for commands that read a whole record."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

import typer


@contextmanager
def progress_bar(label: str, *, quiet: bool = False) -> Generator[Callable[[int, int], None]]:
    """A progress bar on standard error, if it is a terminal; called with done and total."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, last: None
        return
    with typer.progressbar(length=1, label=label, file=sys.stderr) as bar:

        def show(done: int, last: int) -> None:
            bar.length = max(1, last)
            bar.update(done - bar.pos)

        yield show
