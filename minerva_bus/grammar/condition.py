"""Conditions c of events e^d_c (3.2): a small language about the state of an agent.

    condition  → all ("or" all)*
    all        → term ("and" term)*
    term       → "not" term | "(" condition ")" | comparison
    comparison → value ("<" | "<=" | ">" | ">=" | "==" | "!=") value
    value      → attribute | number | "text" | true | false | distance
    distance   → "distance" "(" x "," y "," x "," y ")"    between two points; attributes, numbers

The text is parsed, never evaluated by Python, and limited in length and depth. If an agent lacks
one of the attributes, or has it with another sort, the condition does not hold, not even a `not`.
Norms use the same language with more names: `was.x`, `event.x`, `#agent.x`.
"""

from __future__ import annotations

import json
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, NoReturn, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import VocabularyError, nearest
from minerva_bus.values import fast_dataclass

NUMBER: Final = "a number"
TRUTH: Final = "true or false"
TEXT: Final = "a text"
ANYTHING: Final = "anything"
"""The sort of a name whose values are not known in advance."""

_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_DTYPES: dict[str, str] = {"f": NUMBER, "i": NUMBER, "b": TRUTH, "O": TEXT}
_KINDS: dict[str, str] = {"real": NUMBER, "int": NUMBER, "bool": TRUTH, "text": TEXT}


@fast_dataclass
class Name:
    """The name of an attribute, and its offset in the text."""

    name: str
    offset: int


@fast_dataclass
class Distance:
    """The Euclidean distance between two points of a plane, x and y of each; attributes or numbers.

    It has one rounding for each operation, so it is the same number on every machine and in arrays.
    """

    coordinates: tuple[Name | float, Name | float, Name | float, Name | float]

    def of(self, state: Mapping[str, Any]) -> Any:
        """The distance for an agent; an array of them if the state has arrays."""
        x, y, to_x, to_y = (_real(_in(state, value)) for value in self.coordinates)
        # Attributes of agents may be infinite, or so large that their squares are.
        with np.errstate(over="ignore", invalid="ignore"):
            dx, dy = x - to_x, y - to_y
            squared: Any = dx * dx + dy * dy
            return math.sqrt(squared) if isinstance(squared, float) else np.sqrt(squared)


Value: TypeAlias = Name | Distance | bool | float | str


@fast_dataclass
class Comparison:
    """A comparison of two values."""

    left: Value
    sign: str
    right: Value

    def truth(self, state: Mapping[str, Any]) -> Any:
        """Whether it holds; an array of bools if the state has arrays."""
        left, right = _in(state, self.left), _in(state, self.right)
        # Beyond 2^53 Python compares an int and a float exactly, but arrays compare them as floats.
        if type(left) is not type(right):
            left, right = (float(v) if type(v) is int else v for v in (left, right))
        return _COMPARE[self.sign](left, right)

    def names(self) -> Iterator[tuple[Name, Value]]:
        """Each name in it, with a value of the sort that it must have."""
        for value, other in ((self.left, self.right), (self.right, self.left)):
            if isinstance(value, Name):
                yield value, other
            elif isinstance(value, Distance):
                yield from ((each, 0.0) for each in value.coordinates if isinstance(each, Name))


def _in(state: Mapping[str, Any], value: Value) -> Any:
    """What a value is for an agent."""
    if isinstance(value, Name):
        return state[value.name]
    return value.of(state) if isinstance(value, Distance) else value


def _real(value: Any) -> Any:
    return float(value) if isinstance(value, int | float) else value.astype(np.float64)


@fast_dataclass
class Not:
    """The negation of a term."""

    term: Term

    def truth(self, state: Mapping[str, Any]) -> Any:
        """Like `Comparison.truth`."""
        # `not` for a bool as well as for an array.
        return self.term.truth(state) ^ True


@fast_dataclass
class Joined:
    """Terms of which all must hold (`and`), or at least one (`or`)."""

    word: str
    terms: tuple[Term, ...]

    def truth(self, state: Mapping[str, Any]) -> Any:
        """Like `Comparison.truth`."""
        result: Any = self.terms[0].truth(state)
        for term in self.terms[1:]:
            truth = term.truth(state)
            # Operators that exist for bools and arrays alike; terms have no side effects to skip.
            result = result & truth if self.word == "and" else result | truth
        return result


Term: TypeAlias = Comparison | Not | Joined


def sort_in(value: Value, sort_of: Callable[[str], str]) -> str:
    """The sort of a value; `sort_of` gives that of an attribute."""
    return sort_of(value.name) if isinstance(value, Name) else value_sort(value)


def sort_of_kind(kind: str) -> str:
    """The sort of values of a type's kind; empty if they cannot be compared."""
    return _KINDS.get(kind, "")


