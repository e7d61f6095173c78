"""A world as a federate of HELICS, with a broker in this process; `test_helics` runs it."""

import itertools
import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

import helics
import pytest

from minerva_bus import Agent, EventType, MinervaError, World, each, on, run
from minerva_cosimulation.helics import WorldFederate

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "heating"))
import heating
import heating_helics

EXAMPLES = Path(heating.__file__).parent
HOUSE = json.loads((EXAMPLES / "house.json").read_text(encoding="utf-8"))
ROOM = World("ARoom#room", agents=[heating.Room], services=[each(heating.eStep)], name="room")
STEPS = 30
eAsk = EventType("eAsk", text=str, source=str, time=float)
eStep = EventType("eStep")
eAnswer = EventType("eAnswer", text=str, destination=str)
OFFICE = {"name": "office", "period": 2.0, "offset": 0.5, "publications": [], "inputs": []}
DESK = {"key": "desk", "tags": {"receives": "clerk.eAsk", "sends": "clerk.eAnswer"}}
NUMBERS = itertools.count()


class Clerk(Agent, symbol="AClerk"):
    asked: tuple[str, ...] = ()

    @on("eAsk")
    def answer(self, ask, moment):
        self.asked += (f"{ask.source} {ask.time:g} {ask.text}",)
        source = "" if ask.text == "default" else ask.source
        moment.emit(eAnswer(ask.text.upper(), source))


CLERKS = World(
    "AClerk#clerk · AClerk#other", agents=[Clerk], symbols=[eAsk, eAnswer, eStep], name="clerks"
)


@pytest.fixture
def broker():
    """Starts a broker for a number of federates; returns its name."""
    started = []

    def start(federates):
        name = f"broker-{next(NUMBERS)}"
        options = f"--federates {federates} --loglevel=error"
        started.append(helics.helicsCreateBroker("inproc", name, options))
        return name

    yield start
    for each_broker in started:
        helics.helicsBrokerDisconnect(each_broker)


def house(folder, broker_name, **changes):
    """A configuration file of the house."""
    file = folder / "house.json"
    changes |= {"broker": broker_name, "core_name": f"house-{broker_name}", "loglevel": "error"}
    file.write_text(json.dumps({**HOUSE, **changes}), encoding="utf-8")
    return file


def test_the_digest_is_that_of_the_world_alone(broker, tmp_path):
    config = house(tmp_path, broker(1), inputs=[], period=0.5)
    federate = WorldFederate(heating.world, config, frames=2)
    assert federate.run(until=5) == run(heating.world, frames=20).digest


def heated(broker_name, folder):
    """The digest of the room, and the temperatures that the thermostat has got."""
    temperatures = []
    settings = {"broker": broker_name, "core_name": f"thermostat-{broker_name}"}
    other = threading.Thread(
        target=lambda: temperatures.extend(heating_helics.thermostat(STEPS, **settings))
    )
    other.start()
    digest = WorldFederate(ROOM, house(folder, broker_name)).run(until=STEPS)
    other.join()
    return digest, temperatures


def test_another_federate_heats_the_room_as_an_agent_does(broker, tmp_path):
    digest, temperatures = heated(broker(2), tmp_path)
    alone = run(heating.world, frames=STEPS, collect={"celsius": heating.Room.celsius})
    # The thermostat gets a temperature one step after the room has published it.
    assert temperatures == list(alone.table("ARoom")["celsius"])[:STEPS]
    assert heated(broker(2), tmp_path) == (digest, temperatures)


def corresponded(broker_name, folder, sent, **changes):
    """The digest of an office, and the answers to messages: (time, endpoint, data) of a town."""
    answers = []
    config = {"name": "town", "core_type": "inproc", "broker": broker_name, "period": 1.0}
    config |= {
        "core_name": f"town-{broker_name}",
        "endpoints": [{"key": "north"}, {"key": "south"}],
    }
    town = helics.helicsCreateCombinationFederateFromConfig(json.dumps(config))

    def live():
        town.enter_executing_mode()
        for time in range(1, 7):
            town.request_time(time)
            for name, endpoint in town.endpoints.items():
                while endpoint.has_message():
                    message = endpoint.get_message()
                    answers.append((time, name, message.time, message.data))
                for data in sent.get((time, name), ()):
                    endpoint.send_data(data, "office/desk")
        town.disconnect()

    other = threading.Thread(target=live)
    other.start()
    config = house(folder, broker_name, **{**OFFICE, "endpoints": [DESK], **changes})
    try:
        return WorldFederate(CLERKS, config, frames=2).run(until=6), answers
    finally:
        other.join()


