"""Every error that Minerva Bus raises, in one tree.

    MinervaError
    ├── SceneError               a string, or something that claims to be one, is wrong
    │   ├── GrammarError         it is not in L(M) (Table 1)
    │   └── VocabularyError      its symbols or values are not those of the world
    ├── WorldFileError           a world file cannot be used as it is written
    ├── MisuseError              code that uses this library asks for something it cannot have
    │   ├── StateError           an attribute of an agent has a value that it cannot have
    │   └── SignatureError       a method takes other arguments than it is called with
    ├── UserCodeError            a method of an agent or a service failed
    ├── ProtocolError            a member of the bus sent what the protocol does not allow
    ├── BusError                 a session, an endpoint or a world on the bus cannot be reached
    ├── KeysError                a key or a certificate is missing, or is not what is needed
    └── WorldStopped             a running world had to end before its time

A message says who, where, what was expected and what to do next.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class MinervaError(Exception):
    """Base of all errors of Minerva Bus."""


class SceneError(MinervaError):
    """A string is wrong.

    `line` and `column` count from 1 and are 0 where the string never was a text (a fragment that
    came over the bus). `expected` and `found` are phrases; `source` is a file's or a member's name.
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
        wanted = f"; expected {self.expected}" if self.expected else ""
        return f"{place}: {self.problem}{wanted}{self._excerpt}"


class GrammarError(SceneError):
    """A text is not a string of L(M) (Table 1)."""


class VocabularyError(SceneError):
    """A string uses symbols, parameters or values that its world does not have."""


class WorldFileError(MinervaError):
    """A world file cannot be used as it is written."""


class MisuseError(MinervaError):
    """Code that uses this library asks for something it cannot have."""


class StateError(MisuseError):
    """An attribute of an agent has a value that it cannot have."""

    def __init__(self, problem: str, attribute: str = "") -> None:
        super().__init__(problem)
        self.attribute = attribute


class SignatureError(MisuseError):
    """A method takes other arguments than it is called with; `handler` is the method."""

    def __init__(self, problem: str, handler: Callable[..., Any]) -> None:
        super().__init__(problem)
        self.handler = handler


class UserCodeError(MinervaError):
    """A method of an agent or a service raised, or returned what it may not; `__cause__` says what.

    `where` names the method and what it was called for; `handler` is the method, if it is known.
    `minerva_bus.blame.report` writes the error with its file, line and source line.
    """

    def __init__(self, where: str, handler: Callable[..., Any] | None = None) -> None:
        super().__init__(where)
        self.where = where
        self.handler = handler

    def __str__(self) -> str:
        cause = self.__cause__
        return self.where if cause is None else f"{self.where}: {_named(cause)}"


def _named(error: BaseException) -> str:
    """An error of ours as it speaks for itself, any other one with its type."""
    text = str(error)
    if isinstance(error, MinervaError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class ProtocolError(MinervaError):
    """A member of the bus sent what the protocol does not allow."""


class BusError(MinervaError):
    """A session, an endpoint or a world on the bus cannot be reached."""


class Followed(BusError):
    """Another coordinator runs the world now."""


class KeysError(MinervaError):
    """A key or a certificate is missing, or is not what is needed."""


class WorldStopped(MinervaError):
    """A running world had to end before its time."""


_EXCERPT_WIDTH = 76


def _locate(text: str, offset: int) -> tuple[int, int, str]:
    """Line, column (from 1) and an excerpt with a caret for an offset into a text."""
    if offset < 0:
        return 0, 0, ""
    offset = min(offset, len(text))
    start = text.rfind("\n", 0, offset) + 1
    end = text.find("\n", offset)
    line = text[start : end if end >= 0 else len(text)]
    at = offset - start
    first = max(0, at - _EXCERPT_WIDTH // 2)
    shown = line[first : first + _EXCERPT_WIDTH].replace("\t", " ")
    left = "…" if first else ""
    right = "…" if first + _EXCERPT_WIDTH < len(line) else ""
    caret = " " * (len(left) + at - first) + "^"
    return text.count("\n", 0, offset) + 1, at + 1, f"\n  {left}{shown}{right}\n  {caret}"


def nearest(word: str, words: list[str]) -> str:
    """`; did you mean 'x'?` for the closest of the words, or nothing."""
    from difflib import get_close_matches

    close = get_close_matches(word, words, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""
