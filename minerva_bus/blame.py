"""Reports of errors in user code: the line that caused an error, in at most ten lines.

Frames of this framework, of the standard library and of installed packages are omitted: a report
names the last frame in user code. `whole` returns all frames.
"""

from __future__ import annotations

import builtins
import traceback
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, Final, cast

from minerva_bus.errors import (
    MinervaError,
    SceneError,
    SignatureError,
    StateError,
    UserCodeError,
    nearest,
    sendable,
    text_of,
)
from minerva_bus.source import LINE_LENGTH, SourceLine, assignments, defined, handler_name, place_of

MESSAGE_LINES: Final = 3
"""Lines of an exception's text to show."""

OWN_LINES: Final = 6
"""Lines of an error of ours: it may have an excerpt, a caret, and what to write instead."""

TRACEBACK_LENGTH: Final = 60_000

WORLD_CODE: Final = "code of the world"
"""Head of the report of an error whose method is not known."""


def report(error: BaseException) -> str:
    """A report of an error in at most ten lines: what, where, the source line, the cause."""
    # A UserCodeError has only the place; what happened is its cause.
    main = error.__cause__ if isinstance(error, UserCodeError) and error.__cause__ else error
    head = f"{error.where}: " if main is not error and isinstance(error, UserCodeError) else ""
    # A handler with wrong parameters has never run, so no traceback has a line of it.
    place = defined(main.handler) if isinstance(main, SignatureError) else place_of(main)
    if place is None and isinstance(error, UserCodeError) and error.handler is not None:
        place = _handler_place(error.handler, main)
    lines = (head + described(main)).split("\n")
    if place is not None:
        lines += place.lines()
    root = _root(main)
    if root is not None:
        lines += _caused_by(root, place)
    return "\n".join(lines)


def described(error: BaseException) -> str:
    """An exception's type and text, with a suggestion for a misspelt name."""
    text = text_of(error).strip("\n")
    if not isinstance(error, MinervaError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    if isinstance(error, SystemExit):
        text += "; code of a world must not exit: raise another exception, or return"
    lines = text.split("\n")
    most = OWN_LINES if isinstance(error, MinervaError) else MESSAGE_LINES
    if len(lines) > most:
        lines = [*lines[: most - 1], f"… ({len(lines) - most + 1} more lines)"]
    cut = [line if len(line) <= LINE_LENGTH else line[: LINE_LENGTH - 1] + "…" for line in lines]
    return "\n".join(cut) + _suggestion(error)


def whole(error: BaseException) -> str:
    """The traceback of an error with its causes; a very long one is cut in the middle."""
    text = sendable("".join(traceback.format_exception(error)))
    if len(text) <= TRACEBACK_LENGTH:
        return text
    half = TRACEBACK_LENGTH // 2
    return f"{text[:half]}\n…\n{text[-half:]}"


class blamed:  # noqa: N801 - used like a function
    """Context in which a service's method is called.

    Raises UserCodeError for any exception but KeyboardInterrupt. A class, because `contextmanager`
    takes five times as many calls, and a frame has several contexts in each member.
    """

    __slots__ = ("_handler",)

    def __init__(self, handler: Callable[..., Any]) -> None:
        self._handler = handler

    def __enter__(self) -> None:
        pass

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        if error is None or isinstance(error, UserCodeError):
            # An inner context has already named the method that failed.
            return
        # Ctrl-C is not an error of user code, but `sys.exit()` in a method is.
        if not isinstance(error, KeyboardInterrupt):
            raise UserCodeError(handler_name(self._handler), self._handler) from error


def _handler_place(handler: Callable[..., Any], error: BaseException) -> SourceLine | None:
    """The line of a handler that sets the attribute in question, or its first line."""
    attribute = error.attribute if isinstance(error, StateError) else ""
    places = assignments(handler, attribute) if attribute else []
    return places[-1] if places else defined(handler)


# --- causes and hints ---


def _causes(error: BaseException) -> Iterator[BaseException]:
    """The exceptions that led to an exception, as a traceback shows them."""
    # Code can set `__cause__` itself, so the chain may have a cycle.
    seen = {id(error)}
    cause = _cause(error)
    while cause is not None and id(cause) not in seen:
        seen.add(id(cause))
        yield cause
        cause = _cause(cause)


def _cause(error: BaseException) -> BaseException | None:
    if isinstance(error, BaseExceptionGroup):
        # The group has its own line only where it was put together, in a TaskGroup's `async with`.
        parts = cast("tuple[BaseException, ...]", error.exceptions)  # pyright: ignore[reportUnknownMemberType]
        return parts[0]
    # The rule by which Python prints tracebacks.
    explicit = error.__suppress_context__ or error.__cause__ is not None
    return error.__cause__ if explicit else error.__context__


def _root(error: BaseException) -> BaseException | None:
    """The first cause of an exception that involves user code."""
    causes = list(_causes(error))
    own = [cause for cause in causes if place_of(cause) is not None]
    if own:
        return own[-1]
    # The exceptions of a group may never have been raised.
    return causes[-1] if causes and isinstance(error, BaseExceptionGroup) else None


def _caused_by(root: BaseException, shown: SourceLine | None) -> Iterable[str]:
    place = place_of(root)
    yield f"  caused by {described(root).partition(chr(10))[0]}"
    if place is None:
        return
    if shown is None or (place.file, place.line) != (shown.file, shown.line):
        where, *source = place.lines()
        yield f"  {where}"
        yield from (f"  {line}" for line in source[:1])


def _suggestion(error: BaseException) -> str:
    """`; did you mean 'energy'?` for a misspelt name: Python itself adds it only to tracebacks."""
    # A SceneError has its own suggestion.
    if isinstance(error, SceneError) or not isinstance(error, AttributeError | NameError):
        return ""
    name: str | None = getattr(error, "name", None)
    if not name or "did you mean" in text_of(error).lower():
        return ""
    try:
        return nearest(name, sorted(_known(error)))
    except Exception:
        return ""  # The object's own __dir__ may raise, too.


def _known(error: AttributeError | NameError) -> set[str]:
    if isinstance(error, AttributeError):
        return {name for name in dir(error.obj) if not name.startswith("_")}
    return _visible(error.__traceback__)


def _visible(trace: TracebackType | None) -> set[str]:
    names = set(dir(builtins))
    # The name was looked up in the innermost frame.
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is not None:
        names |= {*trace.tb_frame.f_locals, *trace.tb_frame.f_globals}
    return names
