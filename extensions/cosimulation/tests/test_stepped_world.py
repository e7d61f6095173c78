"""A world that another program steps: inputs, outputs, and its digest."""

import pytest

from minerva_bus import EMPTY, Agent, Default, EventType, MinervaError, World, each, on, run
from minerva_cosimulation import SteppedWorld

eStep = EventType("eStep")
eHeat = EventType("eHeat", watts=float, share=Default(float, 1.0))
eLeave = EventType("eLeave")
eAlarm = EventType("eAlarm")


class Room(Agent, symbol="ARoom"):
    celsius: float = 18.0
    watts: float = 0.0
    heated: int = 0

    @on("eHeat")
    def heat(self, heat, moment):
        self.heated += 1
        if heat.watts > 1000:
            moment.emit(eAlarm())
        self.watts = heat.watts * heat.share

    @on("eStep")
    def cool(self, step, moment):
        self.celsius += self.watts / 2000 - 0.02 * (self.celsius - 5)

    @on("eLeave")
    def leave(self, event, moment):
        return EMPTY


WORLD = World("ARoom#hall · ARoom#bath", agents=[Room], services=[each(eStep)], name="rooms")


@pytest.fixture
def rooms():
    with SteppedWorld(WORLD) as stepped:
        yield stepped


def test_without_inputs_it_is_the_world_alone(rooms):
    rooms.step(3)
    rooms.step(7)
    assert rooms.frame == 10
    assert rooms.digest == run(WORLD, frames=10).digest


def test_an_input_is_an_event_of_one_step(rooms):
    rooms.set("eHeat.watts", 1000)
    rooms.set("bath.eHeat.watts", 200.0)
    rooms.set("bath.eHeat.share", 0.5)
    rooms.step()
    assert (rooms.get("hall.watts"), rooms.get("bath.watts")) == (1000.0, 100.0)
    rooms.step(2)
    rooms.step()
    assert (rooms.get("hall.heated"), rooms.get("bath.heated")) == (1, 2)


def test_events_are_published_and_what_agents_sent_is_known(rooms):
    rooms.publish("bath.eHeat", watts=2000.0)
    rooms.publish("bath.eHeat", watts=20.0)
    rooms.step()
    assert (rooms.get("hall.heated"), rooms.get("bath.heated"), rooms.get("bath.watts")) == (
        0,
        2,
        20.0,
    )
    assert [event.sender for event in rooms.sent("eAlarm")] == ["bath"]
    assert rooms.sent("hall.eAlarm") == rooms.sent("eHeat") == ()
    rooms.step()
    assert rooms.sent("eAlarm") == ()


def test_data_that_were_not_set_keep_their_value(rooms):
    rooms.set("bath.eHeat.watts", 200.0)
    rooms.step()
    rooms.set("bath.eHeat.share", 0.25)
    rooms.step()
    assert rooms.get("bath.watts") == 50.0


def test_the_order_of_inputs_does_not_matter(rooms):
    with SteppedWorld(WORLD) as other:
        for stepped, names in ((rooms, ("hall", "bath")), (other, ("bath", "hall"))):
            for name in names:
                stepped.set(f"{name}.eHeat.watts", 10.0)
            stepped.step(2)
        assert rooms.digest == other.digest


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("watts", "expected EVENT.DATUM or AGENT.EVENT.DATUM"),
        ("hal.eHeat.watts", "no agent 'hal' in frame 0; did you mean 'hall'"),
        ("eHeet.watts", "no event type eHeet; did you mean 'eHeat'"),
        ("eHeat.watt", "eHeat has no 'watt'; did you mean 'watts'"),
    ],
)
def test_a_wrong_input_is_explained(rooms, name, problem):
    with pytest.raises(MinervaError, match=problem):
        rooms.set(name, 1.0)


@pytest.mark.parametrize(
    ("name", "problem"),
    [("hal.watts", "no agent 'hal'"), ("hall.wats", "ARoom has no attribute 'wats'")],
)
def test_a_wrong_output_is_explained(rooms, name, problem):
    with pytest.raises(MinervaError, match=problem):
        rooms.get(name)


def test_a_value_that_does_not_fit_is_explained(rooms):
    rooms.set("eHeat.watts", "warm")
    with pytest.raises(MinervaError, match="watts"):
        rooms.step()
