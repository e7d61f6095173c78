"""World files: a world's string, its rules, and the processes that run it, in TOML.

    [world]
    string = "PMeadow · AFox#a<x=1, y=2> · AFox#b"   # or scene = "module:function"
    vocabulary = "meadow:vocabulary"
    order = ["eNear", "eHunger", "eRepresent"]

    [process.foxes]
    agents = "meadow:Fox"
    processes = 2

settings/world_settings.py declares every key, and docs/worlds.md lists them. Each table is read by
its own functions, those of processes in `process_specs.py`, then the checks follow that need all of
them.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

from minerva_bus.collect.plans import (
    ENDINGS,
    condition_of,
    parse_entries,
    plans_of,
    read_expression,
)
from minerva_bus.errors import (
    BusError,
    MisuseError,
    SceneError,
    VocabularyError,
    WorldFileError,
    nearest,
)
from minerva_bus.files import check_ending, ending_of
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.placement import PlacementRules, Rule, hosts_for
from minerva_bus.frame.sender_rights import ID
from minerva_bus.frame.stimuli import source_of
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AGENT_ID, Scene, agents, kind_counts
from minerva_bus.grammar.vocabulary import EventType, Primitive, Transformation, Vocabulary
from minerva_bus.launch.assignment import assigned
from minerva_bus.launch.installed import file_text
from minerva_bus.launch.machine_resources import cores
from minerva_bus.launch.process_specs import (
    PEOPLE,
    SERVICES,
    ProcessSpec,
    apply_mode,
    check_hosts,
    check_members,
    names_of,
    read_patience,
    read_processes,
    sharing,
)
from minerva_bus.launch.specs import load
from minerva_bus.launch.toml_tables import (
    Table,
    TomlError,
    called,
    filled,
    of_nodes,
    read_options,
    read_toml,
)
from minerva_bus.runtime.endpoints import check_endpoint, check_listening
from minerva_bus.runtime.timeouts import Deadlines, Patience
from minerva_bus.settings.kinds import ALL, TEXT, TEXTS, TOPICS, number, whole
from minerva_bus.settings.world_settings import (
    AS_WRITTEN,
    BusSettings,
    CollectSettings,
    NormSettings,
    Overrides,
    PlacementSettings,
    RecordSettings,
    WatchSettings,
    WorldSettings,
)
from minerva_bus.user_code import expressions, variables_of
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.keys import is_name
from minerva_bus.wire.plain import DEFAULT, Limits, configurable_limits
from minerva_bus.wording import counted
from minerva_bus.world.agent import Agent
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.evolution import Policy
from minerva_bus.world.expressions import Expression
from minerva_bus.world.norms import REFUSED, Norm, Then, check_conditions, sanction_of
from minerva_bus.world.services import Generator

MAX_BYTES: Final = 16 << 20
"""Bytes of a world file."""

TABLES: Final = (
    *("world", "options", "choices", "process", "norm", "bus"),
    *("limits", "placement", "metrics", "log", "collect"),
)

_MAX_FLOAT = sys.float_info.max

AGENT_SECONDS: Final = 0.65e-6
"""Time of an agent's short method, one by one."""

ROW_SECONDS: Final = 0.03e-6
"""Time of an agent's row in a short method for populations."""


@fast_dataclass
class Collecting:
    """Data to collect of a run, by name, and their file ("": in memory)."""

    entries: Mapping[str, Expression] = field(default_factory=dict[str, Expression])
    into: str = ""


@fast_dataclass
class Access:
    """Admission of remote members, and limits for messages of all members.

    `keys` is the folder of certificates (None: remote members cannot join), `routers` are Zenoh
    routers that the coordinator joins.
    """

    keys: Path | None = None
    routers: tuple[str, ...] = ()
    limits: Limits = DEFAULT


