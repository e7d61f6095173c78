"""How children end: who has, what an exit code says, and killing one with all it has started."""

from __future__ import annotations

import os
import signal


def next_ended(*, wait: bool = False) -> tuple[int, int] | None:
    """A child that has ended, or that ends while we wait: its process id and its exit code.

    None where there is none.
    """
    try:
        pid, status = os.waitpid(-1, 0 if wait else os.WNOHANG)
    except ChildProcessError:
        return None
    return (pid, os.waitstatus_to_exitcode(status)) if pid else None


def how_ended(code: int) -> str:
    """What an exit code says, in words; below zero, it is the signal that killed."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"


def kill(pid: int) -> None:
    """Kill a child and what it has started: it leads a group, but for its first moment."""
    kill_rest(pid)
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def kill_rest(pid: int) -> None:
    """Kill what a child has started."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return  # A group that is empty, or of zombies.
