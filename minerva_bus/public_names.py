"""The public names of a package, each of which is imported from its module at its first use.

So the command line imports a package without numpy, and without what its names need.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # Instead of typing.TYPE_CHECKING, because importing typing takes time.
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any


def imported_at_first_use(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """A `__getattr__` for a package.

    `homes` are the modules of the package, each with its public names, separated by spaces.
    """

    def find(name: str) -> Any:
        from importlib import import_module

        for module, names in homes.items():
            if name in names.split():
                value = getattr(import_module(f"{package}.{module}"), name)
                # Python calls this function only for names that are missing.
                setattr(sys.modules[package], name, value)
                return value
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return find