@fast_dataclass
class WorldFile:
    """A world file with the settings of the command line, checked.

    `patience` has the time-outs for all members; a process may have its own. `notes` are lines to
    print at the start, and the `warnings` are among them. `writers` are the processes whose
    services write files.
    """

    path: Path
    world: WorldSpec
    rate: float
    processes: tuple[ProcessSpec, ...]
    bus: BusSettings = field(default_factory=BusSettings)
    access: Access = field(default_factory=Access)
    patience: Patience = field(default_factory=Patience)
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    writers: frozenset[str] = frozenset()
    record: RecordSettings = field(default_factory=RecordSettings)
    text: str = ""
    watch: WatchSettings = field(default_factory=WatchSettings)
    collect: Collecting = field(default_factory=Collecting)

    @property
    def deadlines(self) -> Deadlines:
        """Time-outs of frames for each member."""
        processes = self.processes
        own = {each.name: each.patience for each in processes if each.patience is not None}
        elsewhere = frozenset(process.name for process in processes if process.elsewhere)
        on_failure = {process.name: process.on_failure for process in processes}
        return Deadlines(self.patience, own, elsewhere, on_failure)


def read_world_file(path: Path, overrides: Overrides = AS_WRITTEN) -> WorldFile:
    """Read, complete and check a world file. Raises WorldFileError and SceneError."""
    top, text = _tables(path, overrides)
    return _read(top, text, path)


def read_world_text(text: str, path: Path, overrides: Overrides = AS_WRITTEN) -> WorldFile:
    """As `read_world_file`, from the text of a file that may be on another machine."""
    return _read(_parsed(text, path, overrides), text, path)


def read_tables(
    tables: Mapping[str, Any], path: Path, overrides: Overrides = AS_WRITTEN
) -> WorldFile:
    """A world from tables that are not in a file, read as if they were at this path.

    Raises WorldFileError and SceneError.
    """
    return _read(_opened(Table(tables, "", "", path.stem, overrides)), "", path)


def open_tables(path: Path) -> Table:
    """The tables of a world file, unread. Raises WorldFileError."""
    return _tables(path)[0]


def _tables(path: Path, overrides: Overrides = AS_WRITTEN) -> tuple[Table, str]:
    text = file_text(path, MAX_BYTES)
    return _parsed(text, path, overrides), text


def _parsed(text: str, path: Path, overrides: Overrides) -> Table:
    try:
        return _opened(Table(read_toml(text), "", text, str(path), overrides))
    except TomlError as error:
        if path.suffix == ".py":
            run = f"python {path.name} runs it, and World.save in it writes its world file"
            raise WorldFileError(f"{path}: a Python program, not a world file; {run}") from None
        place = SceneError(
            f"not TOML: {error}",
            text=text,
            offset=error.offset,
            expected=error.expected,
            source=str(path),
        )
        raise WorldFileError(str(place)) from None


def _opened(top: Table) -> Table:
    for name in TABLES:
        top.table(name)
    top.done()  # First, because a key missing in [world] may be in [wrold].
    return top


def _read(top: Table, text: str, path: Path) -> WorldFile:
    """Read the tables, in the order of their dependencies."""
    overrides = top.overrides
    completed_by = top.table("world").get("defaults", TEXT, "")
    # Options come first, because the other tables may refer to them as `${name}`.
    options = read_options(top, path, overrides.options, completed_by)
    for name in ("world", "process", "bus", "norm", "collect"):
        if name in top:
            top.put(name, filled(top.data[name], options, path))
    # Before the description, which compares the agents of processes with the vocabulary.
    processes = read_processes(top, path)
    bus = top.read(BusSettings)
    waiting = read_patience(top.table("bus"))
    access = read_access(top, bus, path.parent)
    record = _record_settings(top)
    settings = top.read(WorldSettings)
    world = read_description(top, settings, path, options, processes)
    compiled = apply_mode(processes, settings.compiled, world.scene, path)
    names = [world.shares.get(process.name, process.name) for process in processes]
    norms = read_norms(top.table("norm"), world.vocabulary, world.scene, names)
    watch = top.read(WatchSettings)
    collect = read_collecting(top, world.vocabulary)
    for name in ("world", "bus", "limits", "metrics", "log", "collect"):
        # Every reader has taken its keys, so the remaining ones are unknown.
        top.table(name).done()
    # The views of the command line are in no table.
    made = [p for p in processes if not (overrides.only_code and p.table and p.make_service)]
    members = check_members(made, world.vocabulary, path)
    check_hosts(processes, world.policy, path)
    file = WorldFile(
        path,
        replace(world, norms=norms),
        settings.rate,
        processes,
        bus,
        access,
        waiting,
        options,
        (*_notes(settings.notes, options, path, top.table("world")), *compiled),
        (),
        frozenset(member.name for member in members if member.service and member.service.writes),
        record,
        text,
        watch,
        collect,
    )
    file = distributed(file, members)
    # Without its services, the file seems to publish nothing.
    unheard = [] if overrides.only_code else unpublished(file, members)
    warnings = (*unplaced(file), *unheard, *unanswered(file, members), *absent(file, members))
    classes = [cls for process in processes for cls in process.agents]
    classes += [type(member.service) for member in members if member.service]
    warnings = (*warnings, *dict.fromkeys(line for cls in classes for line in idle(cls)))
    file = replace(file, notes=(*file.notes, *warnings), warnings=warnings)
    interactive = any(each.service is not None and each.service.interactive for each in members)
    return _interactive(file, overrides) if interactive else file


