"""Commands that start fast, also to complete a line of a shell.

Typer converts each value, also defaults, with a pydantic model of its parameter. To import pydantic
and build these models takes as long as many commands do. Values that need no model are converted
here; all others, and all that are wrong, go to typer, so messages are the same.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, get_args, get_origin

from typer.core import TyperCommand, TyperGroup

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
