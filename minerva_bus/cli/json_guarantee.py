"""`--json` prints JSON on standard output, however a command ends.

A command prints its own answer. If it fails before, `{"error": "..."}` is printed, with `line`,
`column` and `expected` if a string is wrong; after the lines of a stream it is the last line.
`minerva run` prints an object with the keys of its summary instead, also if a signal ends it.
"""

from __future__ import annotations

import signal
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from types import FrameType
from typing import Any, Final

from minerva_bus.cli.output import forget_answer, has_answered, print_json
from minerva_bus.errors import MinervaError, SceneError

_NOTHING: Final[Mapping[str, Any]] = {
    "world": "", "frames": 0, "frames_before": 0, "digest": None, "reached": False,
    "wall_seconds": 0.0, "frames_per_second": 0.0, "first_frame_seconds": None,
    "startup_seconds": {}, "members": 0, "seed": None,
}  # fmt: skip


@contextmanager
def promised(words: Sequence[str]) -> Generator[None]:
    """Run a command with these arguments; print JSON about its failure if they ask for JSON."""
    is_run = words[:1] == ["run"]
    if not _promise(words, is_run=is_run):
        yield
        return
    forget_answer()
    if is_run:
        _catch_signals()
    try:
        yield
    except KeyboardInterrupt as error:
        # Ctrl-C is the regular end of a command that follows a world.
        if is_run:
            _print_failure(error, is_run=True)
        raise
    except SystemExit as error:
        if error.code not in (0, None):
            _print_failure(error, is_run=is_run)
        raise
    except Exception as error:
        _print_failure(error, is_run=is_run)
        raise


def _promise(words: Sequence[str], *, is_run: bool) -> bool:
    # The words themselves are searched, because parsing them may fail.
    logged = "--log-format=json" in words or ("--log-format", "json") in pairwise(words)
    return "--json" in words or (is_run and logged)


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


def _print_failure(error: BaseException, *, is_run: bool) -> None:
    # At most one object: a command may fail after it has printed its answer.
    if has_answered():
        return
    cause, why = _cause(error)
    if is_run:
        print_json({**_NOTHING, "ended": why.partition("\n")[0]})
    else:
        print_json({"error": why, **_place(cause)})


def _place(cause: BaseException | None) -> dict[str, Any]:
    if not isinstance(cause, SceneError):
        return {}
    return {"line": cause.line, "column": cause.column, "expected": cause.expected}


def _cause(error: BaseException | None) -> tuple[BaseException | None, str]:
    """The first cause with a message for users: an exit code follows from an earlier error."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):  # Ctrl-C has no arguments, other signals do.
            return error, "terminated" if error.args else "interrupted"
        if isinstance(error, MinervaError):
            return error, str(error)
        usage = getattr(error, "format_message", None)  # A usage error of the command line.
        if usage is not None:
            return error, str(usage())
        if not isinstance(error, SystemExit) and isinstance(error, OSError | MemoryError):
            return error, f"{type(error).__name__}: {error}"
        error = error.__cause__ or error.__context__
    return None, "it failed; see standard error"
