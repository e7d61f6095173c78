"""Contents of the page as HTML: status, events and an agent's state."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape

import numpy as np

from minerva_bus.grammar.appearance import Disc, Label, Line
from minerva_bus.grammar.scene import AgentNode, Scene, Value
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.operator_client import activity, awaited
from minerva_bus.wording import duration
from minerva_bus.world.operator import LogEntry, WorldStatus
from minerva_services.geometry.colors import Legend, LegendEntry, rgb
from minerva_services.views.fates import OrderEntry
from minerva_services.views.palette import DARK

_MAX_CHARACTERS = 44
_MARGIN = "padding:0 0.75em;font-size:0.85em;line-height:1.5;overflow-wrap:anywhere"
_CODE = "font-family:ui-monospace,monospace;font-size:0.88em"
_DECIMALS = re.compile(r"\d+\.\d{4,}(e-?\d+)?")
_DIM, _BAD, _GOOD = "#868e96", "#c92a2a", "#2b8a3e"
_FATES = {"done": _GOOD, "rejected": _BAD, "dropped": _BAD, "failed": _BAD, "replaced": _BAD}
_NAME = f"color:{_DIM};padding-right:0.8em;vertical-align:top;white-space:nowrap"


def _block(content: str) -> str:
    return f'<div style="{_MARGIN}">{content}</div>'


def _dim(text: str) -> str:
    return f'<span style="color:{_DIM}">{escape(text)}</span>'


def head(status: WorldStatus, report: str = "") -> str:
    """Frame, simulated time, rate and state; below, the latest report of an agent."""
    wanted = f" of {status.rate:g}" if status.rate else ""
    pace = f"{status.rate:g}" if status.paused else f"{status.hz:.1f}{wanted}"
    numbers = [f"frame {status.frame}", f"{status.time:.1f} s", f"{pace} frames/s"]
    line = f"<div>{escape(_cut(report, 100))}</div>" if report else ""
    return _block(f"<b>{escape(_state(status))}</b> · {' · '.join(numbers)}{line}")


_HINTS = (
    "drag: turn · right drag: move · wheel: zoom · click an agent: select it · click a label: send"
    " it as an order"
)


def legend(entries: Legend) -> str:
    """The legend in two columns, and below what the mouse does."""
    rows = "".join(
        '<div style="break-inside:avoid;padding-left:1.9em;text-indent:-1.9em">'
        f"{_swatch(entry)}{escape(_cut(entry.text))}</div>"
        for entry in entries
    )
    listed = f'<div style="columns:2;column-gap:0.8em;line-height:1.35">{rows}</div>'
    return _block(f'{listed}<div style="margin:0.5em 0">{_dim(_HINTS)}</div>')


def _swatch(entry: LegendEntry) -> str:
    """A swatch 1.4 em wide, with a space of 0.5 em."""
    box = "display:inline-block;height:0.85em;margin-right:0.5em;vertical-align:-0.05em"
    stops = [_css_color(color, entry.opacity) for color in entry.colors]
    if entry.swatch is Line:
        style = "dashed" if entry.dashed else "solid"
        drawn = f"width:1.4em;height:0;vertical-align:0.25em;border-top:0.2em {style} {stops[0]}"
        if entry.on_dark:
            drawn += f";box-shadow:0 0 0 0.25em {DARK};background:{DARK}"
    elif entry.swatch is Disc:
        drawn = f"width:0.85em;margin-left:0.55em;border-radius:50%;background:{stops[0]}"
    elif entry.swatch is Label:
        # A drop with its tip below.
        drawn = (
            "width:0.75em;height:0.75em;margin:0 0.6em 0 0.65em;vertical-align:0.1em;"
            f"border-radius:50% 50% 50% 0;transform:rotate(-45deg);background:{stops[0]}"
        )
    else:
        share = 100 / len(stops)
        parts = [
            f"{color} {at * share:.0f}% {(at + 1) * share:.0f}%" for at, color in enumerate(stops)
        ]
        drawn = f"width:1.4em;background:linear-gradient(90deg,{','.join(parts)})"
    line = "" if entry.swatch is Line else ";box-shadow:0 0 0 1px #0003"
    return f'<span style="{box};{drawn}{line}"></span>'


def _css_color(color: str, opacity: float) -> str:
    red, green, blue = rgb(color)
    return f"rgb({red} {green} {blue} / {opacity:g})"


def _state(status: WorldStatus) -> str:
    waited = f", {duration(status.waited)}" if awaited(status) else ""
    return f"{activity(status)}{waited}"


def notice(text: str) -> str:
    """A line about the last action."""
    return _block(_dim(text)) if text else ""


def problem(text: str) -> str:
    """An error line."""
    line = " ".join(text.split())
    # Cut before it is escaped, or an entity could be cut in two.
    return _block(f'<span style="color:{_BAD}">{escape(_cut(line, 300))}</span>')


def events(happenings: Iterable[LogEntry]) -> str:
    """Events, newest first."""
    lines = [
        f"{_dim(str(event.frame))} {escape(_cut(_rounded(event.text), 120))}"
        for event in reversed(list(happenings))
    ]
    shown = "".join(f"<div>{line}</div>" for line in lines) or _dim("nothing yet")
    return _block(f'<div style="{_CODE};min-height:6em">{shown}</div>')


def fates(orders: Iterable[OrderEntry]) -> str:
    """Orders of people with their fates, newest first."""
    lines = [
        f'<div title="{escape(order.event)}" style="margin-bottom:0.3em">'
        f'<b style="color:{order.colour}">{escape(order.person)}</b>'
        f" {escape(order.short[0])}<br>{_fate(order)}</div>"
        for order in reversed(list(orders))
    ]
    return _block("".join(lines))


def _fate(order: OrderEntry) -> str:
    return f'<span style="color:{_FATES.get(order.state, _DIM)}">{escape(order.fate)}</span>'


def state(agent: AgentNode | None) -> str:
    """An agent's attributes as a table, with long values shortened."""
    if agent is None:
        return ""
    rows = [(name, summary(value)) for name, value in zip(agent.names, agent.values, strict=True)]
    if agent.scope.nodes:
        rows.append(("scope", _cut(" · ".join(str(node.symbol) for node in agent.scope.nodes))))
    cells = "".join(
        f'<tr><td style="{_NAME}">{escape(name)}</td><td style="{_CODE}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return _block(
        '<div style="max-height:15em;overflow-y:auto;margin-bottom:0.6em">'
        '<table style="border-spacing:0">'
        f'<tr><td colspan="2"><b>{escape(agent.symbol)}#{escape(agent.id)}</b></td></tr>'
        f"{cells}</table></div>"
    )


def summary(value: Value) -> str:
    """A value in a few words."""
    if isinstance(value, np.ndarray):
        return f"{' × '.join(map(str, value.shape))} numbers"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple) and len(value) > 6:
        return f"{len(value)} values: {_cut(value_text(value[:6]))}"
    if isinstance(value, Scene):
        return _cut(_rounded(str(value))) or "ε"
    return _cut(_rounded(value_text(value)))


def whole(text: str) -> str:
    """A long text in a scrollable block."""
    return (
        f'<pre style="{_CODE};max-height:60vh;overflow:auto;white-space:pre-wrap;'
        f'overflow-wrap:anywhere">{escape(text)}</pre>'
    )


def _cut(text: str, longest: int = _MAX_CHARACTERS) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"


def _rounded(text: str) -> str:
    """The text with long decimals shortened."""
    return _DECIMALS.sub(lambda match: f"{float(match[0]):.3g}", text)


def parted(text: str, vocabulary: Vocabulary) -> AgentNode | None:
    """The agent of a fragment's text; None if it is not an agent."""
    nodes = vocabulary.read(text, "the fragment").nodes
    return nodes[0] if nodes and isinstance(nodes[0], AgentNode) else None
