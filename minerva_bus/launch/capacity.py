"""What this machine can carry: cores, open files, threads and memory, before a world starts."""

from __future__ import annotations

import math
import os
import resource
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.wording import counted

FILES_BESIDE: Final = 256
"""Files that launcher and coordinator have open beside one for each process, at most."""

THREADS_EACH: Final = 10
"""Threads of one process: Python's main one and the lifeline's, and Zenoh's; measured: 8."""

BYTES_EACH: Final = 8 << 20
"""Memory that one process has for itself before it does anything; measured: 7.3 MB."""

CHECKED_FROM: Final = 32
"""Processes from which on it is looked at: fewer fit wherever Python does."""

_GROUPS: Final = Path("/sys/fs/cgroup")


@dataclass(frozen=True, slots=True)
class Bounds:
    """What may still be had here; None: nobody sets a bound, or it cannot be told.

    `files` are open files of one process, and `threads` those of all processes together.
    """

    files: int | None = None
    threads: int | None = None
    bytes: int | None = None


def shortage(processes: int, bounds: Bounds) -> str:
    """Why a world of so many processes cannot start here, and what helps; empty where it can."""
    files, threads = processes + FILES_BESIDE, processes * THREADS_EACH
    if bounds.files is not None and files > bounds.files:
        return (
            f"{files} open files in one process, and {bounds.files} are allowed:"
            f" raise the limit (ulimit -n {files})"
        )
    if bounds.threads is not None and threads > bounds.threads:
        return (
            f"about {threads} threads, and {bounds.threads} more are allowed:"
            " raise the limit (ulimit -u, or the container's limit of processes)"
        )
    needed = processes * BYTES_EACH
    if bounds.bytes is not None and needed > bounds.bytes:
        return f"at least {needed >> 20} MiB of memory, and {bounds.bytes >> 20} MiB are free"
    return ""


def make_room(processes: int) -> None:
    """See to it that so many processes can run here. Raises MisuseError where they cannot.

    The soft limit of open files is raised as far as needed, which needs no rights.
    """
    if processes < CHECKED_FROM:
        return
    found = shortage(processes, _this_machine())
    if found:
        raise MisuseError(
            f"{counted(processes, 'process')} cannot start here: they need {found}."
            " Or let fewer processes run the same agents (processes = N)"
        )
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = processes + FILES_BESIDE
    if soft != resource.RLIM_INFINITY and soft < needed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def cores() -> int:
    """How many cores this process may use, as its affinity and its container allow."""
    try:
        mine = len(os.sched_getaffinity(0))
    except AttributeError:  # Not on every system.
        mine = os.cpu_count() or 1
    return max(1, min([mine, *_quotas(_own_groups())]))


def _quotas(groups: Iterable[Path]) -> list[int]:
    found: list[int] = []
    for group in groups:
        quota, _, period = _text(group / "cpu.max").partition(" ")
        if quota.isdecimal() and period.isdecimal():
            found.append(math.ceil(int(quota) / int(period)))
    return found


def _this_machine() -> Bounds:
    groups = _own_groups()
    return Bounds(
        _bound(resource.getrlimit(resource.RLIMIT_NOFILE)[1]),
        _least([_user_threads(), *(_left(group, "pids.max", "pids.current") for group in groups)]),
        _least([_free_bytes(), *map(_left_bytes, groups)]),
    )


def _bound(limit: int) -> int | None:
    return None if limit == resource.RLIM_INFINITY else limit


def _least(bounds: list[int | None]) -> int | None:
    return min((bound for bound in bounds if bound is not None), default=None)


def _user_threads() -> int | None:
    """How many threads this user may still have; the administrator has no such bound."""
    limit = _bound(resource.getrlimit(resource.RLIMIT_NPROC)[0])
    return None if limit is None or os.geteuid() == 0 else limit - _threads_of(os.getuid())


def _threads_of(user: int) -> int:
    found = 0
    for path in Path("/proc").glob("[0-9]*/status"):
        fields = _fields(path)
        if fields.get("Uid", "").split()[:1] == [str(user)]:
            found += int(fields.get("Threads", "1"))
    return found


def _free_bytes() -> int | None:
    fields = _fields(Path("/proc/meminfo"))
    kilobytes = fields.get("MemAvailable", "").split()[:1]
    return int(kilobytes[0]) << 10 if kilobytes else None


def _own_groups() -> list[Path]:
    """The control group of this process, and those around it."""
    for line in _text(Path("/proc/self/cgroup")).splitlines():
        if line.startswith("0::/"):
            own = _GROUPS / line.removeprefix("0::/")
            return [own, *[above for above in own.parents if above.is_relative_to(_GROUPS)]]
    return []


def _left(group: Path, limit: str, used: str) -> int | None:
    most, now = _text(group / limit), _text(group / used)
    return int(most) - int(now) if most.isdecimal() and now.isdecimal() else None


def _left_bytes(group: Path) -> int | None:
    """Memory that a control group may still use; what it holds of files can be had back."""
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
