"""Classes of commands: they start fast, and take words in the order in which people write them.

Typer converts each value, also defaults, with a pydantic model of its parameter. To import pydantic
and build these models takes as long as many commands do. Values that need no model are converted
here; all others, and all that are wrong, go to typer, so messages are the same.

The name of a running world is the first word of a command, `minerva pub garden eRain`, and may be
left out. So whether the first word is the world or the first argument of the command follows from
the words themselves, and from the worlds that run here. Some commands also take the options of a
world or a service.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple, cast, get_args, get_origin

from typer import BadParameter
from typer.core import TyperCommand, TyperGroup

from minerva_bus.cli import completing
from minerva_bus.errors import MinervaError, MisuseError, UnknownOption
from minerva_bus.settings.kinds import phrase_of

WORLD: Final = "WORLD"
"""Metavar of the argument that is the name of the world; it is the first one."""

_EVENT_TYPE: Final = re.compile(r"e[A-Z]\w*")


_IN_WORDS: Final = {"str": "text", "list[str]": "text", "int": "whole number", "float": "number"}
"""Types in the help, for people who do not know those of Python."""


def _type_in_words(shown: Callable[[Any], str | None], ctx: Any) -> str:
    kind = (shown(ctx) or "").strip("<>")
    return f"<{_IN_WORDS.get(kind.removesuffix(' range'), kind)}>"


def use_plain_conversions(parameter: Any) -> None:
    """Let a parameter of typer convert plain values itself, if this typer has models."""
    make = getattr(parameter, "get_runtime_param", None)
    if make is not None and not isinstance(parameter.__dict__.get("get_runtime_param"), _Quick):
        parameter.get_runtime_param = _Quick(parameter, make)


class _Quick:
    """Converts the values of a parameter; `make` creates typer's conversion."""

    def __init__(self, parameter: Any, make: Callable[[], Any]) -> None:
        self._descriptor = parameter.type_descriptor
        self._make = make

    def __call__(self) -> _Quick:
        return self

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """The converted value. Raises typer's BadParameter."""
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        try:
            return plain(value, self._descriptor.annotation, self._descriptor.parameter_info)
        except ValueError:
            return self._make().coerce(value, param=param, ctx=ctx)


def plain(value: Any, kind: Any, info: Any) -> Any:
    """A value of this annotation; `info` is typer's declaration. Raises ValueError for others."""
    if info.parser is not None:
        raise ValueError
    if get_origin(kind) is list:
        if not isinstance(value, list | tuple):
            raise ValueError
        return [plain(each, get_args(kind)[0], info) for each in value]  # pyright: ignore
    if kind not in _PLAIN:
        raise ValueError
    return _PLAIN[kind](value, info)


def _text(value: Any, _: Any) -> str:
    if type(value) is str:
        return value
    raise ValueError


def _switch(value: Any, _: Any) -> bool:
    if type(value) is bool:
        return value
    raise ValueError


def _number(kind: type, value: Any, info: Any) -> Any:
    if type(value) is str:
        try:
            value = kind(value)
        except ValueError:
            raise BadParameter(f"expected {phrase_of(kind)}, not {value!r}") from None
    low = info.min is None or value >= info.min if type(value) is kind else False
    if low and (info.max is None or value <= info.max):
        return value
    raise ValueError


def _path(value: Any, info: Any) -> Path:
    special = info.exists or info.resolve_path or info.allow_dash or info.path_type is not None
    restricted = info.writable or not (info.file_okay and info.dir_okay)
    if special or restricted or not isinstance(value, str | Path):
        raise ValueError
    # Typer rejects a path that it cannot read, but not one where nothing exists.
    if os.path.lexists(value) and not os.access(value, os.R_OK):
        raise ValueError
    return Path(value)


_PLAIN: Final[Mapping[Any, Callable[[Any, Any], Any]]] = MappingProxyType(
    {str: _text, bool: _switch, Path: _path}
    | {int: partial(_number, int), float: partial(_number, float)}
)


ASKED: Final = "_MINERVA_COMPLETE"


def answer_fast() -> None:
    """Answer a shell that asks for completions without formatted descriptions."""
    if ASKED in os.environ:
        # Typer formats them with rich if it is installed, which takes longer than all the rest.
        sys.modules.setdefault("rich", None)  # pyright: ignore[reportArgumentType]


@contextmanager
def in_one_line(ctx: Any) -> Generator[None]:
    """Report wrong words in one line, with the command whose help lists the right ones."""
    try:
        yield
    except Exception as error:
        said = getattr(error, "format_message", None)  # As a usage error of the command line has.
        # A group without a command shows its help; completion takes what it can.
        if said is None or type(error).__name__ == "NoArgsIsHelpError" or ctx.resilient_parsing:
            raise
        command = ctx.command_path.removeprefix(ctx.find_root().command_path).strip()
        text = f"{command}: {said().rstrip('.')}".removeprefix(": ")
        raise MisuseError(f"{text} (see {f'minerva {command}'.strip()} --help)") from error


class QuickParsing:
    """Parses words with plain conversions, and takes them as they are for completions.

    Typer converts values with pydantic, whose import takes longer than all the rest.
    """

    get_params: Callable[[Any], list[Any]]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for parameter in self.get_params(ctx):
            if ctx.resilient_parsing:
                parameter.process_value = _as_given
            else:
                use_plain_conversions(parameter)
            if hasattr(parameter, "display_type"):
                parameter.display_type = partial(_type_in_words, parameter.display_type)
        with in_one_line(ctx):
            return super().parse_args(ctx, args)  # pyright: ignore


def _as_given(ctx: Any, value: Any) -> Any:
    return value


class Command(QuickParsing, TyperCommand):
    """A command."""


