"""Groups of options: a command takes many options as few parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import cache, wraps
from typing import Annotated, Any, Final, get_origin, get_type_hints

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.argument_order import WORLD
from minerva_bus.cli.options import Collect, Settings, Views
from minerva_bus.settings.world_settings import OPTIONS, Overrides

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
                given[name] = tuple(value)
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
