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

from minerva_bus import MinervaError, World, each, run
from minerva_cosimulation.helics import WorldFederate

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "heating"))
import heating
import heating_helics

EXAMPLES = Path(heating.__file__).parent
HOUSE = json.loads((EXAMPLES / "house.json").read_text(encoding="utf-8"))
ROOM = World("ARoom#room", agents=[heating.Room], services=[each(heating.eStep)], name="room")
STEPS = 30
NUMBERS = itertools.count()


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


def test_mistakes_are_explained(broker, tmp_path):
    with pytest.raises(MinervaError, match="cannot read"):
        WorldFederate(ROOM, tmp_path / "none.json")
    with pytest.raises(MinervaError, match="`period` as a number of seconds"):
        WorldFederate(ROOM, house(tmp_path, "", period="1 s"))
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
