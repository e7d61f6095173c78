"""Conversion of SVG to PNG by resvg. Importing this module fails without resvg_py."""

import resvg_py

from minerva_bus.errors import MisuseError
from minerva_services.views.svg.fonts import font_options


def png(document: str) -> bytes:
    """An SVG document as a PNG of its own size. Raises MisuseError if resvg rejects it."""
    try:
        # Some versions return a list of numbers.
        return bytes(resvg_py.svg_to_bytes(svg_string=document, **font_options()))
    except ValueError as error:
        raise MisuseError(f"picture: resvg cannot render it: {error}") from None
