"""A world that is sent to the workers of an executor: its text, and digests of its code.

Workers import the code themselves. One without a module, or with another version of it, would give
other results, so it runs nothing and reports that.
"""

from __future__ import annotations

import os
import platform
import socket
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import minerva_bus
from minerva_bus.errors import MinervaError
from minerva_bus.launch.toml_tables import read_toml
from minerva_bus.launch.world_files import WorldFile, read_world_text
from minerva_bus.settings.world_settings import Overrides
from minerva_study.code_digests import changed, code_digests, named_objects

MAX_NAMES: Final = 3


@dataclass(frozen=True)
class SentWorld:
    """A world as text; calling it reads the world with the settings of a run.

    `given` are settings of all runs. `code` are digests by `module.name`, and `modules` the user's
    modules, which the workers need; `folders` are searched for them if they exist there.
    """

    text: str
    path: str
    given: Overrides
    code: Mapping[str, str]
    modules: tuple[str, ...]
    folders: tuple[str, ...]
    version: str

    @staticmethod
    def of(text: str, path: Path, given: Overrides, *more: object) -> SentWorld:
        """The world of this text, whose code can be imported; `more` code that is sent by name."""
        folder = path.parent
        named = named_objects(read_toml(text), folder)
        code = code_digests([*named, *more])
        modules = sorted({_module(name) for name in code} - {"", "__main__"})
        folders = sorted({_folder(module) for module in modules} - {""})
        return SentWorld(
            text, str(path), given, code, tuple(modules), tuple(folders), minerva_bus.__version__
        )

    def __call__(self, overrides: Overrides) -> WorldFile:
        """Read the world. Raises MinervaError."""
        return read_world_text(self.text, Path(self.path), overrides.over(self.given))

    def check(self) -> None:
        """Check in a worker that it has the same code. Raises MinervaError."""
        # A worker has many runs of a world, and the modules that it has imported do not change.
        if self in _checked:
            return
        problem = _problem(self)
        if problem:
            raise MinervaError(f"the worker {worker_name()} {problem}")
        _checked.add(self)

    def __hash__(self) -> int:
        return hash((self.text, self.path, tuple(self.code.items())))


_checked: Final[set[SentWorld]] = set()
"""Worlds whose code this process has."""


def _problem(world: SentWorld) -> str:
    own = minerva_bus.__version__
    if own != world.version:
        return f"has Minerva Bus {own}, not {world.version}: install the same version"
    for folder in world.folders:
        if Path(folder).is_dir() and folder not in sys.path:
            sys.path.append(folder)
    for module in world.modules:
        try:
            import_module(module)
        except ModuleNotFoundError as error:
            name = error.name or module
            return (
                f"has no module {name}: install it there, or start the worker in a folder with it;"
                f' Dask: client.upload_file("{name.partition(".")[0]}.py")'
            )
        except Exception as error:
            return f"cannot import {module}: {type(error).__name__}: {error}"
    named = named_objects(read_toml(world.text), Path(world.path).parent)
    here = code_digests([*named, *map(import_module, world.modules), *_roots(world)])
    others = [name for name in changed(world.code, here) if name in world.code]
    if others:
        more = len(others) - MAX_NAMES
        names = ", ".join(others[:MAX_NAMES]) + (f" and {more} more" if more > 0 else "")
        return (
            f"has another version of {names} (Python {platform.python_version()}): update its"
            " modules, and restart it"
        )
    return ""


def _roots(world: SentWorld) -> list[object]:
    """The functions and classes whose digests are expected, as far as they exist."""
    objects: list[object] = []
    for name in world.code:
        value: Any = sys.modules.get(_module(name))
        for part in name.removeprefix(_module(name)).split(".")[1:]:
            value = getattr(value, part, None)
        objects.append(value)
    return objects


def _module(name: str) -> str:
    """The module of a `module.name`, where the name may have dots."""
    while name and name not in sys.modules:
        name = name.rpartition(".")[0]
    return name


def _folder(module: str) -> str:
    """The folder from which a module was imported."""
    file = getattr(sys.modules.get(module), "__file__", None)
    return "" if file is None else str(Path(file).resolve().parents[module.count(".")])


def spec_of(function: Any) -> str:
    """The `module:name` of a function that other processes can import; "" if there is none."""
    module, name = getattr(function, "__module__", ""), getattr(function, "__qualname__", "")
    known = getattr(sys.modules.get(module), name, None) is function and module != "__main__"
    return f"{module}:{name}" if known else ""


def worker_name() -> str:
    """The worker, as an error names it: its address in Dask, or machine and process."""
    try:
        return str(dask_worker().address)
    except (ImportError, ValueError):
        return f"{socket.gethostname()}:{os.getpid()}"


def dask_worker() -> Any:
    """The Dask worker that runs this code. Raises ImportError or ValueError if there is none."""
    if "distributed" not in sys.modules:
        raise ImportError("distributed")
    return import_module("distributed").get_worker()
