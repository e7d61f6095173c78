"""Permissions of a server: what its tools may change."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from minerva_bus.errors import MisuseError, nearest

PERMISSIONS: Final = {
    "control": "pause, resume, step and change the frame rate",
    "publish": "send events as a person",
    "run": "run and sweep worlds in processes of their own",
}


def checked_permissions(names: Iterable[str]) -> frozenset[str]:
    """A set of permissions. Raises MisuseError if there is no such permission."""
    for name in names:
        if name not in PERMISSIONS:
            hint = nearest(name, [*PERMISSIONS])
            raise MisuseError(f"--allow {name!r}: expected {', '.join(PERMISSIONS)}{hint}")
    return frozenset(names)
