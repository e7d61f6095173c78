"""A world in a scenario of mosaik, which controls the time."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("mosaik", reason="needs mosaik (pip install mosaik)")

from minerva_bus import MinervaError, World, each, run
from minerva_cosimulation import SteppedWorld
from minerva_cosimulation.mosaik import MinervaSimulator

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "heating"))
import heating

ROOM = World("ARoom#room", agents=[heating.Room], services=[each(heating.eStep)], name="room")
STEPS = 100


@pytest.fixture
def simulator():
    made = MinervaSimulator()
    yield made
    made.finalize()


def test_the_digest_is_that_of_the_world_alone(simulator):
    simulator.init("house", world=heating.world, frames=5, duration=60)
    simulator.create(1, "World")
    times = [0]
    for _ in range(20):
        times.append(simulator.step(times[-1], {}, 10_000))
    assert times[-1] == 1200
    assert simulator.digest == run(heating.world, frames=STEPS).digest


def test_inputs_are_events_for_all_or_for_one_agent(simulator):
    simulator.init("house", world=ROOM)
    entity = simulator.create(1, "World")[0]
    assert entity["children"] == [{"eid": "room", "type": "ARoom"}]
    simulator.step(0, {"World": {"eHeat.watts": {"t": 50.0}}}, 1)
    simulator.step(1, {"room": {"eHeat.watts": {"t": 70.0}}}, 2)
    with SteppedWorld(ROOM) as stepped:
        stepped.set("eHeat.watts", 50.0)
        stepped.step()
        stepped.set("room.eHeat.watts", 70.0)
        stepped.step()
        assert simulator.digest == stepped.digest
    assert simulator.get_data({"room": ["watts"]}) == {"room": {"watts": 70.0}}


def test_models_are_described(simulator):
    models = simulator.init("house", world=ROOM)["models"]
    assert models["World"]["public"]
    assert models["ARoom"]["attrs"] == ["celsius", "watts", "eHeat.watts"]


def test_mistakes_are_explained(simulator):
    with pytest.raises(MinervaError, match="has not been initialized"):
        simulator.step(0, {}, 1)
    with pytest.raises(MinervaError, match="frames is 0; expected a whole number from 1"):
        simulator.init("house", world=ROOM, frames=0)
    simulator.init("house", world=ROOM)
    with pytest.raises(MinervaError, match="one World; start another simulator"):
        simulator.create(2, "World")
    both = {"room": {"eHeat.watts": {"b.Entity": 1.0, "a.Entity": 2.0}}}
    with pytest.raises(MinervaError, match=r"2 connections to eHeat\.watts: a\.Entity, b\.Entity"):
        simulator.step(0, both, 1)
