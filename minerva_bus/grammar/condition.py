"""Conditions c of events e^d_c (3.2): comparisons of an agent's attributes, joined by `and`.

    condition → comparison ("and" comparison)*
    comparison → attribute ("<" | "<=" | ">" | ">=" | "==" | "!=") (number | "text" | true | false)

The text is parsed, never evaluated by Python.
"""

from __future__ import annotations

import json
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import VocabularyError

_COMPARE: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_COMPARISON = re.compile(
    r"\s*([A-Za-z_][A-Za-z0-9_]*)\s*(<=|>=|==|!=|<|>)\s*"
    r'(true\b|false\b|"(?:[^"\\]|\\.)*"|[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*'
)
_EXPECTED = "attribute < number, joined by 'and'"
_AND = re.compile(r"and\b")


@dataclass(frozen=True, slots=True)
class Comparison:
    """One comparison of an attribute with a value."""

    attribute: str
    sign: str
    value: bool | float | str

    def holds(self, state: Mapping[str, Any]) -> bool:
        """Whether it holds; False where the agent has no such attribute or the types differ."""
        mine = state.get(self.attribute)
        if _sort(mine) is None or _sort(mine) is not _sort(self.value):
            return False
        return _COMPARE[self.sign](mine, self.value)


def _sort(value: object) -> type | None:
    """What a value can be compared with: truth with truth, text with text, number with number."""
    if isinstance(value, bool | str):
        return type(value)
    return float if isinstance(value, int | float) else None


@lru_cache(maxsize=1024)
def parse_condition(text: str, source: str = "condition") -> tuple[Comparison, ...]:
    """The comparisons of a condition; none for the empty text, which always holds.

    Raises VocabularyError with a caret.
    """
    if not text.strip():
        return ()
    found: list[Comparison] = []
    at = 0
    while True:
        match = _COMPARISON.match(text, at)
        if match is None:
            raise _wrong("the condition cannot be read", text, at, _EXPECTED, source)
        name, sign, literal = match.groups()
        try:
            found.append(Comparison(name, sign, _literal(literal)))
        except ValueError:
            wrong = "the text has a wrong escape"
            raise _wrong(wrong, text, match.start(3), "a text as in JSON", source) from None
        at = match.end()
        if at == len(text):
            return tuple(found)
        joint = _AND.match(text, at)
        if joint is None:
            raise _wrong("the condition goes on", text, at, "'and'", source)
        at = joint.end()


def holds(text: str, state: Mapping[str, Any]) -> bool:
    """Whether a condition holds for an agent's state."""
    return all(one.holds(state) for one in parse_condition(text))


def holds_of_many(text: str, state: Mapping[str, NDArray[Any]], count: int) -> NDArray[np.bool_]:
    """Of which of many agents a condition holds; their states as arrays of shape (count,)."""
    found = np.ones(count, np.bool_)
    for one in parse_condition(text):
        mine = state.get(one.attribute)
        if mine is None or _SORTS.get(mine.dtype.kind) is not _sort(one.value):
            return np.zeros(count, np.bool_)
        found &= _COMPARE[one.sign](mine, one.value)
    return found


_SORTS: dict[str, type] = {"f": float, "i": float, "b": bool, "O": str}


def _literal(literal: str) -> bool | float | str:
    return json.loads(literal) if literal[0] in '"tf' else float(literal)


def _wrong(problem: str, text: str, at: int, expected: str, source: str) -> VocabularyError:
    return VocabularyError(problem, text=text, offset=at, expected=expected, source=source)
