"""`minerva run --json` prints one JSON object on standard output, however it ends.

A world that ran prints its own summary. If none could start, because the options or the world file
are wrong or a signal came first, the object has the keys of a summary and the reason.
"""

from __future__ import annotations

import json
import signal
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from types import FrameType
from typing import Any, Final

from minerva_bus.cli.output import print_result
from minerva_bus.errors import MinervaError

_NOTHING: Final[Mapping[str, Any]] = {
    "world": "", "frames": 0, "frames_before": 0, "digest": None, "reached": False,
    "wall_seconds": 0.0, "frames_per_second": 0.0, "first_frame_seconds": None,
    "startup_seconds": {}, "members": 0, "seed": None,
}  # fmt: skip
_said: list[str] = []


def say_summary(plain: Mapping[str, Any]) -> None:
    """Print the summary of this command."""
    text = json.dumps(plain)
    _said.append(text)
    print_result(text)


@contextmanager
def promised(words: Sequence[str]) -> Generator[None]:
    """Run a command with these arguments; print a summary if they ask for JSON."""
    if not _promise(words):
        yield
        return
    # A process may run several commands, as tests do.
    _said.clear()
    _catch_signals()
    try:
        yield
    except KeyboardInterrupt as error:
        _say_why(error)
        raise
    except SystemExit as error:
        if error.code not in (0, None):
            _say_why(error)
        raise
    except Exception as error:
        _say_why(error)
        raise


def _promise(words: Sequence[str]) -> bool:
    # The words themselves are searched, because parsing them may fail.
    logged = "--log-format=json" in words or ("--log-format", "json") in pairwise(words)
    return words[:1] == ["run"] and ("--json" in words or logged)


def _catch_signals() -> None:
    """Exit in order on signals; a running supervisor installs its own handlers.

    An ignored SIGHUP, as under `nohup`, stays ignored.
    """

    def end(number: int, _: FrameType | None) -> None:
        raise KeyboardInterrupt(signal.Signals(number).name)

    # SIGINT raises KeyboardInterrupt already.
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, end)


def _say_why(error: BaseException) -> None:
    # At most one object: a command may fail after it has printed its summary.
    if not _said:
        say_summary({**_NOTHING, "ended": _why(error)})


def _why(error: BaseException | None) -> str:
    """The first cause with a message for users: an exit code follows from an earlier error."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):  # Ctrl-C has no arguments, other signals do.
            return "terminated" if error.args else "interrupted"
        if isinstance(error, MinervaError):
            return str(error).partition("\n")[0]
        usage = getattr(error, "format_message", None)  # A usage error of the command line.
        if usage is not None:
            return str(usage())
        if not isinstance(error, SystemExit) and isinstance(error, OSError | MemoryError):
            return f"{type(error).__name__}: {error}"
        error = error.__cause__ or error.__context__
    return "it failed; see standard error"
