"""The robot's world frame by frame, with physics and its errors, without a bus."""

import math
import tomllib
from pathlib import Path
from typing import Any

import minerva_agents.robot
from minerva_agents.robot.robot import ALocalisingRobot, ARobot
from minerva_agents.robot.vocabulary import eDecide, eObjective, eRepresent, eSpeed
from minerva_agents.robot.world import scene, vocabulary
from minerva_bus import Frame, Tick, View, WorldInfo, evolve, visualize
from minerva_bus.grammar.scene import agents
from minerva_bus.world.event_collection import Priority, collect
from minerva_services.physics.kept import kept_bodies
from minerva_services.physics.service import Physics
from minerva_services.sensors.camera import Camera
from minerva_services.sensors.laser import Laser

FILE = Path(minerva_agents.robot.__file__).parent / "robot.toml"
ORDER = Priority(tuple(tomllib.loads(FILE.read_text(encoding="utf-8"))["world"]["order"]))
KINDS = {"ARobot": ARobot, "ALocalisingRobot": ALocalisingRobot}
DT = 0.1


class House:
    """The office with one robot on its way to the kitchen; physics executes its commands."""

    def __init__(self, localise, seed=0, **errors):
        self.seed, self.frame = seed, 0
        self.scene = scene({"localise": localise, "parcels": ""})
        self.physics, self.laser, self.camera = Physics(**errors), Laser(), Camera()
        for service in (self.physics, self.laser, self.camera):
            service.joined(WorldInfo("house", vocabulary, seed, DT))
        self.errors = []

    def run(self, frames):
        for _ in range(frames):
            self._step()
        return self

    @property
    def robot(self):
        (node,) = agents(self.scene)
        return KINDS[node.symbol].thaw(node)

    def _step(self):
        frame = Frame(self.frame, DT, self.seed)
        moment = Tick(frame, "physics")
        said: dict[str, list[Any]] = {"physics": list(self.physics.generate(moment))}
        for name, service in (("scan", self.laser), ("sightings", self.camera)):
            readings = tuple(reading for topic, reading in moment.published if topic == name)
            said[name] = list(service.generate(Tick(frame, name, readings=readings)))
        orders = [] if self.frame else [eSpeed(0.8), eObjective("kitchen")]
        events = collect(ORDER, {**said, "people": [*orders, eDecide()]})
        self._compare()
        view = visualize(self.scene, [eRepresent()], KINDS.values())
        self.scene = evolve(self.scene, events, KINDS.values(), frame).scene
        self.physics.show(View(self.frame, "eRepresent", view))
        self.frame += 1

    def _compare(self):
        bodies = kept_bodies(self.physics.save())
        if "r1" not in bodies:
            return  # it has no action yet, so its body has not been placed
        at, robot = bodies["r1"].body.pose, self.robot
        dist = math.dist((at.x, at.y), robot.metres(robot.position))
        self.errors.append((dist, abs(math.remainder(at.angle - robot.angle, 360.0))))