def value_sort(value: object) -> str:
    """The sort of a value, or of an array's values; empty if they cannot be compared."""
    if isinstance(value, Distance):
        return NUMBER
    if isinstance(value, np.ndarray):
        array = cast("NDArray[Any]", value)
        return _DTYPES.get(array.dtype.kind, "") if array.ndim == 1 else ""
    if isinstance(value, bool):
        return TRUTH
    if isinstance(value, str):
        return TEXT
    return NUMBER if isinstance(value, int | float) else ""


LONGEST: Final = 4000
"""Maximum number of characters of a condition."""

DEEPEST: Final = 32
"""Maximum nesting of parentheses and `not`."""

_TOKEN = re.compile(
    r"\s*(?:(?P<sign><=|>=|==|!=|<|>)|(?P<mark>[()])"
    r"|(?P<name>#[\w:-]+\.[A-Za-z_]\w*|[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)?)"
    r'|(?P<text>"(?:[^"\\]++|\\.)*+")'
    r"|(?P<number>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?))",
    re.ASCII,
)
_TRUTHS = {"true": True, "false": False}
_WORDS = frozenset(("and", "or", "not"))


@fast_dataclass
class Condition:
    """A parsed condition; without a term it always holds."""

    text: str
    term: Term | None = None
    comparisons: tuple[Comparison, ...] = ()

    @property
    def names(self) -> frozenset[str]:
        """The names of the attributes in it."""
        return frozenset(name.name for each in self.comparisons for name, _ in each.names())

    def holds(self, state: Mapping[str, Any]) -> bool:
        """Whether it holds for an agent's state."""
        if self.term is None:
            return True
        # All names are checked before any comparison: with an attribute missing, not even a `not`
        # holds.
        fits = self.problem(lambda name: value_sort(state.get(name))) is None
        return fits and bool(self.term.truth(state))

    def holds_of_many(self, state: Mapping[str, Any], count: int) -> NDArray[np.bool_]:
        """For which agents it holds; their states are arrays of shape (count,), or values."""
        everyone = np.ones(count, np.bool_)
        if self.term is None:
            return everyone
        if self.problem(lambda name: value_sort(state.get(name))) is not None:
            return ~everyone
        # The conjunction also extends a single bool to all agents.
        return everyone & np.asarray(self.term.truth(state), np.bool_)

    def problem(self, sort_of: Callable[[str], str]) -> tuple[int, str, str] | None:
        """The first wrong name, if there is one: offset, name, and the sort it is compared with.

        `sort_of` a name is empty if it is unknown or cannot be compared, and ANYTHING if its values
        are not known in advance.
        """
        for comparison in self.comparisons:
            for name, other in comparison.names():
                sort, other_sort = sort_of(name.name), sort_in(other, sort_of)
                either = ANYTHING in (sort, other_sort)
                if not sort or (other_sort and sort != other_sort and not either):
                    return name.offset, name.name, other_sort if sort else ""
        return None

    def check(self, scopes: Sequence[Scope], source: str) -> None:
        """Raise VocabularyError if it can hold in none of the scopes; without scopes, do nothing.

        The error is about the scope in which the largest part of it is valid.
        """
        wrong = [(scope, self.problem(scope.sort_of)) for scope in scopes]
        problems = [(scope, problem) for scope, problem in wrong if problem is not None]
        if not problems or len(problems) < len(wrong):
            return
        # The further to the right the first problem is, the more names the scope has.
        scope, (offset, name, other) = max(
            problems, key=lambda item: (item[1][0], item[0].near(item[1]))
        )
        if other:
            sort = scope.sort_of(name)
            problem = f"{name} of {scope.who} is {sort}, which cannot be compared with {other}"
        elif name in scope.known:
            problem = f"{name} of {scope.who} is not a number, bool or text: it cannot be compared"
        else:
            problem = f"{scope.who} has no {name}{scope.near((offset, name, ''))}"
        raise VocabularyError(problem, text=self.text, offset=offset, source=source)


@fast_dataclass
class Scope:
    """The names that a condition may use, and the sort of each.

    The sort is empty if there is no such name, or if it cannot be compared.
    """

    who: str
    known: Sequence[str]
    sort_of: Callable[[str], str]

    def near(self, problem: tuple[int, str, str]) -> str:
        """A suggestion for a wrong name, as part of a message."""
        _, name, other = problem
        alike = [scope for scope in self.known if scope.startswith("#") == name.startswith("#")]
        return "" if other else nearest(name, alike)


def holds(text: str, state: Mapping[str, Any]) -> bool:
    """Whether a condition holds for an agent's state."""
    return parse_condition(text).holds(state)


def holds_of_many(text: str, state: Mapping[str, Any], count: int) -> NDArray[np.bool_]:
    """For which agents a condition holds; their states are arrays of shape (count,)."""
    return parse_condition(text).holds_of_many(state, count)


