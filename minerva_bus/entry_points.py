"""The entry points of installed packages: services, worlds, commands and others by name.

It imports little, because completing a command line must be fast.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

OWN: Final = "minerva_"
"""Begins the names of this project's packages, and of no others."""


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """The installed entry points of a group, by name."""
    # An extension whose folder is gone has its entry points until the project is installed again.
    return {
        entry.name: entry
        for entry in _all_entries().select(group=group)
        if _is_there(entry.module.partition(".")[0])
    }


@cache
def _is_there(package: str) -> bool:
    return not package.startswith(OWN) or importlib.util.find_spec(package) is not None


@cache
def _all_entries() -> Any:
    # The metadata of all installed packages are read for any group.
    return entry_points()
