"""Cases of numbers, texts and values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from minerva_bus import Scene
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.wire.strings_codec import plain_value
from tools import golden_messages as golden
from tools.vectors.notation import Cases, bits, packed_hex

FLOATS: Final = {
    "zero": 0.0, "minus zero": -0.0, "one": 1.0, "tenth": 0.1, "third": 1 / 3,
    "sum of a tenth and a fifth": 0.1 + 0.2, "whole": 1500.0, "negative": -2.5,
    "least that is written without exponent": 1e-4, "below it": 9.999999999999999e-05,
    "small": 1e-5, "greatest that is written without exponent": 9999999999999998.0,
    "exponent from 1e16": 1e16, "exponent of three digits": 1.5e100, "greatest exponent": 1e308,
    "greatest": 1.7976931348623157e308, "least normal": 2.2250738585072014e-308,
    "greatest denormal": 2.225073858507201e-308, "denormal": 1e-310, "least denormal": 5e-324,
    "negative denormal": -5e-324, "two to the 53": 2.0**53, "two to the 63": 2.0**63,
    "shortest of several": 5e-5, "halfway": 9007199254740993.0,
    "next after one": 1.0000000000000002,
    "greatest float32": 3.4028234663852886e38, "pi": 3.141592653589793, "million": 1e6,
}  # fmt: skip


def floats() -> Cases:
    """The text and the encoding of a real."""
    for name, number in FLOATS.items():
        expected = {"text": value_text(number), "msgpack": packed_hex(number)}
        yield name, bits(number), expected


INTEGERS: Final = (
    *(0, 1, 127, 128, 255, 256, 65535, 65536, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 32),
    *((1 << 53) - 1, 1 << 53, (1 << 53) + 1, (1 << 63) - 1),
    *(-1, -32, -33, -128, -129, -32768, -32769, -(1 << 31), -(1 << 31) - 1, -(1 << 53) - 1),
    -(1 << 63),
)


def integers() -> Cases:
    """The shortest encoding of an int, and one of 64 bits that a reader accepts as well."""
    for number in INTEGERS:
        longest = b"\xcf" if number >= 0 else b"\xd3"
        wide = longest + (number % (1 << 64)).to_bytes(8, "big")
        expected = {"text": str(number), "msgpack": packed_hex(number), "accepted": wide.hex()}
        yield str(number), str(number), expected


TEXTS: Final = {
    "empty": "", "plain": "kitchen", "quotes": 'a "b"', "backslash": "a\\b", "slash": "a/b",
    "line feed, tab, return": "a\n\t\r", "backspace, form feed": "\b\f", "control": "\x00\x1f",
    "delete is not escaped": "\x7f", "two bytes": "é", "three bytes": "€",
    "four bytes": "𝄞", "combining, not normalized": "e\u0301", "right to left": "שלום",
    "joined emoji": "👩\u200d🚀", "no-break space": "\u00a0", "separators": "\u2028\u2029",
    "byte order mark": "\ufeff", "last code point": "\U0010ffff", "32 bytes": "x" * 32,
}  # fmt: skip


def texts() -> Cases:
    """The quoted text and the encoding of a text, given by its code points."""
    for name, value in TEXTS.items():
        expected = {"text": value_text(value), "msgpack": packed_hex(value)}
        yield name, [ord(char) for char in value], expected


VALUES: Final[Mapping[str, Any]] = {
    "cells": np.array([[0, 1], [2, -1]], np.int16),
    "cells, least and greatest": np.array([[-32768, 32767]], np.int16),
    "matrix": np.array([[0.5]], np.float64),
    "matrix, minus zero and denormal": np.array([[-0.0, 5e-324]], np.float64),
    "list": (1.5, 2.0),
    "list of texts": ("a", ""),
    "nested lists": ((1,), ()),
    "string": golden.STAR_BOX,
    "empty string": Scene(),
    "true": True,
}


def values() -> Cases:
    """The text and the encoding of other values."""
    for name, value in VALUES.items():
        yield name, {"text": value_text(value)}, {"msgpack": packed_hex(plain_value(value))}
