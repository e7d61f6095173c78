"""Loads objects named in a world file or command line: services, agents, module attributes."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import os
import re
import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, cast, get_type_hints

from minerva_bus.blame import report
from minerva_bus.errors import MinervaError, WorldFileError, nearest
from minerva_bus.grammar.printer import value_text
from minerva_bus.settings.kinds import fits, phrase_of
from minerva_bus.source import place_of
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Service

SERVICES, AGENTS, WORLDS = "minerva.services", "minerva.agents", "minerva.worlds"


def load(spec: str, folder: Path | None = None) -> Any:
    """The attribute that `module:attribute` names; the world file's `folder` is searched, too.

    Raises WorldFileError.
    """
    module_name, _, attribute = spec.partition(":")
    if not module_name or not attribute:
        raise WorldFileError(f"{spec!r} names no attribute; expected module:attribute")
    if folder is not None and str(folder) not in sys.path:
        # First, so that an installed module does not hide one beside the world file.
        sys.path.insert(0, str(folder))
    module = _import(module_name, spec)
    value: Any = module
    for part in attribute.split("."):
        if not hasattr(value, part):
            public = [name for name in dir(module) if not name.startswith("_")]
            raise WorldFileError(f"{module_name} has no {attribute}{nearest(attribute, public)}")
        value = getattr(value, part)
    return value


def _import(name: str, spec: str) -> Any:
    try:
        return importlib.import_module(name)
    except MinervaError as error:
        raise WorldFileError(f"{spec!r}: in {name}: {report(error)}") from error
    except ModuleNotFoundError as error:
        if error.name is not None and name.split(".")[0] == error.name.split(".")[0]:
            # Otherwise the module exists, and one that it imports is missing.
            raise WorldFileError(
                f"{spec!r}: there is no module {name}; install it, or put it beside the world file"
            ) from None
        place = place_of(error)
        shown = "\n" + "\n".join(place.lines()) if place is not None else ""
        raise WorldFileError(
            f"{spec!r}: {name} needs {error.name}, which is not installed{shown}"
        ) from error
    except (Exception, SystemExit) as error:
        raise WorldFileError(f"{spec!r}: importing {name}: {report(error)}") from error


def called(spec: str, options: Mapping[str, Any], path: Path) -> Any:
    """Call the function that a world file names, `module:function`, with its options.

    Raises WorldFileError, and any MinervaError that the function raises.
    """
    function = load(spec, path.parent)
    if not callable(function):
        raise WorldFileError(f"{path}: {spec} is not a function")
    try:
        return function(options)
    except MinervaError:
        raise
    except (Exception, SystemExit) as error:
        raise WorldFileError(f"{path}: {spec}: {report(error)}") from error


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """The installed entry points of a group, by name."""
    return {entry.name: entry for entry in entry_points(group=group)}


def find_service(spec: str, folder: Path | None = None) -> type[Service]:
    """The service class of an installed name or a `module:Class`. Raises WorldFileError."""
    cls = load(spec, folder) if ":" in spec else _installed(SERVICES, spec)
    if not inspect.isclass(cls) or not issubclass(cls, Service):
        raise WorldFileError(f"{spec!r} is not a Generator or Device class")
    return cls


def find_agent(spec: str, folder: Path | None = None) -> type[Agent]:
    """The agent class of an installed name or a `module:Class`. Raises WorldFileError."""
    cls = load(spec, folder) if ":" in spec else _installed(AGENTS, spec)
    if not inspect.isclass(cls) or not issubclass(cls, Agent) or not hasattr(cls, "kind"):
        raise WorldFileError(f"{spec!r} is not an Agent class with a symbol")
    return cls


def names_agents(spec: str, folder: Path) -> bool:
    """Whether this names an agent class and not a service. Raises WorldFileError."""
    if ":" not in spec:
        return spec in entries(AGENTS)
    loaded = load(spec, folder)
    return inspect.isclass(loaded) and issubclass(loaded, Agent)


def _installed(group: str, name: str) -> Any:
    known = entries(group)
    if name not in known:
        kind = group.split(".")[1]
        raise WorldFileError(
            f"no {kind[:-1]} {name!r} is installed{nearest(name, list(known))}; there are"
            f" {', '.join(sorted(known)) or 'none'}; or write module:Class"
        )
    return load(known[name].value)


def is_file(path: Path) -> bool:
    """Whether a user's text is the path of a file."""
    # pathlib raises an error for a part that is too long, such as a text that is not a path.
    return os.path.isfile(path)  # noqa: PTH113


