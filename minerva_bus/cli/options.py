"""Options that several commands share, and groups of them: one parameter for many options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import fields
from functools import cache, wraps
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, get_origin, get_type_hints

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.command_classes import ALL, WORLD
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.settings.world_settings import OPTIONS, Overrides
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import NO_VALUE


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
    str, typer.Option(help="Name of the world, if several run.", autocompletion=completing.running)
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
        help="PROCESS.KEY=VALUE: set a key of a process (KEY.KEY of a table); SYMBOL.NAME=VALUE or"
        " #ID.NAME=VALUE: a parameter of the string; may be repeated.",
    ),
]
Collect = Annotated[
    list[str] | None,
    typer.Option(
        help="NAME=EXPRESSION, such as 'sick=count(APerson, sick == true)'; may be repeated."
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


@fast_dataclass
class RunOptions:
    """How `minerva run` runs a world and what it prints; its class answers `help_all`."""

    help_all: Annotated[bool, typer.Option(ALL, help="Show all options and exit.")] = False
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


@fast_dataclass
class WorldTarget:
    """The running world that a command addresses; `keys` takes effect by its callback."""

    connect: Connect = ""
    keys: Keys = ""
    world: World = ""


@fast_dataclass
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


@fast_dataclass
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


def by_comma(words: Iterable[str] | None) -> tuple[str, ...]:
    """The words of an option that is repeated, or has several words separated by commas."""
    parts = [part.strip() for word in words or () for part in word.split(",")]
    return tuple([part for part in parts if part])


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


def options_of(words: list[str]) -> dict[str, str]:
    """Parse `--name value` and `--name=value`, which typer does not know. Raises MinervaError."""
    options: dict[str, str] = {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        name, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or not name:
            raise MinervaError(f"unexpected word {word!r}: write options as --name value")
        if not equals:
            # Whoever knows the options reports a missing value, or that there is no such option.
            value = rest.pop(0) if rest and not rest[0].startswith("--") else NO_VALUE
        options[name.replace("-", "_")] = value
    return options


# --- groups of options ---

Parameter = inspect.Parameter


class Takes:
    """The settings that a command takes as options, by name, in the order of its help."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def parameters(self) -> list[Parameter]:
        """A parameter for each option."""
        # None means that the option is not given, so the world file's value stays.
        return [_keyword(name, None, self._annotation(name)) for name in self.names]

    def _annotation(self, name: str) -> Any:
        if name in _LISTS:
            return _LISTS[name]
        setting = OPTIONS[name]
        python: Any = list[str] if setting.kind.repeats else setting.kind.python
        # With the negative form, a command line can also switch off what the world file switches
        # on.
        flag = f"{setting.flag}/--no-{setting.flag[2:]}" if python is bool else setting.flag
        text = setting.help.replace("`", "")
        complete = _COMPLETERS.get(name)
        return Annotated[python | None, typer.Option(flag, help=text, autocompletion=complete)]

    def collect(self, values: dict[str, Any]) -> Overrides:
        """The settings that were given, taken out of the values of all parameters."""
        given = {name: values.pop(name) for name in self.names}
        settings, views, collect = [tuple(given.pop(name, None) or ()) for name in _LISTS]
        for name, value in given.items():
            if OPTIONS[name].kind.repeats and value is not None:
                given[name] = by_comma(value)
        return Overrides(None, settings, views, collect, **given)


_COMPLETERS: Final = {"into": completing.tables, "record": completing.records}


_LISTS: Final[dict[str, Any]] = {"set_": Settings, "view": Views, "collect": Collect}


def _keyword(name: str, default: Any, annotation: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


class _Fields:
    """The options that the fields of a dataclass declare."""

    def __init__(self, cls: type[Any]) -> None:
        self._cls = cls

    def parameters(self) -> list[Parameter]:
        hints = _hints(self._cls)
        return [_keyword(each.name, each.default, hints[each.name]) for each in fields(self._cls)]

    def collect(self, values: dict[str, Any]) -> Any:
        return self._cls(**{each.name: values.pop(each.name) for each in fields(self._cls)})


@cache
def _hints(cls: type[Any]) -> dict[str, Any]:
    """The annotations of a dataclass; cached, because many commands share one."""
    return get_type_hints(cls, include_extras=True)


def _names_world(parameter: Parameter) -> bool:
    """Whether a parameter is the argument that is before all others."""
    metadata = getattr(parameter.annotation, "__metadata__", ())
    return any(getattr(each, "metavar", None) == WORLD for each in metadata)


def _group(annotation: Any) -> Takes | _Fields | None:
    if get_origin(annotation) is Annotated and isinstance(annotation.__metadata__[0], Takes):
        return annotation.__metadata__[0]
    is_group = isinstance(annotation, type) and hasattr(annotation, "__dataclass_fields__")
    return _Fields(annotation) if is_group else None


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command take many options as few parameters.

    A parameter `Annotated[Overrides, Takes(...)]` stands for the options of settings, one that is
    annotated with a dataclass for an option of each field.
    """
    hints = get_type_hints(command, include_extras=True)
    parameters: list[Parameter] = []
    groups: dict[str, Takes | _Fields] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        group = _group(hints[name])
        if group is None:
            parameters.append(_keyword(name, parameter.default, hints[name]))
        else:
            groups[name] = group
            parameters += group.parameters()
    parameters.sort(key=lambda each: not _names_world(each))

    @wraps(command)
    def collected(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group.collect(values)
        command(**values)

    # typer derives the options from signature and annotations, so both describe the single options.
    collected.__dict__["__signature__"] = inspect.Signature(parameters)
    collected.__annotations__ = {each.name: each.annotation for each in parameters}
    return collected
