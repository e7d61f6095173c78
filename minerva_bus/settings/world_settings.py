"""Every setting of a world file and of `minerva run`, declared once.

The reader of world files, the options of the command line, their help and the tables in docs/
follow from these declarations. To add a setting, add a field here and use it; then run `python -m
tools.settings_tables` to update the documents.

`Overrides` is the upper layer: what a command line sets in place of a world file. Nothing heavy is
imported here, because `minerva --help` reads this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from minerva_bus.runtime.timeouts import THEN, Patience
from minerva_bus.settings.kinds import (
    ADDRESS,
    ANY,
    BOOLEAN,
    MAX_WHOLE,
    TABLE,
    TOPICS,
    Setting,
    by_option,
    check_known,
    choice,
    number,
    setting,
    single,
    switch,
    whole,
    whole_or_auto,
)
from minerva_bus.values import fast_dataclass

MODULE: Final = '`"module:function"`'
MAX_PROCESSES: Final = 1000
"""Processes of one table [process.NAME]."""

_world = partial(setting, "world")
_bus = partial(setting, "bus")
_process = partial(setting, "process.NAME")
_norm = partial(setting, "norm.NAME")
# The defaults are those of the class that applies them, so each is declared once.
_PATIENCE: Final = Patience()


@fast_dataclass
class WorldSettings:
    """What the world is, independent of where it runs."""

    string: str = _world(
        "",
        "The initial string *w₀*, with `${option}` replaced.",
        more="Give either `string` or `scene`. Separate symbols with `·` or `.`; between primitives"
        " a blank is enough (`PWall PFloor`).",
        shown=" ",
    )
    scene: str = _world(
        "",
        "A function that takes the options and returns *w₀* as a `Scene` or a text.",
        form=MODULE,
        shown=" ",
    )
    vocabulary: tuple[str, ...] = _world(
        (),
        "A `Vocabulary`: the symbols and event types of the world.",
        more="A list names symbols, event types and agent classes one by one.",
        form='`"module:attribute"`, or a list of them',
        shown="required",
    )
    defaults: str = _world(
        "",
        "A function that takes the options and returns them completed.",
        more="It is called once, before anything else uses the options.",
        form=MODULE,
    )
    notes: str = _world(
        "",
        "A function that takes the options and returns a list of lines to print at the start.",
        form=MODULE,
    )
    name: str = _world(
        "",
        "Name of the world on the bus.",
        option="name",
        more="1 to 64 letters, digits and `_ . ~ -`. A machine runs one world of a name at a time.",
        shown="the file's name without `.toml`",
    )
    seed: int = _world(0, "Seed of all random numbers.", whole(-MAX_WHOLE - 1), option="seed")
    rate: float = _world(
        0.0,
        "Frames per second; 0: as fast as possible.",
        option="rate",
        more="With 0, an idle world (no waiting event, no generator in step but those of orders)"
        " runs ten frames per second and continues at once when an event arrives.",
    )
    real_time: bool = _world(
        False,
        "An external process, such as a robot, makes each frame last `dt`.",
        more="Frames that take more than a tenth longer are late, as with a `rate`. Late frames are"
        " logged with the member that answered last, after pauses of 1, 2, 4 and up to 60 s, and"
        " counted in the summary, in `minerva top` and in the metrics.",
    )
    dt: float = _world(
        0.1,
        "Simulated seconds per frame.",
        # Limits are inclusive, and 0 is not allowed.
        number(1e-9),
        form="number above 0",
        shown="1/rate, or 0.1 if the rate is 0",
    )
    frames: int = _world(0, "Stop after this many frames; 0: no limit.", option="frames")
    order: tuple[str, ...] = _world(
        (),
        "The order relation of events (the paper's 4.2.2), the first type first.",
        more="Types that are not listed come last, by name.",
        form="list of event types",
    )
    people: tuple[str, ...] = _world(
        (),
        "Event types that people may send although a generator makes them.",
        more="People use `minerva pub`, windows and pages; see below.",
        form="list of event types",
    )
    policy: str = _world(
        "sequential",
        "How to read equation 3 if an agent receives several events in a frame, or none.",
        choice("sequential", "literal"),
        more="See [The letter of equation 3](#the-letter-of-equation-3).",
    )
    compiled: bool | str = _world(
        False,
        "Run the methods of agents as machine code, with the same results.",
        switch("if possible"),
        option="compiled",
        more="It needs the extra `fast`. `true`: a method that cannot be compiled is an error;"
        ' `"if possible"`: it runs agent by agent, and the start lists it. See'
        " [Run methods as machine code](../extensions/fast/compile.md).",
    )
    until: str = _world(
        "",
        "Stop when every agent that can send this event has sent it; '': never.",
        single("event type"),
        option="until",
        empty=True,
    )
    give_up: str = _world(
        "",
        "The event by which an agent reports that it cannot reach `until`.",
        single("event type"),
        more="It is logged, and the world ends when every agent has sent one of the two. The"
        " summary names the agents that gave up, with the data of their events.",
    )


@fast_dataclass
class RecordSettings:
    """Where a run is recorded ("": nowhere), and how often the record is flushed, seconds.

    `durable`: a frame counts once it is on the disk. `topics` are the sensor topics to record;
    `*` means all.
    """

    path: str = _world(
        "",
        "Record the run in this file, .mcap.",
        key="record",
        option="record",
        more='A table `{ file = "FILE.mcap", topics = [...] }` also records sensor topics'
        " (`true`: all); see [records.md](records.md).",
        form="file .mcap, or a table",
    )
    topics: tuple[str, ...] = _world(
        (),
        "Also record sensor topics: all, or a list such as scan,image.",
        TOPICS,
        key="",
        option="record_topics",
        form="list of topics",
    )
    flush: float = _world(
        2.0,
        "Flush the record to disk at this interval, seconds.",
        number(unit="seconds"),
        option="flush",
    )
    durable: bool = _world(
        False, "Complete a frame only after its record is on disk.", option="durable"
    )


@fast_dataclass
class BusSettings:
    """Where the coordinator listens, whom it admits, and where it keeps its journal."""

    listen: str = _bus(
        "tcp/127.0.0.1:0",
        "Listen at this endpoint, such as tls/0.0.0.0:7447.",
        option="listen",
        more="Port 0: any free port. `tls/` admits remote members with a certificate; see"
        " [security.md](security.md).",
        form="endpoint",
    )
    keys: str = _bus(
        "",
        "Folder with the certificates of remote members (tls/).",
        option="keys",
        more="A relative path is relative to the world file; on the command line, to the current"
        " folder.",
        form="folder",
    )
    connect: tuple[str, ...] = _bus(
        (),
        "Join a Zenoh router, tls/HOST:PORT; may be repeated.",
        option="connect",
        form="endpoint, or a list of them",
        shown="none",
    )
    insecure: bool = _bus(
        False,
        "Admit any member that can reach the endpoint, without certificates.",
        key="",
        option="insecure",
    )
    journal: str = _bus(
        "",
        "Keep the journal in this folder, and resume from an existing one.",
        option="journal",
        more="See [its successor](concepts/6-failures.md#the-coordinators-successor).",
        form="folder",
        shown=" ",
    )
    shared_memory: bool | None = _bus(
        None,
        "Send messages of 1 MB or more between local processes through `/dev/shm`.",
        BOOLEAN,
        more="The coordinator and each process need 64 MB of it.",
        form="boolean",
        shown="true if the initial string has 4 MB of numbers in columns and `/dev/shm` has room",
    )


@fast_dataclass
class PatienceSettings:
    """How long a frame waits for a member, in [bus] or for one process, seconds."""

    soft: float = _bus(
        _PATIENCE.soft,
        "Log that a frame waits for a member after this time, and what will happen next.",
        number(0.05, "seconds"),
    )
    hard: float = _bus(
        _PATIENCE.hard, "Time after which `late` is applied.", number(0.1, "seconds")
    )
    late: str = _bus(
        _PATIENCE.then,
        "What happens to a member that does not answer in time.",
        choice(*THEN),
        more="`restart`: kill it and start it again (an attached member is disconnected); `skip`:"
        " continue the frame without it, and its agents do not evolve; `wait`: wait without limit;"
        " `stop`: stop the world.",
    )


@fast_dataclass
class WatchSettings:
    """Where metrics are served, HOST:PORT ("": nowhere), and the format of log lines."""

    metrics: str = setting(
        "metrics",
        "",
        "Serve /metrics, /live and /ready at HOST:PORT.",
        ADDRESS,
        key="listen",
        option="metrics",
        form='`"HOST:PORT"`',
    )
    log_format: str = setting(
        "log",
        "text",
        "Format of log lines: text or json.",
        choice("text", "json"),
        key="format",
        option="log_format",
    )


@fast_dataclass
class ProcessSettings:
    """One table [process.NAME]."""

    agents: tuple[str, ...] = _process(
        (),
        "The agent kinds that the process evolves and shows.",
        form='`"module:Class"`, an installed name, or a list of them',
        shown=" ",
    )
    service: str = _process(
        "",
        "A generator or a device.",
        more="Every other key of the table is an argument of its constructor; see"
        " [services.md](services.md).",
        form='`"module:Class"` or an installed name',
        shown=" ",
    )
    command: tuple[str, ...] = _process(
        (),
        "A program that implements [PROTOCOL.md](../PROTOCOL.md).",
        more="It reads the world's name, the endpoint and its own name from `MINERVA_WORLD`,"
        " `MINERVA_CONNECT` and `MINERVA_NAME`. It runs in the world file's folder: a program with"
        " a `/` is relative to it, any other is searched in `PATH`.",
        shown=" ",
    )
    processes: int = _process(
        1,
        "Number of processes for each table of agents: `NAME-1`, `NAME-2`, ...; auto: by their"
        " number and the cores.",
        whole_or_auto(1, MAX_PROCESSES),
        option="processes",
        more="They divide the agents. In a file, services whose events go to single agents, such as"
        " `physics`, may have several, too; see [Distribute agents](howto/processes.md).",
    )
    on_failure: str = _process(
        "restart",
        "What happens when it fails: restart it while the frame waits, stop the world, or ignore"
        " the failure.",
        choice("restart", "stop", "ignore"),
    )
    elsewhere: bool = _process(
        False,
        "Start no members; attach them from other machines.",
        option="coordinator_only",
        more="The world waits for the process; start it with `minerva attach WORLD --process NAME`"
        " on its machine. `--coordinator-only` sets this for every process; see"
        " [fleet.md](fleet.md).",
    )
    restarts: int = _process(
        5,
        "Consecutive failures after which the world stops.",
        more="The delay before each restart grows (0.05 s, 0.1 s, ... 5 s); a process that is"
        " killed after ten frames of work is restarted at once. The count starts again after 30 s"
        " without a failure.",
    )
    speaks_for: tuple[str, ...] = _process(
        (),
        "The agents in whose name a generator may send events.",
        more="Events of other generators have no sender; an event with one violates the protocol."
        " See [security.md](security.md#senders-of-events).",
        form='kind, `"#ID"`, or a list of them',
        shown=" ",
    )


@fast_dataclass
class NormSettings:
    """One table [norm.NAME]; docs/norms.md explains them."""

    applies: tuple[str, ...] = _norm(
        (),
        "The agent kinds that the norm is about.",
        more="With `on` also names of processes, and `people`, see below.",
        form="agent kinds",
        shown="all",
    )
    on: tuple[str, ...] = _norm(
        (),
        "The events that the norm is about; none of them visual.",
        more="Without it, the norm is about states of agents.",
        form="event types",
        shown="none",
    )
    when: str = _norm("", "The condition that is forbidden.", form="condition", shown="always")
    where: object = _norm(
        "",
        "The area in which it is forbidden.",
        ANY,
        more="The corners are those of a rectangle for the attributes `x` and `y`.",
        form="condition, or `[x0, y0, x1, y1]`",
        shown="anywhere",
    )
    most: int = _norm(0, "Number of violations that are allowed in `per` frames.")
    per: int = _norm(1, "Length of the period for `most`, in frames.", whole(1))
    then: str = _norm(
        "refuse",
        "`refuse` rejects it; `sanction` allows it and sends `event`; `count` only counts it.",
        choice("refuse", "sanction", "count"),
    )
    event: str = _norm(
        "",
        "The event that the violator receives in the next frame.",
        more="Required for a sanction, allowed for a refusal.",
        form="event type",
    )
    data: object = _norm(
        None,
        "The data of the event.",
        TABLE,
        more="A field called `norm` gets the norm's name unless set here.",
        shown="`{}`",
    )
    in_force: bool = _norm(
        True,
        "false: the norm is checked, but not applied.",
        more='`in_force = "${norms}"` makes it an option.',
    )


@fast_dataclass
class CollectSettings:
    """The table [collect], without its expressions."""

    into: str = setting(
        "collect",
        "",
        "Write collected data into this file, .parquet or .csv.",
        option="into",
        more="Several tables go into several files, `FILE-TABLE.parquet`; see"
        " [python.md](python.md#collect-data).",
        form="file .parquet or .csv",
    )


@fast_dataclass
class PlacementSettings:
    """The table [placement], without its rules for agent kinds."""

    agents_per_host: int = setting(
        "placement", 0, "Maximum number of agents per host; 0: no limit."
    )


TABLES: Final = (
    WorldSettings,
    RecordSettings,
    BusSettings,
    PatienceSettings,
    WatchSettings,
    ProcessSettings,
    NormSettings,
    PlacementSettings,
    CollectSettings,
)


# --- the upper layer ---

OPTIONS: Final[Mapping[str, Setting]] = by_option(*TABLES)
"""The settings that have an option on the command line, by its name."""


@dataclass(frozen=True, slots=True, init=False)
class Overrides:
    """Settings of a command line: they replace those of the world file.

    `options` are the world's own options as text, `settings` texts PROCESS.KEY=VALUE, or
    SYMBOL.PARAMETER=VALUE for the string, `views` texts such as `svg:every=5`, `collect` texts
    NAME=EXPRESSION that replace the expressions of [collect]. With `only_code`, the services of the
    world file are not created: its agents' code answers questions about a record. `values` are
    the other settings that were given, by the names of their options:
    `Overrides(seed=3, record="run.mcap")`; None means not given. Values are converted when a world
    file is read. Raises MisuseError for a name that is not a setting.
    """

    options: Mapping[str, str]
    settings: tuple[str, ...]
    views: tuple[str, ...]
    collect: tuple[str, ...]
    only_code: bool
    values: Mapping[str, Any]

    def __init__(
        self,
        options: Mapping[str, str] | None = None,
        settings: tuple[str, ...] = (),
        views: tuple[str, ...] = (),
        collect: tuple[str, ...] = (),
        only_code: bool = False,
        **values: Any,
    ) -> None:
        check_known(values, OPTIONS)
        plain = {name: plain_value(value) for name, value in values.items()}
        given = {name: value for name, value in plain.items() if _given(name, value)}
        for name, value in (
            ("options", dict(options or {})),
            ("settings", tuple(settings)),
            ("views", tuple(views)),
            ("collect", tuple(collect)),
            ("only_code", only_code),
            ("values", given),
        ):
            object.__setattr__(self, name, value)

    def over(self, lower: Overrides) -> Overrides:
        """These settings, and those of a lower layer that are not given here."""
        return Overrides(
            {**lower.options, **self.options},
            # The upper layer comes last: of two settings of one key, the later one counts
            # (`settings_by_process`).
            (*lower.settings, *self.settings),
            (*lower.views, *self.views),
            self.collect or lower.collect,
            self.only_code or lower.only_code,
            **{**lower.values, **self.values},
        )


def _given(name: str, value: Any) -> bool:
    """Whether a value replaces that of the world file: an empty text may not."""
    return value is not None and value != () and (value != "" or OPTIONS[name].empty)


def plain_value(value: Any) -> Any:
    """A number of numpy as a Python object, other values unchanged."""
    # Without numpy, which commands that need no world do not import.
    scalar = type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0
    return value.item() if scalar else value


AS_WRITTEN: Final = Overrides()
"""No setting is replaced."""
