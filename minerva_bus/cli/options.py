"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.argument_order import WORLD
from minerva_bus.errors import MinervaError, MisuseError


def _choose_keys(keys: str) -> None:
    from minerva_bus.cli.places import choose_keys

    choose_keys(keys)  # Also if there are none: tests run several commands in one process.


def _choose_force(force: bool) -> bool:
    from minerva_bus.files import force_overwriting

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
        help="For tls/ endpoints: folder with your keys, or your certificate in it, NAME.pem.",
    ),
]
World = Annotated[
    str,
    typer.Option(help="Name of the world, if several run.", autocompletion=completing.running),
]
Views = Annotated[
    list[str] | None,
    typer.Option(
        "--view",
        help="Add a view: svg, or svg:path=FILE,every=N; may be repeated.",
        autocompletion=completing.views,
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="PROCESS.KEY=VALUE: set a key of a process; SYMBOL.NAME=VALUE or #ID.NAME=VALUE: a"
        " parameter of the string; may be repeated.",
    ),
]
Collect = Annotated[
    list[str] | None,
    typer.Option(
        help="NAME=EXPRESSION, such as 'sick=count(APerson, sick == true)'; may be repeated.",
    ),
]
WorldArgument = Annotated[
    str,
    typer.Argument(
        help="A world file, or an installed world's name.", autocompletion=completing.worlds
    ),
]
MovedWorld = Annotated[
    str,
    typer.Argument(
        help="World file or installed world, if the original one has moved.",
        autocompletion=completing.worlds,
    ),
]
By = Annotated[str, typer.Option("--as", help="Your name, for norms, the log and the record.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")]
Record = Annotated[Path, typer.Argument(help="A record, .mcap.", autocompletion=completing.records)]
Quiet = Annotated[bool, typer.Option(help="Print errors only.")]
QuietRun = Annotated[bool, typer.Option(help="Print errors and the output of members only.")]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How `minerva run` runs a world and what it prints."""

    in_process: Annotated[
        bool, typer.Option(help="Run all members in one process, without a bus.")
    ] = False
    json: Json = False
    quiet: QuietRun = False
    profile: Annotated[
        bool, typer.Option("--profile", help="Report how the time of a frame is spent.")
    ] = False
    profile_member: Annotated[
        str, typer.Option(help="Profile this member's code; writes a page WORLD-MEMBER.html.")
    ] = ""
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Show full tracebacks of errors in a member's code.")
    ] = False


@dataclass(frozen=True, slots=True)
class WorldTarget:
    """The running world that a command addresses; `keys` takes effect by its callback."""

    connect: Connect = ""
    keys: Keys = ""
    world: World = ""


@dataclass(frozen=True, slots=True)
class NamedTarget(WorldTarget):
    """A running world that may be named without --world: the name is the first word.

    Raises MisuseError for two names.
    """

    name: Annotated[
        str,
        typer.Argument(
            metavar=WORLD,
            help="Name of the world, if several run; like --world.",
            autocompletion=completing.running,
        ),
    ] = ""

    def __post_init__(self) -> None:
        if self.name and self.world and self.name != self.world:
            raise MisuseError(f"which world: {self.name!r} or --world {self.world!r}? Give one")
        object.__setattr__(self, "world", self.name or self.world)


@dataclass(frozen=True, slots=True)
class JoinOptions(WorldTarget):
    """How a new member joins a world."""

    name: Annotated[
        str,
        typer.Option(
            help="Name of the new member; default: that of its certificate, or a generated one."
        ),
    ] = ""
    keep_trying: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Seconds to try to reconnect; default: 600, on the world's machine 5."
        ),
    ] = None
    json: Json = False
    force: Force = False


Command = TypeVar("Command", bound=Callable[..., None])


def examples(*lines: str) -> Callable[[Command], Command]:
    """Give a command examples for its help."""

    def mark(command: Command) -> Command:
        command.__dict__["examples"] = lines
        return command

    return mark


def examples_of(command: Callable[..., None]) -> tuple[str, ...]:
    """The examples of a command."""
    return command.__dict__["examples"]


# --- groups of options ---


def options_of(words: list[str]) -> dict[str, str]:
    """Parse `--name value` and `--name=value`, which typer does not know. Raises MinervaError."""
    options: dict[str, str] = {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        name, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or not name:
            raise MinervaError(f"what is {word!r}? Expected options such as --name value")
        if not equals:
            if not rest:
                raise MinervaError(f"--{name} needs a value")
            value = rest.pop(0)
        options[name.replace("-", "_")] = value
    return options
