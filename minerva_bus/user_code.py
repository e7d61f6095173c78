"""Positions in user code, and reports of errors there: the line of an error, in at most ten lines.

Frames of this framework, of the standard library and of installed packages are omitted: a report
names the last frame in user code. `whole` returns all frames.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import linecache
import os
import sys
import sysconfig
import textwrap
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tokenize import TokenError
from types import CodeType, FrameType, TracebackType
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

LINE_LENGTH: Final = 300

# With a separator at the end, so that a folder with a longer name does not match.
_FRAMEWORK: Final = str(Path(__file__).parent) + os.sep
_LIBRARIES: Final = tuple(
    str(folder) + os.sep
    for folder in {*map(sysconfig.get_path, ("stdlib", "platstdlib")), Path(os.__file__).parent}
)

# Installed, the project's packages are in a folder of libraries.
_ROOT: Final = Path(__file__).parents[1]
_FOLDERS: Final = ("agents", "extensions/*", "services", "worlds")
_SHIPPED: Final = tuple(
    f"{each}{os.sep}" for folder in _FOLDERS for each in _ROOT.glob(f"{folder}/minerva_*")
)

# The file of methods that libraries generate, such as those of dataclasses, of `exec` and of
# `python -c`.
_GENERATED: Final = "<string>"


@dataclass(frozen=True, slots=True)
class SourceLine:
    """A line of user code; `shown` is its source, with markers below it if known."""

    file: str
    line: int
    function: str = ""
    shown: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return {"file": self.file, "line": self.line, "shown": self.shown}

    @property
    def where(self) -> str:
        """`file:line`; in a notebook `Cell In[3], line 12`, as its own tracebacks have it."""
        cell = _cell(self.file)
        if cell:
            return f"{cell}, line {self.line}"
        return f"{self.file}:{self.line}" if self.line else self.file

    def lines(self) -> list[str]:
        """`file:line, in function` and the source line, indented."""
        where = f"  {self.where}"
        if self.function:
            where += f", in {self.function}"
        return [where, *(f"    {text[:LINE_LENGTH]}" for text in self.shown)]


def _cell(file: str) -> str:
    """The cell of a notebook or of IPython that was compiled as this file; otherwise empty."""
    # Not imported: without IPython there are no cells.
    interactive = sys.modules.get("IPython")
    shell = None if interactive is None else interactive.get_ipython()
    label = None if shell is None else shell.compile.format_code_name(file)
    return "" if label is None else " ".join(label)


def place_of(error: BaseException) -> SourceLine | None:
    """The last line of user code that an exception came through, if it came through any."""
    if isinstance(error, SyntaxError) and error.filename is not None:
        return _syntax_place(error)
    place = _user_frame(list(traceback.walk_tb(error.__traceback__)))
    if place is None:
        return None
    frame, number, index = place
    summary = traceback.extract_tb(error.__traceback__)[index]
    _, *shown = "".join(traceback.StackSummary.from_list([summary]).format()).split("\n")
    source = textwrap.dedent("\n".join(line for line in shown if line.strip()))
    lines = tuple(source.splitlines()) or _of_program(frame.f_code, number)
    return SourceLine(frame.f_code.co_filename, number, function_name(frame.f_code), lines)


def _user_frame(frames: list[tuple[FrameType, int]]) -> tuple[FrameType, int, int] | None:
    """The last frame of user code, its line and its index.

    A package that the framework calls is user code even if it is installed.
    """
    # The first choice is a file of the user's own. Otherwise it is an installed package that the
    # framework has called, such as one with agents, or code without a file.
    written = [frame for frame, _ in frames if frame.f_code.co_filename != _GENERATED]
    entry = next((frame for frame in written if not is_foreign(frame.f_code.co_filename)), None)
    if entry is None:
        outside = (f for f in written if not f.f_code.co_filename.startswith(_FRAMEWORK))
        entry = next((f for f in outside if not _is_standard(f.f_code.co_filename)), None)
    if entry is None:
        written = [frame for frame, _ in frames if frame.f_code.co_filename == _GENERATED]
        entry = next(iter(written), None)
    if entry is None:
        return None
    package = _package(entry)
    for index, (frame, number) in reversed(list(enumerate(frames))):
        own = not is_foreign(frame.f_code.co_filename) or _package(frame) == package
        if own and frame in written:
            return frame, number, index
    return None


def _of_program(code: CodeType, line: int) -> tuple[str, ...]:
    """The line of the program of `python -c` that code is a part of; otherwise nothing.

    Other code without a file has no source: Python does not keep that of `exec`.
    """
    if code.co_filename != _GENERATED or "-c" not in sys.orig_argv[:-1]:
        return ()
    source = sys.orig_argv[sys.orig_argv.index("-c") + 1]
    # Code of `exec` has the same file and perhaps the same module.
    if code not in _codes_of(source):
        return ()
    return (source.splitlines()[line - 1].strip(),)


@cache
def _codes_of(source: str) -> frozenset[CodeType]:
    """The code of a program, and that of its functions and classes."""
    waiting, codes = [compile(source, _GENERATED, "exec", dont_inherit=True)], set[CodeType]()
    while waiting:
        code = waiting.pop()
        codes.add(code)
        waiting += [each for each in code.co_consts if isinstance(each, CodeType)]
    return frozenset(codes)


def innermost(frames: Sequence[SourceLine]) -> SourceLine | None:
    """The first frame of user code in a stack, most recent call first, with its source line.

    A package that the framework calls is user code if there is no other.
    """
    written = [frame for frame in frames if frame.file != _GENERATED] or frames
    own = [frame for frame in written if not is_foreign(frame.file)]
    outside = (frame for frame in written if not frame.file.startswith(_FRAMEWORK))
    installed = (frame for frame in outside if not _is_standard(frame.file))
    place = next(iter(own), None) or next(installed, None)
    if place is None:
        return None
    shown = linecache.getline(place.file, place.line).strip()
    return replace(place, shown=(shown,) if shown else ())


def is_foreign(file: str) -> bool:
    """Whether a source file belongs to the framework or a library, or is not a file."""
    outside = (_FRAMEWORK, "<frozen", *_LIBRARIES, *_SHIPPED)
    return _is_installed(file) or file.startswith(outside)


def _is_standard(file: str) -> bool:
    """Whether a file belongs to the standard library."""
    own = file.startswith(_LIBRARIES) and not _is_installed(file)
    return own or file.startswith("<frozen")


def _is_installed(file: str) -> bool:
    """Whether a file is of a package in any Python: the user's, or that of another environment."""
    return any(f"{os.sep}{kind}-packages{os.sep}" in file for kind in ("site", "dist"))


