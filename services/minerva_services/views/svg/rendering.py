"""From SVG to PNG by resvg. To import this module fails where resvg_py is not installed."""

import resvg_py

from minerva_bus.errors import MisuseError
from minerva_services.views.svg.fonts import font_options


def png(document: str) -> bytes:
    """An SVG document as a PNG of its own size. Raises MisuseError where resvg refuses it."""
    try:
        # Some versions give a list of numbers.
        return bytes(resvg_py.svg_to_bytes(svg_string=document, **font_options()))
    except ValueError as error:
        raise MisuseError(f"picture: resvg refuses the picture: {error}") from None
