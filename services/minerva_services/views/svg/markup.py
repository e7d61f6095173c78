"""Safe SVG markup for numbers, colours and texts of any origin."""

import re
from xml.sax.saxutils import escape

from minerva_bus.errors import MisuseError
from minerva_bus.wording import xml_characters

_MAX_NUMBER = 1e9
_COLOR = re.compile(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})|[A-Za-z]+")


def short(value: float, decimals: int = 3) -> str:
    """A number rounded to `decimals` and limited to 1e9, beyond which renderers fail.

    The default suits pixels; lengths that are multiplied by the picture's scale need more.
    """
    return f"{round(min(max(value, -_MAX_NUMBER), _MAX_NUMBER), decimals):.15g}"


def exact(value: float) -> str:
    """A number with all significant digits, for values multiplied by large numbers."""
    return f"{min(max(value, -_MAX_NUMBER), _MAX_NUMBER):.12g}"


def paint(color: str) -> str:
    """A colour that is safe in an attribute. Raises MisuseError if it is invalid."""
    if not _COLOR.fullmatch(color):
        raise MisuseError(f"{color[:40]!r} is not a colour; expected #rrggbb or a name")
    return color


def line_of_text(text: str, longest: int = 60) -> str:
    """A text on one line as XML character data: escaped, and shortened if too long."""
    # The first cut bounds the work for texts of any length.
    shown = " ".join(xml_characters(text[: 4 * longest]).split())
    return escape(shown if len(shown) <= longest else shown[: longest - 1] + "…")