def _package(frame: FrameType) -> str:
    name: str = frame.f_globals.get("__name__") or ""
    return name.partition(".")[0] or frame.f_code.co_filename


def function_name(code: CodeType) -> str:
    """The qualified name of a function, `Fox.starve`; empty for code at module level."""
    name = code.co_qualname.rpartition("<locals>.")[2]
    return "" if name == "<module>" else name


def _syntax_place(error: SyntaxError) -> SourceLine:
    source = (error.text or "").rstrip("\n")
    bare = source.lstrip()
    shown = [bare] if bare else []
    if bare and error.offset:
        # The excerpt is shown without its indentation, so the caret moves by as much.
        column = max(0, error.offset - 1 - (len(source) - len(bare)))
        end = (error.end_offset or 0) - error.offset if error.end_lineno == error.lineno else 1
        shown.append(" " * column + "^" * max(1, min(end, len(bare) - column)))
    return SourceLine(str(error.filename), error.lineno or 0, "", tuple(shown))


# --- handlers, for errors without a frame in them ---


def handler_name(handler: Callable[..., Any]) -> str:
    """The qualified name of a method: `Fox.starve`."""
    bare = inspect.unwrap(handler)
    name: str = getattr(bare, "__qualname__", type(bare).__name__)
    return name.rpartition("<locals>.")[2]


def source_of(code: CodeType | None) -> tuple[list[str], int]:
    """The lines of a code object, and the number of the first. Raises OSError without them."""
    try:
        return inspect.getsourcelines(cast("CodeType", code))
    # Code may name a file that is not of Python, such as the page of which it is a block.
    except (TypeError, SyntaxError, TokenError) as error:
        raise OSError(str(error)) from None


def defined(handler: Callable[..., Any]) -> SourceLine | None:
    """The first line of a function, without its decorators."""
    code: CodeType | None = getattr(inspect.unwrap(handler), "__code__", None)
    if code is None:
        return None
    first = code.co_firstlineno
    try:
        lines, first = source_of(code)
    except OSError:
        return SourceLine(code.co_filename, first, function_name(code), _of_program(code, first))
    # The first line of the code object is that of the first decorator.
    at = next((n for n, line in enumerate(lines) if line.lstrip().startswith(("def ", "async"))), 0)
    return SourceLine(code.co_filename, first + at, function_name(code), (lines[at].strip(),))


def variables_of(function: Callable[..., Any]) -> dict[str, Any]:
    """The variables of enclosing functions that a function uses, as far as they are set."""
    code: CodeType | None = getattr(function, "__code__", None)
    cells = getattr(function, "__closure__", None) or ()
    pairs = zip(() if code is None else code.co_freevars, cells, strict=True)
    return {name: cell.cell_contents for name, cell in pairs if _is_set(cell)}


