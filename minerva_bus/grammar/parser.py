"""Parser for strings of L(M), by Table 1 only.

    WORLD    → OBJECTS | ε
    OBJECTS  → OBJECT (("·" | ".") OBJECT)*
    OBJECT   → FIGURE | TRANSFORMATION | AGENT
    AGENT    → Aname ["#" id] [values] ["(" [OBJECTS] ")"]
    TRANSFORMATION → Tname [values] "(" [OBJECTS] ")"
    FIGURE   → PRIMITIVE PRIMITIVE*
    PRIMITIVE → Pname [values]
    values   → "<" [name "=" value ("," name "=" value)*] ">"
    value    → number [unit] | "text" | true | false | [value, ...] | RxC[runs] | RxCr[runs]
             | {WORLD}
    runs     → (number ["*" count])*      R·C numbers in row order; int16, with `r` float64

Primitives of one figure may be adjacent without a dot (p⁺, rule 6): `PX PY` and `PX · PY` are the
same string, because φ runs both from left to right (equation 1); it prints with dots. The first
letter of a symbol is its alphabet, as in the paper: P, T or A. `//` starts a comment. An agent
without an id gets one from its kind and a count of such agents of that kind; ids that the text
gives to others are skipped. The parser has its own stack, so only memory limits the depth.
"""

import json
import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import GrammarError, MisuseError
from minerva_bus.grammar.scene import (
    AGENT_ID,
    DEPTH,
    EMPTY,
    MATRIX_CELLS,
    AgentNode,
    Array,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
)
from minerva_bus.grammar.types import Quantity

_BLANK = re.compile(r"(?:\s+|//[^\n]*)*")
_HEAD = re.compile(rf"([PTA][A-Za-z0-9_]*)(?:#({AGENT_ID.pattern}))?")
# Texts and comments match first, so that a # within them does not count as an id.
_GIVEN_ID = re.compile(rf'"(?:[^"\\]++|\\.)*+"|//[^\n]*|#({AGENT_ID.pattern})')
_PLAIN_VALUES = re.compile(r'<[^<>{}"\[\]/]*>')
_ALPHABETS = "a symbol of P, T or A (PMap, TMove<dist=1>(...), ARobot#r1)"

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
# Possessive quantifiers (++ and *+) do not backtrack: a long run of digits is scanned once.
_DIGITS = r"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?"
_PLAIN_PAIR = re.compile(rf"([A-Za-z_][A-Za-z0-9_]*)\s*=\s*({_DIGITS})\s*([,>])")
_NUMBER = re.compile(rf"({_DIGITS})(?:\s*([A-Za-z°]+(?:/[A-Za-z]+)?))?")
_RUN = re.compile(rf"({_DIGITS})(?:\*([0-9]{{1,12}}))?")
_MATRIX = re.compile(r"([0-9]{1,9})x([0-9]{1,9})(r?)\[([^\]]*)\]")
_STRING = re.compile(r'"(?:[^"\\]++|\\.)*+"')
_WORD = re.compile(r"true\b|false\b")
_VALUE = 'a number, "text", true, false, [list], RxC[matrix] or {string}'

_Values: TypeAlias = tuple[tuple[str, ...], tuple[Value, ...]]


@dataclass(slots=True)
class _Open:
    """A symbol whose scope is being read, and the nodes in it so far."""

    symbol: str
    id: str
    values: _Values
    offset: int
    nodes: list[Node]


@dataclass(frozen=True, slots=True)
class Parsed:
    """A string, its text, and the offset of each node in the text, by the node's `id()`."""

    scene: Scene
    text: str
    source: str
    offsets: dict[int, int]