def _record_settings(top: Table) -> RecordSettings:
    """Settings of a run's record; `record` in [world] is a file or a table.

    Raises WorldFileError, and MisuseError for topics without a record.
    """
    world, defaults = top.table("world"), RecordSettings()
    nested: Any = world.data.get("record")
    if isinstance(nested, dict):
        table = world.table("record")
        defaults = RecordSettings(table.get("file", TEXT, ""), table.get("topics", TOPICS, ()))
        table.done()
        # Otherwise `record` is read as a text below.
        del world.data["record"]
    settings = top.read(RecordSettings, defaults)
    if settings.path:
        check_ending(Path(settings.path), (".mcap",), "record")
    if settings.topics and not settings.path:
        raise MisuseError("topics are recorded in a record: name one, --record FILE.mcap")
    return settings


def _notes(spec: str, options: Mapping[str, Any], path: Path, world: Table) -> tuple[str, ...]:
    """The notes that a function returns for these options; `spec` "": none."""
    notes: object = called(spec, options, path, world, "notes") if spec else ()
    if not isinstance(notes, list | tuple):
        raise WorldFileError(f"{path}: {spec} must return a list of texts, not {notes!r:.60}")
    return tuple([str(note) for note in cast("list[object]", notes)])


def _interactive(file: WorldFile, overrides: Overrides) -> WorldFile:
    """A world with a user interface: by default in real time and without end."""
    world, rate, notes = file.world, file.rate, list(file.notes)
    if "rate" not in overrides.values and not rate:
        rate = 1.0 / world.dt
        notes.append(f"{rate:g} frames per second, real time (--rate changes it)")
    if "until" not in overrides.values and world.until:
        notes.append(f"runs on after {world.until} (--until {world.until} ends it there)")
        world = replace(world, until="")
    return replace(file, world=world, rate=rate, notes=tuple(notes))


# --- [world] and [placement] ---


def read_description(
    top: Table,
    settings: WorldSettings,
    path: Path,
    options: Mapping[str, Any],
    processes: Sequence[ProcessSpec],
) -> WorldSpec:
    """The world, without its norms.

    The world waits for the `processes`; `options` are the arguments of a function that makes the
    scene. Raises WorldFileError and SceneError.
    """
    table = top.table("world")
    vocabulary = _vocabulary(table, settings, path)
    # Before the string is read, because a missing class would be reported as an unknown symbol.
    _check_kinds(processes, vocabulary, path, ", ".join(settings.vocabulary))
    _check_speakers(processes, vocabulary, path)
    # `dt` follows the file's rate only: `--rate` changes the pace of a run, but must not change the
    # string.
    own_rate: float = table.get("rate", number(), 0.0)
    scene = _scene(table, settings, vocabulary, path, options)
    given = tuple(filter(of_nodes, top.overrides.settings))
    world = WorldSpec(
        name=table.named(settings.name or path.stem, "a world"),
        scene=assigned(scene, vocabulary, given) if given else scene,
        vocabulary=vocabulary,
        seed=settings.seed,
        dt=settings.dt if "dt" in table else 1.0 / own_rate if own_rate else settings.dt,
        order=Priority(_event_types(table, "order", settings.order, vocabulary)),
        people=_event_types(table, "people", settings.people, vocabulary),
        speaks_for={each.name: each.speaks_for for each in processes if each.speaks_for},
        shares={each.name: each.table for each in processes if each.dividing},
        policy=Policy(settings.policy),
        frames=settings.frames,
        until=_sent(top, "until", settings.until, vocabulary),
        give_up=_sent(top, "give_up", settings.give_up, vocabulary),
        expected=frozenset(process.name for process in processes),
        real_time=settings.real_time,
        placement=_placement(top.table("placement"), vocabulary),
    )
    if not processes:
        raise WorldFileError(f"{path}: no [process.NAME]: no process would run this world")
    return world


