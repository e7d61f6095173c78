"""Files of users: output never overwrites them, and input is read as a whole, up to a size.

Every file that the program writes carries a mark, by which a later run recognises it: a comment, a
text chunk or a tag, depending on the format. In text formats it has a checksum, so a file that was
edited afterwards counts as the user's. The rules for output apply per process; forked processes
inherit the inputs and permissions.

A name of an input may belong to any file, by mistake or by intent. A pipe would be opened when
something writes to it, a device may have no end, and a sparse file takes no space but more memory
than there is.

Paths become texts: on Linux a name is any bytes, but messages, records and journals have UTF-8.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
import struct
import zlib
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import IO, Final, TypeAlias

from minerva_bus.errors import MisuseError, nearest


def text_of_path(path: str | Path) -> str:
    r"""The UTF-8 text of a path; bytes that are no UTF-8 are escaped as `\xff`.

    Python decodes names in the encoding of the locale, so `str` of a path would have other
    characters in the locale C, or lone surrogates, which no message can contain.
    """
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def path_of_text(text: str) -> Path:
    """The path that `text_of_path` has made into a text; another one if bytes were escaped."""
    return Path(os.fsdecode(text.encode()))


MARK: Final = "Made by Minerva Bus"

_EDGE: Final = 1 << 16
"""Bytes at the start and the end of a file that are searched for its mark."""


def marked(content: bytes, suffix: str) -> bytes:
    """The content with the program's mark in the format of the file's suffix.

    Content of a format without a place for a mark is returned unchanged.
    """
    add = _MARKERS.get(suffix.lower())
    return add(content) if add else content


def is_own(path: Path) -> bool:
    """Whether a file carries the program's mark and, in a text format, is unchanged."""
    try:
        if ending_of(path) in _COMMENTS:
            return _is_unchanged(path.read_bytes())
        with path.open("rb") as file:
            # A format determines where its mark is: near the start of a PNG or PGM, at the end of a
            # PDF or GIF.
            edges = file.read(_EDGE)
            file.seek(max(0, os.fstat(file.fileno()).st_size - _EDGE))
            edges += file.read()
    except OSError:
        return False
    # Under another name, such as that of a link, it would be destroyed as a video or a table.
    is_named_record = ending_of(path) == ".mcap"
    # An MCAP file whose header names this library.
    is_record = edges.startswith(b"\x89MCAP") and b"minerva-bus" in edges[:256]
    return MARK.encode() in edges or (is_named_record and is_record)


_COMMENTS: Final[Mapping[str, tuple[str, str]]] = {
    ".svg": ("<!-- ", " -->"),
    ".html": ("<!-- ", " -->"),
    ".yaml": ("# ", ""),
    ".toml": ("# ", ""),
    ".mnv": ("// ", ""),
    ".mmd": ("%% ", ""),
}
"""Start and end of a comment in text formats."""

_LAST_LINE: Final = re.compile(
    rb"(?:<!--|#|//|%%) " + MARK.encode() + rb", checksum ([0-9a-f]{8})(?: -->)?\n\Z"
)


def _commented(suffix: str) -> Callable[[bytes], bytes]:
    begin, end = _COMMENTS[suffix]

    def add(content: bytes) -> bytes:
        text = content if content.endswith(b"\n") else content + b"\n"
        mark = f"{begin}{MARK}, checksum {zlib.crc32(text):08x}{end}\n"
        return text + mark.encode()

    return add


def _is_unchanged(content: bytes) -> bool:
    # The mark must be the last line, so a file to which a user has added lines does not match.
    mark = _LAST_LINE.search(content[-200:])
    if mark is None:
        return False
    line = len(mark.group(0))
    return f"{zlib.crc32(content[:-line]):08x}".encode() == mark.group(1)


_PNG_HEADER: Final = 33
"""Bytes of the signature and the first chunk, IHDR."""


def _png_chunk(content: bytes) -> bytes:
    """A PNG with a text chunk after its header (PNG specification, 11.3.3.2, keyword Software)."""
    chunk = b"tEXtSoftware\0" + MARK.encode()
    # The length counts the data without the type, the CRC covers both.
    framed = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return content[:_PNG_HEADER] + framed + content[_PNG_HEADER:]


def _pgm_comment(content: bytes) -> bytes:
    """A PGM with a comment line after its magic number."""
    return content[:3] + f"# {MARK}\n".encode() + content[3:]


def _pdf_comment(content: bytes) -> bytes:
    return content + f"% {MARK}\n".encode()


def gif_comment(content: bytes) -> bytes:
    """A GIF with a comment extension before its trailer (GIF89a, section 24)."""
    text = MARK.encode()
    return content[:-1] + b"\x21\xfe" + bytes([len(text)]) + text + b"\0" + content[-1:]


