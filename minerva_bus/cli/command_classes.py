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
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple, get_args, get_origin

from typer.core import TyperCommand, TyperGroup

from minerva_bus.cli import completing
from minerva_bus.errors import MinervaError, UnknownOption

WORLD: Final = "WORLD"
"""Metavar of the argument that is the name of the world; it is the first one."""

_EVENT_TYPE: Final = re.compile(r"e[A-Z]\w*")

_WHOLE: Final = re.compile(r"-?[0-9]{1,18}")
_DECIMAL: Final = re.compile(r"-?[0-9]{1,15}(\.[0-9]{1,15})?")


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


def _whole(value: Any, info: Any) -> int:
    if type(value) is str and _WHOLE.fullmatch(value):
        value = int(value)
    return _in_range(value, int, info)


def _decimal(value: Any, info: Any) -> float:
    if type(value) is str and _DECIMAL.fullmatch(value):
        value = float(value)
    return _in_range(value, float, info)


def _in_range(value: Any, kind: type, info: Any) -> Any:
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
    {str: _text, bool: _switch, int: _whole, float: _decimal, Path: _path}
)


ASKED: Final = "_MINERVA_COMPLETE"


def answer_fast() -> None:
    """Answer a shell that asks for completions without formatted descriptions."""
    if ASKED in os.environ:
        # Typer formats them with rich if it is installed, which takes longer than all the rest.
        sys.modules.setdefault("rich", None)  # pyright: ignore[reportArgumentType]


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
        return super().parse_args(ctx, args)  # pyright: ignore


def _as_given(ctx: Any, value: Any) -> Any:
    return value


class Command(QuickParsing, TyperCommand):
    """A command."""


class Group(QuickParsing, TyperGroup):
    """A group of commands."""


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
    if len(rest) < needed or _is_number(first):
        return False
    # In `step nowhere` it can be nothing else, even if no world of this name runs.
    return isinstance(others[0].default, int) or first in _running()


def _is_number(word: str) -> bool:
    return word.replace(".", "", 1).isdigit()


def _running() -> list[str]:
    """The names of the worlds that run here; empty if they cannot be read."""
    from minerva_bus.launch.registry import running

    try:
        return [each.world for each in running()]
    except MinervaError:
        return []  # The command reports it when it looks for its world.


TAKES_OTHERS: Final = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Context settings of such a command; `options_of` parses what it is given."""


def _world_options(spec: str) -> list[tuple[str, str]]:
    from minerva_bus.launch.installed import declared_options

    return [option.help_line() for option in declared_options(spec)]


def _service_options(spec: str) -> list[tuple[str, str]]:
    from minerva_bus.launch.specs import described

    return described(spec)


_DESCRIBED: Final[dict[str, Callable[[str], list[tuple[str, str]]]]] = {
    "run": _world_options,
    "graph": _world_options,
    "sweep": _world_options,
    "calibrate": _world_options,
    "evolve": _world_options,
    "attach": _service_options,
    "bridge": _service_options,
}


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
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        super().format_options(ctx, formatter)
        # `--help` is handled while the arguments are parsed, so their values are not known yet.
        spec = next((word for word in self._words if not word.startswith("-")), "")
        describe = _DESCRIBED.get(self.name or "")
        if not spec or describe is None:
            return
        try:
            options = describe(spec)
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
        if self.name not in _DESCRIBED:
            return choices
        is_world = _DESCRIBED[self.name] is _world_options
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
