"""The error classes of Minerva Bus: one tree, and `MinervaError` is its root.

    MinervaError
    ├── SceneError               a string is wrong
    │   ├── GrammarError         it is not in L(M) (Table 1)
    │   └── VocabularyError      its symbols or values are not those of the world
    ├── Unfit                    a value does not fit its declared type          grammar.types
    ├── WorldFileError           a world file or an option that replaces its settings is wrong
    │   └── UnknownOption        a world has no option of this name
    ├── TomlError                a text is not TOML                              launch.toml_tables
    ├── MisuseError              the caller of the library asks for something impossible
    │   ├── StateError           an attribute of an agent has an invalid value
    │   │   └── Unsound          an attribute of one row is not finite         world.population_step
    │   ├── SignatureError       a method takes other arguments than it is called with
    │   └── NotCompilable        a method uses what cannot be compiled       world.class_declaration
    ├── UserCodeError            a method of an agent or a service failed
    │   └── ActivityError        a method of an agent failed at an event         world.agent
    ├── RecordError              a record cannot be written or read
    ├── RecordingError           a sensor recording cannot be read               log.recordings
    ├── ProtocolError            a member sent what the protocol does not allow
    ├── Refusal                  the world does not admit this member            frame.member_side
    │   ├── Unready              the member's service cannot run in this world   frame.member_side
    │   └── WorldRestarted       the world has restarted: join again             frame.member_side
    ├── BusError                 a session, an endpoint or a world cannot be reached
    │   └── Followed             another coordinator runs the world now
    ├── KeysError                a key or a certificate is missing or does not fit
    └── WorldStopped             a running world ended prematurely

A module name at the end of a line says where a class is defined; the others are defined here.
Extensions, services and agents derive their own errors from `MinervaError`, in the modules that
raise them. tests/unit/test_references.py compares the tree with the classes. An error message says
who failed, where, what was expected and what to do next.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from operator import index
from typing import Any, Final, SupportsIndex, cast


class MinervaError(Exception):
    """Base of all errors of Minerva Bus."""

    def _render_traceback_(self) -> list[str]:
        """What scripts and notebooks show: the error and the line of the caller's code."""
        from minerva_bus.uncaught import rendered  # which imports this module

        return [rendered(self)]


class SceneError(MinervaError):
    """A string is wrong.

    `line` and `column` count from 1; both are 0 if the string was never a text, for example a
    fragment received from the bus. `expected` is a phrase; `source` names a file or a member.
    """

    def __init__(
        self,
        problem: str,
        *,
        text: str = "",
        offset: int = -1,
        expected: str = "",
        source: str = "",
    ) -> None:
        self.problem = problem
        self.expected = expected
        self.offset = offset
        self.source = source
        self.line, self.column, self._excerpt = _locate(text, offset)
        super().__init__(self._message())

    def _message(self) -> str:
        place = self.source or "string"
        if self.line:
            place = f"{place}:{self.line}:{self.column}"
        expectation = f"; expected {self.expected}" if self.expected else ""
        return f"{place}: {self.problem}{expectation}{self._excerpt}"


class GrammarError(SceneError):
    """A text is not a string of L(M) (Table 1)."""


class VocabularyError(SceneError):
    """A string uses symbols, parameters or values that are not in its vocabulary."""


class WorldFileError(MinervaError):
    """A world file, or an option that replaces one of its settings, is wrong."""


class UnknownOption(WorldFileError):
    """A world has no option of this name.

    Args:
        world: its name.
        name: the unknown option.
        options: the options of the world.
        others: options of the command that was called; one of them may have been meant.

    """

    def __init__(
        self, world: str, name: str, options: list[str], others: tuple[str, ...] = ()
    ) -> None:
        self._parts = world, name, options
        known = f"it has {', '.join(options) or 'none'}"
        super().__init__(f"{world} has no option {name}{nearest(name, [*options, *others], known)}")

    def beside(self, others: tuple[str, ...]) -> UnknownOption:
        """The same error of a command with options of its own."""
        return UnknownOption(*self._parts, others)


class MisuseError(MinervaError):
    """The caller of this library asks for something impossible."""


class StateError(MisuseError):
    """An attribute of an agent has an invalid value; `attribute` is its name, if known."""

    def __init__(self, problem: str, attribute: str = "") -> None:
        super().__init__(problem)
        self.attribute = attribute


class SignatureError(MisuseError):
    """A method takes other arguments than it is called with; `handler` is the method."""

    def __init__(self, problem: str, handler: Callable[..., Any]) -> None:
        super().__init__(problem)
        self.handler = handler