_MARKERS: Final[Mapping[str, Callable[[bytes], bytes]]] = {
    **{suffix: _commented(suffix) for suffix in _COMMENTS},
    ".png": _png_chunk,
    ".pgm": _pgm_comment,
    ".pdf": _pdf_comment,
    ".gif": gif_comment,
}


_Identity: TypeAlias = tuple[int, int]


class _Policy:
    """The rules for the files of this process."""

    def __init__(self) -> None:
        self.read: set[_Identity] = set()
        self.forced: bool | None = None  # None: no command, which has the option
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
    return bool(_policy.forced)


def _replacing() -> str:
    """How to overwrite a file, in a command or in Python."""
    return "delete it" if _policy.forced is None else "overwrite it with --force"


def note_read(path: str | Path) -> None:
    """Register a file as an input, which no output may overwrite."""
    with contextlib.suppress(OSError):
        _policy.read.add(_identity(Path(path).stat()))


def similar(path: Path) -> str:
    """The hint `; did you mean 'run.mcap'?` for a missing file, by others in its folder, or ""."""
    if os.path.lexists(path):
        return ""
    try:
        names = sorted(each.name for each in path.parent.iterdir() if each.suffix == path.suffix)
    except (OSError, ValueError):
        return ""
    return nearest(path.name, names)


def is_stream(path: str | Path) -> bool:
    """Whether a path is a pipe, a socket or a device: to read it may wait, or never end."""
    try:
        mode = Path(path).stat().st_mode
    except OSError:
        return False  # The error is reported when the file is opened.
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def ending_of(path: str | Path) -> str:
    """The ending of a file's name in small letters: `.PNG` names the format of `.png`."""
    return Path(path).suffix.lower()


def check_ending(path: Path, endings: Sequence[str], kind: str) -> None:
    """Raise MisuseError if the name of a file has none of these endings, which name formats."""
    if ending_of(path) not in endings:
        known = ", ".join(endings[:-1]) + " or " * (len(endings) > 1) + endings[-1]
        raise MisuseError(f"{kind}: cannot write {path}: expected a name that ends in {known}")


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
        raise MisuseError(f"{kind}: {path} already exists; choose another path, or {_replacing()}")


def check_replaceable(path: Path, kind: str = "output") -> None:
    """Like `check_output`, for a file whose old content is kept under another name."""
    _check(path, kind, inputs=False)


def _check(path: Path, kind: str, *, inputs: bool) -> None:
    try:
        status = _status(path)
    except OSError:
        _check_folder(path, kind)
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
            f"{kind}: {path} is an input of this run; choose another path, or {_replacing()}"
        )
    if status.st_size and not is_own(path):
        why = "exists and was not written by Minerva Bus, or has been edited"
        if ending_of(path) == ".csv":
            why = "exists, and a .csv file has no mark of the program that wrote it"
        raise MisuseError(
            f"{kind}: {path} {why}; choose another path, move the file, or {_replacing()}"
        )


def _check_folder(path: Path, kind: str) -> None:
    """Raise MisuseError if a file cannot be made, before the work whose result it takes."""
    folder = next(each for each in Path(os.path.realpath(path)).parents if os.access(each, os.F_OK))
    if folder.is_dir() and not os.access(folder, os.W_OK | os.X_OK):
        raise MisuseError(
            f"{kind}: cannot write {path}: the folder {folder} is not writable; choose a writable"
            " path"
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
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)  # Keeps a pipe or a device.
            return
        with replacing(path) as file:
            file.write(marked(content, ending_of(path)))
    except OSError as error:
        why = reason_of(error)
        raise MisuseError(f"{kind}: cannot write {path}: {why}; choose a writable path") from None


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
    draft = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
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


def reason_of(error: OSError) -> str:
    """Why the system refused; the text of a library may also have the number and the path."""
    return os.strerror(error.errno) if error.errno else str(error)


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


MAX_BYTES: Final = 64 << 20


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Contents of a file of at most `most` bytes.

    Raises OSError with the reason in `strerror`, also for larger files, pipes and devices, and
    ValueError if the name contains a null character.
    """
    check_input(path, most)
    return path.read_bytes()


def read_text(path: Path, most: int = MAX_BYTES) -> str:
    """Text of a file of at most `most` bytes, in UTF-8 with or without a byte order mark.

    Raises OSError and ValueError as `read_bytes` does, and UnicodeDecodeError.
    """
    return read_bytes(path, most).decode("utf-8-sig")


def check_input(path: Path, most: int = MAX_BYTES) -> None:
    """Raise OSError if this is not a regular file, or one of more than `most` bytes."""
    size = path.stat().st_size
    if path.is_dir():
        raise OSError(errno.EISDIR, "a folder; expected a file")
    if is_stream(path):
        raise OSError(errno.EINVAL, "a pipe or device; expected a file")
    if size > most:
        raise OSError(errno.EFBIG, f"has {size:,} bytes; expected at most {most:,}")
