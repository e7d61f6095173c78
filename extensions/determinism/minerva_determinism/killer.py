"""Kills the processes of a running world in turn, with SIGKILL.

    python -m minerva_determinism.killer FRAMES FILE

One is killed in every FRAMES-th frame, whatever it does at that moment, and its name is appended to
FILE. The coordinator comes first, where the system tells which process it is (Linux). It ends with
the process that holds the other end of its standard input.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from select import select
from typing import Final

from minerva_bus.errors import BusError
from minerva_bus.launch.registry import running
from minerva_bus.runtime.operator_client import Client
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.world.operator import MemberStatus

POLL_SECONDS: Final = 0.005


def kill_in_turn(every: int, file: Path) -> None:
    """Kill processes of the world that runs in the runtime folder, until the input ends."""
    while not (worlds := [world for world in running() if world.endpoint]):
        if _input_has_ended():
            return
    world = worlds[0]
    following, turn = every, 0
    with Client(world.endpoint, world.world) as client, file.open("a", encoding="utf-8") as killed:
        while not _input_has_ended():
            # A successor of the coordinator answers after a moment.
            with suppress(BusError):
                status = client.operator.status()
                if status.frame >= following:
                    victims = list(_processes(world.pid, status.members))
                    name, pid = victims[turn % len(victims)]
                    # A process that is about to end.
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)
                        killed.write(f"{name}\n")
                        killed.flush()
                    following, turn = status.frame + every, turn + 1


def _input_has_ended() -> bool:
    """Whether the process that has started this one is gone; returns after a moment."""
    return bool(select([sys.stdin], [], [], POLL_SECONDS)[0])


def _processes(launcher: int, members: tuple[MemberStatus, ...]) -> Iterator[tuple[str, int]]:
    """Names and ids of the processes: the coordinator is the launcher's child without a member."""
    names = {member.pid: member.name for member in members if member.pid}
    children = Path(f"/proc/{launcher}/task/{launcher}/children")
    if children.exists():
        others = {int(pid) for pid in children.read_text().split()} - names.keys()
        yield from ((COORDINATOR, pid) for pid in sorted(others))
    yield from ((names[pid], pid) for pid in sorted(names))


if __name__ == "__main__":
    # On a full disk the run that is being killed cannot write its record either, and reports it.
    with suppress(OSError):
        kill_in_turn(int(sys.argv[1]), Path(sys.argv[2]))
