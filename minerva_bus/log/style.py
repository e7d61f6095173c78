"""How plots look: matplotlib's settings, and the colours and sizes that others share."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_bus.outputs import write_output

INK: Final = "#2f3640"
FAINT: Final = "#8a929c"
DOTS: Final = 150
"""Dots per inch."""

STYLE: Final[Mapping[str, Any]] = {
    "font.size": 9,
    "axes.edgecolor": "#c4c9cf",
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "grid.color": "#e6e8eb",
    "legend.frameon": False,
}


def write_figure(figure: Any, path: Path) -> None:
    """Save a matplotlib figure; the suffix of the path names the format.

    Raises MisuseError for another format, and where the file may not or cannot be written.
    """
    content = io.BytesIO()
    try:
        figure.savefig(content, format=path.suffix[1:] or "png", facecolor="white")
    except ValueError as error:
        raise MisuseError(f"{path}: the picture cannot be written: {error}") from None
    write_output(path, content.getvalue(), "picture")