# A condition is evaluated for every receiver of its event, but parsed once.
@lru_cache(maxsize=1024)
def parse_condition(text: str, source: str = "condition") -> Condition:
    """A condition; the empty text always holds. Raises VocabularyError with a caret."""
    if not text.strip():
        return Condition(text)
    return _ConditionReader(text, source).read()


class _ConditionReader:
    """Reads one condition from left to right."""

    def __init__(self, text: str, source: str) -> None:
        self._text = text
        self._source = source
        self._at = 0
        self._found: list[Comparison] = []

    def read(self) -> Condition:
        if len(self._text) > LONGEST:
            self._wrong("the condition is too long", f"at most {LONGEST} characters", LONGEST)
        term = self._joined("or", 0)
        self._skip()
        if self._at < len(self._text):
            self._wrong("text after the condition", "'and', 'or' or the end", self._at)
        return Condition(self._text, term, tuple(self._found))

    def _joined(self, word: str, depth: int) -> Term:
        terms = [self._part(word, depth)]
        while self._take_word(word):
            terms.append(self._part(word, depth))
        return terms[0] if len(terms) == 1 else Joined(word, tuple(terms))

    def _part(self, word: str, depth: int) -> Term:
        return self._joined("and", depth) if word == "or" else self._term(depth)

    def _term(self, depth: int) -> Term:
        self._skip()
        # Bounds the recursion: conditions come from remote members, too.
        if depth > DEEPEST:
            self._wrong("the condition is nested too deeply", f"at most {DEEPEST} levels", self._at)
        if self._take_word("not"):
            return Not(self._term(depth + 1))
        token = _TOKEN.match(self._text, self._at)
        if token is None or token["mark"] != "(":
            return self._comparison()
        self._at = token.end()
        inner = self._joined("or", depth + 1)
        token = _TOKEN.match(self._text, self._at)
        if token is None or token["mark"] != ")":
            self._skip()
            self._wrong("the parenthesis is not closed", "')'", self._at)
        self._at = token.end()
        return inner

    def _comparison(self) -> Comparison:
        left = self._value()
        token = _TOKEN.match(self._text, self._at)
        if token is None or not token["sign"]:
            self._skip()
            self._wrong("the condition cannot be read", "< <= > >= == or !=", self._at)
        self._at, at = token.end(), self._at
        comparison = Comparison(left, token["sign"], self._value())
        # A comparison of two constants is probably a mistake: it would not depend on the agent.
        if next(comparison.names(), None) is None:
            self._wrong("the comparison has no attribute", "an attribute on one side", at)
        values = left, comparison.right
        if any(isinstance(each, Distance) for each in values) and any(
            not isinstance(each, Name) and value_sort(each) != NUMBER for each in values
        ):
            self._wrong("a distance is a number", "a number or an attribute on the other side", at)
        self._found.append(comparison)
        return comparison

    def _value(self) -> Value:
        self._skip()
        at, token = self._at, _TOKEN.match(self._text, self._at)
        if token is None or token["sign"] or token["mark"] or token["name"] in _WORDS:
            is_text = self._text.startswith("'", at)
            expected = "a text in double quotes" if is_text else "an attribute or a value"
            self._wrong("the condition cannot be read", expected, at)
        self._at = token.end()
        if token["name"]:
            if token["name"] == "distance" and self._take_mark("("):
                return self._distance()
            known = _TRUTHS.get(token["name"])
            return Name(token["name"], at) if known is None else known
        try:
            return json.loads(token["text"]) if token["text"] else float(token["number"])
        except ValueError:
            self._wrong("invalid escape or character in a text", "a JSON string", at)

    def _distance(self) -> Distance:
        """The distance after its opening parenthesis."""
        values = [self._coordinate()]
        for _ in range(3):
            if not self._take_mark(","):
                self._skip()
                self._wrong("distance has four values: x, y, x and y", "','", self._at)
            values.append(self._coordinate())
        if not self._take_mark(")"):
            self._skip()
            self._wrong("distance has four values: x, y, x and y", "')'", self._at)
        x, y, to_x, to_y = values
        return Distance((x, y, to_x, to_y))

    def _coordinate(self) -> Name | float:
        self._skip()
        at, value = self._at, self._value()
        if isinstance(value, bool | str | Distance):
            self._wrong("distance needs coordinates", "an attribute or a number", at)
        return value

    def _take_mark(self, mark: str) -> bool:
        self._skip()
        is_next = self._text.startswith(mark, self._at)
        self._at += is_next
        return is_next

    def _take_word(self, word: str) -> bool:
        token = _TOKEN.match(self._text, self._at)
        if token is None or token["name"] != word:
            return False
        self._at = token.end()
        return True

    def _skip(self) -> None:
        while self._at < len(self._text) and self._text[self._at].isspace():
            self._at += 1

    def _wrong(self, problem: str, expected: str, at: int) -> NoReturn:
        raise VocabularyError(
            problem, text=self._text, offset=at, expected=expected, source=self._source
        )
