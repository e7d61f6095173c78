"""Running worlds of this user on this machine, the folder of their files, and temporary folders.

Each has a file that its process has locked. The operating system releases the lock of a process
that ends in any way, so a file without a lock is left over and is removed, with its temporary
folder.

The folder of running worlds has journals and local sockets, too. Without XDG_RUNTIME_DIR it is in
the shared temporary folder, where another user can guess its name and create a folder or a link
first. So it is used only if it is a real folder of this user without write permission for others,
and no file in it is opened through a link.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Final

from minerva_bus.errors import BusError
from minerva_bus.files import open_itself

PROBE_SECONDS: Final = 1.0
"""Time within which another process has checked a lock, and released its own."""
POLL_SECONDS: Final = 0.001


@dataclass(frozen=True, slots=True)
class RunningWorld:
    """A running world of this machine."""

    world: str
    endpoint: str
    pid: int


class WorldLock:
    """The exclusive right to run a world of this name here, held until `release`.

    Raises BusError if such a world already runs.
    """

    def __init__(self, world: str) -> None:
        self.world = world
        self._path = make_runtime_folder() / f"{world}.json"
        self._file = self._lock()

    def _lock(self) -> IO[str]:
        until = time.monotonic() + PROBE_SECONDS
        while True:
            file = self._open()
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                # `running` in another process has locked the new file for a moment.
                if not _is_locked(self._path) and time.monotonic() < until:
                    file.close()
                    time.sleep(POLL_SECONDS)
                    continue
                other = _read(self._path)
                file.close()
                where = f" (process {other.pid}, {other.endpoint})" if other is not None else ""
                raise BusError(
                    f"a world {self.world!r} runs here already{where}; attach to it, stop it"
                    f" (minerva stop --world {self.world}), or start this one under another name"
                    " (--name)"
                ) from None
            # A run that has just ended may have removed the file between opening and locking. A
            # lock on the removed file would exclude no other run.
            if _same_file(file, self._path):
                return file
            file.close()

    def _open(self) -> IO[str]:
        try:
            # Not truncated: the file may be that of a running world.
            descriptor = open_itself(self._path, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise BusError(f"{self._path} cannot be opened: {error.strerror}; remove it") from None
        return os.fdopen(descriptor, "r+", encoding="utf-8")

    def publish(self, endpoint: str) -> None:
        """Publish the endpoint of the world to local processes."""
        entry = json.dumps(asdict(RunningWorld(self.world, endpoint, os.getpid()))).encode()
        file = self._file.fileno()
        # One write that covers the previous entry: a reader finds either of them, never an empty
        # file, which it would take for a world that does not run.
        os.pwrite(file, entry.ljust(os.fstat(file).st_size), 0)

    def release(self) -> None:
        """Release the name after the world has ended."""
        # Removed while it is locked: without the lock it may already be the file of another run.
        self._path.unlink(missing_ok=True)
        self._file.close()


def _same_file(file: IO[str], path: Path) -> bool:
    """Whether the locked file is still the one at this path: a run that ended removes it."""
    try:
        return os.fstat(file.fileno()).st_ino == path.stat().st_ino
    except FileNotFoundError:
        return False


def _read(path: Path) -> RunningWorld | None:
    try:
        with os.fdopen(open_itself(path, os.O_RDONLY), encoding="utf-8") as file:
            entry = json.load(file)
        return RunningWorld(str(entry["world"]), str(entry["endpoint"]), int(entry["pid"]))
    except (OSError, ValueError, KeyError, TypeError):
        # It may be incomplete while a world writes it.
        return None


def running() -> list[RunningWorld]:
    """The worlds that run here, by name; removes files of worlds that have ended.

    Raises BusError if another user could have written to the folder.
    """
    worlds: list[RunningWorld] = []
    place = runtime_folder()
    if not check_runtime_folder(place):
        return worlds
    for path in sorted(place.glob("*.json")):
        world = _read(path)
        if _is_locked(path):
            if world is not None:
                worlds.append(world)
        else:
            # A world that has created the file but not locked it yet notices the removal
            # (`_same_file`).
            path.unlink(missing_ok=True)
    return worlds


def _is_locked(path: Path) -> bool:
    try:
        with os.fdopen(open_itself(path, os.O_RDONLY)) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return False
    except FileNotFoundError:
        return False
    except OSError:
        return True


def find(world: str = "", preferred: str = "") -> RunningWorld:
    """The running world with a name, or the only one, or of several the preferred one.

    Raises BusError if there is none.
    """
    worlds = running()
    if len(worlds) > 1 and preferred in {each.world for each in worlds}:
        world = world or preferred
    if world:
        for running_world in worlds:
            if running_world.world == world:
                return running_world
        names = ", ".join(each.world for each in worlds) or "none"
        raise BusError(f"no world {world!r} runs on this machine; running: {names}")
    if len(worlds) == 1:
        return worlds[0]
    if not worlds:
        raise BusError(
            "no world runs on this machine; start one (minerva run), or use a remote one with"
            " --connect tcp/HOST:PORT --world NAME"
        )
    names = ", ".join(each.world for each in worlds)
    raise BusError(f"several worlds run on this machine ({names}); choose one with --world")


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
    # socket in it requires more (`local_endpoint` in coordinator_process.py).
    if mode & 0o022:
        raise _unusable(place, f"is writable by others (mode {mode:o}); chmod 700")
    return True


def _unusable(place: Path, problem: str) -> BusError:
    return BusError(f"{place} {problem}; set MINERVA_RUNTIME_DIR to a folder of your own")


# --- temporary folders ---

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
