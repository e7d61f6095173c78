"""Expressions of data to collect, checked and as text, and their tables: rows and columns of each.

The text of an expression is that of world files and of the command line (world/expressions.py).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn, TypeAlias, cast

from minerva_bus.errors import MisuseError, VocabularyError, nearest
from minerva_bus.grammar.condition import Condition, Scope, parse_condition, sort_of_kind
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.expressions import FUNCTIONS, Expression

FRAMES: Final = "frames"
ENDINGS: Final = (".parquet", ".csv")
"""Endings of the files of tables."""
_OWN: Final = {"A": ("frame", "id"), "e": ("frame", "sender", "receiver")}

Entries: TypeAlias = Mapping[str, Expression]


@dataclass(slots=True)
class TablePlan:
    """One table: its rows are about a kind of agents, a type of events, or the frames.

    `columns` are the types of its columns (float64, int64, bool or text) by name. `names` are the
    attributes by column, `entries` the expressions by column for a table of frames.
    """

    name: str
    interval: int
    columns: dict[str, str]
    symbol: str = ""
    condition: str = ""
    names: dict[str, str] = field(default_factory=dict[str, str])
    entries: dict[str, Expression] = field(default_factory=dict[str, Expression])

    @property
    def expressions(self) -> list[Expression]:
        """The expressions that it evaluates, or one for the rows that it selects."""
        if self.entries:
            return list(self.entries.values())
        return [Expression(self.symbol, condition=self.condition)]


def read_entries(given: object) -> dict[str, Expression]:
    """The expressions to collect, by name, from a mapping or from a list of attributes.

    Values are expressions or their texts. Raises MisuseError and VocabularyError.
    """
    pairs: list[tuple[str, object]]
    if isinstance(given, Mapping):
        named = cast("Mapping[object, object]", given)
        pairs = [(str(name), value) for name, value in named.items()]
    elif isinstance(given, list | tuple):
        listed = cast("Iterable[object]", given)
        # A list gives no names, so the attributes name the columns.
        expressions = [_expression(value, "collect") for value in listed]
        pairs = [(default_name(expression), expression) for expression in expressions]
    else:
        raise MisuseError(
            'collect: expected names with expressions, such as {"foxes": count(Fox)}, not'
            f" {given!r:.60}"
        )
    entries: dict[str, Expression] = {}
    for name, value in pairs:
        if not name.isprintable():
            raise MisuseError(f"collect: the name {name!r} has characters that cannot be printed")
        if not name or name in entries:
            raise MisuseError(f"collect: the name {name!r} is given twice, or is empty")
        entries[name] = _expression(value, f"collect: {name}")
    return entries


_NAMED: Final = re.compile(r"\s*(?P<name>[A-Za-z_]\w*)\s*=(?!=)(?P<text>.*)\Z", re.DOTALL)


def parse_entries(words: Sequence[str]) -> dict[str, Expression]:
    """The expressions of `--collect`, each `NAME=EXPRESSION` or `EXPRESSION`.

    Without a name, an attribute names its column, and a function gives `mean_APerson_x`. Raises
    MisuseError and VocabularyError, which name the option.
    """
    entries: dict[str, Expression] = {}
    for word in words:
        named = _NAMED.match(word)
        name, text = (named["name"], named["text"].strip()) if named else ("", word)
        expression = read_expression(text, f"--collect {name}".rstrip())
        name = name or default_name(expression)
        if name in entries:
            raise MisuseError(f"--collect: the name {name} is given twice; give NAME=EXPRESSION")
        entries[name] = expression
    return entries


def default_name(expression: Expression) -> str:
    """The name of an expression that has none."""
    if not expression.function:
        return expression.name or expression.symbol
    return "_".join(filter(None, (expression.function, expression.symbol, expression.name)))


def _expression(value: object, source: str) -> Expression:
    if isinstance(value, Expression):
        return value
    if isinstance(value, str):
        return read_expression(value, source)
    raise MisuseError(
        f"{source}: expected an expression such as Person.x or count(Person), not {value!r:.60}"
    )


def plans_of(entries: Entries, vocabulary: Vocabulary, option: str = "collect:") -> list[TablePlan]:
    """The tables for these expressions. Raises VocabularyError and MisuseError.

    `option` begins the messages about an expression, before its name.
    """
    plans: dict[tuple[Any, ...], TablePlan] = {}
    taken: set[str] = set()
    for name, entry in entries.items():
        condition_of(entry, vocabulary, f"{option} {name}")
        about = FRAMES if entry.function else entry.symbol
        # Aggregates select rows column by column, so they share a table whatever their conditions
        # are.
        key = (about, entry.condition if not entry.function else "", entry.interval)
        # One table for each kind of rows: the same agents or events, in the same frames.
        plan = plans.get(key)
        if plan is None:
            plan = plans[key] = _plan(_table_name(about, entry, name, taken), about, entry)
            taken.add(plan.name)
        fields = fields_of(vocabulary, entry.symbol)
        made = _columns(name, entry, fields)
        for column, kind in made:
            if column in plan.columns:
                raise MisuseError(
                    f"collect: the table {plan.name} has two columns {column!r}; rename {name}"
                )
            plan.columns[column] = kind
        if entry.function:
            plan.entries[name] = entry
        else:
            plan.names |= {column: entry.name or column for column, _ in made}
    return list(plans.values())


def _table_name(about: str, entry: Expression, name: str, taken: set[str]) -> str:
    if about not in taken:
        return about
    return f"{about}_every_{entry.interval}" if about == FRAMES else f"{about}_{name}"


def _plan(name: str, about: str, entry: Expression) -> TablePlan:
    if about == FRAMES:
        return TablePlan(name, entry.interval, {"frame": "int64", "time": "float64"})
    return TablePlan(name, entry.interval, own_columns(about), about, entry.condition)


def own_columns(symbol: str) -> dict[str, str]:
    """The columns that all tables of agents, or of events, have."""
    return dict.fromkeys(_OWN[symbol[0]], "text") | {"frame": "int64"}


def series_of(plan: TablePlan, vocabulary: Vocabulary) -> dict[str, str]:
    """The columns of a table of frames that are series over time, with their units; no bins."""
    series: dict[str, str] = {}
    for name, entry in plan.entries.items():
        if entry.function == "histogram":
            continue
        fields = fields_of(vocabulary, entry.symbol)
        units = {field.name: field.type.unit for field in fields.all}
        unit = "" if entry.function == "count" else units[entry.name]
        series |= dict.fromkeys([column for column, _ in _columns(name, entry, fields)], unit)
    return series


COLUMN_TYPES: Final = {"real": "float64", "int": "int64", "bool": "bool", "text": "text"}
"""The types of columns, by the kind of an attribute's type."""


