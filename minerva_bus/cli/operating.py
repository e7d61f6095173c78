"""`minerva pause`, `resume`, `step`, `rate`, `restart` and `logs`."""

from __future__ import annotations

import time

from minerva_bus.cli.places import client
from minerva_bus.cli.saying import say, tell
from minerva_bus.errors import MinervaError, nearest
from minerva_bus.launch.console import json_line
from minerva_bus.runtime.client import Client
from minerva_bus.world.operator import LogLine

LOOK_EVERY = 0.1
LAST = 1000


def pause_world(connect: str, world: str) -> None:
    """Pause a world before its next frame."""
    with client(connect, world) as asked:
        asked.operator.pause()
        say(f"{asked.world}: paused before frame {_resting(asked)}")


def resume_world(connect: str, world: str) -> None:
    """Resume a world."""
    with client(connect, world) as asked:
        asked.operator.resume()
        say(f"{asked.world}: goes on")


def step_world(frames: int, connect: str, world: str) -> None:
    """Run a number of frames, wait for them, and pause."""
    with client(connect, world) as asked:
        asked.operator.step(frames)
        say(f"{asked.world}: paused before frame {_resting(asked)}")


def set_rate(hz: float, connect: str, world: str) -> None:
    """Change the frame rate of a world."""
    with client(connect, world) as asked:
        asked.operator.set_rate(hz)
        say(f"{asked.world}: {f'{hz:g} frames per second' if hz else 'as fast as it goes'}")


def restart_member(member: str, connect: str, world: str) -> None:
    """Restart a process of a world."""
    with client(connect, world) as asked:
        asked.operator.restart(member)
        say(f"{asked.world}: {member} is started anew")


def drain_member(member: str, connect: str, world: str) -> None:
    """Move the agents of a host to other hosts."""
    with client(connect, world) as asked:
        others = asked.operator.drain(member)
        say(f"{asked.world}: the agents of {member} go to {', '.join(others)}")


def _resting(asked: Client) -> int:
    """Wait until the world has paused and return its frame; report members it waits for."""
    reported: tuple[str, ...] = ()
    while True:
        status = asked.operator.status()
        resumed = not status.paused and not status.left
        if resumed or (status.paused and status.phase == "between frames"):
            return status.frame
        if status.waited > 1 and status.waiting != reported:
            reported = status.waiting
            tell(f"waiting for {', '.join(reported)}")
        time.sleep(LOOK_EVERY)


def show_logs(member: str, follow: bool, connect: str, world: str, json_too: bool) -> None:
    """Print the logs of members, with the messages of the world about them."""
    with client(connect, world) as asked:
        _check_member(asked, member)
        since, answered = 0, False
        while True:
            try:
                lines = asked.operator.logs(since, member)
            except MinervaError:
                if not (follow and answered):
                    raise
                return  # The followed world has ended.
            answered = True
            for line in lines:
                say(_json(line, asked.world) if json_too else _shown(line))
                since = line.number
            if not follow and len(lines) < LAST:
                return
            if follow:
                time.sleep(LOOK_EVERY)


def _check_member(asked: Client, member: str) -> None:
    known = [each.name for each in asked.operator.status().members]
    if member and member not in [*known, "coordinator"]:
        raise MinervaError(f"{asked.world} has no member {member!r}{nearest(member, known)}")


def _json(line: LogLine, world: str) -> str:
    return json_line(line.time, line.level, world, line.frame, line.member, line.text)


def _shown(line: LogLine) -> str:
    clock = time.strftime("%H:%M:%S", time.localtime(line.time))
    return f"{clock}  {line.member} │ {line.text}"