def _check_kinds(
    processes: Sequence[ProcessSpec], vocabulary: Vocabulary, path: Path, spec: str
) -> None:
    """Check that the vocabulary has all agents of the processes, before it reads the string."""
    for process in processes:
        for cls in process.agents:
            if cls.kind.name not in vocabulary.kinds:
                raise WorldFileError(
                    f"{path}: [process.{process.name}]: the vocabulary {spec} has no"
                    f" {cls.kind.name}: add its class, {cls.__name__} of {cls.__module__}, to"
                    " Vocabulary.of(...)"
                )


def _check_speakers(processes: Sequence[ProcessSpec], vocabulary: Vocabulary, path: Path) -> None:
    """Check that generators represent kinds of the vocabulary, or valid ids."""
    for process in processes:
        for agent in process.speaks_for:
            known = list(vocabulary.kinds)
            if agent.startswith(ID):
                valid = AGENT_ID.fullmatch(agent[1:])
                wrong = "" if valid else f"{agent!r} is not a valid agent id"
            else:
                unknown = f"the vocabulary has no agents {agent}{nearest(agent, known)}"
                wrong = "" if agent in known else f'{unknown} (an id is "#{agent}")'
            if wrong:
                raise WorldFileError(f"{path}: [process.{process.name}]: speaks_for: {wrong}")


def _vocabulary(table: Table, settings: WorldSettings, path: Path) -> Vocabulary:
    specs = settings.vocabulary
    if not specs:
        raise WorldFileError(f'{path}: [world] needs vocabulary = "module:attribute"')
    with table.loading("vocabulary"):
        loaded = [load(spec, path.parent) for spec in specs]
    if len(loaded) == 1 and isinstance(loaded[0], Vocabulary):
        return loaded[0]
    if len(loaded) == 1:
        kind = type(loaded[0]).__name__
        table.wrong("vocabulary", f"must name a Vocabulary; {specs[0]} is of type {kind}")
    try:
        return Vocabulary.of(*loaded)
    except MisuseError as error:
        table.wrong("vocabulary", f"lists no vocabulary: {error}")


def _scene(
    table: Table,
    settings: WorldSettings,
    vocabulary: Vocabulary,
    path: Path,
    options: Mapping[str, Any],
) -> Scene:
    text, maker = settings.string, settings.scene
    if bool(text) == bool(maker):
        raise WorldFileError(f"{path}: [world] needs exactly one of string and scene")
    if text:
        return vocabulary.read(text, f"{path}: world.string")
    if any(sign in maker for sign in "#<(·"):
        table.wrong("scene", 'must name a function, "module:function"; write string = "..."')
    made = called(maker, options, path, table, "scene")
    if isinstance(made, str):
        return vocabulary.read(made, maker)
    if not isinstance(made, Scene):
        kind = type(made).__name__
        raise WorldFileError(f"{path}: {maker} must return a string, not {kind}")
    # No reader has checked the symbols and values of a Scene that code has built.
    return vocabulary.check(made, maker)


def _event_types(
    table: Table, key: str, types: tuple[str, ...], vocabulary: Vocabulary
) -> tuple[str, ...]:
    _check_known(table, key, types, list(vocabulary.events), "event type")
    for name in types:
        if types.count(name) > 1:
            table.wrong(key, f"has {name} twice")
    return types


def _sent(top: Table, key: str, name: str, vocabulary: Vocabulary) -> str:
    """An event type, or "", if agents can send it."""
    if not name:
        return ""
    if name not in vocabulary.events:
        close = nearest(name, list(vocabulary.events))
        top.wrong_setting(WorldSettings, key, f"has the unknown event type {name}{close}")
    if vocabulary.events[name].visual:
        problem = f"must be an event that agents send; {name} is visual"
        top.wrong_setting(WorldSettings, key, problem)
    return name