def fields_of(vocabulary: Vocabulary, symbol: str) -> Fields:
    """The attributes of an agent kind, or the data of an event type."""
    known: Mapping[str, Any] = vocabulary.events if symbol[0] == "e" else vocabulary.kinds
    return known[symbol].fields


def _columns(name: str, entry: Expression, fields: Fields) -> list[tuple[str, str]]:
    """The columns of an expression, with their types."""
    types = {field.name: field.type.kind for field in fields.all}
    function = entry.function
    if not function:
        return (
            [(name, COLUMN_TYPES[types[entry.name]])] if entry.name else _data_columns(entry, types)
        )
    if function == "quantiles":
        return [(f"{name}_{number:g}", "float64") for number in entry.arguments]
    if function == "histogram":
        return [(f"{name}_{number}", "int64") for number in range(int(entry.arguments[2]))]
    whole = function == "count" or (function == "sum" and types[entry.name] in ("int", "bool"))
    return [(name, "int64" if whole else "float64")]


def _data_columns(entry: Expression, types: Mapping[str, str]) -> list[tuple[str, str]]:
    """The columns of all data of events, or of those attributes of agents that have columns."""
    for name, kind in types.items():
        if kind not in COLUMN_TYPES and entry.of_events:
            raise MisuseError(f"collect: {entry.symbol}.{name} is not a number, bool or text; name"
                              f" the data to collect: data({entry.symbol}, NAME)")  # fmt: skip
    return [(name, COLUMN_TYPES[kind]) for name, kind in types.items() if kind in COLUMN_TYPES]