class Group(QuickParsing, TyperGroup):
    """A group of commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        with in_one_line(ctx):
            return super().resolve_command(ctx, args)


class WorldFirstCommand(Command):
    """A command that takes the name of a running world before its other arguments."""

    def make_parser(self, ctx: Any) -> Any:
        parser = super().make_parser(ctx)
        arguments = [each for each in self.params if each.param_type_name == "argument"]
        if len(arguments) < 2 or arguments[0].metavar != WORLD:
            return parser
        world, *others = arguments
        parse = parser.parse_args

        def parse_args(args: list[str]) -> tuple[dict[str, Any], list[str], list[Any]]:
            values, rest, order = parse(args)
            _place(values, world.name, others, asks=ctx.resilient_parsing)
            return values, rest, order

        parser.parse_args = parse_args
        return parser


def _place(values: dict[str, Any], world: str, others: Sequence[Any], *, asks: bool) -> None:
    """Give the words, which the parser has assigned from left to right, to their arguments.

    asks: a shell asks for the next word, so a world that is left out counts as given.
    """
    words = _words(values, [world, *(each.name for each in others)])
    is_world = _is_expected_or_named(words) if asks else _names_world(words, others)
    if is_world:
        return
    # An absent key is an argument that is not given.
    values.pop(world, None)
    if asks:
        values[world] = ""
    for each in others:
        values.pop(each.name, None)
        if each.nargs == -1:
            values[each.name] = tuple(words)
        elif words:
            values[each.name] = words.pop(0)


def _words(values: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """All words that are not options, in their order."""
    words: list[str] = []
    for name in names:
        value = values.get(name)
        if isinstance(value, str):
            words.append(value)
        elif isinstance(value, tuple | list):
            words += value
    return words


def _is_expected_or_named(words: Sequence[str]) -> bool:
    """Whether a shell asks for the world, because several run, or for a word after it."""
    running = _running()
    return words[0] in running if words else len(running) > 1


def _names_world(words: Sequence[str], others: Sequence[Any]) -> bool:
    """Whether the first word is the world, and not the first of the other arguments."""
    if not words:
        return False
    first, *rest = words
    if any(each.nargs == -1 for each in others):
        # Any number of data follow, so a second word that is not KEY=VALUE is the event type.
        is_data = not rest or "=" in rest[0]
        return not is_data and (bool(_EVENT_TYPE.fullmatch(rest[0])) or first in _running())
    # With a word too many the first one is the world, even if none of this name runs: the message
    # is then about the world.
    if len(words) > len(others):
        return True
    needed = sum(each.required for each in others)
    if len(rest) < needed or first.replace(".", "", 1).isdigit():
        return False
    # In `step nowhere` it can be nothing else, even if no world of this name runs.
    return isinstance(others[0].default, int) or first in _running()


def _running() -> list[str]:
    """The names of the worlds that run here; empty if they cannot be read."""
    from minerva_bus.launch.registry import running

    try:
        return [each.world for each in running()]
    except MinervaError:
        return []  # The command reports it when it looks for its world.


TAKES_OTHERS: Final = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Context settings of such a command; `options_of` parses what it is given."""


ALL: Final = "--help-all"
"""The option for all options of `run`, whose help shows the world's and these:"""
_USUAL: Final = (
    *("world", "seed", "rate", "frames", "view", "set_", "record", "record_video", "resume"),
    *("collect", "into", "help_all"),
)


_OF_WORLDS: Final = ("run", "graph", "sweep", "calibrate", "evolve")
_OF_SERVICES: Final = ("attach", "bridge")
"""The commands that take the options of worlds, or of services."""


class _Completion(NamedTuple):
    """A completion, as shells print it."""

    value: str
    help: str
    type: str = "plain"


class OtherOptionsCommand(Command):
    """Shows the others' options in its help, and counts its own among suggestions."""

    _words: tuple[str, ...] = ()

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        self._words = tuple(args)
        return super().parse_args(ctx, ["--help" if word == ALL else word for word in args])

    def format_options(self, ctx: Any, formatter: Any) -> None:
        usual = _USUAL if self.name == "run" and ALL not in self._words else None
        for parameter in cast("list[Any]", self.params):
            parameter.hidden = usual is not None and parameter.name not in usual
        super().format_options(ctx, formatter)
        # `--help` is handled while the arguments are parsed, so their values are not known yet.
        spec = next((word for word in self._words if not word.startswith("-")), "")
        if not spec or self.name not in _OF_WORLDS + _OF_SERVICES:
            return
        from minerva_bus.launch.installed import declared_options
        from minerva_bus.launch.specs import described

        try:
            if self.name in _OF_SERVICES:
                options = described(spec)
            else:
                options = [option.help_line() for option in declared_options(spec)]
        except (MinervaError, OSError, UnicodeDecodeError) as error:
            options = []
            with formatter.section(f"Options of {spec}"):
                formatter.write_text(str(error))
        if options:
            with formatter.section(f"Options of {spec}"):
                formatter.write_dl(options)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Complete the others' options, too, and their values."""
        choices: list[Any] = super().shell_complete(ctx, incomplete)
        own = {choice.value for choice in choices}
        if self.name not in _OF_WORLDS + _OF_SERVICES:
            return choices
        is_world = self.name in _OF_WORLDS
        if incomplete.startswith("-"):
            complete = completing.world_flags if is_world else completing.service_flags
        else:
            complete = completing.world_values if is_world else completing.service_values
        others = complete(ctx, incomplete)
        return choices + [_Completion(name, text) for name, text in others if name not in own]

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except UnknownOption as error:
            # The parser passes on a misspelt option of the command as one of the world.
            own = tuple(option for parameter in self.params for option in parameter.opts)
            raise error.beside(own) from None
