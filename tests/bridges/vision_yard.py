"""A small world for cameras: an agent that stores sightings, and a source of images."""

import numpy as np

from minerva_bus import Agent, Default, Degrees, EventType, Generator, Metres, Vocabulary, on
from minerva_bus.world.readings import Image, Mount

eCamera = EventType("eCamera", marker=str, dist=Metres, angle=Default(Degrees, 0.0))


class Watcher(Agent, symbol="AWatcher"):
    marker: str = ""
    dist: Metres = 0.0
    angle: Degrees = 0.0

    @on("eCamera")
    def see(self, camera, moment):
        self.marker, self.dist, self.angle = camera.marker, camera.dist, camera.angle


class Eyeball(Generator, when="freely"):
    """Publishes one image repeatedly, as a robot's camera does."""

    publishes = ("image",)

    def __init__(self, file: str, robot: str = "r"):
        self.file, self.robot = file, robot

    def run(self, emit, stop):
        pixels = np.load(self.file)
        height, width = pixels.shape
        while not stop.wait(0.02):
            emit.publish(
                "image", Image(self.robot, pixels.tobytes(), "mono8", width, height, 0.0, Mount())
            )


vocabulary = Vocabulary.of(eCamera, Watcher)