def _placement(table: Table, vocabulary: Vocabulary) -> PlacementRules:
    """The placement rules of a world file. Raises WorldFileError."""
    limit = table.read(PlacementSettings).agents_per_host
    rules: dict[str, Rule] = {}
    for kind, hosts in table.rest().items():
        if kind not in vocabulary.kinds:
            known = list(vocabulary.kinds)
            listed = f"it has {', '.join(known) or 'none'}"
            hint = nearest(kind, [*known, "agents_per_host"], listed)
            table.wrong(kind, f"is not an agent kind of this world{hint}")
        rules[kind] = _rule(table, kind, hosts)
    return PlacementRules(rules, limit)


def _rule(table: Table, kind: str, hosts: Any) -> Rule:
    if isinstance(hosts, dict):
        inner = table.table(kind)
        rule = Rule(inner.get("only", TEXTS, ()), inner.get("near", TEXT, ""))
        inner.done()
    else:
        names = cast("list[Any]", hosts if isinstance(hosts, list) else [hosts])
        if not all(isinstance(name, str) for name in names):
            table.wrong(kind, 'must be a list of hosts, or { only = ["HOST"], near = "MEMBER" }')
        rule = Rule(tuple(names))
    if rule == Rule():
        table.wrong(kind, 'allows nothing; name hosts, or near = "MEMBER"')
    return rule


# --- [bus] and [limits] ---


def read_access(top: Table, bus: BusSettings, folder: Path) -> Access:
    """The access rules of a world, checked; `folder` has its world file.

    Raises WorldFileError, and BusError for a world that any process could join.
    """
    # A path in the world file is relative to this file, one on the command line to the current
    # folder.
    keys = Path(bus.keys) if "keys" in top.overrides.values else folder / bus.keys
    keys = keys if bus.keys else None
    check_listening(bus.listen, keys=keys is not None, insecure=bus.insecure)
    # A router gives access to the coordinator like its own endpoint, so the same rules apply.
    for router in bus.connect:
        endpoint = check_endpoint(router)
        if not (endpoint.secured or endpoint.local or bus.insecure):
            raise BusError(
                f"{router} is not a secured link: join tls/{endpoint.host}:{endpoint.port} with"
                " --keys FOLDER, or insist with --insecure"
            )
        check_listening(router, keys=keys is not None, insecure=bus.insecure)
    # Certificates take effect on TLS links only: with keys and without such a link, no member would
    # be checked, contrary to the owner's intention.
    secured = any(check_endpoint(endpoint).secured for endpoint in (bus.listen, *bus.connect))
    if keys is not None and not secured:
        raise BusError(
            f"keys are for secured links, and {bus.listen} is not one;"
            " listen at tls/0.0.0.0:7447 (--listen)"
        )
    return Access(keys, bus.connect, _limits(top.table("limits")))


def _limits(table: Table) -> Limits:
    values = {
        name: table.get(name, whole(least), getattr(DEFAULT, name))
        for name, least in configurable_limits().items()
    }
    return replace(DEFAULT, **values)


# --- [norm.NAME] ---


def read_norms(
    table: Table, vocabulary: Vocabulary, scene: Scene, members: Collection[str]
) -> tuple[Norm, ...]:
    """The active norms of a world file, in the order of the file; docs/norms.md has every key.

    `members` are the names of its processes. Raises WorldFileError.
    """
    norms: list[Norm] = []
    for name in list(table.data):
        table.named(name, "a norm")
        inner = table.table(name)
        settings = inner.read(NormSettings)
        norm = _norm(name, inner, settings, vocabulary, members)
        inner.done()
        _check(norm, inner, vocabulary, scene)
        norms += [norm] if settings.in_force else []
    return tuple(norms)


def _norm(
    name: str,
    table: Table,
    settings: NormSettings,
    vocabulary: Vocabulary,
    members: Collection[str],
) -> Norm:
    kinds, events = list(vocabulary.kinds), list(vocabulary.events)
    _check_known(table, "on", settings.on, events, "event type")
    for event in settings.on:
        if vocabulary.events[event].visual:
            table.wrong("on", f"names {event}, which is visual: norms are not about views")
    who = "agent kind or process"
    persons = [subject for subject in settings.applies if subject.startswith(f"{PEOPLE}:")]
    for person in persons:
        # With certificates a person is that of a member, `people:web/page-1`.
        if not all(map(is_name, person.partition(":")[2].split("/"))):
            expected = "people:NAME, with up to 64 letters, digits and _ . ~ -"
            table.wrong("applies", f"names no person by {person[:80]!r}; expected {expected}")
    known = [*kinds, *members, PEOPLE, *persons]
    _check_known(table, "applies", settings.applies, known, who)
    for subject in settings.applies:
        if not settings.on and subject not in kinds:
            table.wrong(
                "applies", f"names {subject}, which is not an agent: only norms `on` events can"
            )
    return Norm(
        name,
        tuple([_source(subject) for subject in settings.applies]),
        settings.on,
        settings.when,
        _where(table, settings),
        settings.most,
        settings.per,
        Then(settings.then),
        _sanction(name, table, settings, vocabulary),
    )


