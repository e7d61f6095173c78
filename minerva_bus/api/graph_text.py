"""The graph of a world as the text of a Mermaid flowchart."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from minerva_bus.api.graphs import EventEntry, Graph, KindEntry, ProcessEntry
from minerva_bus.world.services import Participation


def mermaid(graph: Graph) -> str:
    """A flowchart: processes, kinds of agents in their hosts, and event types in their order."""
    return "\n".join([*_lines(graph), ""])


def _lines(graph: Graph) -> Iterator[str]:
    yield "flowchart LR"
    yield '    subgraph coordinator["coordinator: event types in the order of a frame"]'
    for event in graph.events:
        yield f'        {_id("e", event.name)}(["{event.rank} {_text(event.name)}{_tags(event)}"])'
    yield "    end"
    for process in graph.processes:
        yield from _process(graph, process)
    yield "    classDef visual stroke-dasharray: 3 3"
    visual = [_id("e", event.name) for event in graph.events if event.visual]
    if visual:
        yield f"    class {','.join(visual)} visual"


def _tags(event: EventEntry) -> str:
    return ", pub" if event.people else ""


def _process(graph: Graph, process: ProcessEntry) -> Iterator[str]:
    node, label = _id("p", process.name), _text(_process_label(process))
    if not process.hosts:
        yield f'    {node}["{label}<br>{_text(", ".join(_process_notes(process)))}"]'
    else:
        yield f'    subgraph {node}["{label}"]'
        for kinds in graph.alike(process):
            yield f'        {_kind(process, kinds)}["{_text(_kinds_label(kinds))}"]'
        yield "    end"
    for event in process.publishes:
        yield f"    {node} --> {_id('e', event)}"
    for kinds in graph.alike(process):
        yield from _agents(graph, _kind(process, kinds), kinds[0])
    for topic in process.reads:
        for other in graph.processes:
            if topic in other.writes:
                yield f'    {_id("p", other.name)} -. "{_text(topic)}" .-> {node}'


def _agents(graph: Graph, node: str, kind: KindEntry) -> Iterator[str]:
    for event in kind.receives:
        chance = kind.chances.get(event)
        label = "" if chance is None else f'|"with probability {_text(str(chance))}"|'
        yield f"    {_id('e', event)} -->{label} {node}"
    for event in kind.emits:
        yield f"    {node} -.-> {_id('e', event)}"
    for event in kind.views:
        yield f"    {_id('e', event)} --> {node}"
        for device in graph.processes:
            if event in device.draws:
                yield f'    {node} == "{_text(event)}" ==> {_id("p", device.name)}'


def _process_label(process: ProcessEntry) -> str:
    """The name of a process and the number of its copies."""
    return f"{process.name} ×{process.count}" if process.count > 1 else process.name


def _process_notes(process: ProcessEntry) -> list[str]:
    """What a process is and does, in a few words."""
    notes = [process.what]
    if process.when not in ("", Participation.IN_STEP):
        notes.append(process.when)
    if process.orders:
        notes.append("takes orders")
    if process.elsewhere:
        notes.append("on another machine")
    return notes


def _kinds_label(kinds: list[KindEntry]) -> str:
    """Kinds with the number of their agents in the initial string."""
    return ", ".join(f"{kind.symbol} ×{kind.initial}" for kind in kinds)


def _kind(process: ProcessEntry, kinds: list[KindEntry]) -> str:
    return _id("a", f"{process.name} {kinds[0].symbol}")


def _id(prefix: str, name: str) -> str:
    """An id of Mermaid, which has only letters, digits and _."""
    plain = [char if char.isascii() and char.isalnum() else f"_{ord(char):x}_" for char in name]
    return "".join([prefix, "_", *plain])


def _text(text: str) -> str:
    """A text inside the quotes of a label."""
    return "".join(_ENTITIES.get(char, char) for char in text)


_ENTITIES: Final = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "\n": " "}
