"""Numbers, colours and texts as they may stand in an SVG document, wherever they come from."""

import re
from xml.sax.saxutils import escape

from minerva_bus.errors import MisuseError

_FARTHEST = 1e9
_COLOR = re.compile(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})|[A-Za-z]+")
# What XML 1.0 cannot hold, not even escaped.
_UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def short(value: float, decimals: int = 3) -> str:
    """A number rounded to so many decimals; renderers choke on those beyond 1e9, so it ends there.

    The default suits pixels; a length that is multiplied by the picture's scale needs more.
    """
    return f"{round(min(max(value, -_FARTHEST), _FARTHEST), decimals):.15g}"


def exact(value: float) -> str:
    """A number with all digits that matter, for what is multiplied by large numbers."""
    return f"{min(max(value, -_FARTHEST), _FARTHEST):.12g}"


def paint(color: str) -> str:
    """A colour that is safe in an attribute. Raises MisuseError for what is none."""
    if not _COLOR.fullmatch(color):
        raise MisuseError(f"{color[:40]!r} is no colour of a form; write #rrggbb or a name")
    return color


def line_of_text(text: str, longest: int = 60) -> str:
    """A text in one line as XML character data: escaped, cut where it is too long."""
    shown = " ".join(_UNWRITABLE.sub("\ufffd", text[: 4 * longest]).split())
    return escape(shown if len(shown) <= longest else shown[: longest - 1] + "…")
