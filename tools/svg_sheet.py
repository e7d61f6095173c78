"""A small writer of SVG drawings for the documentation.

A drawing has an opaque background, so that its text is readable on light and on dark pages. All
lengths are pixels, x to the right and y down.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final
from xml.sax.saxutils import escape

INK, FAINT, PAPER, EDGE = "#22252b", "#6b7280", "#ffffff", "#c9ced6"
PRIMITIVE, TRANSFORMATION, AGENT, EVENT = "#2f6b3a", "#1f5f8b", "#a2480f", "#7a2f8f"
_STYLE: Final = (
    f"text {{ font: 13px 'DejaVu Sans', Helvetica, Arial, sans-serif; fill: {INK} }}"
    " .mono { font-family: 'DejaVu Sans Mono', Menlo, Consolas, monospace }"
    " .bold { font-weight: bold }"
    f" .small {{ font-size: 11.5px; fill: {FAINT} }}"
)


class Sheet:
    """One drawing; each method adds a part on top of the earlier ones."""

    def __init__(self, title: str, width: int, height: int) -> None:
        self.title, self.width, self.height = title, width, height
        self._parts: list[str] = []

    def text(
        self,
        x: float,
        y: float,
        words: str | Iterable[tuple[str, str]],
        kind: str = "",
        anchor: str = "start",
        color: str = "",
    ) -> None:
        """A line of text, or of (text, colour) pairs; `kind` is a list of style classes."""
        pairs = [(words, color)] if isinstance(words, str) else words
        spans = "".join(
            f'<tspan fill="{color}">{escape(text)}</tspan>' if color else escape(text)
            for text, color in pairs
        )
        self._parts.append(
            f'<text x="{x:g}" y="{y:g}" class="{kind}" text-anchor="{anchor}"'
            f' xml:space="preserve">{spans}</text>'
        )

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        label: str = "",
        fill: str = "#f3f5f8",
        edge: str = EDGE,
        kind: str = "",
    ) -> None:
        """A rectangle with lines of text in its middle."""
        self._parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="5"'
            f' fill="{fill}" stroke="{edge}"/>'
        )
        lines = label.split("\n") if label else []
        top = y + height / 2 + 4.5 - 8.5 * (len(lines) - 1)
        for number, line in enumerate(lines):
            self.text(x + width / 2, top + 17 * number, line, kind, "middle")

    def line(self, points: list[tuple[float, float]], color: str = FAINT, dash: str = "") -> None:
        """A line through points."""
        path = " ".join(f"{x:g},{y:g}" for x, y in points)
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="1.5"{dashes}/>'
        )

    def arrow(self, points: list[tuple[float, float]], color: str = FAINT, dash: str = "") -> None:
        """A line with a head at its last point; the last segment must be straight or diagonal."""
        (x0, y0), (x1, y1) = points[-2:]
        length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
        dx, dy = (x1 - x0) / length, (y1 - y0) / length
        back = (x1 - 8 * dx, y1 - 8 * dy)
        self.line([*points[:-1], back], color, dash)
        left = (back[0] - 4 * dy, back[1] + 4 * dx)
        right = (back[0] + 4 * dy, back[1] - 4 * dx)
        corners = " ".join(f"{x:.2f},{y:.2f}" for x, y in ((x1, y1), left, right))
        self._parts.append(f'<polygon points="{corners}" fill="{color}"/>')

    def disc(self, x: float, y: float, radius: float, color: str) -> None:
        """A filled circle around (x, y)."""
        self._parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="{radius:g}" fill="{color}"/>')

    def document(self) -> str:
        """The text of the SVG file."""
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}"'
                f' width="{self.width}" height="{self.height}" role="img">',
                f"<title>{escape(self.title)}</title>",
                f"<style>{_STYLE}</style>",
                f'<rect x="0.5" y="0.5" width="{self.width - 1}" height="{self.height - 1}" rx="8"'
                f' fill="{PAPER}" stroke="{EDGE}"/>',
                *self._parts,
                "</svg>",
                "",
            ]
        )
