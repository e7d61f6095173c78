"""Commands that also take the options of a world or a service."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

from minerva_bus.cli import completing
from minerva_bus.cli.shells import Command
from minerva_bus.errors import MinervaError, UnknownOption

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
