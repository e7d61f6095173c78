"""A sequence diagram as SVG: lifelines of agents, and an arrow for each message.

Unlike Mermaid text, SVG needs no renderer beyond a browser. A message to several agents is one
arrow with a head at each receiver, so a call to twenty takes as much room as a call to one.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Final

from minerva_bus.wording import xml_characters
from minerva_messages.acts import Act
from minerva_messages.exchanges import Exchange, SentMessage

COLUMN, ROW, FRAME_ROW = 150, 34, 12
LEFT, TOP, MARGIN = 84, 92, 28
BOX_WIDTH, BOX_HEIGHT = 124, 30
LETTER: Final = 6.6
"""Approximate width of a letter in pixels."""

INK, FAINT, PAPER = "#2b2b33", "#b9bcc6", "#ffffff"
SAYS, DENIES, SETTLES = "#2f6f8f", "#b3205f", "#4f8049"
_COLORS: Final = {
    **dict.fromkeys(
        (Act.REFUSE, Act.REJECT_PROPOSAL, Act.FAILURE, Act.NOT_UNDERSTOOD, Act.CANCEL), DENIES
    ),
    **dict.fromkeys((Act.AGREE, Act.ACCEPT_PROPOSAL, Act.INFORM, Act.CONFIRM), SETTLES),
}
_STYLE: Final = (
    f"text {{ font-family: 'DejaVu Sans', Helvetica, sans-serif; font-size: 11px; fill: {INK} }}"
    " .title { font-size: 16px; font-weight: bold } .frame { fill: #80848f; text-anchor: end }"
    " .name { text-anchor: middle; font-weight: bold }"
    f" .label {{ paint-order: stroke; stroke: {PAPER}; stroke-width: 4px }}"
)


def draw(exchange: Exchange) -> str:
    """The diagram as the text of an SVG file."""
    rows = list(_rows(exchange))
    columns = {name: LEFT + COLUMN * (n + 0.5) for n, name in enumerate(exchange.agents)}
    # Labels may extend beyond the last lifeline.
    right = max(_right_end(message, columns) for message, _, _ in rows)
    width = max(LEFT + COLUMN * len(columns), right, _wide(exchange.title, 10)) + MARGIN
    height = rows[-1][1] + 2 * MARGIN
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}"'
        f' width="{width:.0f}" height="{height:.0f}">',
        f"<title>{_xml_text(exchange.title)}</title>",
        f"<style>{_STYLE}</style>",
        f'<rect width="100%" height="100%" fill="{PAPER}"/>',
        f'<text class="title" x="{MARGIN}" y="32">{_xml_text(exchange.title)}</text>',
    ]
    for name, x in columns.items():
        lines += _lifeline(name, x, height - MARGIN)
    for message, y, begins in rows:
        if begins:
            lines.append(
                f'<text class="frame" x="{LEFT - 16}" y="{y + 4:.0f}">frame {message.frame}</text>'
            )
        lines += _arrow(message, y, columns)
    return "\n".join([*lines, "</svg>", ""])


def _rows(exchange: Exchange) -> Iterator[tuple[SentMessage, float, bool]]:
    """Each message with its height, and whether it is the first of a frame."""
    y, frame = float(TOP), None
    for message in exchange.messages:
        begins = message.frame != frame
        y += ROW + (FRAME_ROW if begins else 0)
        frame = message.frame
        yield message, y, begins


def _lifeline(name: str, x: float, bottom: float) -> Iterator[str]:
    top, shown = TOP - BOX_HEIGHT - 8, _cut(name, BOX_WIDTH - 8)
    yield (
        f'<line x1="{x:.0f}" y1="{top + BOX_HEIGHT}" x2="{x:.0f}" y2="{bottom:.0f}"'
        f' stroke="{FAINT}" stroke-dasharray="3 4"/>'
    )
    yield (
        f'<rect x="{x - BOX_WIDTH / 2:.0f}" y="{top}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}"'
        f' rx="6" fill="#f2f4f7" stroke="{INK}"/>'
    )
    yield f'<text class="name" x="{x:.0f}" y="{top + 19}">{_xml_text(shown)}</text>'


def _arrow(message: SentMessage, y: float, columns: dict[str, float]) -> Iterator[str]:
    x, color = columns[message.sender], _COLORS.get(Act(message.act), SAYS)
    ends = [columns[name] for name in message.receivers]
    dashes = ' stroke-dasharray="5 3"' if color == DENIES else ""
    # One line to each side is enough for any number of receivers.
    for end in sorted({min([x, *ends]), max([x, *ends])} - {x}):
        yield (
            f'<line x1="{x:.0f}" y1="{y:.0f}" x2="{end:.0f}" y2="{y:.0f}" stroke="{color}"'
            f' stroke-width="1.6"{dashes}/>'
        )
    for end in ends:
        back = 7 if end < x else -7
        # A message to the sender itself has no arrow.
        if end == x:
            yield f'<circle cx="{x:.0f}" cy="{y:.0f}" r="4" fill="{color}"/>'
            continue
        yield (f'<path d="M {end:.0f} {y:.0f} l {back} -4 l 0 8 z" fill="{color}"/>')
    yield f'<circle cx="{x:.0f}" cy="{y:.0f}" r="2.5" fill="{color}"/>'
    yield f'<text class="label" x="{_label_at(message, columns):.0f}" y="{y - 6:.0f}">'
    yield f"<title>{_xml_text(message.content)}</title>{_xml_text(message.label)}</text>"


def _label_at(message: SentMessage, columns: dict[str, float]) -> float:
    """The left end of a label: beside the sender, above the arrow."""
    x, ends = columns[message.sender], [columns[name] for name in message.receivers]
    if max(ends) >= x:
        return x + 8
    return max(min(ends) + 10, x - 8 - _wide(message.label))


def _right_end(message: SentMessage, columns: dict[str, float]) -> float:
    return _label_at(message, columns) + _wide(message.label)


def _wide(text: str, letter: float = LETTER) -> float:
    return letter * len(text)


def _cut(text: str, width: float) -> str:
    most = int(width / LETTER)
    return text if len(text) <= most else text[: most - 1] + "…"


def _xml_text(text: str) -> str:
    """Any text as XML character data."""
    return escape(xml_characters(text), quote=False)
