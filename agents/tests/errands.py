"""Robots and parcels on a known floor, frame by frame, without bus or physics."""

import tomllib
from pathlib import Path

import numpy as np

import minerva_agents.robot
from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.grid import FREE, MARKER
from minerva_agents.robot.pose import STAY, action_of
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.vocabulary import eDecide
from minerva_bus import EMPTY, Frame, Scene, evolve
from minerva_bus.grammar.scene import agents
from minerva_bus.world.event_collection import Priority, collect

FILE = Path(minerva_agents.robot.__file__).parent / "robot.toml"
ORDER = Priority(tuple(tomllib.loads(FILE.read_text(encoding="utf-8"))["world"]["order"]))
PLACES = {"office": (10, 10), "store": (10, 40), "lab": (40, 25)}
ALL_MARKERS = (*PLACES, "attic")


def centre(marker):
    """The position of a marker in metres."""
    row, column = PLACES[marker]
    return (row + 0.5) / 10, (column + 0.5) / 10


def known():
    """A grid of free ground in which the robot has seen all markers except the attic's."""
    grid = np.full((50, 50), FREE, np.int16)
    for number, place in enumerate(PLACES.values()):
        grid[place] = MARKER + number
    return grid


def robot(name="r1", row=25.5, column=25.5, **state):
    given = {"speed": 1.0, "markers": ALL_MARKERS, "action": action_of(STAY, name, 0.18)}
    return ARobot(name, grid=known(), row=row, column=column, **(given | state)).string


def parcel(name="p1", marker="office", side=0.0):
    made = AParcel(name, x=0.0, y=0.0, side=side)
    made.stand(marker, *centre(marker))
    return made.string


class Story:
    """Evolves a string; emitted events arrive in the next frame, as on the bus."""

    def __init__(self, *strings):
        self.scene = sum(strings, EMPTY)
        self.frame = 0
        self.coming = []
        self.told = []

    def step(self, *orders):
        """Run one frame with the given orders and an `eDecide`."""
        events = collect(ORDER, {"#": self.coming, "people": [*orders, eDecide()]})
        done = evolve(self.scene, events, [ARobot, AParcel], Frame(self.frame))
        self.scene = done.scene
        self.coming = [event for sent in done.emitted.values() for event in sent]
        self.told += [(self.frame, event) for event in self.coming]
        self.frame += 1
        return self

    def until(self, event_type, frames=300):
        """Step until an agent emits an event of the type; return that event."""
        for _ in range(frames):
            self.step()
            for event in self.coming:
                if event.type == event_type:
                    return event
        raise AssertionError(f"no {event_type} in {frames} frames, but {self.types()}")

    def robot(self, name="r1"):
        return ARobot.thaw(self._node(name))

    def parcel(self, name="p1"):
        return AParcel.thaw(self._node(name))

    def types(self, *types):
        """Senders and types of the emitted events, without `eCarry`."""
        return [
            (event.sender, event.type)
            for _, event in self.told
            if event.type != "eCarry" and (not types or event.type in types)
        ]

    def without(self, name):
        """Remove an agent."""
        self.scene = Scene(tuple(n for n in self.scene if getattr(n, "id", "") != name))

    def _node(self, name):
        return next(node for node in agents(self.scene) if node.id == name)
