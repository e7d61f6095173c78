"""A small world for studies, in a separate folder: buds that grow by their vigour."""

from pathlib import Path

MODULE = """
import os
import time

from minerva_bus import Agent, EventType, Primitive, Transformation, Vocabulary, on

eDay = EventType("eDay")
PStone = Primitive("PStone", size=float)
TMove = Transformation("TMove", x=float)


class Bud(Agent, symbol="ABud"):
    vigour: float = 0.1
    size: float = 1.0

    @on("eDay")
    def grow(self, day, moment):
        self.size += self.vigour * (1 + 0.1 * moment.chance.random())
        if self.vigour > 3.0:
            raise ValueError("burst")
        if self.vigour < -3.0:
            time.sleep(60)


vocabulary = Vocabulary.of(eDay, PStone, TMove, Bud)


def size(outcome):
    return sum(node.state["size"] for node in outcome.scene if node.symbol == "ABud")


def days(outcome):
    return outcome.events["eDay"] + 100 * outcome.frames


def far_from_two(rows):
    return abs(rows["size"][-1] - 2.0)


def nothing(outcome):
    return float("nan")


def wrong(outcome):
    raise KeyError("size")


def forgotten(outcome):
    len(outcome.scene)
"""

WORLD = """
[world]
string = "ABud#b<vigour=${vigour}> · PStone<size=1>"
vocabulary = "pond_of_buds:vocabulary"
frames = 5

[options]
vigour = 0.1
wood = "oak"

[process.buds]
agents = "pond_of_buds:Bud"

[process.days]
service = "each"
event = "eDay"
"""


def pond(folder: Path) -> Path:
    """Write the world into a folder; returns its file."""
    (folder / "pond_of_buds.py").write_text(MODULE)
    (folder / "pond.toml").write_text(WORLD)
    return folder / "pond.toml"
