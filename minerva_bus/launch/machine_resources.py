"""Resources of this machine: cores, open files, threads and memory, checked before a start.

A killed process leaves its files of shared memory behind. Zenoh locks the files that are in use,
and the system releases a lock when its process ends: a file without a lock is an orphan.
"""

from __future__ import annotations

import fcntl
import math
import os
import resource
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import column_bytes
from minerva_bus.grammar.scene import Scene
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import counted

FILES_PER_PROCESS: Final = 2
"""Open files of the launcher for each process: the pipes with its output and its reports."""

BASE_FILES: Final = 256
"""Maximum number of open files of the launcher and coordinator, besides those per process."""

LEAST_FILES: Final = 24
"""The same for few processes; 21 were measured with a record, a journal and a picture."""

THREADS_PER_PROCESS: Final = 10
"""Main thread, lifeline and Zenoh's threads; 8 were measured."""

BYTES_PER_PROCESS: Final = 8 << 20
"""Private memory of an idle process; 7.3 MB were measured."""

MIN_CHECKED: Final = 32
"""Number of processes from which threads and memory are checked; fewer fit on any machine."""

_GROUPS: Final = Path("/sys/fs/cgroup")

SHARED_MEMORY: Final = Path("/dev/shm")  # noqa: S108
LARGE_BYTES: Final = 4 * 1024 * 1024
"""Size of a string's columns from which the processes of a world share memory by default."""


@fast_dataclass
class Headroom:
    """Available resources; None: unlimited or unknown.

    `files`: open files of one process; `threads` and `bytes`: of all processes together.
    """

    files: int | None = None
    threads: int | None = None
    bytes: int | None = None


def shortage(processes: int, free: Headroom, base_files: int = BASE_FILES) -> str:
    """Missing resource for this number of processes, with advice; empty if they fit."""
    files = processes * FILES_PER_PROCESS + base_files
    threads = processes * THREADS_PER_PROCESS
    if free.files is not None and files > free.files:
        return (
            f"{files} open files in one process, and {free.files} are allowed:"
            f" raise the limit (ulimit -n {files})"
        )
    if free.threads is not None and threads > free.threads:
        return (
            f"about {threads} threads, and {free.threads} more are allowed:"
            " raise the limit (ulimit -u, or the container's limit of processes)"
        )
    needed = processes * BYTES_PER_PROCESS
    if free.bytes is not None and needed > free.bytes:
        return f"at least {needed >> 20} MiB of memory, and {free.bytes >> 20} MiB are free"
    return ""


def check_capacity(processes: int) -> None:
    """Check that this number of processes can run here. Raises MisuseError if not.

    Raises the soft limit of open files if necessary, which needs no privileges.
    """
    hard = _limit(resource.getrlimit(resource.RLIMIT_NOFILE)[1])
    few = processes < MIN_CHECKED
    free = Headroom(hard) if few else _this_machine()
    problem = shortage(processes, free, LEAST_FILES if few else BASE_FILES)
    if problem:
        raise MisuseError(
            f"{counted(processes, 'process')} cannot start here: they need {problem}."
            " Or use fewer processes for the same agents (processes = N)"
        )
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = processes * FILES_PER_PROCESS + BASE_FILES
    if soft != resource.RLIM_INFINITY and soft < needed:
        # The hard limit suffices by `shortage`, but may leave few processes less than this.
        most = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def cores() -> int:
    """Number of cores that this process may use, by its affinity and its container's quota."""
    try:
        # An affinity may exclude some of the cores that `cpu_count` reports.
        allowed = len(os.sched_getaffinity(0))
    except AttributeError:  # Not available on every system.
        allowed = os.cpu_count() or 1
    return max(1, min([allowed, *_quotas(_own_groups())]))


def _quotas(groups: Iterable[Path]) -> list[int]:
    quotas: list[int] = []
    for group in groups:
        # An unlimited group has the word "max" instead of a number, here and in `_left`.
        quota, _, period = _text(group / "cpu.max").partition(" ")
        if quota.isdecimal() and period.isdecimal():
            quotas.append(math.ceil(int(quota) / int(period)))
    return quotas


