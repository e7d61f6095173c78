"""A world whose agents kill their process, once or always, in a module that workers can import."""

import os
import signal
from pathlib import Path

from minerva_bus import Agent, EventType, World, each, on

eTick = EventType("eTick")
NEVER, ONCE, ALWAYS = 0, 1, 2
MARK = "MINERVA_TEST_MARK"
"""The variable with the file that exists after the first kill."""


class Bomb(Agent, symbol="ABomb"):
    fuse: int = NEVER
    age: int = 0

    @on("eTick")
    def live(self, tick, moment):
        self.age += 1
        mark = Path(os.environ[MARK])
        if self.fuse == ALWAYS or (self.fuse == ONCE and not mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)


def bomb(options):
    return f"ABomb#a<fuse={options['fuse']}>"


def bombs():
    return World(bomb, agents=[Bomb], services=[each(eTick)], options={"fuse": 0}, name="bombs")


def fuse(outcome):
    """The fuse of the agent after a run, as fitness."""
    return next(node.state["fuse"] for node in outcome.scene.nodes if hasattr(node, "state"))