def test_messages_are_events_and_events_messages(broker, tmp_path):
    sent = {(1, "town/south"): ["x"], (1, "town/north"): ["z", "y"], (3, "town/south"): ["default"]}
    desk = DESK | {"destination": "town/north"}
    digest, answers = corresponded(broker(2), tmp_path, sent, endpoints=[desk])
    assert answers == [
        (3, "town/north", 2.5, "Z"), (3, "town/north", 2.5, "Y"), (3, "town/south", 2.5, "X"),
        (5, "town/north", 4.5, "DEFAULT"),
    ]  # fmt: skip
    # By time, source and order; only the agent that the tag names.
    with CLERKS.start() as alone:
        for step in (
            [("north", 1, "z"), ("north", 1, "y"), ("south", 1, "x")],
            [("south", 3, "default")],
        ):
            for name, time, data in step:
                alone.publish(eAsk(data, f"town/{name}", time, receivers=["clerk"]))
            alone.step(2)
        assert alone.digest == digest


@pytest.mark.parametrize(
    ("tags", "problem"),
    [
        ({}, "endpoint office/desk needs a tag"),
        ({"sends": "clerk.eAnswe"}, "no event type eAnswe; did you mean 'eAnswer'"),
        ({"receives": "eStep"}, "eStep has the data none; .* has a `text`"),
    ],
)
def test_wrong_tags_are_explained(tags, problem, broker, tmp_path):
    config = house(tmp_path, broker(1), **OFFICE, endpoints=[DESK | {"tags": tags}])
    with pytest.raises(MinervaError, match=problem):
        WorldFederate(CLERKS, config).run(until=2)


@pytest.mark.parametrize(
    ("message", "endpoint", "problem"),
    [
        (
            "a",
            {"tags": {"sends": "eAnswer"}},
            'from town/north to office/desk: .* no tag "receives"',
        ),
        (b"\xff", {}, "from town/north to office/desk is not text"),
        ("default", {}, "clerk sends eAnswer without a destination"),
    ],
)
def test_wrong_messages_are_explained(message, endpoint, problem, broker, tmp_path):
    sent = {(1, "town/north"): [message]}
    with pytest.raises(MinervaError, match=problem):
        corresponded(broker(2), tmp_path, sent, endpoints=[DESK | endpoint])


def test_times_that_helics_does_not_grant_are_explained(broker, tmp_path):
    config = house(tmp_path, broker(1), inputs=[], period=1.0, time_delta=3.0)
    with pytest.raises(MinervaError, match=r"HELICS granted 3 s in place of 1 s"):
        WorldFederate(heating.world, config).run(until=5)


def test_mistakes_are_explained(broker, tmp_path):
    with pytest.raises(MinervaError, match="cannot read"):
        WorldFederate(ROOM, tmp_path / "none.json")
    with pytest.raises(MinervaError, match="`period` as a number of seconds"):
        WorldFederate(ROOM, house(tmp_path, "", period="1 s"))
    with pytest.raises(MinervaError, match="`offset` as a number of seconds"):
        WorldFederate(ROOM, house(tmp_path, "", offset=-1.0))
    (tmp_path / "house.json").write_text("{", encoding="utf-8")
    with pytest.raises(MinervaError, match="is not JSON"):
        WorldFederate(ROOM, tmp_path / "house.json")
    with pytest.raises(MinervaError, match="frames is 0"):
        WorldFederate(ROOM, house(tmp_path, ""), frames=0)
    wrong = {"key": "room.eHeat.wats", "type": "double", "targets": ["thermostat/watts"]}
    with pytest.raises(MinervaError, match=r"eHeat has no 'wats'.*did you mean 'watts'"):
        WorldFederate(ROOM, house(tmp_path, broker(1), inputs=[wrong])).run(until=1)
    missing = {"key": "hall.celsius", "type": "double"}
    with pytest.raises(MinervaError, match="the string has no agent 'hall'"):
        WorldFederate(ROOM, house(tmp_path, broker(1), publications=[missing])).run(until=1)


def test_an_interrupt_ends_a_federate_that_waits_for_others(tmp_path):
    program = f"""
import helics, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {str(EXAMPLES)!r})
import heating
from minerva_cosimulation.helics import WorldFederate
broker = helics.helicsCreateBroker("inproc", "alone", "--federates 2 --loglevel=error")
federate = WorldFederate(heating.world, {str(house(tmp_path, "alone"))!r})
print("waits", flush=True)
federate.run(until=1)
"""
    words = [sys.executable, "-c", program]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"waits\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate()
    assert process.returncode != 0
    assert b"KeyboardInterrupt" in errors
