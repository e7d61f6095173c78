"""Completion of the options of worlds and services, for their commands and for studies."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from minerva_bus.cli.completing import (
    Choices,
    completer,
    paths,
    running_code,
    service_option_values,
    service_options,
)
from minerva_bus.input_files import read_text

if TYPE_CHECKING:
    from minerva_bus.grammar.vocabulary import Vocabulary


@completer
def world_flags(ctx: typer.Context, incomplete: str) -> Choices:
    """The own options of a world, for its command, without running its code."""
    return [(f"--{name}", text) for name, text in _world_options(_world_of(ctx)).items()]


@completer
def service_flags(ctx: typer.Context, incomplete: str) -> Choices:
    """The options of an installed service, without importing it; with --process, of a world."""
    spec = _argument(ctx, "spec", "kind")
    options = _world_options(spec) if ctx.params.get("process") else service_options(spec)
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
    return service_option_values(spec, option, incomplete)


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
    if not ctx.params.get("world"):
        ctx.params["world"] = _recorded(ctx.params["file"])
    yield from swept(ctx, incomplete)


@completer
def ranged(ctx: typer.Context, incomplete: str) -> Choices:
    """As `swept` without the seed, for a world or the world of a record."""
    spec = _world_of(ctx)
    if spec.endswith(".mcap"):
        ctx.params["world"] = _recorded(spec)
    yield from (choice for choice in swept(ctx, incomplete) if choice[0] != "seed=")


def _recorded(path: str) -> str:
    """The world file that a record names."""
    from minerva_bus.log.reader import Record

    with Record(Path(path)) as record:
        return record.description.path


def _process_keys(spec: str) -> Iterator[tuple[str, str]]:
    import tomllib

    from minerva_bus.launch.installed import find_world

    tables = tomllib.loads(read_text(find_world(spec))).get("process", {})
    for name, table in tables.items():
        known = dict.fromkeys([*table], "")
        service = table.get("service", "")
        if service and ":" not in service:
            known |= service_options(service)
        fixed = ("service", "agents", "command")
        yield from ((f"{name}.{key}", text) for key, text in known.items() if key not in fixed)


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

    with running_code():
        return World.load(spec).vocabulary
