"""Colours and marks that views share: paper, ink, interaction, headings and people."""

import colorsys
import hashlib
from functools import cache
from typing import Final

PAPER = "#f4f0e6"
PANEL = "#fbfaf6"
BORDER = "#d3ccbb"
INK = "#2f3640"
FAINT = "#857e6e"
OUTLINE = "#1d232b"
DARK = "#5b6573"
CHOSEN = "#1f7a8c"
BEAM = "#e8963c"

HEADING_MARK = ((0.78, 0.0), (0.7, 140.0), (0.28, 180.0), (0.7, -140.0))
"""The mark on discs with a heading: distances in radii, and directions in degrees."""

_HUES: Final = 24
_LUMINANCE: Final = 0.15
"""Relative luminance of people's colours: a contrast of 4.5 to paper (WCAG 2.2)."""


@cache
def person_colour(name: str) -> str:
    """The colour of a person, derived from the name, as `#rrggbb`; text has it on paper.

    The name of a certificate, before `/`, has no effect: `web/anna` has the colour of `anna`.
    """
    digest = hashlib.blake2b(name.rpartition("/")[2].encode(), digest_size=2).digest()
    hue = int.from_bytes(digest, "big") % _HUES / _HUES
    lightness = 0.5
    # Yellow is much lighter than blue of the same lightness.
    while _luminance(colorsys.hls_to_rgb(hue, lightness, 0.8)) > _LUMINANCE:
        lightness -= 0.01
    red, green, blue = colorsys.hls_to_rgb(hue, lightness, 0.8)
    return f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}"


def _luminance(colour: tuple[float, float, float]) -> float:
    red, green, blue = (part**2.2 for part in colour)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
