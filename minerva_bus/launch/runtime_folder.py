"""The folder of a user's running worlds: registry files, journals and local sockets.

Without XDG_RUNTIME_DIR its name in the shared temporary folder can be guessed, so another user may
have made it, or a link, before us. It is used only if it is a real folder of this user that nobody
else can write to, and no file in it is opened through a link.
"""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from minerva_bus.errors import BusError


def runtime_folder() -> Path:
    """Its path: MINERVA_RUNTIME_DIR, XDG_RUNTIME_DIR/minerva or a folder in the temporary one."""
    named = os.environ.get("MINERVA_RUNTIME_DIR")
    if named:
        return Path(named)
    system = os.environ.get("XDG_RUNTIME_DIR")
    if system and Path(system).is_dir():
        return Path(system) / "minerva"
    return Path(tempfile.gettempdir()) / f"minerva-{os.getuid()}"


def make_runtime_folder() -> Path:
    """The folder, made where there is none. Raises BusError where it cannot be used or trusted."""
    place = runtime_folder()
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise _unusable(place, f"cannot hold what runs here: {error.strerror}") from None
    check_runtime_folder(place)
    if not os.access(place, os.W_OK | os.X_OK):
        raise _unusable(place, "cannot hold what runs here: it is not writable")
    return place


def check_runtime_folder(place: Path) -> bool:
    """Whether the folder exists. Raises BusError where another user could have put files there."""
    try:
        found = place.lstat()
    except FileNotFoundError:
        return False
    except OSError as error:
        raise _unusable(place, f"cannot be looked into: {error.strerror}") from None
    if stat.S_ISLNK(found.st_mode):
        raise _unusable(place, "is a symbolic link, which another user could redirect")
    if not stat.S_ISDIR(found.st_mode):
        raise _unusable(place, "is not a folder")
    if found.st_uid != os.getuid():
        raise _unusable(place, f"belongs to another user (uid {found.st_uid})")
    if found.st_mode & 0o022:
        raise _unusable(place, f"is writable by others (mode {found.st_mode & 0o777:o}); chmod 700")
    return True


def _unusable(place: Path, problem: str) -> BusError:
    return BusError(f"{place} {problem}; set MINERVA_RUNTIME_DIR to a folder of your own")