def _source(subject: str) -> str:
    """A subject of `applies` as the frame algorithm names it."""
    who, _, name = subject.partition(":")
    return source_of(name) if who == PEOPLE else subject


def _check_known(table: Table, key: str, names: Iterable[str], known: list[str], what: str) -> None:
    for name in names:
        if name not in known:
            table.wrong(key, f"has the unknown {what} {name}{nearest(name, known)}")


def _where(table: Table, settings: NormSettings) -> str:
    """The condition; the corners of a rectangle are a short form for the attributes x and y."""
    where: Any = settings.where
    if isinstance(where, str):
        return where
    if not isinstance(where, list):
        table.wrong("where", "must be a text")
    corners = cast("list[Any]", where)
    numbers = [
        corner
        for corner in corners
        if isinstance(corner, int | float) and not isinstance(corner, bool)
    ]
    # The limit excludes NaN and infinity, which a condition would read as names, and whole numbers
    # that are too long for a float.
    if len(numbers) != 4 or len(corners) != 4 or any(not abs(x) <= _MAX_FLOAT for x in numbers):
        table.wrong("where", "must be a condition, or the corners [x0, y0, x1, y1]")
    (x0, x1), (y0, y1) = sorted(map(float, numbers[::2])), sorted(map(float, numbers[1::2]))
    return f"x >= {x0} and x <= {x1} and y >= {y0} and y <= {y1}"


def _sanction(
    name: str, table: Table, settings: NormSettings, vocabulary: Vocabulary
) -> Event | None:
    event, then = settings.event, Then(settings.then)
    data = cast("dict[str, Any]", settings.data or {})
    if not event:
        if then is Then.SANCTION:
            table.wrong("then", "is a sanction: `event` must name its event")
        if data:
            table.wrong("data", "is for an event, which is not given")
        return None
    if then is Then.COUNT:
        table.wrong("event", "is sent only if `then` is refuse or sanction")
    if event not in vocabulary.events:
        table.wrong("event", f"is unknown: {event}{nearest(event, list(vocabulary.events))}")
    try:
        return sanction_of(name, vocabulary.events[event], data)
    except (MisuseError, VocabularyError) as error:
        table.wrong("data" if data else "event", f"is wrong: {error}")


def _check(norm: Norm, table: Table, vocabulary: Vocabulary, scene: Scene) -> None:
    """Check that the conditions can hold; a norm about states needs one."""
    if not (norm.on or norm.when.strip() or norm.where.strip()):
        table.wrong("when", "is missing, and so is where: what is forbidden?")
    if REFUSED in vocabulary.events and norm.refuses and not norm.on:
        try:
            sanction_of(norm.name, vocabulary.events[REFUSED], {})
        except (MisuseError, VocabularyError) as error:
            table.wrong("then", f"sends {REFUSED}, which may have no data but norm: {error}")
    try:
        check_conditions(norm, vocabulary, scene, table.place)
    except VocabularyError as error:
        raise WorldFileError(str(error)) from None


# --- [collect] ---


def read_collecting(top: Table, vocabulary: Vocabulary) -> Collecting:
    """The table [collect], or the expressions of the command line in its place.

    Raises WorldFileError, MisuseError and VocabularyError.
    """
    into = top.read(CollectSettings).into
    entries: Mapping[str, Expression] = _written(top.table("collect"), vocabulary)
    if top.overrides.collect:
        entries = _given(top.overrides.collect, into, vocabulary)
    if into and not entries:
        raise WorldFileError(
            "nothing is collected: name expressions with --collect 'birds=count(ABird)', or under"
            ' [collect], such as birds = "count(ABird)"'
        )
    # Checked here, because the coordinator would only report it after the start of the world.
    if into and ending_of(into) not in ENDINGS:
        top.wrong_setting(CollectSettings, "into", f"must end with {' or '.join(ENDINGS)}: {into}")
    return Collecting(entries, into)


