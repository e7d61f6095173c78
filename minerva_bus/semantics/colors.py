"""Colours of forms as numbers."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, TypeAlias

Color: TypeAlias = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""

OKABE_ITO: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours that people with colour-vision deficiency can also distinguish (Okabe and Ito, 2008)."""


@lru_cache(maxsize=1024)
def rgb(color: str) -> Color:
    """A colour `#rrggbb` or `#rgb` as numbers from 0 to 255; grey for any other text."""
    digits = color.removeprefix("#")
    digits = "".join(2 * digit for digit in digits) if len(digits) == 3 else digits
    try:
        red, green, blue = bytes.fromhex(digits)
    except ValueError:
        return (0x88, 0x88, 0x88)
    return red, green, blue


def is_pale(color: str) -> bool:
    """Whether a line of this colour is hard to see on paper.

    Its relative luminance (WCAG 2.2, with the approximate exponent 2.2) is above 0.7.
    """
    red, green, blue = [(part / 255) ** 2.2 for part in rgb(color)]
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.7
