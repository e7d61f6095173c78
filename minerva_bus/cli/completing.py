"""Completion of names and files: each function returns values with descriptions.

They are called for each press of Tab. So they import what they need, run no code of a world, and
answer with nothing if anything goes wrong.
"""

from __future__ import annotations

import signal
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import typer

if TYPE_CHECKING:
    from minerva_bus.grammar.vocabulary import Vocabulary
    from minerva_bus.runtime.operator_client import Client


Choices: TypeAlias = Iterable[tuple[str, str]]
Completer: TypeAlias = Callable[[typer.Context, str], list[tuple[str, str]]]

ANSWER_SECONDS: Final = 10
"""Time-out for everything: a world that does not answer must not block the shell."""

CONNECT_SECONDS: Final = 1.0
"""Time-out for the connection to a world at another address."""

_FILE_OPTIONS: Final = ("file", "path", "source")
"""Ends of the names of services' options that are files."""


def completer(find: Callable[[typer.Context, str], Choices]) -> Completer:
    """Make a completion function: it keeps what begins with the given text, and never fails."""

    @wraps(find)
    def complete(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
        # Ends the process, whatever it waits for; nothing has been printed by then.
        signal.alarm(ANSWER_SECONDS)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
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


def _files(*endings: str) -> Completer:
    return completer(lambda ctx, incomplete: paths(incomplete, *endings))


records = _files(".mcap")
tables = _files(".csv", ".parquet")
recordings = _files(".log", ".clf", ".bag", ".db3", ".mcap")
strings_and_worlds = _files(".mnv", ".toml")


# --- what is installed ---


@completer
def installed(ctx: typer.Context, incomplete: str) -> Choices:
    """Installed worlds."""
    from minerva_bus.launch.installed import installed_worlds

    return installed_worlds().items()


@completer
def worlds(ctx: typer.Context, incomplete: str) -> Choices:
    """Installed worlds and world files."""
    return [*installed(ctx, incomplete), *paths(incomplete, ".toml")]


@completer
def members_to_attach(ctx: typer.Context, incomplete: str) -> Choices:
    """Services and agents, or world files with --process."""
    from minerva_bus.entry_points import entries
    from minerva_bus.launch.installed import AGENTS, SERVICES

    if ctx.params.get("process"):
        return worlds(ctx, incomplete)
    groups = [sorted(entries(group).items()) for group in (SERVICES, AGENTS)]
    return [(name, entry.value) for group in groups for name, entry in group]


@completer
def views(ctx: typer.Context, incomplete: str) -> Choices:
    """Services that are views."""
    from minerva_bus.entry_points import entries
    from minerva_bus.launch.installed import SERVICES, installed_views

    return [(view, entries(SERVICES)[view].value) for view in installed_views()]


# --- options of worlds and services, beside those of a command ---


@completer
def world_flags(ctx: typer.Context, incomplete: str) -> Choices:
    """The own options of a world, for its command, without running its code."""
    return _world_flags(_argument(ctx, "world"))


@completer
def service_flags(ctx: typer.Context, incomplete: str) -> Choices:
    """The options of an installed service; with --process, of a world."""
    from minerva_bus.launch.specs import described

    spec = _argument(ctx, "spec", "kind")
    if ctx.params.get("process"):
        return _world_flags(spec)
    return [(line.split()[0], text) for line, text in described(_installed_service(spec))]


@completer
def world_values(ctx: typer.Context, incomplete: str) -> Choices:
    """The values of a world's option, which is the last word of its command."""
    return _world_values(_argument(ctx, "world"), _last_option(ctx), incomplete)


@completer
def service_values(ctx: typer.Context, incomplete: str) -> Choices:
    """The values of a service's option, as of a world's; with --process, of a world."""
    from minerva_bus.launch.specs import find_service

    spec, name = _argument(ctx, "spec", "kind"), _last_option(ctx)
    if ctx.params.get("process"):
        return _world_values(spec, name, incomplete)
    kind = find_service(_installed_service(spec)).__init__.__annotations__.get(name)
    if kind in ("bool", bool):
        return [("true", ""), ("false", "")]
    return paths(incomplete, "") if kind and name.endswith(_FILE_OPTIONS) else ()


def _installed_service(name: str) -> str:
    """The name of an installed service: no other code is run. Raises KeyError for others."""
    from minerva_bus.entry_points import entries
    from minerva_bus.launch.installed import SERVICES

    return entries(SERVICES)[name].name


def _world_flags(spec: str) -> Choices:
    from minerva_bus.launch.installed import declared_options

    return [(f"--{option.name}", option.help_line()[1]) for option in declared_options(spec)]


def _world_values(spec: str, name: str, incomplete: str) -> Choices:
    """All values of a world's option, or files, of which any other text may be one."""
    from minerva_bus.launch.installed import declared_options

    option = {option.name: option for option in declared_options(spec)}.get(name)
    if option is None:
        return ()
    if option.choices:
        return [(value, "") for value in option.choices]
    return paths(incomplete, "") if isinstance(option.default, str) else ()


def _argument(ctx: typer.Context, *names: str) -> str:
    """The first argument of a command, which has one of these names."""
    for name in names:
        if ctx.params.get(name):
            return str(ctx.params[name])
    # The parser stops at an option that lacks its value, which is the one to complete.
    return next((word for word in ctx.args if not word.startswith("-")), "")


def _last_option(ctx: typer.Context) -> str:
    """The name of the option whose value is completed; empty for none."""
    last = ctx.args[-1] if ctx.args else ""
    return last.removeprefix("--").replace("-", "_") if last.startswith("--") else ""


# --- running worlds ---


@completer
def running(ctx: typer.Context, incomplete: str) -> Choices:
    """Worlds that run on this machine."""
    from minerva_bus.launch.registry import running as registered

    return [(world.world, world.endpoint) for world in registered()]


@completer
def members(ctx: typer.Context, incomplete: str) -> Choices:
    """Members of a running world."""
    with _client(ctx) as connected:
        status = connected.operator.status()
    return [(member.name, " ".join(member.roles)) for member in status.members]


@completer
def event_types(ctx: typer.Context, incomplete: str) -> Choices:
    """Event types of a running world."""
    return _event_types(_running_vocabulary(ctx))


@completer
def event_types_and_kinds(ctx: typer.Context, incomplete: str) -> Choices:
    """Event types and kinds of agents of a running world."""
    vocabulary = _running_vocabulary(ctx)
    return [*_event_types(vocabulary), *((name, "agents") for name in sorted(vocabulary.kinds))]


def _event_types(vocabulary: Vocabulary) -> list[tuple[str, str]]:
    return [
        (name, ", ".join(f"{each.name}: {each.type}" for each in event.fields.all))
        for name, event in sorted(vocabulary.events.items())
    ]


def _running_vocabulary(ctx: typer.Context) -> Vocabulary:
    with _client(ctx) as connected:
        return connected.vocabulary()


@contextmanager
def _client(ctx: typer.Context) -> Generator[Client]:
    from minerva_bus.cli.options import WorldTarget
    from minerva_bus.cli.places import choose_keys, client
    from minerva_bus.runtime.endpoints import check_endpoint, check_reachable

    given = {key: str(ctx.params.get(key) or "") for key in ("connect", "keys", "world")}
    given["world"] = given["world"] or str(ctx.params.get("name") or "")
    choose_keys(given["keys"])
    if given["connect"]:
        # A command waits for a world that may be restarting; Tab must not.
        check_reachable(check_endpoint(given["connect"]), CONNECT_SECONDS)
    with client(WorldTarget(**given)) as connected:
        yield connected
