"""Loops without end that make events: they stop before they fill the memory."""

import pytest

from minerva_bus import Agent, EventType, Generator, World, on, run
from minerva_bus.errors import MinervaError
from minerva_bus.grammar import batch

eGo = EventType("eGo", speed=float)


class Endless(Generator, events=("eGo",)):
    def generate(self, tick):
        while True:
            yield eGo(1.0)


class Silent(Generator, events=("eGo",)):
    def generate(self, tick):
        while True:
            yield None


class Go(Generator, events=("eGo",)):
    def generate(self, tick):
        return eGo(2.0)


class Car(Agent, symbol="ACar"):
    @on("eGo")
    def go(self, event, moment):
        pass


class Talker(Car, symbol="ATalker"):
    @on("eGo")
    def go(self, event, moment):
        while True:
            moment.emit(eGo(1.0))


@pytest.mark.parametrize(
    ("string", "service", "where"),
    [
        ("ACar#a", Endless, "Endless.generate"),
        ("ACar#a", Silent, "Silent.generate"),
        ("ATalker#a", Go, "go"),
    ],
)
def test_a_loop_without_end_stops_with_its_name(string, service, where, monkeypatch):
    monkeypatch.setattr(batch, "MOST_SINGLE", 5_000)
    world = World(string, agents=[Car, Talker], services=[service], frames=2)
    with pytest.raises(MinervaError) as error:
        run(world)
    assert "makes more than 5,000 events in a frame: end its loop" in str(error.value)
    assert where in str(error.value)


def test_the_limit_is_far_beyond_what_worlds_make():
    assert batch.MOST_SINGLE >= 1_000_000
    batch.check_number(batch.MOST_SINGLE - 1)
