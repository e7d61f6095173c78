"""Loads objects named in a world file or command line: services, agents, module attributes."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.machinery import (
    BYTECODE_SUFFIXES,
    EXTENSION_SUFFIXES,
    SOURCE_SUFFIXES,
    ExtensionFileLoader,
    FileFinder,
    SourceFileLoader,
    SourcelessFileLoader,
)
from importlib.util import find_spec
from pathlib import Path, PurePath
from types import ModuleType
from typing import Any, cast, get_type_hints

from minerva_bus.entry_points import entries
from minerva_bus.errors import MinervaError, WorldFileError, nearest
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.launch.installed import AGENTS, SERVICES, WORLDS, help_line, installed_views
from minerva_bus.settings.kinds import fits, phrase_of
from minerva_bus.user_code import place_of, report
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Service, check_attributes

_folders: set[Path] = set()


def load(spec: str, folder: Path | None = None) -> Any:
    """The attribute that `module:attribute` names; the world file's `folder` is searched, too.

    Raises WorldFileError.
    """
    module_name, _, attribute = spec.partition(":")
    if not module_name or not attribute:
        raise WorldFileError(f"{spec!r} names no attribute; expected module:attribute")
    if folder is not None:
        search(folder)
    module = _import(module_name, spec)
    value: Any = module
    for part in attribute.split("."):
        if not hasattr(value, part):
            public = [name for name in dir(module) if not name.startswith("_")]
            hint = f"{nearest(attribute, public)}{_hidden(module, folder)}"
            raise WorldFileError(f"{module_name} has no {attribute}{hint}")
        value = getattr(value, part)
    return value


def _hidden(module: ModuleType, folder: Path | None) -> str:
    """Hint that a module of Python or of a library hides the file beside the world file."""
    beside = None if folder is None else folder / f"{module.__name__}.py"
    if beside is None or not beside.is_file():
        return ""
    file = getattr(module, "__file__", None)  # None for a module built into Python.
    if file and beside.resolve() == Path(file).resolve():
        return ""
    return f" (another module has this name, so {beside} is not imported: rename the file)"


def _import(name: str, spec: str) -> Any:
    attribute = spec.partition(":")[2]
    if name.startswith(".") or "/" in name or "\\" in name or name.endswith(".py"):
        stem = PurePath(name.replace("\\", "/")).name.removesuffix(".py")
        raise WorldFileError(
            f"{spec!r} names a file; expected a module beside the world file, such as"
            f" {f'{stem}:{attribute}'!r}"
        )
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
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if isinstance(error, SyntaxError) and error.filename is None and place_of(error) is None:
            # Python does not say which file has bytes that are no text.
            module = find_spec(name)
            error.filename = None if module is None else module.origin
            error.msg += "; save it as text in UTF-8"
        raise WorldFileError(f"{spec!r}: importing {name}: {report(error)}") from error


def find_service(spec: str, folder: Path | None = None) -> type[Service]:
    """The service class of an installed name or a `module:Class`. Raises WorldFileError."""
    cls = load(spec, folder) if ":" in spec else _installed(SERVICES, spec)
    if not inspect.isclass(cls) or not issubclass(cls, Service):
        raise WorldFileError(f"{spec!r} is not a Generator or Device class")
    return cls


def find_view(spec: str, folder: Path) -> type[Service]:
    """The service class that `--view` names. Raises WorldFileError."""
    if ":" not in spec and spec not in entries(SERVICES):
        views = installed_views()
        hint = nearest(spec, views, f"there are {', '.join(views)}; or write module:Class")
        raise WorldFileError(f"no view {spec!r} is installed{hint}")
    return find_service(spec, folder_of(spec, folder))


def folder_of(spec: str, folder: Path) -> Path:
    """The folder to search for a module that the command line names.

    That of the world file, or else the current one: the world may be an installed one.
    """
    module, colon, _ = spec.partition(":")
    package = module.partition(".")[0]
    # A file's name may begin with a dot; `load` explains what is expected.
    if not (colon and package):
        return folder
    search(folder)
    # A folder without code is a package, too; it has no origin.
    origin = getattr(find_spec(package), "origin", None)
    return Path.cwd() if origin is None else folder


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


def divisible_names() -> str:
    """The installed services of which several processes may divide the agents, for a message."""
    names: list[str] = []
    for name in sorted(entries(SERVICES)):
        with suppress(WorldFileError):  # The libraries of some may be missing.
            names += [name] if getattr(find_service(name), "by_agent", False) else []
    return ", ".join(names)


def _installed(group: str, name: str) -> Any:
    known = entries(group)
    if name not in known:
        kind = group.split(".")[1]
        hint = nearest(name, list(known), f"there are {_listed(group)}; or write module:Class")
        if name in entries(WORLDS):
            hint = f"; {name} is a world: minerva run {name}"
        raise WorldFileError(f"no {kind[:-1]} {name!r} is installed{hint}")
    return load(known[name].value)


def _listed(group: str) -> str:
    """The installed names of a group; views first, because they are attached most."""
    views = installed_views() if group == SERVICES else []
    others = ", ".join(sorted(set(entries(group)) - set(views))) or "none"
    return f"the views {', '.join(views)}, and {others}" if views else others


def described(spec: str) -> list[tuple[str, str]]:
    """The options of a service, each with its documentation and default, for help texts.

    Raises WorldFileError if there is no such service.
    """
    cls = find_service(spec)
    # Docstrings describe each option in a line that begins with `name: `; that of the class counts
    # before that of its constructor, which has groups of options.
    documented = re.split(r"^ *(\w+): ", f"{cls.__init__.__doc__}\n\n{cls.__doc__}", flags=re.M)
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


@dataclass(frozen=True, slots=True)
class Factory:
    """A class of services with options, checked against its constructor; a call makes a service.

    Raises WorldFileError for an unknown option or one of a wrong type. Errors begin with `owner`,
    those of an option with its place, if `places` has any.
    """

    cls: type[Service]
    options: Mapping[str, Any]
    owner: str
    places: Mapping[str, str] = field(default_factory=dict[str, str])

    def __post_init__(self) -> None:
        parameters = inspect.signature(self.cls.__init__).parameters
        hints = get_type_hints(self.cls.__init__)
        names = [name for name in parameters if name not in ("self", "args", "kwargs")]
        for name, value in self.options.items():
            at = self.places.get(name, self.owner)
            if name not in names:
                hint = nearest(name, names, f"it has {', '.join(names) or 'none'}")
                raise WorldFileError(f"{at}: {self.cls.__name__} has no option {name!r}{hint}")
            _check_option(at, name, value, hints.get(name))
        for name in names:
            if parameters[name].default is inspect.Parameter.empty and name not in self.options:
                raise WorldFileError(f"{self.owner}: {self.cls.__name__} needs the option {name!r}")

    def __call__(self) -> Service:
        """A new service. Raises WorldFileError."""
        try:
            service = self.cls(**cast("dict[str, Any]", self.options))
            check_attributes(service)
            return service
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            # Options of a package with installed services are documented: no need to show code.
            package = self.cls.__module__.partition(".")[0]
            known = [each.value.partition(".")[0] for each in entries(SERVICES).values()]
            is_option = isinstance(error, TypeError | ValueError) and package in known
            is_clear = is_option or isinstance(error, MinervaError)
            problem = error if is_clear else f"{self.cls.__name__}: {report(error)}"
            raise WorldFileError(f"{self.owner}: {problem}") from error


def _check_option(owner: str, name: str, value: Any, hint: Any) -> None:
    if not fits(value, hint):
        shown = value_text(value) if isinstance(value, str | int | float) else type(value).__name__
        raise WorldFileError(f"{owner}: {name} must be {phrase_of(hint)}, not {shown}")


class _ExactLoader(SourceFileLoader):
    """A loader whose compiled files have the time of their source in microseconds."""

    def path_stats(self, path: str) -> Mapping[str, Any]:
        """Time and size of a source file; Python stores the lower 32 bits of the time."""
        stat = Path(path).stat()
        return {"mtime": stat.st_mtime_ns // 1000, "size": stat.st_size}


_LOADERS = (
    (ExtensionFileLoader, EXTENSION_SUFFIXES),
    (_ExactLoader, SOURCE_SUFFIXES),
    (SourcelessFileLoader, BYTECODE_SUFFIXES),
)


def search(folder: Path) -> None:
    """Search a folder first for modules, so that an installed one does not hide one beside it.

    Every edit of these modules is noticed. Python compares the time of a source file with that of
    its compiled file in whole seconds, so an edit within a second that keeps the size would run the
    former code (`importlib`, PEP 552).
    """
    folder = Path(folder)
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    if folder in _folders:
        return
    if not _folders:
        sys.path_hooks.insert(0, _finder)
    _folders.add(folder)
    # A finder without exact times may be known already, if the folder was in `sys.path`.
    sys.path_importer_cache.pop(str(folder), None)


def world_folders() -> frozenset[Path]:
    """The folders that `search` has added in this process: those of worlds."""
    return frozenset(folder.resolve() for folder in _folders)


def _finder(path: str) -> FileFinder:
    """A path hook for the folders, and packages in them. Raises ImportError for other paths."""
    place = Path(path)
    # An environment beside a world file has compiled files that other programs use, too.
    installed = "site-packages" in place.parts
    if installed or not place.is_dir() or _folders.isdisjoint((place, *place.parents)):
        raise ImportError(f"{path} is not beside a world file")
    return FileFinder(path, *_LOADERS)
