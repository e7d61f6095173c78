"""Generators and devices: the declarations of their classes."""

from typing import Any

import pytest

from minerva_bus import Context, Device, Event, Frame, Generator
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.frame.member import Member
from minerva_bus.launch.specs import bind
from minerva_bus.world.service_inputs import Tick


class Rain(Generator, events=("eRain",)):
    def generate(self, tick):
        yield Event("eRain")


class Free(Rain, when="freely"):
    pass


class Screen(Device, draws=("eDraw",), coupled=True):
    def show(self, view): ...


def test_a_class_declares_what_it_generates_and_draws():
    assert (Rain().generates(), Rain.when) == (("eRain",), "")
    assert (Free().generates(), Free.when) == (("eRain",), "freely")
    assert (Screen.draws, Screen.coupled, Screen.when) == (("eDraw",), True, "")
    assert (Device.draws, Device.coupled) == ((), False)


def test_one_event_type_is_not_its_letters():
    with pytest.raises(MisuseError, match=r'Bad: events are several, write events=\("eRain",\)'):

        class Bad(Generator, events="eRain"):
            pass

    with pytest.raises(MisuseError, match="draws are several"):

        class Worse(Device, draws="eDraw"):
            pass


@pytest.mark.parametrize("events", [3, "eRain", {"a": 1}, (3,), None])
def test_an_option_overrides_the_default_of_a_service(events):
    class Shower(Rain):
        def __init__(self, events: Any = 1):
            self.events = events

    explained = (
        r"Shower: self.events must be a tuple of names, not .*;"
        " call an attribute for something else, as an option's value, otherwise"
    )
    make = bind(Shower, {"events": events}, "shower")
    with pytest.raises(WorldFileError, match=f"^shower: {explained}"):
        make()
    with pytest.raises(MisuseError, match=f"^{explained}"):
        Member("shower", Shower(events))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("when", 10), ("when", None), ("takes", "last"), ("nth", 0), ("pulse_every", "1"),
    ],
)  # fmt: skip
def test_an_attribute_that_is_not_what_a_member_expects_is_an_error(name, value):
    class Screen(Device, draws=("eDraw",)):
        def show(self, view):
            pass

    screen = Screen()
    setattr(screen, name, value)
    with pytest.raises(MisuseError, match=f"^Screen: self.{name} must be .*, not "):
        Member("screen", screen)


def test_an_option_may_permit_it():
    class Shower(Rain):
        def __init__(self, events: str = "eRain"):
            self.events = tuple(events.split(","))

    class Told(Shower):
        def __init__(self, events: int = 3):
            self.events = events

        def generates(self):
            return ("eRain",) * self.events

    shower = bind(Shower, {"events": "eRain,eHail"}, "shower")()
    assert Member("shower", shower).hello().generates == ("eRain", "eHail")
    assert Member("told", Told(1)).hello().generates == ("eRain",)


@pytest.mark.parametrize("name", ["draws", "topics", "publishes"])
def test_so_of_a_device(name):
    screen = Screen()
    setattr(screen, name, "eDraw")
    with pytest.raises(MisuseError, match=f"Screen: self.{name} must be a tuple of names"):
        Member("screen", screen)


def test_a_tick_is_a_moment_of_a_generator():
    tick = Tick(Frame(3, dt=0.5, seed=1), "rain")
    assert (tick.number, tick.dt, tick.time) == (3, 0.5, 1.5)
    tick.emit(Event("eRain", sender="a"))
    assert tick.emitted == [Event("eRain", sender="a")]


def test_an_agent_emits_in_its_own_name():
    moment = Context(Frame(), "#a")
    moment.emit(Event("eRain", sender="someone else"))
    assert moment.emitted == [Event("eRain", sender="a")]
