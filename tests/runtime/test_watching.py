"""Views start, stop, die and join late: the world is unaffected, and they show all of it."""

import os
import signal

from running import Run, World, eventually, write_world

MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"

[process.first]
service = "yard:Screen"
on_failure = "ignore"
"""
RATE = 50


def frames_within(operator, wanted):
    """Wait for `wanted` frames; returns the members that the world was observed to wait for."""
    until, waited = operator.status().frame + wanted, []

    def there():
        status = operator.status()
        if status.waited > 1:
            waited.append(status.waiting)
        return status.frame >= until

    eventually(there, f"{wanted} frames")
    return waited


def state(operator, name):
    return {member.name: member.state for member in operator.status().members}.get(name)


def present(operator, *names):
    eventually(
        lambda: all(state(operator, name) == "present" for name in names), f"{names} are here"
    )


def attached(world, name):
    return Run(world.folder, "attach", "yard:Screen", "--name", name, "--connect", world.endpoint(),
               "--world", world.name, "--said", "true")  # fmt: skip


def test_views_attach_and_detach_while_the_world_runs(tmp_path):
    with (
        World(write_world(tmp_path, MEMBERS, frames=0, rate=RATE)) as world,
        world.client() as asked,
    ):
        operator = asked.operator
        world.runs("steps", "walkers", "first")
        with attached(world, "stopped") as stopped, attached(world, "killed") as killed:
            present(operator, "stopped", "killed")
            os.kill(stopped.process.pid, signal.SIGSTOP)
            killed.kill()
            eventually(lambda: state(operator, "killed") == "left", "one is gone")
            assert not frames_within(operator, RATE)
            with attached(world, "late"):
                present(operator, "late")
                assert not frames_within(operator, RATE)
            eventually(lambda: state(operator, "stopped") == "left", "its link is given up")
            os.kill(stopped.process.pid, signal.SIGCONT)
            present(operator, "stopped")
            assert not frames_within(operator, RATE)
            before = operator.status().frame
            eventually(lambda: newest(stopped) >= before, "it catches up")


def newest(run):
    """The last frame that a screen has reported."""
    shown = [line for line in run.output if line.startswith("frame ")]
    return int(shown[-1].split()[1].rstrip(":")) if shown else -1
