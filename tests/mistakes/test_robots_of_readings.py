"""A reading names the agent that has the sensor; a text that is no id is refused at its sensor."""

import numpy as np
import pytest

from minerva_bus import Agent, Degrees, EventType, Generator, Metres, World, on, run, service
from minerva_bus.errors import MinervaError
from minerva_bus.world.readings import Scan
from minerva_services.sensors.laser import Laser

eLaser = EventType("eLaser", dist=Metres, angle=Degrees)


class Lidar(Generator):
    publishes = ("scan",)

    def __init__(self, robot: str) -> None:
        self.robot = robot

    def generate(self, tick):
        tick.publish("scan", Scan(self.robot, np.ones(3, np.float32), 0.0, 1.0, 8.0, 0.0))


class Car(Agent, symbol="ACar"):
    hits: int = 0

    @on("eLaser")
    def hit(self, laser, moment):
        self.hits += 1


def world(robot):
    services = {"lidar": service(Lidar, robot=robot), "laser": service(Laser)}
    return World("ACar#a", agents=[Car], services=services, symbols=[eLaser], frames=2)


@pytest.mark.parametrize("robot", ["a b", "", "#a", "a\n", "ä", "é" * 10_000])
def test_a_text_that_is_no_id_is_refused_at_the_sensor(robot):
    with pytest.raises(MinervaError) as error:
        run(world(robot))
    text = str(error.value)
    assert "lidar: robot of a Scan on 'scan'" in text
    assert "is not a valid agent id; expected letters" in text
    assert "Lidar.generate" in text
    assert len(text) < 1000


def test_that_of_an_agent_reaches_it():
    assert str(run(world("a")).scene) == "ACar#a<hits=6>()"
