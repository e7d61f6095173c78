"""The graph of a world: who publishes and who receives which event types, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from minerva_analysis.emitted import emitted_by
from minerva_bus.api.world import World, world_of
from minerva_bus.errors import MisuseError
from minerva_bus.files import check_output, write_output
from minerva_bus.frame.messages import Hello
from minerva_bus.grammar.scene import kind_counts
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.values import path_of
from minerva_bus.world.agent import Agent
from minerva_bus.world.operator import MemberStatus, WorldStatus
from minerva_bus.world.services import Participation

ENDING: Final = ".mmd"


@dataclass(frozen=True, slots=True)
class EventEntry:
    """An event type; `rank` is its place in the order of a frame's events, from 1.

    `data`: the type of each datum. `people`: whether people may publish it (`minerva pub`).
    `rate`: events per second in a running world; None if it is not asked.
    """

    name: str
    rank: int
    visual: bool
    data: dict[str, str]
    people: bool = False
    rate: float | None = None


@dataclass(frozen=True, slots=True)
class KindEntry:
    """A kind of agents: the event types that it receives, shows a view for and may emit.

    `initial`: the number of its agents in the initial string. `chances`: the probability, a number
    or an attribute, of the types that it responds to by chance. `emits` is what its code names.
    """

    symbol: str
    initial: int
    receives: tuple[str, ...]
    views: tuple[str, ...]
    emits: tuple[str, ...] = ()
    chances: dict[str, float | str] = field(default_factory=dict[str, "float | str"])


@dataclass(frozen=True, slots=True)
class ProcessEntry:
    """Processes of one table of the world file, `count` of them.

    `what`: the service's class, `agents` or the command. `role`: `generator`, `device`, `host` or
    `command`; a generator may draw, too. `hosts`: kinds of agents. `when`: when it takes part in
    frames, as its class declares it. `reads`, `writes`: sensor topics. `rate`: bytes per second
    that the processes send in a running world; None if it is not asked.
    """

    name: str
    count: int
    role: str
    what: str
    hosts: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    draws: tuple[str, ...] = ()
    orders: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    when: str = ""
    elsewhere: bool = False
    rate: float | None = None


@dataclass(frozen=True, slots=True)
class Graph:
    """Processes, agents and events of a world; `events` are in the order of a frame's events.

    `until`, `give_up`: the event types with which agents end the world. Notebooks that draw Mermaid
    show the graph.

    Example:
        >>> graph("robot").mermaid().splitlines()[0]
        'flowchart LR'

    """

    world: str
    events: tuple[EventEntry, ...]
    processes: tuple[ProcessEntry, ...]
    kinds: tuple[KindEntry, ...]
    until: str = ""
    give_up: str = ""

    def with_rates(self, status: WorldStatus) -> Graph:
        """The graph with the rates of a running world, which `Operator.status` measures."""
        events = [replace(each, rate=status.events.get(each.name, 0.0)) for each in self.events]
        processes = [
            replace(process, rate=status.hz * sum(member.sent for member in _of(process, status)))
            for process in self.processes
        ]
        return replace(self, events=tuple(events), processes=tuple(processes))

    def publishers(self, event_type: str) -> list[str]:
        """Processes and kinds of agents that publish an event type; `people` with `pub`."""
        own = [each.name for each in self.processes if event_type in each.publishes]
        own += [kind.symbol for kind in self.kinds if event_type in kind.emits]
        people = any(each.people for each in self.events if each.name == event_type)
        return [*own, *(["people"] if people else [])]

    def receivers(self, event_type: str) -> list[str]:
        """Kinds of agents that respond to an event type or show a view, and devices that draw."""
        kinds = [k.symbol for k in self.kinds if event_type in (*k.receives, *k.views)]
        return [*kinds, *(each.name for each in self.processes if event_type in each.draws)]

    def alike(self, process: ProcessEntry) -> list[list[KindEntry]]:
        """The kinds that a process hosts, in groups with the same event types."""
        groups: dict[object, list[KindEntry]] = {}
        for kind in self.kinds:
            if kind.symbol in process.hosts:
                groups.setdefault((kind.receives, kind.views, kind.emits), []).append(kind)
        ordered = [sorted(kinds, key=lambda kind: -kind.initial) for kinds in groups.values()]
        return sorted(ordered, key=lambda kinds: -kinds[0].initial)

    def plain(self) -> dict[str, Any]:
        """The graph as plain data, for JSON."""
        events = [
            {
                **asdict(each),
                "publishers": self.publishers(each.name),
                "receivers": self.receivers(each.name),
            }
            for each in self.events
        ]
        return {**asdict(self), "events": events, "order": [each.name for each in self.events]}

    def mermaid(self) -> str:
        """The graph as the text of a Mermaid flowchart."""
        return mermaid(self)

    def save(self, path: str | Path) -> None:
        """Write a .mmd file of Mermaid. Raises MisuseError for another name, or if it cannot."""
        target = path_of("path", path)
        check_writable(target)
        write_output(target, self.mermaid().encode(), "graph")

    def _repr_markdown_(self) -> str:
        return f"```mermaid\n{self.mermaid()}```"


def _of(process: ProcessEntry, status: WorldStatus) -> list[MemberStatus]:
    """The members of a table of processes: NAME, or NAME-1, NAME-2 and so on."""
    names = {process.name, *(f"{process.name}-{n}" for n in range(1, process.count + 1))}
    return [member for member in status.members if member.name in names]


def check_writable(path: Path) -> None:
    """Raise MisuseError if a graph cannot be written to a file of this name."""
    if path.suffix.lower() != ENDING:
        mermaid = path.with_suffix(ENDING)
        raise MisuseError(
            f"{path}: a graph is written as Mermaid text, into a {ENDING}; to draw it:"
            f" pip install mermaidx; mermaidx -i {mermaid} -o {mermaid.with_suffix('.svg')}"
        )
    check_output(path, "graph")


def graph(world: World | str | Path, **options: Any) -> Graph:
    """The graph of a world, which is read and not run.

    Args:
        world: a `World`, an installed name, or the path of a world file.
        options: the world's own options, of a world that is given by its name or path.

    Raises WorldFileError and SceneError if the world cannot be read.

    Example:
        >>> graph("meadow").publishers("eRain")
        ['weather', 'people']

    """
    return graph_of(world_of(world, options).read())


def graph_of(file: WorldFile) -> Graph:
    """The graph of a world file."""
    world = file.world
    hellos = [(process, _hello(process)) for process in file.processes]
    orders = {name for _, hello in hellos if hello is not None for name in hello.orders}
    events = sorted(
        world.vocabulary.events.values(), key=lambda event: world.order.key(event.name, "", 0)
    )
    return Graph(
        world.name,
        tuple(
            EventEntry(
                event.name,
                rank,
                event.visual,
                {each.name: str(each.type) for each in event.fields.all},
                event.name in orders,
            )
            for rank, event in enumerate(events, 1)
        ),
        tuple(_processes(hellos)),
        tuple(_kinds(file, world.vocabulary.kinds.values())),
        world.until,
        world.give_up,
    )


def _hello(process: ProcessSpec) -> Hello | None:
    """What a process announces when it joins; None for a program, which is not asked."""
    return None if process.command else process.make_member().hello()


def _processes(hellos: Iterable[tuple[ProcessSpec, Hello | None]]) -> Iterable[ProcessEntry]:
    """One entry for each table of the world file."""
    tables: dict[str, list[tuple[ProcessSpec, Hello | None]]] = {}
    for process, hello in hellos:
        tables.setdefault(process.table or process.name, []).append((process, hello))
    for name, members in tables.items():
        process, hello = members[0]
        elsewhere = process.elsewhere
        if hello is None:
            yield ProcessEntry(
                name, len(members), "command", process.command[0], elsewhere=elsewhere
            )
            continue
        role = "generator" if hello.generates or hello.orders else "device"
        yield ProcessEntry(
            name,
            len(members),
            "host" if hello.kinds and not hello.service else role,
            hello.service or "agents",
            tuple(kind.name for kind in hello.kinds),
            hello.generates,
            hello.draws,
            hello.orders,
            hello.topics,
            hello.publishes,
            str(hello.when),
            elsewhere,
        )


def _kinds(file: WorldFile, kinds: Iterable[AgentKind]) -> Iterable[KindEntry]:
    classes = {cls.kind.name: cls for process in file.processes for cls in process.agents}
    known, initial = file.world.vocabulary.events, kind_counts(*file.world.scene.pieces)
    for kind in sorted(kinds, key=lambda kind: kind.name):
        cls: type[Agent] | None = classes.get(kind.name)
        used = emitted_by(cls) if cls is not None else set[str]()
        yield KindEntry(
            kind.name,
            initial[kind.name],
            tuple(sorted(kind.subscribes)),
            tuple(sorted(kind.views)),
            tuple(sorted(used.intersection(known))),
            dict(kind.chances),
        )


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
    rate = "" if event.rate is None else f"<br>{event.rate:,.0f}/s"
    return (", pub" if event.people else "") + rate


def _process(graph: Graph, process: ProcessEntry) -> Iterator[str]:
    node, label = _id("p", process.name), _text(_process_label(process))
    rate = "" if process.rate is None else f"<br>sends {process.rate / 1000:,.1f} kB/s"
    if not process.hosts:
        yield f'    {node}["{label}<br>{_text(", ".join(_process_notes(process)))}{rate}"]'
    else:
        yield f'    subgraph {node}["{label}{rate}"]'
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