def _this_machine() -> Headroom:
    groups = _own_groups()
    return Headroom(
        # The hard limit counts, because `check_capacity` raises the soft one.
        _limit(resource.getrlimit(resource.RLIMIT_NOFILE)[1]),
        _smallest(
            [_user_threads(), *(_left(group, "pids.max", "pids.current") for group in groups)]
        ),
        _smallest([_free_bytes(), *map(_left_bytes, groups)]),
    )


def _limit(limit: int) -> int | None:
    return None if limit == resource.RLIM_INFINITY else limit


def _smallest(limits: list[int | None]) -> int | None:
    return min((limit for limit in limits if limit is not None), default=None)


def _user_threads() -> int | None:
    """Number of threads that this user may still start; root has no limit."""
    # Linux counts the threads of all processes of a user against RLIMIT_NPROC.
    limit = _limit(resource.getrlimit(resource.RLIMIT_NPROC)[0])
    return None if limit is None or os.geteuid() == 0 else limit - _threads_of(os.getuid())


def _threads_of(user: int) -> int:
    threads = 0
    for path in Path("/proc").glob("[0-9]*/status"):
        fields = _fields(path)
        # The first number is the real user, to whom the limit applies.
        if fields.get("Uid", "").split()[:1] == [str(user)]:
            threads += int(fields.get("Threads", "1"))
    return threads


def _free_bytes() -> int | None:
    fields = _fields(Path("/proc/meminfo"))
    kilobytes = fields.get("MemAvailable", "").split()[:1]
    return int(kilobytes[0]) << 10 if kilobytes else None


def _own_groups() -> list[Path]:
    """The control group of this process, and its parents."""
    for line in _text(Path("/proc/self/cgroup")).splitlines():
        # The line of version 2; without it no limit of a group is known, and none is checked.
        if line.startswith("0::/"):
            own = _GROUPS / line.removeprefix("0::/")
            return [own, *[above for above in own.parents if above.is_relative_to(_GROUPS)]]
    return []


def _left(group: Path, limit: str, used: str) -> int | None:
    allowed, now = _text(group / limit), _text(group / used)
    return int(allowed) - int(now) if allowed.isdecimal() and now.isdecimal() else None


def _left_bytes(group: Path) -> int | None:
    """Bytes that a control group may still use; the system can reclaim its page cache."""
    left = _left(group, "memory.max", "memory.current")
    files = _fields(group / "memory.stat", " ").get("file", "0")
    return None if left is None else left + int(files)


def _fields(path: Path, sign: str = ":") -> dict[str, str]:
    split = [line.partition(sign) for line in _text(path).splitlines()]
    return {name: value for name, _, value in split}


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


def prepare(wanted: bool | None, scene: Scene, needed: int, note: Callable[[str], None]) -> bool:
    """Whether the processes of a world share memory, after orphaned files are removed.

    `needed`: bytes for all processes. `wanted` is the setting; None: if the string is large.
    """
    if wanted is False or (wanted is None and column_bytes(scene) < LARGE_BYTES):
        return False
    remove_orphans()
    # A process that writes beyond the free space would be killed by SIGBUS.
    shared = has_room(needed)
    if wanted and not shared:
        note(f"no room for {needed >> 20} MB of shared memory; large messages go through sockets")
    return shared


def has_room(needed: int, folder: Path = SHARED_MEMORY) -> bool:
    """Whether this much shared memory is free, in bytes, and can be written."""
    try:
        # A container may mount it read-only; Zenoh would then not even listen.
        return os.access(folder, os.W_OK) and shutil.disk_usage(folder).free >= needed
    except OSError:
        return False


def remove_orphans(folder: Path = SHARED_MEMORY) -> int:
    """Remove the files of sessions that have ended; returns their number."""
    return sum([_removed(path) for path in sorted(folder.glob("*.zenoh"))])


def _removed(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False  # It belongs to another user, or has just been removed.
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
