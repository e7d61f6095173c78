"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from minerva_bus.errors import MisuseError

UNKNOWN_TOO: Final = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Of a command that takes a world's or a service's own options, too (`words.options_of`)."""


def _choose_keys(keys: str) -> None:
    from minerva_bus.cli.places import choose_keys

    choose_keys(keys)  # None too: a process may give several commands, one after another.


def _choose_force(force: bool) -> bool:
    from minerva_bus.outputs import force_overwriting

    force_overwriting(force)
    return force


Force = Annotated[
    bool,
    typer.Option(
        "--force",
        envvar="MINERVA_FORCE",
        callback=_choose_force,
        help="Overwrite output files that Minerva Bus did not write.",
    ),
]
Connect = Annotated[
    str, typer.Option(help="Endpoint of the world, such as tcp/HOST:PORT; default: this machine.")
]
Keys = Annotated[
    str,
    typer.Option(
        envvar="MINERVA_KEYS",
        callback=_choose_keys,
        help="For tls/ endpoints: folder of your keys, or your certificate in it, NAME.pem.",
    ),
]
World = Annotated[str, typer.Option(help="Name of the world, where several run.")]
KeepTrying = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        help="Seconds to look for a world out of sight; default: 600, on its own machine 5.",
    ),
]
Views = Annotated[
    list[str] | None,
    typer.Option("--view", help="Add a view: svg, or svg:path=FILE,every=N; may be repeated."),
]
Listen = Annotated[str, typer.Option(help="Where to listen, such as tls/0.0.0.0:7447.")]
RunKeys = Annotated[
    str, typer.Option("--keys", help="Folder of those who may come in from elsewhere (tls/).")
]
Routers = Annotated[
    list[str] | None, typer.Option(help="A Zenoh router to join, tls/HOST:PORT; may be repeated.")
]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Let in whoever can reach it, without certificates.")
]
Audit = Annotated[
    bool, typer.Option("--audit", help="With --keys: name and count what Zenoh itself drops.")
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="PROCESS.KEY=VALUE of a process.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")]
Quiet = Annotated[bool, typer.Option(help="Say only what goes wrong.")]


def chosen(name: str, world: str) -> str:
    """The world that a command's only word or its --world names. Raises MisuseError for two."""
    if name and world and name != world:
        raise MisuseError(f"which world: {name!r} or --world {world!r}? Give one of them")
    return name or world