class UserCodeError(MinervaError):
    """A method of an agent or a service raised or returned an invalid value: see `__cause__`.

    `where` names the method and its arguments; `handler` is the method, if known.
    `minerva_bus.user_code.report` formats the error with its file, line and source line.
    """

    def __init__(self, where: str, handler: Callable[..., Any] | None = None) -> None:
        super().__init__(where)
        self.where = where
        self.handler = handler

    def __str__(self) -> str:
        cause = self.__cause__
        return self.where if cause is None else f"{self.where}: {_named(cause)}"


_ESCAPED: Final = {
    code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\n\t"
}
"""Escapes of control characters, which would move a terminal's cursor or change its colours."""


def text_of(error: BaseException) -> str:
    """The text of an exception of any class, also of one whose `__str__` raises."""
    try:
        text = sendable(str(error.msg if isinstance(error, SyntaxError) else error))
    except Exception as failure:
        return f"its __str__ raises {type(failure).__name__}"
    return text.replace("\r\n", "\n").translate(_ESCAPED)


def sendable(text: str) -> str:
    """A text with escapes for lone surrogates, which neither a terminal nor a message can have."""
    return text.encode("utf-8", "backslashreplace").decode()


def _named(error: BaseException) -> str:
    """The text of an error of ours; any other error with its type."""
    text = text_of(error)
    if isinstance(error, MinervaError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class RecordError(MinervaError):
    """A record cannot be written, or a file is damaged or not a record."""


class ProtocolError(MinervaError):
    """A member sent a message that the protocol does not allow."""


class BusError(MinervaError):
    """A session, an endpoint or a world on the bus cannot be reached."""


class Followed(BusError):
    """Another coordinator runs the world now."""


class KeysError(MinervaError):
    """A key or a certificate is missing or does not fit its purpose."""


class WorldStopped(MinervaError):
    """A running world ended prematurely.

    `rest`: the text for a reader of the log, which has the cause already; otherwise empty.
    """

    def __init__(self, problem: str, rest: str = "") -> None:
        super().__init__(problem)
        self.rest = rest


_EXCERPT_WIDTH = 76


def _locate(text: str, offset: int) -> tuple[int, int, str]:
    """Line, column (from 1) and an excerpt with a caret for an offset into a text."""
    if offset < 0:
        return 0, 0, ""
    offset = min(offset, len(text))
    start = text.rfind("\n", 0, offset) + 1
    end = text.find("\n", offset)
    line = text[start : end if end >= 0 else len(text)].removesuffix("\r")
    at = offset - start
    first = max(0, at - _EXCERPT_WIDTH // 2)
    # A tab may be several columns wide, and the caret below would be in the wrong place. Other
    # control characters would control the terminal.
    part = line[first : first + _EXCERPT_WIDTH].replace("\t", " ")
    shown = "".join([char if char.isprintable() else "?" for char in part])
    left = "…" if first else ""
    right = "…" if first + _EXCERPT_WIDTH < len(line) else ""
    caret = " " * (len(left) + at - first) + "^"
    return text.count("\n", 0, offset) + 1, at + 1, f"\n  {left}{shown}{right}\n  {caret}"


class DamagedRecordWarning(UserWarning):
    """Data of a record are lost, and its reader went on with the rest."""


_COMPARED = 100
"""Words that `nearest` compares; of more, those that follow or precede the word in sorted order."""
_COMPARED_CHARS = 64


def whole(value: object, least: int) -> bool:
    """Whether a value that code has given is a whole number, from `least` on."""
    try:
        number = index(cast("SupportsIndex", value))
    except TypeError:  # Neither an integer of Python nor one of numpy.
        return False
    return not isinstance(value, bool) and number >= least


def nearest(word: str, words: list[str], otherwise: str = "") -> str:
    """The hint `; did you mean 'x'?` with the closest of the words, else `; OTHERWISE` if any."""
    # Imported here, because only errors need it.
    from difflib import get_close_matches

    word = word[:_COMPARED_CHARS]
    if len(words) > _COMPARED:
        # A comparison with each of 10,000 ids may take seconds; neighbours begin alike.
        words = sorted(words)
        first = max(0, bisect_left(words, word) - _COMPARED // 2)
        words = words[first : first + _COMPARED]
    close = get_close_matches(word, words, n=1, cutoff=0.6)
    if close:
        return f"; did you mean {close[0]!r}?"
    return f"; {otherwise}" if otherwise else ""
