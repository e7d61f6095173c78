"""Assets: files that a world names, found on this machine or at other members.

An asset is named by a path: of a file beside the world, or in an installed package,
`PACKAGE/FOLDER/FILE`. These are the folders from which Python imports. The name may end with the
digest of the contents, `FILE#sha256=HEX`, of 16 digits or more. A process that lacks a file of this
digest asks the other members of its world, and keeps what it gets in a folder of its user.

The questions are queries, see assets.md: `[file, digest]` on `minerva/WORLD/asset/*` is answered
with the size by each member that has the file, and `[file, digest, place]` on the key of one of
them with the bytes from there on. All data are compared with the digest before they are used.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any, Final

from minerva_bodies.errors import BodiesError
from minerva_bus.errors import ProtocolError
from minerva_bus.launch.specs import world_folders
from minerva_bus.wire.keys import Keys, last_part
from minerva_bus.wire.plain import as_int, as_list, as_text, pack, unpack
from minerva_bus.world.services import Emit, Generator, WorldInfo

MAX_BYTES: Final = 64 << 20
CHUNK: Final = 256 << 10
"""Bytes of an answer, at most."""
SENT: Final = (".glb", ".obj", ".stl")
"""Types of the files that members send to others."""
_DIGEST, _MIN_DIGEST = "#sha256=", 16
_HEX: Final = re.compile(r"[0-9a-f]{16,64}")
_MAX_QUESTION, _MAX_HOLDERS = 4096, 100
_ANSWER_SECONDS = 5.0
_PAUSES: tuple[float, ...] = (0.5, 1.0, 2.0)
"""Seconds before it asks again: a member with the file may be about to join, or to come back."""

_sources = list["AssetBus"]()
"""The members that this process may ask: those of its world."""


def read_asset(where: str, name: str) -> tuple[str, bytes]:
    """The file of an asset's name, and its contents. Raises BodiesError that begin with `where`."""
    file, marked, digest = name.partition(_DIGEST)
    check_path(where, file)
    digest = digest.lower()
    is_digest = _HEX.fullmatch(digest) is not None
    path = _local(where, file)
    data = None if path is None else _contents(where, path)
    if data is not None and (not marked or (is_digest and _fits(data, digest))):
        return file, data
    if not marked:
        raise BodiesError(f"{where}: {_missing()}; {_ADVICE}")
    tried = [_missing()]
    if data is not None:
        tried = [f"{path} has another digest; expected {_mark(data)}"]
    if not is_digest:
        tried.insert(0, f"a digest has {_MIN_DIGEST} to 64 hexadecimal digits")
    for source in _sources if is_digest else ():
        data, problems = source.fetch(file, digest)
        if data is not None:
            return file, data
        tried += problems
    raise BodiesError(f"{where}: {'; '.join(tried[:4])}")


_ADVICE: Final = (
    "a name that ends with #sha256= and the digest of the file lets other members send it"
)

_NOBODY: Final = "no other member has it: run the service assets on the machine of the file"


def _missing() -> str:
    worlds = world_folders()
    beside = next((f" ({folder})" for folder in _folders() if folder in worlds), "")
    places = f"beside the world{beside} or in an installed package, as PACKAGE/FILE"
    return f"there is no such file {places}"