def _written(table: Table, vocabulary: Vocabulary) -> dict[str, Expression]:
    """The expressions of a world file. Raises VocabularyError."""
    entries: dict[str, Expression] = {}
    for name in [key for key in table.data if key != "into"]:
        source = table.place(name)
        entries[name] = read_expression(table.get(name, TEXT, ""), source)
        condition_of(entries[name], vocabulary, source)
    return entries


def _given(words: tuple[str, ...], into: str, vocabulary: Vocabulary) -> Mapping[str, Expression]:
    """The expressions of a command line. Raises MisuseError and VocabularyError."""
    for word in words:
        if "=" not in word and ending_of(word) in ENDINGS:
            raise MisuseError(f"--collect takes NAME=EXPRESSION; name the file by --into {word}")
    entries = parse_entries(words)
    # The plans are made for their checks: errors appear here, before any process starts.
    plans_of(entries, vocabulary, "--collect")
    # Without a file, only a program in Python receives the tables.
    if not into:
        raise MisuseError("--collect needs a file for its tables: --into FILE.csv or FILE.parquet")
    return entries


# --- processes = "auto" ---


def distributed(file: WorldFile, members: Iterable[Member]) -> WorldFile:
    """The world file with a number of processes for each table that leaves it to this machine.

    A second host halves the evolution of agents, and costs the coordinator a request, a reply and
    its part of the string, so `hosts_for` chooses a number, at most that of cores. The costs of
    the agents' own code are unknown before it runs, so the work is a lower bound: the rule rather
    starts too few hosts than one that makes the world slower. The strings are the same for any
    number.

    If it leaves any, services share one where there are fewer cores than processes. `members` are
    those of the first process of each table.
    """
    if not any(process.automatic for process in file.processes):
        return file
    processes, notes = list[ProcessSpec](), list[str]()
    for process in file.processes:
        own = list(_hosts(process, file.world)) if process.automatic else [process]
        processes += own
        if process.automatic:
            notes.append(f"{process.name}: {counted(len(own), 'process')} (auto)")
    processes = [*sharing(processes, members, cores())]
    if shared := sum(each.shared for each in processes):
        notes.append(f"{SERVICES}: 1 process for {shared} services (auto)")
    expected = frozenset(process.name for process in processes)
    return replace(
        file,
        processes=tuple(processes),
        world=replace(file.world, expected=expected),
        notes=(*file.notes, *notes),
    )


def _hosts(process: ProcessSpec, world: WorldSpec) -> Iterator[ProcessSpec]:
    counts = kind_counts(*world.scene.pieces)
    work = sum(counts[cls.kind.name] * _seconds(cls) for cls in process.agents)
    count = 1 if world.policy.rules.makes_copies else min(hosts_for(work), cores())
    yield from [replace(process, name=n, automatic=False) for n in names_of(process.name, count)]


def _seconds(cls: type[Agent]) -> float:
    """Time of an agent of this class in a frame, if its code is short."""
    if not cls.activities:
        return 0.0
    return ROW_SECONDS if cls.activities.keys() <= cls.population.keys() else AGENT_SECONDS


def several_hosts(processes: Iterable[ProcessSpec]) -> bool:
    """Whether the agents of a table have more than one process."""
    tables = [process.table for process in processes if process.agents]
    return len(set(tables)) < len(tables)


# --- warnings ---


def unplaced(file: WorldFile) -> list[str]:
    """A warning for each rule that keeps agents from all processes of the file.

    It is no error, because such a process may attach while the world runs.
    """
    rules = file.world.placement.rules
    return [
        f"placement.{kind}: {problem}; {kind} does not evolve until one attaches"
        for kind, rule in rules.items()
        for problem in _problems(file, kind, rule)
    ]


def unanswered(file: WorldFile, members: Iterable[Member]) -> list[str]:
    """A warning for each event type of a generator that has no effect: no agent responds to it.

    `members` are those of the processes of the file.
    """
    world = file.world
    events = world.vocabulary.events
    known = {*(name for kind in world.vocabulary.kinds.values() for name in kind.subscribes)}
    # These end the world, or are all that a norm is about.
    known |= {world.until, world.give_up, *(name for norm in world.norms for name in norm.on)}
    return [
        f"{hello.member}: no agent of this world responds to {name}, so it has no effect;"
        f" use another event type, or respond to it in an agent: @on({name!r})"
        for hello in [member.hello() for member in members]
        for name in hello.generates
        if name not in known and not events[name].visual
    ]


