"""Completion of running worlds: their names, members and event types."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import typer

from minerva_bus.cli.completing import Choices, completer

if TYPE_CHECKING:
    from minerva_bus.grammar.vocabulary import Vocabulary
    from minerva_bus.runtime.client import Client


CONNECT_SECONDS: Final = 1.0
"""Time-out for the connection to a world at another address."""


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
    given["world"] = given["world"] or str(ctx.params.get("name") or "")
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
