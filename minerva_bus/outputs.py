"""Output files: never overwrite a user's file or an input of this run.

Every file that the program writes carries a mark (file_marks.py), so a later run recognises it.

The rules apply per process; forked processes inherit the inputs and permissions.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Callable, Generator
from pathlib import Path
from typing import IO, TypeAlias

from minerva_bus.errors import MisuseError
from minerva_bus.file_marks import is_own, marked

_Identity: TypeAlias = tuple[int, int]


class _Policy:
    """The rules for the files of this process."""

    def __init__(self) -> None:
        self.read: set[_Identity] = set()
        self.forced = False
        self.pipes: dict[Path, int] = {}


_policy = _Policy()


def forget_inputs() -> None:
    """Forget the inputs of earlier commands of this process."""
    _policy.read.clear()


def force_overwriting(forced: bool) -> None:
    """Allow (`--force`) or forbid overwriting any file."""
    _policy.forced = forced


def is_forced() -> bool:
    """Whether `--force` allows overwriting any file."""
    return _policy.forced


def note_read(path: str | Path) -> None:
    """Register a file as an input, which no output may overwrite."""
    with contextlib.suppress(OSError):
        _policy.read.add(_identity(Path(path).stat()))


def is_stream(path: str | Path) -> bool:
    """Whether a path is a pipe, a socket or a device: to read it may wait, or never end."""
    try:
        mode = Path(path).stat().st_mode
    except OSError:
        return False  # The error is reported when the file is opened.
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def check_output(path: Path, kind: str = "output") -> None:
    """Raise MisuseError if writing `path` would destroy an input or a user's file.

    `kind` names the output in the message. A missing file, an empty file, a file with the
    program's mark, a pipe that a program reads and a device may be written.
    """
    _check(path, kind, inputs=True)


def check_file(path: Path, kind: str = "output") -> None:
    """Like `check_output`, for a format that neither a pipe nor a device takes."""
    if is_stream(path):
        raise MisuseError(
            f"{kind}: cannot write {path}: it is a pipe or a device; choose a file name"
        )
    _check(path, kind, inputs=True)


def check_new(path: Path, kind: str = "output") -> None:
    """Raise MisuseError if `path` is an input, or exists without `--force`."""
    with contextlib.suppress(OSError):
        if _identity(_status(path)) in _policy.read:
            raise MisuseError(f"{kind}: {path} is an input of this run; choose another path")
    # A link counts as existing even if its target does not.
    if not _policy.forced and os.path.lexists(path):
        raise MisuseError(
            f"{kind}: {path} already exists; choose another path, or overwrite it with --force"
        )


def check_replaceable(path: Path, kind: str = "output") -> None:
    """Like `check_output`, for a file whose old content is kept under another name."""
    _check(path, kind, inputs=False)


def _check(path: Path, kind: str, *, inputs: bool) -> None:
    try:
        status = _status(path)
    except OSError:
        return  # It is missing, or the attempt to write it reports why it is unreachable.
    if stat.S_ISFIFO(status.st_mode):
        _check_read(path, kind)
    if _policy.forced:
        return
    if stat.S_ISDIR(status.st_mode):
        raise MisuseError(f"{kind}: cannot write {path}: it is a folder; choose a file name")
    if not stat.S_ISREG(status.st_mode):
        return
    if inputs and _identity(status) in _policy.read:
        raise MisuseError(
            f"{kind}: {path} is an input of this run; choose another path, or overwrite it with"
            " --force"
        )
    if status.st_size and not is_own(path):
        raise MisuseError(
            f"{kind}: {path} exists and was not written by Minerva Bus, or has been edited; choose"
            " another path, move the file, or overwrite it with --force"
        )


def _check_read(pipe: Path, kind: str) -> None:
    """Raise MisuseError if no program reads a pipe: to open it would wait for one."""
    if pipe in _policy.pipes:
        return
    try:
        # Kept open until the process ends, because the reader would end with the last writer.
        _policy.pipes[pipe] = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno != errno.ENXIO:
            return  # The attempt to write it reports why it cannot be written.
        raise MisuseError(
            f"{kind}: no program reads the pipe {pipe}; start its reader first, or choose a file"
            " name"
        ) from None


def _status(path: Path) -> os.stat_result:
    """The status of the file that a path names once its missing folders are made."""
    # In `new/../house.svg` the folder `new` may be missing when the file is checked, and be made
    # before the file is written.
    return Path(os.path.realpath(path)).stat()


def write_output(path: Path, content: bytes, kind: str = "output") -> None:
    """Write a file with the program's mark atomically.

    Raises MisuseError if the file must not be overwritten or cannot be written.
    """
    check_output(path, kind)
    if path.exists() and not path.is_file():
        _write(path, kind, lambda: _write_into(path, content))  # Keeps a pipe or a device.
        return
    _write(path, kind, lambda: _replace(path, marked(content, path.suffix)))


def _write(path: Path, kind: str, write: Callable[[], None]) -> None:
    try:
        write()
    except OSError as error:
        reason = error.strerror or error
        raise MisuseError(
            f"{kind}: cannot write {path}: {reason}; choose a writable path"
        ) from None


def _write_into(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)


def _replace(path: Path, content: bytes) -> None:
    with replacing(path) as file:
        file.write(content)


@contextlib.contextmanager
def replacing(path: Path, *, mode: int = 0o666, durable: bool = False) -> Generator[IO[bytes]]:
    """A new file that is renamed to `path` at the end of the block, and removed on failure.

    A link stays, and names the new file. So readers of `path` never see a partial file. `mode` is
    as for `os.open`; `durable`: the content is on disk before the file is renamed. Raises OSError
    with the name of a file.
    """
    path = target_of(path)
    # In the same folder, because a file is renamed atomically within one file system only. The name
    # is random, because several processes may write the same output.
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    descriptor = open_itself(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(descriptor, "w+b") as file:
            yield file
            file.flush()
            if durable:
                # Before the renaming: a crash could otherwise leave an empty file under the final
                # name.
                os.fsync(file.fileno())
            draft.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            draft.unlink()
        name_file(error, path)
        raise


def target_of(path: Path) -> Path:
    """The file that a link names, which may be missing; any other path as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def name_file(error: BaseException | None, path: Path) -> None:
    """Name the file or folder in an error of writing: the system names only those it opens."""
    if isinstance(error, OSError) and error.filename is None:
        error.filename = str(path)


def open_itself(path: Path, flags: int, mode: int = 0o600) -> int:
    """A descriptor of a file; links are not followed. Raises OSError."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, mode)


def _identity(status: os.stat_result) -> _Identity:
    # Not the path, because links give a file several names.
    return status.st_dev, status.st_ino
