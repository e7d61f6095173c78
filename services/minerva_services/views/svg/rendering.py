"""Conversion of SVG to PNG by resvg. Importing this module fails without resvg_py."""

import io
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import resvg_py

from minerva_bus.errors import MisuseError
from minerva_services.views.svg.document import FONTS

_SAMPLE = '<svg xmlns="http://www.w3.org/2000/svg" width="40" height="20">{}</svg>'
_TEXT = f'<text y="16" font-family="{FONTS}">Ag</text>'


@cache
def font_options() -> dict[str, Any]:
    """Options that make resvg render text: none, or a font file.

    Without system fonts, that of Pillow's `load_default` is used. Without Pillow, a line on stderr
    says what to install.
    """
    if _shows_text():
        return {}
    file = _pillow_font()
    if file is not None and _shows_text(font_files=[file]):
        return {"font_files": [file]}
    sys.stderr.write(
        "picture: no font found, so the PNG has no text; pip install pillow, or install DejaVu\n"
    )
    return {}


def _shows_text(**options: Any) -> bool:
    import resvg_py

    blank, text = _SAMPLE.format(""), _SAMPLE.format(_TEXT)
    return resvg_py.svg_to_bytes(svg_string=text, **options) != resvg_py.svg_to_bytes(
        svg_string=blank
    )


# Referenced for the life of the process: the folder is removed with its object.
_folder: list[tempfile.TemporaryDirectory[str]] = []


def _pillow_font() -> str | None:
    """Pillow's font as a file for the life of the process: resvg reads only files."""
    try:
        from PIL import ImageFont

        font = ImageFont.load_default(12)
    except (ImportError, TypeError):  # no Pillow, or one before 10.1
        return None
    data = getattr(font, "path", None)
    if not isinstance(data, io.BytesIO):
        return None
    _folder.append(tempfile.TemporaryDirectory(prefix="minerva-font-"))
    file = Path(_folder[-1].name) / "letters.ttf"
    file.write_bytes(data.getvalue())
    return str(file)


def png(document: str) -> bytes:
    """An SVG document as a PNG of its own size. Raises MisuseError if resvg rejects it."""
    try:
        # Some versions return a list of numbers.
        return bytes(resvg_py.svg_to_bytes(svg_string=document, **font_options()))
    except ValueError as error:
        raise MisuseError(f"picture: resvg cannot render it: {error}") from None
