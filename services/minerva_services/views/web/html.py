"""Contents of the page as HTML: status, events and an agent's state."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape

import numpy as np

from minerva_bus.grammar.printer import value_text
from minerva_bus.grammar.scene import AgentNode, Scene, Value
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import LogEntry, WorldStatus

_MAX_CHARACTERS = 44
_MARGIN = "padding:0 0.75em;font-size:0.85em;line-height:1.5;overflow-wrap:anywhere"
_CODE = "font-family:ui-monospace,monospace;font-size:0.88em"
_DECIMALS = re.compile(r"\d+\.\d{4,}(e-?\d+)?")
_DIM, _BAD = "#868e96", "#c92a2a"
_NAME = f"color:{_DIM};padding-right:0.8em;vertical-align:top;white-space:nowrap"


def _block(content: str) -> str:
    return f'<div style="{_MARGIN}">{content}</div>'


def _dim(text: str) -> str:
    return f'<span style="color:{_DIM}">{escape(text)}</span>'


def head(status: WorldStatus) -> str:
    """Frame, simulated time, rate and state."""
    wanted = f" of {status.rate:g}" if status.rate else ""
    numbers = [
        f"frame {status.frame}",
        f"{status.time:.1f} s",
        f"{status.hz:.1f}{wanted} frames/s",
    ]
    return _block(f"<b>{escape(_state(status))}</b> · {' · '.join(numbers)}")


def _state(status: WorldStatus) -> str:
    if status.waiting and status.waited > 0.5:
        return f"waiting for {', '.join(status.waiting)}, {status.waited:.0f} s"
    return "paused" if status.paused else "running"


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