def _contents(where: str, path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise BodiesError(f"{where}: {size} bytes; expected at most {MAX_BYTES} ({path})")
        return path.read_bytes()
    except OSError as error:
        raise BodiesError(f"{where}: {error.strerror} ({path})") from None


def with_digest(file: str, data: bytes) -> str:
    """The name by which members on other machines get a file with these contents."""
    return file + _mark(data)


def _mark(data: bytes) -> str:
    return _DIGEST + _sha256(data)[:_MIN_DIGEST]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _fits(data: bytes, digest: str) -> bool:
    return not digest or _sha256(data).startswith(digest)


# --- files of this machine ---


def _folders() -> list[Path]:
    return list(dict.fromkeys(Path(folder).resolve() for folder in sys.path))


def check_path(where: str, file: str) -> None:
    """Raise BodiesError for a path that is not one below a folder."""
    parts = PurePosixPath(file).parts
    if not parts or parts[0].startswith("/") or ".." in parts or "\\" in file or "\0" in file:
        raise BodiesError(f"{where}: expected the path of a file below a folder, without ..")


def _local(where: str, file: str) -> Path | None:
    """The file in the first folder that has it. Raises BodiesError for one outside of it."""
    for folder in _folders():
        try:
            path = (folder / file).resolve()
            exists = path.is_file()
        except (OSError, ValueError) as error:  # Such as a name that is too long.
            why = error.strerror if isinstance(error, OSError) else "no name of a file"
            raise BodiesError(f"{where}: {why}") from None
        if exists:
            if not path.is_relative_to(folder):
                raise BodiesError(f"{where}: {folder / file} leads out of its folder")
            return path
    return None


def _cache() -> Path:
    """The folder of assets from other members; each file is named by its digest."""
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    except RuntimeError:  # There is no home.
        folder = Path(tempfile.gettempdir())
    return folder / "minerva-bus" / "assets"


def _kept(digest: str) -> Path | None:
    """The file of a digest, or of its first digits, that another member has sent."""
    for path in sorted(_cache().glob(f"{digest}*")):
        with suppress(OSError):  # Somebody may have emptied the folder.
            known = path.stat()
            if len(path.name) == 64 and _has(path, known.st_size, known.st_mtime_ns, path.name):
                return path
    return None


def _keep(data: bytes) -> None:
    path = _cache() / _sha256(data)
    part = path.with_name(f"{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(data)
        part.replace(path)
    except OSError:
        return  # Without a folder to write to, each process asks again.


# --- files of other members ---


class AssetBus:
    """The queries between members of a world: this one asks others for files, and answers them."""

    def __init__(self, world: WorldInfo) -> None:
        import zenoh
        from zenoh.handlers import Callback

        member, self._session = world.session
        self._base = f"{Keys(world.world).base}/asset"
        self._library: Any = zenoh
        self._own = f"{self._base}/{member}"
        # Not in the thread of Zenoh that keeps the link alive.
        answer = Callback(self._answer, indirect=True)
        self._declared = self._session.declare_queryable(self._own, answer)

    @property
    def session(self) -> Any:
        """The session that it uses."""
        return self._session

    def fetch(self, file: str, digest: str) -> tuple[bytes | None, list[str]]:
        """The contents, or None and what each member that has the file did instead."""
        if PurePosixPath(file).suffix.lower() not in SENT:
            return None, [f"members send {', '.join(SENT)} only"]
        data, problems = self._fetched(file, digest)
        for seconds in _PAUSES:
            if data is None:
                time.sleep(seconds)
                data, problems = self._fetched(file, digest)
        return data, problems

    def _fetched(self, file: str, digest: str) -> tuple[bytes | None, list[str]]:
        kept = _kept(digest)
        if kept is not None:
            return kept.read_bytes(), []
        problems = list[str]()
        holders = dict(islice(self._ask(f"{self._base}/*", [file, digest]), _MAX_HOLDERS))
        for key, answer in sorted(holders.items()):
            who = last_part(key)
            try:
                size = as_int(unpack(answer), "the size of an asset")
            except ProtocolError:
                size = 0
            if not 0 < size <= MAX_BYTES:
                problems.append(f"{who} has {size} bytes; expected 1 to {MAX_BYTES}")
                continue
            data = self._received(key, file, digest, size)
            if len(data) < size:
                problems.append(f"{who} has sent {len(data)} of {size} bytes")
            elif not _fits(data, digest):
                problems.append(f"{who} has sent other data, {_mark(data)}")
            else:
                _keep(data)
                return data, []
        return None, problems or [_NOBODY]

    def _received(self, key: str, file: str, digest: str, size: int) -> bytes:
        """The bytes that a member sends, up to a gap."""
        data = bytearray()
        while len(data) < size:
            part = next((each for _, each in self._ask(key, [file, digest, len(data)])), b"")
            if not 0 < len(part) <= min(CHUNK, size - len(data)):
                break
            data += part
        return bytes(data)

    def _ask(self, key: str, question: list[Any]) -> Iterator[tuple[str, bytes]]:
        zenoh = self._library
        try:
            replies = self._session.get(
                key,
                payload=pack(question),
                timeout=_ANSWER_SECONDS,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                allowed_destination=zenoh.Locality.REMOTE,
            )
            for reply in replies:
                if reply.ok is not None:
                    yield str(reply.ok.key_expr), reply.ok.payload.to_bytes()
        except zenoh.ZError:
            return  # The session is closing.

    def _answer(self, query: Any) -> None:
        with query:
            payload = query.payload
            if payload and len(payload) <= _MAX_QUESTION:
                data = answer_to(payload.to_bytes())
                if data is not None:
                    query.reply(self._own, data)


def connect(world: WorldInfo) -> None:
    """Send files to the other members of a world, and ask them for those that are missing."""
    if world.session is not None and all(each.session is not world.session[1] for each in _sources):
        _sources[:] = [AssetBus(world)]


def answer_to(question: bytes) -> bytes | None:
    """The answer to a question of another member, or None if this one cannot help."""
    try:
        file, digest, *place = as_list(unpack(question), "a question")
        path = _sendable(as_text(file, "a file"), as_text(digest, "a digest"))
        if path is None:
            return None
        if not place:
            return pack(path.stat().st_size)
        with path.open("rb") as opened:
            opened.seek(as_int(place[0], "a place"))
            return opened.read(CHUNK)
    except (ProtocolError, BodiesError, OSError, ValueError):
        return None


def _sendable(file: str, digest: str) -> Path | None:
    """A file of this digest, which the asker therefore knows."""
    check_path("", file)
    if PurePosixPath(file).suffix.lower() not in SENT or not _HEX.fullmatch(digest):
        return None
    path = _local("", file)
    if path is not None:
        known = path.stat()
        if known.st_size <= MAX_BYTES and _has(path, known.st_size, known.st_mtime_ns, digest):
            return path
    return _kept(digest)


@lru_cache(maxsize=256)
def _has(path: Path, size: int, changed: int, digest: str) -> bool:
    """Whether a file that has not changed since has this digest."""
    return _fits(path.read_bytes(), digest)


class Assets(Generator, when="freely"):
    """Sends the assets of its machine to members that lack them, where no other service does."""

    def joined(self, world: WorldInfo) -> None:
        connect(world)

    def run(self, emit: Emit, stop: threading.Event) -> None:
        stop.wait()
