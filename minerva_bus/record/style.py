"""How plots look: matplotlib's settings, and the colours and sizes that others share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

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