def find_world(spec: str) -> Path:
    """The world file of a path or an installed name. Raises WorldFileError."""
    path = Path(spec)
    if is_file(path):
        return path.resolve()
    known = entries(WORLDS)
    if spec in known:
        module, _, name = known[spec].value.partition(":")
        package = importlib.util.find_spec(module)
        folders = package.submodule_search_locations if package is not None else None
        for folder in folders or ():
            if (Path(folder) / name).is_file():
                return Path(folder) / name
        raise WorldFileError(f"the world {spec!r} is installed without its file {name}")
    if path.suffix == ".toml" or "/" in spec:
        raise WorldFileError(f"there is no world file {spec}")
    raise WorldFileError(
        f"there is no world {spec!r}{nearest(spec, list(known))}; installed are"
        f" {', '.join(sorted(known)) or 'none'}; or give a world file, NAME.toml"
    )


def installed_worlds() -> dict[str, str]:
    """The installed worlds with their descriptions: the first line of each file, a comment."""
    lines = {
        name: find_world(name).read_text(encoding="utf-8").partition("\n")[0]
        for name in sorted(entries(WORLDS))
    }
    return {
        name: line.removeprefix("#").strip() if line.startswith("#") else ""
        for name, line in lines.items()
    }


def described(spec: str) -> list[tuple[str, str]]:
    """The options of a service, each with its documentation and default, for help texts.

    Raises WorldFileError if there is no such service.
    """
    cls = find_service(spec)
    # The docstring of a service describes each option in a line that begins with `name: `.
    documented = re.split(r"^ *(\w+): ", cls.__doc__ or "", flags=re.MULTILINE)
    texts = {
        name: " ".join(text.split("\n\n")[0].split())
        for name, text in zip(documented[1::2], documented[2::2], strict=True)
    }
    hints = get_type_hints(cls.__init__)
    return [
        help_line(name, hints.get(name), texts.get(name, ""), parameter.default)
        for name, parameter in inspect.signature(cls.__init__).parameters.items()
        if name not in ("self", "args", "kwargs")
    ]


def help_line(name: str, python: Any, text: str, default: Any) -> tuple[str, str]:
    """An option and its description, as the help of a command shows them."""
    kind = python.__name__ if phrase_of(python) else "toml"
    if default is inspect.Parameter.empty:
        return f"--{name} <{kind}>", f"{text}  [required]".lstrip()
    return f"--{name} <{kind}>", f"{text}  [default: {json.dumps(default, default=str)}]".lstrip()


def bind(cls: type[Service], options: Mapping[str, Any], owner: str) -> Callable[[], Service]:
    """A factory of the service with these options, checked against its constructor.

    Raises WorldFileError for an unknown option or one of a wrong type.
    """
    parameters = inspect.signature(cls.__init__).parameters
    hints = get_type_hints(cls.__init__)
    names = [name for name in parameters if name not in ("self", "args", "kwargs")]
    for name, value in options.items():
        if name not in names:
            raise WorldFileError(
                f"{owner}: {cls.__name__} has no option {name!r}{nearest(name, names)}; it has"
                f" {', '.join(names) or 'none'}"
            )
        _check_option(owner, name, value, hints.get(name))
    for name in names:
        if parameters[name].default is inspect.Parameter.empty and name not in options:
            raise WorldFileError(f"{owner}: {cls.__name__} needs the option {name!r}")
    return lambda: _make(cls, options, owner)


def _check_option(owner: str, name: str, value: Any, hint: Any) -> None:
    if not fits(value, hint):
        raise WorldFileError(f"{owner}: {name} must be {phrase_of(hint)}, not {_shown(value)}")


def _shown(value: Any) -> str:
    return value_text(value) if isinstance(value, str | int | float) else type(value).__name__


def _make(cls: type[Service], options: Mapping[str, Any], owner: str) -> Service:
    try:
        return cls(**cast("dict[str, Any]", options))
    except MinervaError as error:
        raise WorldFileError(f"{owner}: {error}") from error
    except (TypeError, ValueError) as error:
        if _is_installed(cls):  # Its options are documented, so the error need not show its code.
            raise WorldFileError(f"{owner}: {error}") from error
        raise WorldFileError(f"{owner}: {cls.__name__}: {report(error)}") from error
    except (Exception, SystemExit) as error:
        raise WorldFileError(f"{owner}: {cls.__name__}: {report(error)}") from error


def _is_installed(cls: type[Service]) -> bool:
    """Whether a class belongs to a package with installed services."""
    package = cls.__module__.partition(".")[0]
    return any(each.value.partition(".")[0] == package for each in entries(SERVICES).values())
