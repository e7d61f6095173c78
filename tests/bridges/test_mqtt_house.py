"""The house example with real processes and a real broker."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mosquitto import Mosquitto, eventually, needs_mosquitto

from minerva_bus import evolve, visualize

pytest.importorskip("paho.mqtt")
pytestmark = needs_mosquitto

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "worlds" / "minerva_worlds" / "house"
sys.path.insert(0, str(FOLDER))

from house import Thermostat, eSwitch, eTarget, eTemperature, vocabulary  # noqa: E402


def test_a_thermostat():
    room = vocabulary.read("AThermostat#bath<target=20>")
    for celsius, heats in ((20.4, "false"), (19.4, "true"), (20.4, "true"), (20.6, "false")):
        room = evolve(room, [eTemperature(celsius)], [Thermostat]).scene
        seen = str(visualize(room, [eSwitch()], [Thermostat]))
        assert seen == f'TRoom<room="bath">(PHeater<on={heats}>)'
    room = evolve(room, [eTarget(25.0)], [Thermostat]).scene
    assert "on=true" in str(visualize(room, [eSwitch()], [Thermostat]))


def commands():
    """Topics and payloads of the publish commands in the README."""
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    published = re.findall(r"mosquitto_pub -t (\S+) -m (?:'([^']+)'|(\S+))", text)
    return [(topic, quoted or plain) for topic, quoted, plain in published]


@pytest.fixture
def house(tmp_path):
    """The broker of the house, and a function that starts its world."""
    broker, worlds = Mosquitto(tmp_path), []

    def begin():
        env = os.environ | {
            "MINERVA_RUNTIME_DIR": str(tmp_path / "run"),
            "PYTHONPATH": os.pathsep.join(str(ROOT / name) for name in ("", "services", "agents")),
        }
        words = ["run", "house.toml", "--broker", broker.address]
        folder = shutil.copytree(FOLDER, tmp_path / "house")
        out = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        command = [sys.executable, "-m", "minerva_bus.cli.main", *words]
        worlds.append(subprocess.Popen(command, cwd=folder, env=env, **out))
        return worlds[0]

    yield broker, begin
    for world in worlds:
        world.kill()
        world.wait()
        world.stdout.close()
    broker.kill()


def test_the_house_of_the_readme(house):
    broker, begin = house
    with broker.client("home/#") as client:
        world = begin()

        def heard(*message, since=0):
            there = lambda: message in [entry[:2] for entry in client.heard[since:]]  # noqa: E731
            eventually(there, message, 40)

        heard("home/minerva", b"online")
        heard("home/kitchen/heater/set", b"OFF")
        kitchen, bath, target = commands()
        client.publish(*kitchen)
        heard("home/kitchen/heater/set", b"ON")
        client.publish("home/kitchen/temperature", "90")
        client.publish(*bath)
        client.publish(*target)
        heard("home/bath/heater/set", b"ON")
        before = len(client.heard)
        client.publish("home/kitchen/temperature", "30")
        heard("home/kitchen/heater/set", b"OFF", since=before)
        world.send_signal(signal.SIGINT)
        said, _ = world.communicate()
        heard("home/minerva", b"offline")
    assert "Traceback" not in said
