"""The graph of a world as SVG: generators, events in their order, agents in hosts, devices.

Each event type has one colour. `graph_layout.py` has the places of all boxes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from minerva_bus.api.graph_layout import (
    LANE,
    LETTER,
    LINE,
    MARGIN,
    ROW,
    TOP,
    KindsRow,
    ProcessBox,
    event_tags,
    layout_of,
)
from minerva_bus.api.graph_text import process_label
from minerva_bus.api.graphs import Graph, ProcessEntry
from minerva_bus.markup import xml_text

SMALL = 6.4
"""Approximate width of a letter in notes, in pixels."""

INK, FAINT, PAPER = "#2b2b33", "#8a8e99", "#ffffff"
FILLS: Final = {"generator": "#e9f1fa", "host": "#eaf5ea", "device": "#f3ecf8"}
COLORS: Final = (
    *("#1f6fb2", "#c2410c", "#2e7d32", "#8e24aa", "#b8860b", "#00838f", "#c2185b", "#5d4037"),
    *("#3f51b5", "#6d8b00", "#d84315", "#607d8b"),
)
_STYLE: Final = (
    f"text {{ font-family: 'DejaVu Sans', Helvetica, sans-serif; font-size: 12px; fill: {INK} }}"
    " .title { font-size: 17px; font-weight: bold } .name { font-weight: bold }"
    f" .note {{ font-size: 11px; fill: {FAINT} }} .edge {{ fill: none; stroke-width: 1.5 }}"
)


def draw(graph: Graph) -> str:
    """The drawing as the text of an SVG file."""
    return _Drawing(graph).text()


class _Drawing:
    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._layout = layout_of(graph)
        self._colors = {
            each.name: COLORS[number % len(COLORS)] for number, each in enumerate(graph.events)
        }

    def text(self) -> str:
        """The drawing."""
        layout, boxes = self._layout, self._layout.boxes
        # Edges end at the entries inside of boxes, so they are drawn between these and those.
        body = [*self._titles(), *(line for box in boxes for line in _frame(box))]
        body += [*self._edges(), *self._list()]
        for box in boxes:
            body += _inside(box)
        lanes = LANE * (len(layout.returns) + 1)
        height = layout.bottom + lanes + 64
        body += self._legend(layout.bottom + lanes + 30)
        width = max(layout.right + MARGIN * 2, MARGIN * 2 + LETTER * 112)
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}"'
                f' width="{width:.0f}" height="{height:.0f}">',
                f"<title>{xml_text(self._graph.world)}</title>",
                f"<style>{_STYLE}</style>",
                f'<rect width="100%" height="100%" fill="{PAPER}"/>',
                *body,
                "</svg>",
                "",
            ]
        )

    def _titles(self) -> Iterator[str]:
        layout = self._layout
        yield _label(MARGIN, 36, f"World {self._graph.world}", "title")
        yield _rect(layout.list_x, TOP, layout.list_width, layout.list_end - TOP, "#f4f4f2")
        columns = [
            (layout.sources, "generators"),
            (layout.hosts, "agents in their host processes"),
            (layout.devices, "devices"),
        ]
        for boxes, name in columns:
            if boxes:
                yield _label(boxes[0].x, TOP - 16, name, "note")

    def _list(self) -> Iterator[str]:
        """The event types in their order, in the coordinator."""
        layout = self._layout
        x, wide = layout.list_x, layout.list_width
        yield _label(x + 12, TOP + 21, "coordinator", "name")
        yield _label(x, TOP - 16, "event types, in the order of a frame", "note")
        for event in self._graph.events:
            y, color = layout.heights[event.name], self._colors[event.name]
            yield _rect(x + 8, y - ROW / 2 + 2, wide - 16, ROW - 4, PAPER, color)
            data = ", ".join(f"{name}: {kind}" for name, kind in event.data.items())
            yield f"<g><title>{xml_text(f'{event.name}({data})')}</title>"
            yield (
                f'<text x="{x + 36:.0f}" y="{y + 4:.0f}" text-anchor="end" class="note">'
                f"{event.rank}</text>"
            )
            yield _label(x + 44, y + 4, event.name, "")
            yield (
                f'<text x="{x + wide - 16:.0f}" y="{y + 4:.0f}" text-anchor="end" class="note">'
                f"{xml_text(' '.join(event_tags(self._graph, event)))}</text></g>"
            )

    def _edges(self) -> Iterator[str]:
        layout = self._layout
        left, right = layout.list_x + 8, layout.list_x + layout.list_width - 8
        for box in layout.sources:
            names = sorted(box.process.publishes, key=self._height)
            for name, y in zip(names, _ports(box.y, box.height, len(names)), strict=True):
                yield _curve(box.x + box.width, y, left, self._height(name), self._color(name))
        for box in layout.hosts:
            for row in box.rows:
                yield from self._of_agents(box, row, right)
        for lane, (process, event) in enumerate(layout.returns):
            yield from self._back(process, event, lane)
        for lane, (topic, writer, reader) in enumerate(layout.topics):
            yield from self._between(topic, writer, reader, lane)

    def _of_agents(self, box: ProcessBox, row: KindsRow, right: float) -> Iterator[str]:
        """The events of a group of kinds, sorted by their order, and its views."""
        ends = [(name, False) for name in row.inputs] + [(name, True) for name in row.kind.emits]
        ends.sort(key=lambda end: (self._height(end[0]), end[1]))
        ports = _ports(box.y + row.top, row.height, len(ends))
        for (name, out), y in zip(ends, ports, strict=True):
            to, color = self._height(name), self._color(name)
            if out:
                yield _curve(box.x + 8, y, right, to + 5, color, dashed=True)
            else:
                yield _curve(right, to - 4, box.x + 8, y, color)
        middle = box.y + row.top + row.height / 2
        for device in self._layout.devices:
            for name in sorted(set(device.process.draws) & set(row.kind.views)):
                yield _curve(
                    box.x + box.width - 8, middle, device.x, device.y + device.height / 2,
                    self._color(name), wide=True,
                )  # fmt: skip

    def _back(self, process: ProcessEntry, event: str, lane: int) -> Iterator[str]:
        """A view that goes to a device on the left, below all boxes."""
        layout = self._layout
        (target,) = (box for box in layout.sources if box.process is process)
        rows = [(box, row) for box in layout.hosts for row in box.rows if event in row.kind.views]
        if not rows:
            return
        edge = max(box.x + box.width for box in layout.hosts) + LANE * (lane + 1)
        bottom, left = layout.bottom + LANE * (lane + 1), target.x - LANE * (lane + 1)
        style = _style(self._color(event), wide=True)
        starts = [box.y + row.top + row.height / 2 for box, row in rows]
        for (box, _), y in zip(rows, starts, strict=True):
            yield f'<path d="M {box.x + box.width - 8:.0f} {y:.0f} H {edge:.0f}" {style}/>'
        y = target.y + target.height / 2
        yield (
            f'<path d="M {edge:.0f} {min(starts):.0f} V {bottom:.0f} H {left:.0f} V {y:.0f}'
            f' H {target.x - 7:.0f}" {style}/>{_head(target.x, y, self._color(event))}'
        )

    def _between(
        self, topic: str, writer: ProcessEntry, reader: ProcessEntry, lane: int
    ) -> Iterator[str]:
        """A sensor topic, in a lane on the left."""
        layout = self._layout
        boxes = {box.process.name: box for box in (*layout.sources, *layout.devices)}
        if writer.name not in boxes or reader.name not in boxes:
            return
        start, end = boxes[writer.name], boxes[reader.name]
        x = layout.sources[0].x - LANE * (len(layout.returns) + lane + 1.5)
        y, to = start.y + start.height - 12 - 5 * lane, end.y + end.height - 14
        yield (
            f'<path d="M {start.x:.0f} {y:.0f} H {x:.0f} V {to:.0f} H {end.x - 7:.0f}"'
            f" {_DOTTED}><title>{xml_text(topic)}"
            f"</title></path>{_head(end.x, to, FAINT)}"
        )

    def _height(self, event: str) -> float:
        return self._layout.heights[event]

    def _color(self, event: str) -> str:
        return self._colors[event]

    def _legend(self, y: float) -> Iterator[str]:
        entries = [
            ("event", _style(INK)),
            ("event that agents may emit, for the next frame", _style(INK, dashed=True)),
        ]
        if any(process.draws for process in self._graph.processes):
            entries.append(("view", _style(INK, wide=True)))
        if self._layout.topics:
            entries.append(("sensor topic", _DOTTED))
        x = float(MARGIN)
        for text, style in entries:
            yield f'<path d="M {x:.0f} {y:.0f} h 28" {style}/>'
            yield _label(x + 36, y + 4, text, "note")
            x += 36 + SMALL * len(text) + 24
        notes = ["×N: processes, or agents at the start"]
        events = self._graph.events
        notes += ["pub: people may publish it"] if any(each.people for each in events) else []
        notes += ["view: agents answer with a view"] if any(e.visual for e in events) else []
        yield _label(MARGIN, y + 24, "  ·  ".join(notes), "note")


def _frame(box: ProcessBox) -> Iterator[str]:
    fill = FILLS.get(box.process.role, "#f2f2f2")
    # Copies of a process look like a stack.
    if box.process.count > 1:
        yield _rect(box.x + 4, box.y + 4, box.width, box.height, fill)
    yield _rect(box.x, box.y, box.width, box.height, fill)


def _inside(box: ProcessBox) -> Iterator[str]:
    x, y = box.x, box.y
    yield _label(x + 12, y + 20, process_label(box.process), "name")
    for number, line in enumerate(box.lines, 1):
        yield _label(x + 12, y + 20 + LINE * number, line, "note")
    for row in box.rows:
        yield _rect(x + 8, y + row.top, box.width - 16, row.height, PAPER)
        yield _label(x + 18, y + row.top + row.height / 2 + 4, row.label, "")


def _ports(top: float, height: float, count: int) -> list[float]:
    """Heights of connections on one side of a box."""
    return [top + height * (number + 1) / (count + 1) for number in range(count)]


def _curve(
    x: float, y: float, to_x: float, to_y: float, color: str, *, dashed: bool = False,
    wide: bool = False,
) -> str:  # fmt: skip
    """An edge with a head at its end; it begins and ends horizontally."""
    ahead = 1 if to_x > x else -1
    end, bend = to_x - 7 * ahead, max(30.0, abs(to_x - x) / 2) * ahead
    return (
        f'<path d="M {x:.1f} {y:.1f} C {x + bend:.1f} {y:.1f} {end - bend:.1f} {to_y:.1f}'
        f' {end:.1f} {to_y:.1f}" {_style(color, dashed=dashed, wide=wide)}/>'
        f"{_head(to_x, to_y, color, ahead)}"
    )


def _style(color: str, *, dashed: bool = False, wide: bool = False) -> str:
    dashes = ' stroke-dasharray="5 3"' if dashed else ""
    return f'class="edge" stroke="{color}"{dashes}{_WIDE if wide else ""}'


_DOTTED: Final = f'class="edge" stroke="{FAINT}" stroke-dasharray="1.5 3.5"'
_WIDE: Final = ' style="stroke-width: 3.5" stroke-opacity="0.55"'


def _head(x: float, y: float, color: str, ahead: int = 1) -> str:
    back = -8 * ahead
    return f'<path d="M {x:.1f} {y:.1f} l {back} -3.5 l 0 7 z" fill="{color}"/>'


def _rect(x: float, y: float, width: float, height: float, fill: str, stroke: str = FAINT) -> str:
    return (
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height:.0f}" rx="6"'
        f' fill="{fill}" stroke="{stroke}"/>'
    )


def _label(x: float, y: float, text: str, style: str) -> str:
    named = f' class="{style}"' if style else ""
    return f'<text x="{x:.0f}" y="{y:.0f}"{named}>{xml_text(text)}</text>'
