"""A small world with a steered rover and all kinds of sensor readings, and records of it."""

import io
from typing import Literal

import numpy as np
from PIL import Image as Pillow

from minerva_bus import Agent, Degrees, EventType, Generator, Metres, World, on
from minerva_bus.api.running import run_file
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.world.readings import (
    Battery,
    Image,
    Mount,
    Odometry,
    Position,
    Scan,
    Sighting,
    Sightings,
)

eSteer = EventType("eSteer", ahead=Metres, turn=Degrees)
SPEED, TURN = 0.25, 10.0


class Rover(Agent, symbol="ARover"):
    x: Metres = 0.0
    y: Metres = 0.0
    angle: Degrees = 0.0
    gear: Literal["low", "high"] = "low"
    moves: bool = False

    @on("eSteer")
    def steer(self, event, moment):
        self.x += event.ahead
        self.angle += event.turn
        self.gear = "high" if event.ahead > SPEED else "low"
        self.moves = True


def png(shade):
    """A picture file of 4 x 3 pixels."""
    file = io.BytesIO()
    Pillow.new("RGB", (4, 3), (shade, 10, 20)).save(file, "PNG")
    return file.getvalue()


def readings(number, time):
    """A reading on each topic."""
    ranges = np.array([1.5 + number, 8.0, 0.0, 0.75], np.float32)
    pixels = bytes(range(number, number + 18))
    yield "scan", Scan("r1", ranges, -30.0, 20.0, 8.0, time, 0.1, 0.0, 90.0)
    yield "image", Image("r1", pixels, "rgb8", 3, 2, time, Mount(0.2))
    depths = np.array([[0.5, np.inf, 2.0], [number, np.nan, 1.0]], "<f4").tobytes()
    yield "depth", Image("r1", depths, "32FC1", 3, 2, time)
    yield "photo", Image("r1", png(number), "png", 4, 3, time)
    yield "odometry", Odometry("r1", 1.0 + number, 2.0, 90.0, 0.5, 10.0, time)
    yield "battery", Battery("r1", 0.5, 12.0, time)
    yield "position", Position("r1", 50.0, 14.5, 200.0, 3.0, time)
    yield "sightings", Sightings("r1", (Sighting("kitchen", 3.0, -5.0),), time)


class Driver(Generator, events=("eSteer",)):
    """Steers each rover, except in frame 2, and publishes readings from frame 1 on."""

    publishes = tuple(topic for topic, _ in readings(0, 0.0))

    def generate(self, tick):
        if tick.number:
            for topic, reading in readings(tick.number, tick.time):
                tick.publish(topic, reading)
        if tick.number != 2:
            ahead = SPEED * (1 + tick.number) + float(tick.random.random())
            yield eSteer(ahead, TURN, receivers=["r1"])
            yield eSteer(ahead / 2, -TURN, receivers=["r2"])


def yard(driver=Driver):
    return World(
        "ARover#r1 · ARover#r2<x=5>", agents=[Rover], services=[driver], name="yard", frames=5
    )


def record_yard(path, world=None, **settings):
    """A run of the yard, recorded with all topics."""
    given = Overrides(record=str(path), record_topics="all", rate=0.0, **settings)
    return run_file((world or yard()).read(given), 0.0)
