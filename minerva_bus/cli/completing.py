"""Completion of files and of what is installed: each function returns values with descriptions.

They are called for each press of Tab. So they import what they need, run no code of a world unless
its symbols are needed, and answer with nothing if anything goes wrong.
"""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, Final, TypeAlias

import typer

Choices: TypeAlias = Iterable[tuple[str, str]]
Completer: TypeAlias = Callable[[typer.Context, str], list[tuple[str, str]]]

_FILE_OPTIONS: Final = ("file", "path", "source")
"""Ends of the names of services' options that are files."""
ANSWER_SECONDS: Final = 10
"""Time-out for everything: a world that does not answer must not block the shell."""


CODE_SECONDS: Final = 2
"""Time-out for the modules of a world, which may do anything when they are imported."""
CODE_VARIABLE: Final = "MINERVA_COMPLETION_SECONDS"
"""Environment variable with another time-out in whole seconds, for a slow machine."""


@contextmanager
def running_code() -> Generator[None]:
    """End the process without an answer if this block, which runs code of a world, takes long."""
    left = signal.alarm(int(os.environ.get(CODE_VARIABLE) or CODE_SECONDS))
    try:
        yield
    finally:
        signal.alarm(left)


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
def worlds_and_records(ctx: typer.Context, incomplete: str) -> Choices:
    """Installed worlds, world files and records."""
    from minerva_bus.launch.installed import installed_worlds

    yield from installed_worlds().items()
    yield from paths(incomplete, ".toml", ".mcap")


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
    """Services that connect sensors: all that are not views, physics or input of this package."""
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
        values = service_option_values(name, option, value)
        return [(f"{start}{option}={each}", text) for each, text in values]
    used = {word.partition("=")[0] for word in given.split(",")}
    return [
        (f"{start}{each}=", text)
        for each, text in service_options(name).items()
        if each not in used
    ]


def _sorted(entries: Any) -> list[tuple[str, Any]]:
    return sorted(entries.items())


def service_options(name: str) -> dict[str, str]:
    """The options of an installed service, with their descriptions, without importing it."""
    from minerva_bus.cli.signatures import options_of_service

    return {option: signature.text for option, signature in options_of_service(name).items()}


def service_option_values(service: str, name: str, incomplete: str) -> Choices:
    """true and false, or files, if the option of a service takes them."""
    from minerva_bus.cli.signatures import options_of_service

    name = name.replace("-", "_")
    option = options_of_service(service).get(name)
    if option is not None and option.annotation == "bool":
        return [("true", ""), ("false", "")]
    is_file = option is not None and name.endswith(_FILE_OPTIONS)
    return paths(incomplete, "") if is_file else ()
