"""The entry points and versions of installed packages, by name.

It imports little, because completing a command line and the start of a world must be fast. Python's
`importlib.metadata` reads the same files (the specifications "Entry points" and "Recording
installed projects"), but imports a parser of mails for what else they contain: both together took
as long as a third of the import of numpy.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from operator import attrgetter
from typing import Any, Final, NamedTuple

OWN: Final = "minerva_"
"""Begins the names of this project's packages, and of no others."""


class EntryPoint(NamedTuple):
    """An entry point: the `value` is a module, or `module:attribute`."""

    name: str
    value: str

    @property
    def module(self) -> str:
        """The module's name."""
        return self.value.partition(":")[0]

    def load(self) -> Any:
        """Import the module, and return it or its attribute."""
        module, attribute = importlib.import_module(self.module), self.value.partition(":")[2]
        return attrgetter(attribute)(module) if attribute else module


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """The installed entry points of a group, by name."""
    # An extension whose folder is gone has its entry points until the project is installed again.
    return {
        entry.name: entry
        for section, entry in _all_entries()
        if section == group and _is_there(entry.module.partition(".")[0])
    }


@cache
def _is_there(package: str) -> bool:
    return not package.startswith(OWN) or importlib.util.find_spec(package) is not None


def installed_version(package: str) -> str | None:
    """The version of a package; None if it is not installed."""
    return _packages().get(package.lower().replace("-", "_"), (None,))[0]


@cache
def _all_entries() -> tuple[tuple[str, EntryPoint], ...]:
    return tuple([each for _, folder in _packages().values() for each in _entries_in(folder)])


def _entries_in(folder: str) -> Iterator[tuple[str, EntryPoint]]:
    """The entry points of a package, each with its group."""
    group = ""
    with suppress(OSError), open(f"{folder}/entry_points.txt", encoding="utf-8") as file:  # noqa: PTH123
        for line in map(str.strip, file):
            name, equals, value = line.partition("=")
            if line.startswith("["):
                group = line.strip("[]")
            elif equals and not line.startswith("#"):
                # Extras in brackets are of the past.
                yield group, EntryPoint(name.strip(), value.partition("[")[0].strip())


@cache
def _packages() -> Mapping[str, tuple[str, str]]:
    """The version and the folder of metadata of each package; the first in Python's path counts."""
    packages: dict[str, tuple[str, str]] = {}
    for path in sys.path:
        with suppress(OSError):  # An archive, or no folder.
            for name in sorted(os.listdir(path or ".")):  # noqa: PTH208
                stem, _, ending = name.rpartition(".")
                if ending in ("dist-info", "egg-info"):
                    package, version, *_ = f"{stem}-".split("-")
                    key = package.lower().replace(".", "_")
                    packages.setdefault(key, (version, f"{path or '.'}/{name}"))
    return packages
