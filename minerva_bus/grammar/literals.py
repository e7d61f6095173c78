"""The values between `<` and `>` in the text of a string.

value  → number [unit] | "text" | true | false | [value, ...] | RxC[runs] | RxCr[runs] | {WORLD}
runs   → (number ["*" count])*      R·C numbers in row order; int16, with `r` float64
"""

import json
import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import GrammarError
from minerva_bus.grammar.measures import Quantity
from minerva_bus.grammar.scene import DEPTH, MATRIX_CELLS, Array, Scene, Value

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


@dataclass(slots=True)
class Literals:
    """Reads values from a text.

    `skip` returns the offset after blanks and comments; `world` reads a string in braces at an
    offset and a depth. Lists and braces may be nested `DEPTH` deep, because values are the only
    part of the language that is read, printed and compared recursively.
    """

    text: str
    source: str
    skip: Callable[[int], int]
    world: Callable[[int, int], tuple[Scene, int]]
    depth: int = 0

    def values(self, at: int) -> tuple[tuple[tuple[str, ...], tuple[Value, ...]], int]:
        """Names and values of `<name=value, ...>` at an offset, and the offset after it."""
        at = self.skip(at + 1)
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
        scene, end = self.world(at, self.depth)
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

    def wrong(self, at: int, expected: str, problem: str = "") -> GrammarError:
        actual = "the end" if at >= len(self.text) else repr(self.text[at])
        return GrammarError(
            problem or f"found {actual}",
            text=self.text,
            offset=at,
            expected=expected,
            source=self.source,
        )


_A = TypeVar("_A", NDArray[np.int16], NDArray[np.float64])


def _shaped(flat: _A, rows: int, columns: int) -> _A:
    """A read-only matrix of these cells."""
    flat.flags.writeable = False
    return flat.reshape(rows, columns)
