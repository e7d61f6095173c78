"""Completion of arguments and options: each function returns values with their descriptions.

They are called for each press of Tab. So they import what they need, run no code of a world unless
its symbols are needed, and answer with nothing if anything goes wrong.
"""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import typer

if TYPE_CHECKING:
    from minerva_bus.grammar.vocabulary import Vocabulary
    from minerva_bus.runtime.client import Client

Choices: TypeAlias = Iterable[tuple[str, str]]
Completer: TypeAlias = Callable[[typer.Context, str], list[tuple[str, str]]]

_FILE_OPTIONS: Final = ("file", "path", "source")
"""Ends of the names of services' options that are files."""
ANSWER_SECONDS: Final = 10
"""Time-out for everything: a world that does not answer must not block the shell."""

CONNECT_SECONDS: Final = 1.0
"""Time-out for the connection to a world at another address."""


def completer(find: Callable[[typer.Context, str], Choices]) -> Completer:
    """Make a completion function: it keeps what begins with the given text, and never fails."""

    @wraps(find)
    def complete(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
        # Ends the process, whatever it waits for; nothing has been printed by then.
        signal.alarm(ANSWER_SECONDS)
        try:
            choices = list(find(ctx, incomplete))
        except Exception:
            # A message would appear in the middle of the command line.
            return []
        finally:
            signal.alarm(0)
        return [choice for choice in choices if choice[0].startswith(incomplete)]

    return complete


# --- files ---


def paths(incomplete: str, *endings: str) -> Iterator[tuple[str, str]]:
    """Files with one of these endings, and folders, below the given beginning of a path.

    A folder that is the only choice is replaced by its content, because shells append a space.
    """
    while True:
        head, slash, start = incomplete.rpartition("/")
        folder = Path(f"{head}{slash}" or ".").expanduser()
        names: list[str] = []
        for entry in sorted(folder.iterdir()):
            hidden = entry.name.startswith(".") and not start.startswith(".")
            if not entry.name.startswith(start) or hidden:
                continue
            if entry.is_dir():
                names.append(f"{head}{slash}{entry.name}/")
            elif entry.name.endswith(endings):
                names.append(f"{head}{slash}{entry.name}")
        if len(names) != 1 or not names[0].endswith("/") or names[0] == incomplete:
            break
        incomplete = names[0]
    yield from ((name, "") for name in names)


@completer
def records(ctx: typer.Context, incomplete: str) -> Choices:
    """Records."""
    return paths(incomplete, ".mcap")


@completer
def tables(ctx: typer.Context, incomplete: str) -> Choices:
    """Tables of collected data."""
    return paths(incomplete, ".csv", ".parquet")


@completer
def recordings(ctx: typer.Context, incomplete: str) -> Choices:
    """Recordings of sensors."""
    return paths(incomplete, ".log", ".clf", ".bag", ".db3", ".mcap")


@completer
def checked(ctx: typer.Context, incomplete: str) -> Choices:
    """Strings and world files."""
    return paths(incomplete, ".mnv", ".toml")


# --- what is installed ---


@completer
def worlds(ctx: typer.Context, incomplete: str) -> Choices:
    """Installed worlds and world files."""
    from minerva_bus.launch.installed import installed_worlds

    yield from installed_worlds().items()
    yield from paths(incomplete, ".toml")


@completer
def permissions(ctx: typer.Context, incomplete: str) -> Choices:
    """Permissions of `minerva mcp`."""
    from minerva_bus.mcp.permissions import PERMISSIONS

    return PERMISSIONS.items()


@completer
def installed(ctx: typer.Context, incomplete: str) -> Choices:
    """Installed worlds."""
    from minerva_bus.launch.installed import installed_worlds

    return installed_worlds().items()


@completer
def new_kinds(ctx: typer.Context, incomplete: str) -> Choices:
    """What `minerva new` creates."""
    return [(kind, "") for kind in ("world", "agent", "service", "geometry", "bridge")]


@completer
def conformance_roles(ctx: typer.Context, incomplete: str) -> Choices:
    """Roles in the conformance suite."""
    from minerva_bus.testing.conformance.case import CoordinatorRole
    from minerva_bus.testing.conformance.world import MemberRole

    return [(role.value, "") for role in (*MemberRole, *CoordinatorRole)]


@completer
def conformance_cases(ctx: typer.Context, incomplete: str) -> Choices:
    """Cases of the conformance suite."""
    from minerva_bus.testing.conformance.cases import CASES

    return [(case.id, case.title) for case in CASES]


@completer
def members_to_attach(ctx: typer.Context, incomplete: str) -> Choices:
    """Services and agents, or world files with --process."""
    from minerva_bus.launch.installed import AGENTS, SERVICES, entries

    if ctx.params.get("process"):
        return worlds(ctx, incomplete)
    return [(name, entry.value) for g in (SERVICES, AGENTS) for name, entry in _sorted(entries(g))]


@completer
def bridges(ctx: typer.Context, incomplete: str) -> Choices:
    """Services that connect sensors: all that are no views, physics or input of this package."""
    others = ("minerva_services.views.", "minerva_services.physics.", "minerva_services.input.")
    from minerva_bus.launch.installed import SERVICES, entries

    return [
        (name, entry.value)
        for name, entry in _sorted(entries(SERVICES))
        if not entry.value.startswith(others)
    ]


@completer
def views(ctx: typer.Context, incomplete: str) -> Choices:
    """Views with their options: `svg`, `svg:path=FILE,every=N`."""
    name, colon, rest = incomplete.partition(":")
    if not colon:
        from minerva_bus.launch.installed import SERVICES, entries, installed_views

        return [(view, entries(SERVICES)[view].value) for view in installed_views()]
    given, comma, last = rest.rpartition(",")
    start = f"{name}:{given}{comma}"
    option, equals, value = last.partition("=")
    if equals:
        values = _service_option_values(name, option, value)
        return [(f"{start}{option}={each}", text) for each, text in values]
    used = {word.partition("=")[0] for word in given.split(",")}
    return [
        (f"{start}{each}=", text)
        for each, text in _service_options(name).items()
        if each not in used
    ]


def _sorted(entries: Any) -> list[tuple[str, Any]]:
    return sorted(entries.items())


def _service_options(name: str) -> dict[str, str]:
    from minerva_bus.cli.signatures import options_of_service

    return {option: signature.text for option, signature in options_of_service(name).items()}


def _service_option_values(service: str, name: str, incomplete: str) -> Choices:
    """true and false, or files, if the option of a service takes them."""
    from minerva_bus.cli.signatures import options_of_service

    name = name.replace("-", "_")
    option = options_of_service(service).get(name)
    if option is not None and option.annotation == "bool":
        return [("true", ""), ("false", "")]
    is_file = option is not None and name.endswith(_FILE_OPTIONS)
    return paths(incomplete, "") if is_file else ()


# --- options of worlds and services ---


@completer
def world_flags(ctx: typer.Context, incomplete: str) -> Choices:
    """The own options of a world, for its command, without running its code."""
    return [(f"--{name}", text) for name, text in _world_options(_world_of(ctx)).items()]


@completer
def service_flags(ctx: typer.Context, incomplete: str) -> Choices:
    """The options of an installed service, without importing it; with --process, of a world."""
    spec = _argument(ctx, "spec", "kind")
    options = _world_options(spec) if ctx.params.get("process") else _service_options(spec)
    return [(f"--{name}", text) for name, text in options.items()]


@completer
def world_values(ctx: typer.Context, incomplete: str) -> Choices:
    """The values of a world's option, which is the last word of its command."""
    option = _last_option(ctx)
    return _option_values(_world_of(ctx), option, incomplete) if option else ()


@completer
def service_values(ctx: typer.Context, incomplete: str) -> Choices:
    """The values of a service's option, as of a world's; with --process, of a world."""
    option, spec = _last_option(ctx), _argument(ctx, "spec", "kind")
    if not option:
        return ()
    if ctx.params.get("process"):
        return _option_values(spec, option, incomplete)
    return _service_option_values(spec, option, incomplete)


def _last_option(ctx: typer.Context) -> str:
    """The name of the option whose value is completed; empty for none."""
    last = ctx.args[-1] if ctx.args else ""
    return last.removeprefix("--") if last.startswith("--") else ""


def _option_values(spec: str, name: str, incomplete: str) -> Choices:
    """All values of a world's option, or files, of which any other text may be one."""
    from minerva_bus.launch.installed import declared_options

    options = {option.name: option for option in declared_options(spec)}
    option = options.get(name.replace("-", "_"))
    if option is None:
        return ()
    if option.choices:
        return [(value, "") for value in option.choices]
    return paths(incomplete, "") if isinstance(option.default, str) else ()


def _world_options(spec: str) -> dict[str, str]:
    from minerva_bus.launch.installed import declared_options

    return {option.name: option.help_line()[1] for option in declared_options(spec)}


def _world_of(ctx: typer.Context) -> str:
    return _argument(ctx, "world")


def _argument(ctx: typer.Context, *names: str) -> str:
    """The first argument of a command, which has one of these names."""
    for name in names:
        if ctx.params.get(name):
            return str(ctx.params[name])
    # The parser stops at an option that lacks its value, which is the one to complete.
    return next((word for word in ctx.args if not word.startswith("-")), "")


@completer
def process_settings(ctx: typer.Context, incomplete: str) -> Choices:
    """PROCESS.KEY= of a world, for `--set`."""
    return [(f"{key}=", text) for key, text in _process_keys(_world_of(ctx))]


@completer
def swept(ctx: typer.Context, incomplete: str) -> Choices:
    """KEY= of a sweep: options of the world, its seed, and PROCESS.KEY; values of options."""
    spec = _world_of(ctx)
    name, equals, values = incomplete.partition("=")
    if equals:
        before, comma, last = values.rpartition(",")
        start = f"{name}={before}{comma}"
        yield from ((start + value, text) for value, text in _option_values(spec, name, last))
        return
    yield "seed=", "The seed of the world."
    yield from ((f"{name}=", text) for name, text in _world_options(spec).items())
    yield from ((f"{key}=", text) for key, text in _process_keys(spec))


@completer
def branched(ctx: typer.Context, incomplete: str) -> Choices:
    """As `swept`, for the world of a record."""
    from minerva_bus.log.reader import Record

    if not ctx.params.get("world"):
        with Record(Path(ctx.params["file"])) as record:
            ctx.params["world"] = record.description.path
    yield from swept(ctx, incomplete)


def _process_keys(spec: str) -> Iterator[tuple[str, str]]:
    import tomllib

    from minerva_bus.launch.installed import find_world

    tables = tomllib.loads(find_world(spec).read_text(encoding="utf-8")).get("process", {})
    for name, table in tables.items():
        known = dict.fromkeys([*table], "")
        service = table.get("service", "")
        if service and ":" not in service:
            known |= _service_options(service)
        fixed = ("service", "agents", "command")
        yield from ((f"{name}.{key}", text) for key, text in known.items() if key not in fixed)


# --- running worlds ---


@completer
def running(ctx: typer.Context, incomplete: str) -> Choices:
    """Worlds that run on this machine."""
    from minerva_bus.launch.registry import running as registered

    return [(world.world, world.endpoint) for world in registered()]


@contextmanager
def _client(ctx: typer.Context) -> Generator[Client]:
    from minerva_bus.cli.options import WorldTarget
    from minerva_bus.cli.places import choose_keys, client
    from minerva_bus.runtime.diagnosis import check_reachable
    from minerva_bus.runtime.endpoints import check_endpoint

    given = {key: str(ctx.params.get(key) or "") for key in ("connect", "keys", "world")}
    choose_keys(given["keys"])
    if given["connect"]:
        # A command waits for a world that may be restarting; Tab must not.
        check_reachable(check_endpoint(given["connect"]), CONNECT_SECONDS)
    with client(WorldTarget(**given)) as connected:
        yield connected


@completer
def members(ctx: typer.Context, incomplete: str) -> Choices:
    """Members of a running world: for `restart` its own processes, for `drain` its hosts."""
    with _client(ctx) as connected:
        status = connected.operator.status()
    command = ctx.info_name
    for member in status.members:
        wanted = {"restart": member.expected, "drain": "agents" in member.roles}
        if wanted.get(command or "", True):
            yield member.name, " ".join(member.roles)


@completer
def published(ctx: typer.Context, incomplete: str) -> Choices:
    """Event types of a running world."""
    return _event_types(_running_vocabulary(ctx))


@completer
def echoed(ctx: typer.Context, incomplete: str) -> Choices:
    """Event types and kinds of agents of a running world."""
    vocabulary = _running_vocabulary(ctx)
    return [*_event_types(vocabulary), *((name, "agents") for name in sorted(vocabulary.kinds))]


@completer
def event_data(ctx: typer.Context, incomplete: str) -> Choices:
    """KEY= of the event that is published; words of a text type, true and false."""
    vocabulary = _running_vocabulary(ctx)
    event = vocabulary.events.get(str(ctx.params.get("type")))
    given = {str(word).partition("=")[0] for word in ctx.params.get("data") or ()}
    for each in () if event is None else event.fields.all:
        words = each.type.words or (("true", "false") if each.type.kind == "bool" else ())
        if incomplete.startswith(f"{each.name}=") and words:
            yield from ((f"{each.name}={word}", "") for word in words)
        elif each.name not in given:
            yield f"{each.name}=", str(each.type)


def _event_types(vocabulary: Vocabulary) -> list[tuple[str, str]]:
    return [
        (name, ", ".join(f"{each.name}: {each.type}" for each in event.fields.all))
        for name, event in sorted(vocabulary.events.items())
    ]


def _running_vocabulary(ctx: typer.Context) -> Vocabulary:
    with _client(ctx) as connected:
        return connected.vocabulary()


# --- collected expressions ---

_AGGREGATES: Final = ("count", "mean", "sum", "min", "max", "quantiles", "histogram")
_LAST_NAME: Final = re.compile(r"[\w.]*$")


@completer
def collected(ctx: typer.Context, incomplete: str) -> Choices:
    """NAME=EXPRESSION: aggregates, kinds of agents, event types and their attributes."""
    name, equals, text = incomplete.partition("=")
    if not equals:
        return
    match = _LAST_NAME.search(text)
    last = match.group() if match is not None else ""
    start = f"{name}={text.removesuffix(last)}"
    vocabulary = _vocabulary(ctx)
    symbols = {**vocabulary.kinds, **vocabulary.events}
    symbol, dot, _ = last.partition(".")
    if dot:
        fields = symbols[symbol].fields.all if symbol in symbols else ()
        yield from ((f"{start}{symbol}.{each.name}", str(each.type)) for each in fields)
        return
    if "(" not in text:
        yield from ((f"{start}{each}(", "for each frame") for each in _AGGREGATES)
    yield from ((f"{start}{each}", "") for each in sorted(symbols))


def _vocabulary(ctx: typer.Context) -> Vocabulary:
    """The vocabulary of a command's record, which needs no code, or of its world."""
    spec = _argument(ctx, "file", "world")
    if spec.endswith(".mcap"):
        from minerva_bus.log.reader import Record

        with Record(Path(spec)) as record:
            return record.description.world.vocabulary
    from minerva_bus.api.world import World

    return World.load(spec).vocabulary