def condition_of(
    expression: Expression, vocabulary: Vocabulary, source: str = "collect"
) -> Condition:
    """Its parsed condition. Raises VocabularyError if the vocabulary lacks what it names."""
    owner, text = expression.symbol, str(expression)
    known: Mapping[str, Any] = vocabulary.events if expression.of_events else vocabulary.kinds
    if owner not in known:
        what = "event type" if expression.of_events else "agent kind"
        raise VocabularyError(
            f"the world has no {what} {owner}{nearest(owner, list(known))}",
            text=text,
            # After the parenthesis of a function.
            offset=text.find("(") + 1 if expression.function else 0,
            expected=f"one of {', '.join(known) or 'none'}",
            source=source,
        )
    fields = fields_of(vocabulary, owner)
    types = {field.name: field.type for field in fields.all}
    # The caret points to the name, which follows the first dot.
    where: dict[str, Any] = {"text": text, "offset": text.find(".") + 1, "source": source}
    # The attribute must exist, fit into a column, and be a number if there is a function.
    for name in (expression.name,) if expression.name else ():
        if name not in types:
            near = nearest(name, list(types))
            raise VocabularyError(f"{owner} has no {name}{near}", **where)
        sort = sort_of_kind(types[name].kind)
        if not sort:
            raise VocabularyError(
                f"{owner}.{name} is a {types[name]}; numbers, bools and texts can be collected",
                **where,
            )
        if expression.function and types[name].kind == "text":
            raise VocabularyError(
                f"{owner}.{name} is a text, which has no {expression.function}; count texts with"
                f' count({owner}, {name} == "...")',
                **where,
            )
    condition = parse_condition(in_double_quotes(expression.condition), source)
    sorts = {name: sort_of_kind(kind.kind) for name, kind in types.items()}
    condition.check([Scope(owner, list(types), lambda name: sorts.get(name, ""))], source)
    return condition


# --- expressions as text ---

_EVERY: Final = re.compile(r"\s+every\s+([0-9]+)\s*\Z")
_CALL: Final = re.compile(r"\s*(?P<function>[A-Za-z]+)\s*\((?P<inner>.*)\)\s*\Z", re.DOTALL)
_TERM: Final = re.compile(
    r"\s*(?P<symbol>[Ae]\w*)(?:\.(?P<name>[A-Za-z_]\w*))?(?P<rest>.*)\Z", re.DOTALL | re.ASCII
)
# The look-ahead takes whole arguments only: in `count(AFox, 3 < x)` the 3 begins a condition.
_NUMBER: Final = re.compile(
    r"\s*,\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[-+]?[0-9]+)?)\s*(?=,|\Z)"
)
_WHERE: Final = re.compile(r"\s+where\s+(.*)\Z", re.DOTALL)
# Double quotes match first, so single quotes within a text in double quotes stay.
_QUOTED: Final = re.compile(r"""("(?:[^"\\]++|\\.)*+")|'((?:[^'\\]++|\\.)*+)'""")
_ESCAPED: Final = re.compile(r"""\\(')|\\.|(")""")
_EXPECTED: Final = "KIND.ATTRIBUTE, EVENT.DATUM, or a function of one, such as count(AFox, x > 3)"


def read_expression(text: str, source: str = "collect") -> Expression:
    """The expression that a text represents. Raises VocabularyError with a caret."""
    # From the end of the text, because conditions and names may contain "every" as well.
    every = _EVERY.search(text)
    body = text[: every.start()] if every else text
    interval = int(every.group(1)) if every else 1
    call = _CALL.match(body)
    inner, offset = (call["inner"], call.start("inner")) if call else (body, 0)
    function = call["function"] if call else ""
    if call and function not in FUNCTIONS:
        _wrong(
            f"there is no function {function}{nearest(function, list(FUNCTIONS))}", text, 0, source
        )
    term = _TERM.match(inner)
    if term is None:
        _wrong("the expression cannot be read", text, offset, source)
    condition, numbers, rest = "", list[float](), term["rest"]
    if call:
        while number := _NUMBER.match(rest):
            numbers.append(float(number.group(1)))
            rest = rest[number.end() :]
        condition = rest.strip().removeprefix(",").strip()
        clear = not rest.strip() or rest.lstrip().startswith(",")
    else:
        where = _WHERE.match(rest)
        condition = where.group(1).strip() if where else ""
        clear = bool(where) or not rest.strip()
    if not clear:
        _wrong("the expression cannot be read", text, offset + term.start("rest"), source)
    name = term["name"] or ""
    if not name and function not in ("", "count"):
        _wrong(f"which attribute of {term['symbol']}", text, offset + term.end("symbol"), source)
    try:
        return Expression(term["symbol"], name, function, condition, tuple(numbers), interval)
    except MisuseError as error:
        _wrong(str(error), text, 0, source)


def in_double_quotes(condition: str) -> str:
    """A condition with texts in single quotes rewritten to double quotes."""
    return _QUOTED.sub(lambda match: match[1] or _double_quoted(match[2]), condition)


def _double_quoted(inside: str) -> str:
    # Escapes stay, except for that of a single quote, which JSON does not have.
    escaped = _ESCAPED.sub(lambda match: match[1] or ('\\"' if match[2] else match[0]), inside)
    return f'"{escaped}"'


def _wrong(problem: str, text: str, at: int, source: str) -> NoReturn:
    raise VocabularyError(problem, text=text, offset=at, expected=_EXPECTED, source=source)