def _is_set(cell: Any) -> bool:
    try:
        return cell.cell_contents is not None
    except ValueError:  # A variable that is set later.
        return False


def assignments(handler: Callable[..., Any], attribute: str) -> list[SourceLine]:
    """The lines of a method that set or delete an attribute of its first argument, or an item."""
    own = [each for each in _attributes(handler) if each[1:] == (attribute, True)]
    return sorted({place for place, *_ in own}, key=lambda place: place.line)


def changes(cls: type, method: str) -> list[str]:
    """The attributes that a method sets, or another that it calls, in the user's code."""
    methods, names = [method], set[str]()
    for each in methods:
        for place, name, is_set in _attributes(getattr(cls, each, None)):
            if is_set and not is_foreign(place.file):
                names.add(name)
            elif name not in methods and callable(getattr(cls, name, None)):
                methods.append(name)
    return sorted(names)


def _attributes(handler: Any) -> Iterator[tuple[SourceLine, str, bool]]:
    """The attributes of its first argument in a method, and whether it sets each or its item."""
    function = inspect.unwrap(handler)
    own = getattr(getattr(function, "__code__", None), "co_varnames", ())[:1]
    for place, node in _parsed(function, ast.Attribute, ast.Subscript):
        item = node.value if isinstance(node, ast.Subscript) else node
        if isinstance(item, ast.Attribute) and getattr(item.value, "id", None) in own:
            yield place, item.attr, isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)


def expressions(function: Callable[..., Any]) -> list[tuple[SourceLine, ast.expr]]:
    """The statements of a function that are expressions, with their lines, if it is the user's."""
    code: CodeType | None = getattr(function, "__code__", None)
    if code is None or is_foreign(code.co_filename):
        return []
    nodes = [(place, node.value) for place, node in _parsed(function, ast.Expr)]
    return sorted(nodes, key=lambda each: each[0].line)


def _parsed(function: Callable[..., Any], *wanted: type) -> Iterator[tuple[SourceLine, Any]]:
    """The wanted statements and expressions of a function, and the lines in which they begin."""
    code: CodeType | None = getattr(function, "__code__", None)
    try:
        lines, first = source_of(code)
        # A method is indented, which the parser rejects.
        tree = ast.parse(textwrap.dedent("".join(lines)))
    except (OSError, SyntaxError):
        return
    for node in ast.walk(tree):
        if code is not None and isinstance(node, wanted):
            n, name = cast("ast.stmt", node).lineno, function_name(code)
            yield SourceLine(code.co_filename, first + n - 1, name, (lines[n - 1].strip(),)), node


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
    if (root := _root(main)) is not None:
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
    """The lines of a handler that set the attribute in question, or its first line."""
    attribute = error.attribute if isinstance(error, StateError) else ""
    places = assignments(handler, attribute) if attribute else []
    if len(places) < 2:
        return places[0] if places else defined(handler)
    # Attributes are checked after a method, so any of these lines may be the cause.
    lines = " or ".join(str(place.line) for place in places)
    shown = tuple(line for place in places[:MESSAGE_LINES] for line in place.shown)
    return replace(places[0], function=f"{places[0].function}: set in line {lines}", shown=shown)


# --- causes and hints ---


def _causes(error: BaseException) -> Iterator[BaseException]:
    """The exceptions that led to an exception, as a traceback shows them."""
    # Code can set `__cause__` itself, so the chain may have a cycle.
    seen, cause = {id(error)}, error
    while (cause := _cause(cause)) is not None and id(cause) not in seen:
        seen.add(id(cause))
        yield cause


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


_OF_POPULATIONS: Final = {
    "die": "one agent dies by return EMPTY",
    "bear": "one agent gives birth by return self.string + self.child(...)",
}
_MASKS: Final = "write self.die(mask), np.where(mask, a, b)"


def _suggestion(error: BaseException) -> str:
    """`; did you mean 'energy'?` for a misspelt name: Python itself adds it only to tracebacks.

    For arrays in a condition, what a method for a population writes instead.
    """
    if isinstance(error, ValueError) and "truth value of an array" in text_of(error):
        return f"; with population=True attributes are arrays: {_MASKS}, or drop population=True"
    # A SceneError has its own suggestion.
    if isinstance(error, SceneError) or not isinstance(error, AttributeError | NameError):
        return ""
    name: str | None = getattr(error, "name", None)
    if not name or "did you mean" in text_of(error).lower():
        return ""
    if name in _OF_POPULATIONS and hasattr(getattr(error, "obj", None), "activities"):
        return f"; {_OF_POPULATIONS[name]}, or mark the method @on(..., population=True)"
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
