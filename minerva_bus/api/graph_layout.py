"""Places of the boxes in the drawing of a world's graph.

The columns are fixed and events keep their order, so boxes only need heights: each is placed beside
the events that it is connected to. Lengths are in pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from minerva_bus.api.graph_text import kinds_label, process_label, process_notes
from minerva_bus.api.graphs import EventEntry, Graph, KindEntry, ProcessEntry

MARGIN, TOP, GAP, SPACE = 28, 96, 16, 150
ROW, LINE, PORT, LANE = 26, 16, 9, 14
LETTER = 7.2
"""Approximate width of a letter in names."""

_HEAD, _FOOT = 34, 12
"""Heights above and below the events in their list."""


@dataclass(slots=True)
class ProcessBox:
    """A process in a column; `wanted` is the height that it would like to be centred at.

    `rows` are groups of kinds of agents with their heights, relative to the top of the box.
    """

    process: ProcessEntry
    lines: list[str]
    width: float
    height: float
    wanted: float
    rows: list[KindsRow] = field(default_factory=list["KindsRow"])
    x: float = 0.0
    y: float = 0.0


@dataclass(slots=True)
class KindsRow:
    """A group of kinds in its host, with a port for each event type; `emits` are the last."""

    label: str
    kind: KindEntry
    top: float
    height: float

    @property
    def inputs(self) -> list[str]:
        """The event types that arrive."""
        return [*dict.fromkeys([*self.kind.receives, *self.kind.views])]


@dataclass(frozen=True, slots=True)
class GraphLayout:
    """Boxes in three columns, the list of events between the first two, and lanes beside them.

    `heights`: the middle of each event in the list. `returns`: views that go back to a device that
    is drawn on the left, because it is a generator. `topics`: sensor topics with their writer and
    reader. `right` and `bottom`: the ends of all boxes and of the list.
    """

    sources: Sequence[ProcessBox]
    hosts: Sequence[ProcessBox]
    devices: Sequence[ProcessBox]
    heights: Mapping[str, float]
    list_x: float
    list_width: float
    list_end: float
    right: float
    bottom: float
    returns: Sequence[tuple[ProcessEntry, str]]
    topics: Sequence[tuple[str, ProcessEntry, ProcessEntry]]

    @property
    def boxes(self) -> tuple[ProcessBox, ...]:
        """All boxes."""
        return (*self.sources, *self.hosts, *self.devices)


def layout_of(graph: Graph) -> GraphLayout:
    """The layout of a graph."""
    columns = _Columns(graph)
    returns, topics = _returns(graph), _topics(graph)
    left = MARGIN + LANE * (2 + len(returns) + len(topics))
    list_x = left + _widest(columns.sources) + (SPACE if columns.sources else 0)
    list_width = max([150.0, *(_event_width(graph, event) for event in graph.events)])
    hosts_x = list_x + list_width + SPACE * 1.2
    devices_x = hosts_x + _widest(columns.hosts) + SPACE * 0.8
    _align(columns.sources, left)
    _align(columns.hosts, hosts_x)
    _align(columns.devices, devices_x)
    boxes = (*columns.sources, *columns.hosts, *columns.devices)
    return GraphLayout(
        sources=columns.sources,
        hosts=columns.hosts,
        devices=columns.devices,
        heights=columns.heights,
        list_x=list_x,
        list_width=list_width,
        list_end=columns.list_end,
        right=max(hosts_x + _widest(columns.hosts), devices_x + _widest(columns.devices)),
        bottom=max([columns.list_end, *(box.y + box.height for box in boxes)]),
        returns=returns,
        topics=topics,
    )


def event_tags(graph: Graph, event: EventEntry) -> list[str]:
    """Short notes about an event type."""
    tags = ["pub"] if event.people else []
    tags += ["view"] if event.visual else []
    tags += ["until"] if event.name == graph.until else []
    return [*tags, *(["give up"] if event.name == graph.give_up else [])]


def _event_width(graph: Graph, event: EventEntry) -> float:
    return LETTER * (len(event.name) + len(" ".join(event_tags(graph, event))) + 7) + 24


def _returns(graph: Graph) -> list[tuple[ProcessEntry, str]]:
    return [
        (process, event)
        for process in graph.processes
        if process.role == "generator"
        for event in process.draws
    ]


def _topics(graph: Graph) -> list[tuple[str, ProcessEntry, ProcessEntry]]:
    return [
        (topic, writer, reader)
        for writer in graph.processes
        for topic in writer.writes
        for reader in graph.processes
        if topic in reader.reads
    ]


def _widest(boxes: Sequence[ProcessBox]) -> float:
    return max((box.width for box in boxes), default=0.0)


def _align(boxes: Sequence[ProcessBox], x: float) -> None:
    """Give the boxes of a column one place and one width."""
    width = _widest(boxes)
    for box in boxes:
        box.x, box.width = x, width


class _Columns:
    """The columns of boxes, each from top to bottom."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self.heights = {each.name: TOP + _HEAD + ROW * (each.rank - 0.5) for each in graph.events}
        self.list_end = TOP + _HEAD + ROW * len(graph.events) + _FOOT
        self.hosts: list[ProcessBox] = []
        self.sources = self._column(("generator", "command"))
        self.hosts = self._column(("host",))
        # Last, because devices are placed beside the hosts.
        self.devices = self._column(("device",))

    def _column(self, roles: Sequence[str]) -> list[ProcessBox]:
        """Boxes of processes with these roles, each near the events that it is connected to."""
        processes = [process for process in self._graph.processes if process.role in roles]
        boxes = sorted(map(self._box, processes), key=lambda box: box.wanted)
        y = float(TOP)
        for box in boxes:
            box.y = max(y, box.wanted - box.height / 2)
            y = box.y + box.height + GAP
        # What is pushed down beyond the list of events moves up again, as far as there is room.
        limit = self.list_end
        for box in reversed(boxes):
            box.y = min(box.y, limit - box.height)
            limit = box.y - GAP
        y = float(TOP)
        for box in boxes:
            box.y = max(y, box.y)
            y = box.y + box.height + GAP
        return boxes

    def _box(self, process: ProcessEntry) -> ProcessBox:
        notes = process_notes(process)
        lines = [", ".join(notes)] if process.role != "host" else []
        lines += [f"publishes topic {topic}" for topic in process.writes]
        lines += [f"subscribes to topic {topic}" for topic in process.reads]
        top = LINE * (1 + len(lines)) + 14.0
        rows: list[KindsRow] = []
        for kinds in self._graph.alike(process):
            row = KindsRow(kinds_label(kinds), kinds[0], top, 0.0)
            row.height = max(26.0, PORT * (len(row.inputs) + len(row.kind.emits) + 1))
            rows.append(row)
            top += row.height + 6
        names = [process_label(process), *lines, *(f"  {row.label}" for row in rows)]
        used = [
            *process.publishes,
            *process.draws,
            *(n for r in rows for n in (*r.inputs, *r.kind.emits)),
        ]
        heights = [self.heights[name] for name in used if name in self.heights]
        if process.role == "device":
            heights = [box.y + box.height / 2 for box in self.hosts]
        wanted = sum(heights) / len(heights) if heights else 0.0
        return ProcessBox(process, lines, LETTER * max(map(len, names)) + 30, top, wanted, rows)
