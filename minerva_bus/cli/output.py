"""Output and exit codes of commands.

`--json` prints JSON on standard output, however a command ends. A command prints its own answer. If
it fails before, `{"error": "..."}` is printed, with `line`, `column` and `expected` if a string is
wrong; after the lines of a stream it is the last line. `minerva run` prints an object with the keys
of its summary instead, also if a signal ends it.
"""

from __future__ import annotations

import json
import signal
import sys
import warnings
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any, Final, Protocol

import typer

from minerva_bus.errors import DamagedRecordWarning, MinervaError, SceneError

FAILED: Final = 1
"""A check or a world failed."""
WRONG: Final = 2
"""The input is wrong."""
INTERRUPTED: Final = 130
"""Interrupted by Ctrl-C: the convention of shells for SIGINT."""

MAX_LINE: Final = 1_000
"""Characters of a line of an error."""


class Answer(Protocol):
    """What a command found or did."""

    def plain(self) -> Any:
        """It as a JSON value."""
        ...

    def lines(self) -> Sequence[str]:
        """It as text."""
        ...


@dataclass(frozen=True, slots=True)
class Done:
    """The answer of a command that only reports what it did: its text, and its JSON object."""

    text: str
    fields: Mapping[str, Any]

    def plain(self) -> Mapping[str, Any]:
        """The JSON object."""
        return self.fields

    def lines(self) -> list[str]:
        """The lines of the text."""
        return self.text.splitlines()


@dataclass(slots=True)
class _Printed:
    """Whether this command has printed its JSON answer."""

    answer: bool = False


_printed = _Printed()


def print_result(text: str) -> None:
    """Print a result on standard output, where nothing else is printed, and flush it."""
    print(text, flush=True)  # noqa: T201


def print_answer(answer: Answer, as_json: bool) -> None:
    """Print the answer of a command, as JSON for `--json`."""
    if as_json:
        print_json(answer.plain())
    else:
        print_result("\n".join(answer.lines()))


def print_report(answer: Answer, as_json: bool) -> None:
    """Print an answer on standard error, since the command goes on or has another result.

    With `--json`, standard output has it as JSON.
    """
    for line in answer.lines():
        print_message(line)
    if as_json:
        print_json(answer.plain())


def print_json(value: Any) -> None:
    """Print the JSON answer of a command; if it prints none, `--json` prints its error."""
    text = json.dumps(value)
    _printed.answer = True
    print_result(text)


def has_answered() -> bool:
    """Whether `print_json` was called since `forget_answer`."""
    return _printed.answer


def forget_answer() -> None:
    """Begin another command: a process may run several, as tests do."""
    _printed.answer = False


def print_message(text: str) -> None:
    """Print a message for the user on standard error."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201


@contextmanager
def printing_damage() -> Generator[None]:
    """Print the warnings about damaged records as messages, each once."""
    printed: set[str] = set()
    with warnings.catch_warnings():
        show = warnings.showwarning

        def show_damage(message: Warning | str, category: type[Warning], *rest: Any) -> None:
            if not issubclass(category, DamagedRecordWarning):
                show(message, category, *rest)
            elif str(message) not in printed:
                printed.add(str(message))
                print_message(str(message))

        warnings.simplefilter("always", DamagedRecordWarning)
        warnings.showwarning = show_damage
        yield


@contextmanager
def checking(file: Path) -> Generator[None]:
    """Let a check of a record fail, not its command, if the file cannot be read to its end."""
    from minerva_bus.errors import RecordError

    try:
        yield
    except RecordError as error:
        if not file.exists():  # Wrong input: nothing was checked.
            raise
        print_error(str(error))
        raise typer.Exit(FAILED) from error


def print_error(text: str) -> None:
    """Print the error that ends a command; names and values without end are cut in the middle."""
    lines = map(_cut, text.split("\n"))
    print_message("minerva: " + "\n".join(lines))


def _cut(line: str) -> str:
    if len(line) <= MAX_LINE:
        return line
    # An error begins with the place, and ends with what to do.
    return f"{line[: MAX_LINE // 2]} … {line[-MAX_LINE // 2 :]}"


def print_table(rows: Iterable[Sequence[str]]) -> None:
    """Print rows, the first one with the titles, in columns."""
    from minerva_bus.wire.plain import on_screen

    # Names and figures come from members, whose escape sequences must not reach the terminal.
    rows = [[on_screen(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        print_result("  ".join(cells).rstrip())


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
