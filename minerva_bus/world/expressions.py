"""Expressions for data that a run collects, in Python or as text in a world file.

    Person.x                                    APerson.x
    Person.x.where("x > 3").every(10)           APerson.x where x > 3 every 10
    count(Person, 'health == "I"')              count(APerson, health == "I")
    Person.x.mean()                             mean(APerson.x)
    Person.x.quantiles(0.1, 0.9)                quantiles(APerson.x, 0.1, 0.9)
    Person.x.histogram(0, 60, bins=12)          histogram(APerson.x, 0, 60, 12)
    data(Person); data(eBite, "depth").sum()    APerson; sum(eBite.depth)

An attribute of an agent class is an expression. `str` of an expression is its text, and
collect/plans.py reads it. Conditions have the language of grammar/condition.py; texts in them may
be in single quotes, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.values import text, whole_number

FUNCTIONS: Final = ("count", "sum", "mean", "min", "max", "quantiles", "histogram")
MAX_BINS: Final = 10_000


@dataclass(frozen=True, slots=True)
class Expression:
    """Data to collect in each frame, of all agents of a kind or all events of a type.

    Args:
        symbol: the agent kind, such as `APerson`, or the event type, such as `eBite`.
        name: the attribute or datum; "": all data, or nothing but a count.
        function: one of FUNCTIONS, which makes one row per frame; "": a row per agent or event.
        condition: which agents or events count; "": all.
        arguments: of `quantiles`, numbers from 0 to 1; of `histogram`, low, high and bins.
        interval: frames from one row to the next.

    """

    symbol: str
    name: str = ""
    function: str = ""
    condition: str = ""
    arguments: tuple[float, ...] = ()
    interval: int = 1

    def __post_init__(self) -> None:
        # Plain floats: numbers of numpy have another `repr`, and large ints more digits.
        object.__setattr__(self, "arguments", _finite(self))
        _check_arguments(self)
        text("a condition", self.condition)
        whole_number(f"{self.symbol}: every", self.interval, 1)

    def __str__(self) -> str:
        shown = f"{self.symbol}.{self.name}" if self.name else self.symbol
        if self.function:
            # `repr`, because fewer digits would be read as another number.
            numbers = [repr(number).removesuffix(".0") for number in self.arguments]
            inner = [shown, *numbers, *([self.condition] if self.condition else [])]
            shown = f"{self.function}({', '.join(inner)})"
        elif self.condition:
            shown = f"{shown} where {self.condition}"
        return shown if self.interval == 1 else f"{shown} every {self.interval}"

    @property
    def of_events(self) -> bool:
        """Whether it is about events, not agents."""
        return self.symbol.startswith("e")

    def where(self, condition: str) -> Expression:
        """The expression for agents or events that fulfil a condition only."""
        return replace(self, condition=condition)

    def every(self, frames: int) -> Expression:
        """The expression for each n-th frame, from frame 0. Raises MisuseError below 1."""
        return replace(self, interval=frames)

    def sum(self, where: str = "") -> Expression:
        """The sum in each frame; 0 where nothing counts."""
        return self._of("sum", where)

    def mean(self, where: str = "") -> Expression:
        """The mean in each frame; NaN where nothing counts."""
        return self._of("mean", where)

    def min(self, where: str = "") -> Expression:
        """The least value in each frame; NaN where nothing counts."""
        return self._of("min", where)

    def max(self, where: str = "") -> Expression:
        """The greatest value in each frame; NaN where nothing counts."""
        return self._of("max", where)

    def quantiles(self, *numbers: float, where: str = "") -> Expression:
        """Quantiles in each frame, such as 0.5 for the median; NaN where nothing counts.

        Values between two others are interpolated linearly. Raises MisuseError for a number that
        is not between 0 and 1.
        """
        return self._of("quantiles", where, *numbers)

    def histogram(self, low: float, high: float, bins: int = 10, where: str = "") -> Expression:
        """The number of values in each of `bins` bins of equal width, in each frame.

        `high` belongs to the last bin; values outside do not count. Raises MisuseError.
        """
        return self._of("histogram", where, low, high, bins)

    def _of(self, function: str, where: str, *arguments: float) -> Expression:
        if self.function:
            raise MisuseError(f"{self} is one number in each frame already")
        if not self.name:
            raise MisuseError(f"{function} needs a datum: data({self.symbol}, NAME).{function}()")
        condition = where or self.condition
        return replace(self, function=function, condition=condition, arguments=arguments)


def count(symbol: Any, where: str = "") -> Expression:
    """The number of agents of a kind in each frame, or of events of a type.

    Args:
        symbol: an agent class, an event type, or the name of one.
        where: a condition about the agent's attributes or the event's data; "": all.

    Example:
        `count(Person, "health == 'I'")`

    """
    return Expression(_name_of(symbol), function="count", condition=where)


def data(symbol: Any, name: str = "") -> Expression:
    """The agents of a kind, or the events of a type, a row for each with all its data.

    Args:
        symbol: an agent class, an event type, or the name of one.
        name: only of this attribute or datum; "": of all, except agents' lists, matrices and
            strings.

    Example:
        `data(Person)`, `data(eBite)`, `data(eBite, "depth").mean()`

    """
    return Expression(_name_of(symbol), name)


def _name_of(symbol: Any) -> str:
    if isinstance(symbol, str | EventType):
        return symbol if isinstance(symbol, str) else symbol.name
    kind: Any = getattr(symbol, "kind", None)
    if kind is None:
        raise MisuseError(f"{symbol!r} is neither an agent class nor an event type")
    return str(kind.name)


def _finite(made: Expression) -> tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in made.arguments)
    except (TypeError, ValueError, OverflowError):
        numbers = (nan,)
    if not all(map(isfinite, numbers)):
        raise MisuseError(
            f"the arguments of {made.function} of {made.symbol} must be finite numbers"
        )
    return numbers


def _check_arguments(made: Expression) -> None:
    function, numbers = made.function, made.arguments
    if numbers and function not in ("quantiles", "histogram"):
        raise MisuseError(f"{function or 'a value'} of {made.symbol} takes no numbers")
    if function == "quantiles" and (not numbers or not all(0 <= n <= 1 for n in numbers)):
        raise MisuseError(f"quantiles of {made.symbol} need numbers from 0 to 1, such as 0.5")
    if function == "histogram":
        low, high, bins = numbers if len(numbers) == 3 else (0.0, 0.0, 0.0)
        if not (low < high and bins == int(bins) and 1 <= bins <= MAX_BINS):
            raise MisuseError(
                f"a histogram of {made.symbol} needs finite numbers, low < high, and 1 to"
                f" {MAX_BINS:,} bins: histogram(0, 60, bins=12)"
            )


# --- attributes of agent classes ---

NO_DEFAULT: Final = object()


class ClassAttribute:
    """Makes `Person.x` an expression, where `person.x` is the value of an agent.

    It has no `__set__`, so the state of an agent is found in the agent itself.
    """

    __slots__ = ("default", "name")

    def __init__(self, name: str, default: object = NO_DEFAULT) -> None:
        self.name = name
        self.default = default

    def __get__(self, agent: object, cls: Any) -> Any:
        if agent is None:
            kind = getattr(cls, "kind", None)
            return self if kind is None else Expression(kind.name, self.name)
        if self.default is NO_DEFAULT:
            raise AttributeError(f"{type(agent).__name__!r} object has no attribute {self.name!r}")
        return self.default


def expose_attributes(cls: type[Any], names: Iterable[str]) -> None:
    """Make each of these attributes of a class an expression, as `ClassAttribute`."""
    for name in names:
        # Looked up without `getattr`, which would call the descriptor instead of returning it.
        homes = [base for base in cls.__mro__ if name in vars(base)]
        value = vars(homes[0])[name] if homes else NO_DEFAULT
        if not isinstance(value, ClassAttribute):
            setattr(cls, name, ClassAttribute(name, value))


def default_of(cls: type[Any], name: str) -> Any:
    """The default that a class itself gives an attribute; NO_DEFAULT if it gives none."""
    value = vars(cls).get(name, NO_DEFAULT)
    return value.default if isinstance(value, ClassAttribute) else value
