"""Imports of modules beside world files, which notice every edit.

Python compares the time of a source file with that of its compiled file in whole seconds, so an
edit within a second that keeps the size would run the former code (`importlib`, PEP 552).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.machinery import (
    BYTECODE_SUFFIXES,
    EXTENSION_SUFFIXES,
    SOURCE_SUFFIXES,
    ExtensionFileLoader,
    FileFinder,
    SourceFileLoader,
    SourcelessFileLoader,
)
from pathlib import Path
from typing import Any


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
_folders: set[Path] = set()


def search(folder: Path) -> None:
    """Search a folder first for modules, so that an installed one does not hide one beside it."""
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


def _finder(path: str) -> FileFinder:
    """A path hook for the folders, and packages in them. Raises ImportError for other paths."""
    place = Path(path)
    # An environment beside a world file has compiled files that other programs use, too.
    installed = "site-packages" in place.parts
    if installed or not place.is_dir() or _folders.isdisjoint((place, *place.parents)):
        raise ImportError(f"{path} is not beside a world file")
    return FileFinder(path, *_LOADERS)