def absent(file: WorldFile, members: Iterable[Member]) -> list[str]:
    """A warning for each agent that a process's options name and the string lacks."""
    named = [(m.name, id) for m in members if m.service for id in m.service.concerns]
    named += [(p.name, id[1:]) for p in file.processes for id in p.speaks_for if id[0] == ID]
    known = sorted({node.id for node in agents(file.world.scene)}) if named else []
    return [
        f"{name}: the string has no agent #{agent}, which its options name"
        f"{nearest(agent, known)}; it has no effect until one is born"
        for name, agent in named
        if agent not in known
    ]


def unpublished(file: WorldFile, members: Iterable[Member]) -> list[str]:
    """A warning for each topic that is read or recorded, and published by no process of the file.

    `members` are those of its processes, of which it compares the topics.
    """
    # What a program in another language publishes is known only when it joins.
    if any(process.command for process in file.processes):
        return []
    hellos = [member.hello() for member in members]
    known = sorted({topic for hello in hellos for topic in hello.publishes})
    wanted = {topic: "record" for topic in file.record.topics if topic != ALL}
    # Views draw what they receive: those of a world without sensors lack nothing.
    readers = [hello for hello in hellos if hello.roles != ("device",)]
    wanted |= {topic: hello.member for hello in readers for topic in hello.topics}
    return [
        f"{who}: no process publishes the topic {topic!r}{nearest(topic, known)}; it has no"
        " readings until one attaches"
        for topic, who in sorted(wanted.items())
        if topic not in known
    ]


@cache
def idle(cls: type) -> tuple[str, ...]:
    """A warning for each statement without effect in the methods of a class, by its source.

    For example `EMPTY` or `eDay()` without `return` or `yield`.
    """
    functions = [value for base in cls.__mro__ for value in vars(base).values()]
    return tuple(
        f"{place.where}, in {place.function}: `{ast.unparse(node)}` has no effect: {hint}"
        for function in map(inspect.unwrap, filter(callable, functions))
        for place, node in expressions(function)
        if (hint := _hint(node, function.__globals__ | variables_of(function), cls))
    )


def _hint(node: ast.expr, names: Mapping[str, Any], cls: Any) -> str:
    """What to write instead of an expression as a statement; "" if it may have an effect."""
    forgotten = f"did you forget return{' or yield' if issubclass(cls, Generator) else ''}?"
    match node:
        case ast.Call(func=ast.Call()):
            return _hint(node.func, names, cls)
        case ast.Call():
            meant = names.get(ast.unparse(node.func))
            if isinstance(meant, EventType) and issubclass(cls, Agent):
                return "to send it, use moment.emit"
            symbol = isinstance(meant, EventType | Primitive | Transformation)
            return forgotten if symbol or hasattr(meant, "kind") else ""
        case ast.IfExp():
            return _hint(node.orelse, names, cls) and _hint(node.body, names, cls)
        case ast.Compare(ops=[ast.Eq()]):
            return "to assign, write ="
        case ast.Attribute():
            return "call it, or use its value"
        case ast.Name() | ast.BinOp() | ast.Compare() | ast.Constant(value=None):
            return forgotten
        case _:
            return ""


def _problems(file: WorldFile, kind: str, rule: Rule) -> Iterator[str]:
    hosts = [process.name for process in file.processes if _may_host(process, kind)]
    # Only names matter here: the machines are those of a run.
    if not any(Rule(rule.only).allows(host, {}) for host in hosts):
        names = " or ".join(map(repr, rule.only))
        known = f"there are {', '.join(hosts) or 'none'}"
        hint = next((hint for name in rule.only if (hint := nearest(name, hosts))), f"; {known}")
        yield f"no process that may have such agents has the name {names}{hint}"
    members = [process.name for process in file.processes]
    if rule.near and rule.near not in members:
        known = f"there are {', '.join(members)}"
        yield f"near: there is no process {rule.near!r}{nearest(rule.near, members, known)}"


def _may_host(process: ProcessSpec, kind: str) -> bool:
    # What a program in another language hosts is known only when it joins.
    return bool(process.command) or any(agent.kind.name == kind for agent in process.agents)