def parse(text: str, source: str = "") -> Scene:
    """The string that a text represents, by Table 1 only, without a vocabulary.

    Args:
        text: a string of L(M).
        source: name of the file, for errors.

    Raises:
        GrammarError: with line, column, caret and what was expected.
        MisuseError: the argument is not a text.

    Example:
        >>> print(parse("TAt<x=1>(PSnail PSnail)"))
        TAt<x=1>(PSnail · PSnail)

    """
    if not isinstance(text, str) or not isinstance(source, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(
            "parse takes a text, and the name of its file for errors; to check a string by a"
            " vocabulary: Vocabulary.of(...).check(parse(text))"
        )
    return parse_located(text, source).scene


def parse_located(text: str, source: str = "") -> Parsed:
    """As `parse`, with the offset of each node, for errors that are found later."""
    reader = _StringReader(text, source)
    scene, _ = reader.world(0)
    return Parsed(scene, text, source, reader.offsets)


@dataclass(slots=True)
class _StringReader:
    """Reads one string: the complete text, or at `depth` > 0 a part of it in braces.

    Lists and braces may be nested `DEPTH` deep, because values are the only part of the language
    that is read, printed and compared recursively.
    """

    text: str
    source: str
    depth: int = 0
    offsets: dict[int, int] = field(default_factory=dict[int, int])
    given: frozenset[str] | None = None
    ids: set[str] = field(default_factory=set[str])
    nameless: dict[str, int] = field(default_factory=dict[str, int])
    figures: dict[str, FigureNode] = field(default_factory=dict[str, FigureNode])
    parsed_values: dict[str, _Values] = field(default_factory=dict[str, _Values])

    def world(self, at: int) -> tuple[Scene, int]:
        """The string that begins at an offset, and the offset of its end."""
        at = self.skip(at)
        if self.text.startswith("ε", at) and self.ends(self.skip(at + 1)):
            at = self.skip(at + 1)
        if self.ends(at):
            return EMPTY, at
        stack: list[_Open] = []
        top: list[Node] = []
        nodes = top
        while True:
            start = at
            opened, at = self.symbol(at, nodes)
            end = at
            # The scope of this symbol becomes the current one; it may be empty.
            if opened is not None:
                stack.append(opened)
                nodes = opened.nodes
                if not self.text.startswith(")", at):
                    continue
            # Close every scope that ends here, and skip blanks between the parentheses.
            while stack and self.text.startswith(")", at):
                outer = stack[-2].nodes if len(stack) > 1 else top
                self.close(stack.pop(), outer)
                nodes = outer
                at = self.skip(at + 1)
            if self.ends(at):
                break
            # Rule 6 joins primitives only: after a `)` a dot is required.
            figure = self.text[start] == "P" and at == end
            at = self.separator(at, bool(stack), figure)
        if stack:
            last = stack[-1]
            raise self.wrong(at, "')'", f"the scope of {last.symbol} is not closed", last.offset)
        return Scene(tuple(top)), at

    def ends(self, at: int) -> bool:
        return self.text.startswith("}", at) if self.depth else at == len(self.text)

    def symbol(self, at: int, nodes: list[Node]) -> tuple[_Open | None, int]:
        """Read one symbol; unless it is a figure or an agent without a scope, it remains open."""
        start = at
        match = _HEAD.match(self.text, at)
        if match is None:
            raise self.wrong(at, _ALPHABETS)
        name, agent_id = match.group(1), match.group(2)
        at = match.end()
        if agent_id is not None and name[0] != "A":
            raise self.wrong(match.start(2) - 1, "ids of agents only", f"{name} cannot have an id")
        values, at = self.values(at)
        at = self.skip(at)
        scoped = self.text.startswith("(", at)
        if name[0] == "P":
            if scoped:
                raise self.wrong(at, "'·', ')' or the end", f"the primitive {name} has no scope")
            nodes.append(self.figure(name, values, start))
            return None, at
        # Rules 4 and 5: a transformation always has a scope, an agent may omit an empty one.
        if name[0] == "T" and not scoped:
            raise self.wrong(at, "'('", f"the transformation {name} needs a scope")
        agent_id = self.agent_id(name, agent_id, start) if name[0] == "A" else ""
        opened = _Open(name, agent_id, values, start, [])
        if scoped:
            return opened, self.skip(at + 1)
        self.close(opened, nodes)
        return None, at

    def figure(self, name: str, values: _Values, start: int) -> FigureNode:
        # Equal figures without values share one node, and so its digest.
        if not values[0] and name in self.figures:
            return self.figures[name]
        node = FigureNode(name, *values)
        self.offsets[id(node)] = start
        if not values[0]:
            self.figures[name] = node
        return node

    def close(self, opened: _Open, nodes: list[Node]) -> None:
        scope = Scene(tuple(opened.nodes)) if opened.nodes else EMPTY
        if opened.symbol[0] == "T":
            node = TransformationNode(opened.symbol, *opened.values, scope)
        else:
            node = AgentNode(opened.symbol, opened.id, *opened.values, scope)
        # `id()` is unique here, because the string keeps all its nodes alive.
        self.offsets[id(node)] = opened.offset
        nodes.append(node)

    def agent_id(self, symbol: str, given: str | None, start: int) -> str:
        name = given or self.new_id(symbol)
        if name in self.ids:
            raise self.wrong(start, "a unique id for each agent", f"duplicate id #{name}")
        self.ids.add(name)
        return name

    def new_id(self, symbol: str) -> str:
        given = self.given_ids()
        while True:
            count = self.nameless[symbol] = self.nameless.get(symbol, 0) + 1
            name = f"{symbol[1:].lower() or 'agent'}{count}"
            if name not in given and name not in self.ids:
                return name

    def given_ids(self) -> frozenset[str]:
        """All ids in the text, found once for the complete text."""
        if self.given is None:
            self.given = frozenset(_GIVEN_ID.findall(self.text))
        return self.given

    def separator(self, at: int, inside: bool, figure: bool) -> int:
        """The offset of the next symbol; within a `figure` a primitive may follow without a dot."""
        if figure and self.text.startswith("P", at):
            return at
        if self.text.startswith(("·", "."), at):
            return self.skip(at + 1)
        end = "'}'" if self.depth else "the end"
        wanted = "'·' or ')'" if inside else f"'·' or {end}"
        raise self.wrong(at, wanted)

    def values(self, at: int) -> tuple[_Values, int]:
        if not self.text.startswith("<", at):
            return ((), ()), at
        plain = _PLAIN_VALUES.match(self.text, at)
        if plain is not None:
            # Many symbols of a text have the same values; those with strings or lists in them are
            # not cached.
            known = self.parsed_values.get(plain.group())
            if known is not None:
                return known, plain.end()
        values, end = self.pairs(self.skip(at + 1))
        if plain is not None:
            self.parsed_values[plain.group()] = values
        return values, end

    def skip(self, at: int) -> int:
        sign = self.text[at : at + 1]
        if sign != "/" and not sign.isspace():  # The usual case, and faster than a match.
            return at
        match = _BLANK.match(self.text, at)
        return match.end() if match else at

    def pairs(self, at: int) -> tuple[_Values, int]:
        """Names and values of `name=value, ...>` at an offset, and the offset after them."""
        if self.text.startswith(">", at):
            return ((), ()), at + 1
        pairs: dict[str, Value] = {}
        more = True
        while more:
            at, more = self.pair(at, pairs)
        return (tuple(pairs), tuple(pairs.values())), at

    def pair(self, at: int, pairs: dict[str, Value]) -> tuple[int, bool]:
        """Read `name=value` and the following sign; returns the next offset, and if more follow."""
        # Most values are plain numbers, for which one match reads the whole pair.
        plain = _PLAIN_PAIR.match(self.text, at)
        if plain is not None and plain.group(1) not in pairs:
            name, digits, sign = plain.groups()
            pairs[name] = self.parse_number(digits, plain.start(2))
            return (self.skip(plain.end()), True) if sign == "," else (plain.end(), False)
        name, at = self.name(at, pairs)
        value, at = self.value(at)
        pairs[name], at = value, self.skip(at)
        if self.text.startswith(">", at):
            return at + 1, False
        return self.expect(",", at, "'>'"), True

    def name(self, at: int, names: Collection[str]) -> tuple[str, int]:
        match = _NAME.match(self.text, at)
        if match is None:
            raise self.wrong(at, "a name" if names else "a name or '>'")
        if match.group() in names:
            raise self.wrong(at, "each name once", f"duplicate name {match.group()}")
        return match.group(), self.expect("=", self.skip(match.end()))

    def value(self, at: int) -> tuple[Value, int]:
        """One value at an offset, and the offset after it."""
        first = self.text[at : at + 1]
        if first == '"':
            return self.string(at)
        if first == "[":
            return self.nested(at, self.items)
        if first == "{":
            return self.nested(at, self.scene)
        word = _WORD.match(self.text, at)
        if word is not None:
            return word.group() == "true", word.end()
        # Before numbers: `2x3[...]` begins with one.
        matrix = _MATRIX.match(self.text, at)
        if matrix is not None:
            return self.matrix(matrix), matrix.end()
        return self.number(at)

    def number(self, at: int) -> tuple[Value, int]:
        match = _NUMBER.match(self.text, at)
        if match is None:
            raise self.wrong(at, _VALUE)
        digits, unit = match.groups()
        number = self.parse_number(digits, at)
        return (number if unit is None else Quantity(float(number), unit)), match.end()

    def parse_number(self, digits: str, at: int) -> int | float:
        bare = digits.lstrip("+-")
        if bare.isdigit():
            # `int` takes quadratic time, and raises for more than some thousand digits.
            number = int(digits) if len(bare.lstrip("0")) < 20 else 1 << 64
            if not -(1 << 63) <= number < 1 << 63:
                raise self.wrong(
                    at, "a whole number of at most 64 bits", f"{digits[:30]} is too large"
                )
            return number
        real = float(digits)
        if not math.isfinite(real):
            raise self.wrong(at, "a finite number", f"{digits[:30]} is too large")
        return real

    def string(self, at: int) -> tuple[str, int]:
        match = _STRING.match(self.text, at)
        if match is None:
            raise self.wrong(at, "'\"' at the end of the text", "unterminated text")
        try:
            value = json.loads(match.group(), strict=True)
            # Half a surrogate pair is valid JSON, but cannot be encoded in UTF-8.
            value.encode()
        except ValueError:
            raise self.wrong(at, "a JSON string", "invalid escape or character in a text") from None
        return value, match.end()

    def nested(self, at: int, read: Callable[[int], tuple[Value, int]]) -> tuple[Value, int]:
        # Bounds the recursion of reading, printing and comparing values.
        if self.depth >= DEPTH:
            raise self.wrong(at, f"values nested at most {DEPTH} deep")
        self.depth += 1
        value, end = read(at + 1)
        self.depth -= 1
        return value, end

    def items(self, at: int) -> tuple[tuple[Value, ...], int]:
        items: list[Value] = []
        at = self.skip(at)
        while not self.text.startswith("]", at):
            if items:
                at = self.expect(",", at, "']'")
            item, at = self.value(at)
            items.append(item)
            at = self.skip(at)
        return tuple(items), at + 1

    def scene(self, at: int) -> tuple[Scene, int]:
        """A string in braces; its ids are independent of those outside."""
        given = self.given_ids()
        inner = _StringReader(self.text, self.source, self.depth, self.offsets, given)
        scene, end = inner.world(at)
        return scene, end + 1

    def matrix(self, match: re.Match[str]) -> Array:
        rows, columns, at = int(match.group(1)), int(match.group(2)), match.start()
        real = bool(match.group(3))
        # Checked before anything is allocated: a short text may declare a huge matrix, or repeat a
        # number very often.
        if rows * columns > MATRIX_CELLS:
            raise self.wrong(at, f"at most {MATRIX_CELLS} cells", f"{rows}x{columns} is too large")
        runs = [self.run(text, real, at) for text in match.group(4).split()]
        cells = sum(count for _, count in runs)
        if cells != rows * columns:
            raise self.wrong(at, f"{rows * columns} cells", f"the matrix has {cells}")
        counts = np.array([count for _, count in runs], np.intp)
        numbers = [number for number, _ in runs]
        if real:
            return _shaped(np.repeat(np.array(numbers, np.float64), counts), rows, columns)
        return _shaped(np.repeat(np.array(numbers, np.int16), counts), rows, columns)

    def run(self, text: str, real: bool, at: int) -> tuple[int | float, int]:
        match = _RUN.fullmatch(text)
        if match is None:
            raise self.wrong(at, "runs such as 0*5 or 1", f"invalid run {text[:30]!r}")
        digits, count = match.groups()
        number = self.parse_number(digits, at)
        if not real and (isinstance(number, float) or not -32768 <= number < 32768):
            raise self.wrong(at, "whole numbers of 16 bits", f"invalid cell {digits[:30]}")
        return number, int(count or 1)

    def expect(self, sign: str, at: int, or_else: str = "") -> int:
        if not self.text.startswith(sign, at):
            raise self.wrong(at, f"'{sign}' or {or_else}" if or_else else f"'{sign}'")
        return self.skip(at + 1)

    def wrong(self, at: int, expected: str, problem: str = "", opened: int = -1) -> GrammarError:
        actual = "the end" if at >= len(self.text) else repr(self.text[at])
        problem = problem or f"found {actual}"
        if opened >= 0:
            line = self.text.count("\n", 0, opened) + 1
            column = opened - self.text.rfind("\n", 0, opened)
            problem += f" (opened at line {line}, column {column})"
        return GrammarError(
            problem, text=self.text, offset=at, expected=expected, source=self.source
        )


_A = TypeVar("_A", NDArray[np.int16], NDArray[np.float64])


def _shaped(flat: _A, rows: int, columns: int) -> _A:
    """A read-only matrix of these cells."""
    flat.flags.writeable = False
    return flat.reshape(rows, columns)


def parse_value(text: str, source: str = "") -> Value:
    """The single value of a text such as `0.5`, `"red"` or `{PFox}`. Raises GrammarError."""
    # Any symbol will do, because the parser knows no vocabulary.
    nodes = parse(f"P<value={text}>", source).nodes
    if len(nodes) != 1 or len(nodes[0].values) != 1:
        raise GrammarError(f"{text!r:.60} is not one value")
    return nodes[0].values[0]
