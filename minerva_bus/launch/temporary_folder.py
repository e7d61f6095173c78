"""Temporary folders that do not remain after a process was killed.

Each has a file that its process has locked. The kernel releases the lock of a process that dies in
any way, and the next process that makes such a folder removes it.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from minerva_bus.files import open_itself

LOCK: Final = ".lock"


@contextmanager
def temporary_folder(purpose: str) -> Generator[Path]:
    """A folder `minerva-PURPOSE-...` in the temporary folder, removed at the end of the block."""
    _remove_abandoned()
    # Processes that were killed may still write into it while it is removed.
    with tempfile.TemporaryDirectory(
        prefix=f"minerva-{purpose}-", ignore_cleanup_errors=True
    ) as name:
        folder, draft = Path(name), Path(name, f"{LOCK}-draft")
        with draft.open("wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            # Renamed when it is locked, so that no other process finds it unlocked.
            draft.rename(folder / LOCK)
            yield folder


def _remove_abandoned() -> None:
    for lock in Path(tempfile.gettempdir()).glob(f"minerva-*-*/{LOCK}"):
        # Another user may have removed it, or may own it.
        with suppress(OSError):
            if _is_own(lock.parent) and not _is_locked(lock):
                shutil.rmtree(lock.parent, ignore_errors=True)


def _is_own(folder: Path) -> bool:
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()


def _is_locked(path: Path) -> bool:
    descriptor = open_itself(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False
