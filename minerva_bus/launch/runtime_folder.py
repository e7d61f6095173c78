"""The folder of a user's running worlds: registry files, journals and local sockets.

Without XDG_RUNTIME_DIR the folder is in the shared temporary folder, where another user can guess
its name and create a folder or a link first. So it is used only if it is a real folder of this user
without write permission for others, and no file in it is opened through a link.
"""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from minerva_bus.errors import BusError


def runtime_folder() -> Path:
    """The path: MINERVA_RUNTIME_DIR, XDG_RUNTIME_DIR/minerva, or one in the temporary folder."""
    named = os.environ.get("MINERVA_RUNTIME_DIR")
    if named:
        return Path(named)
    system = os.environ.get("XDG_RUNTIME_DIR")
    if system and Path(system).is_dir():
        return Path(system) / "minerva"
    return Path(tempfile.gettempdir()) / f"minerva-{os.getuid()}"


def make_runtime_folder() -> Path:
    """The folder, created if necessary. Raises BusError if it cannot be used or trusted."""
    place = runtime_folder()
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise _unusable(place, f"cannot be created: {error.strerror}") from None
    check_runtime_folder(place)
    if not os.access(place, os.W_OK | os.X_OK):
        raise _unusable(place, "is not writable")
    return place


def check_runtime_folder(place: Path) -> bool:
    """Whether the folder exists. Raises BusError if another user could have written to it."""
    try:
        # Not `stat`, which would report the target of a link.
        status = place.lstat()
    except FileNotFoundError:
        return False
    except OSError as error:
        raise _unusable(place, f"cannot be read: {error.strerror}") from None
    if stat.S_ISLNK(status.st_mode):
        raise _unusable(place, "is a symbolic link, which another user could redirect")
    if not stat.S_ISDIR(status.st_mode):
        raise _unusable(place, "is not a folder")
    if status.st_uid != os.getuid():
        raise _unusable(place, f"belongs to another user (uid {status.st_uid})")
    mode = status.st_mode & 0o777
    # Others may read the folder; writing to it could redirect the user to another endpoint. A
    # socket in it requires more (`local_endpoint` in access.py).
    if mode & 0o022:
        raise _unusable(place, f"is writable by others (mode {mode:o}); chmod 700")
    return True


def _unusable(place: Path, problem: str) -> BusError:
    return BusError(f"{place} {problem}; set MINERVA_RUNTIME_DIR to a folder of your own")
