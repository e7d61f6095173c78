"""Lines of a world's code that can make its runs differ are named, and no others."""

import minerva_determinism.suspects as module
from minerva_bus.launch.installed import find_world, installed_worlds
from minerva_bus.launch.process_specs import forgotten
from minerva_bus.launch.world_files import read_world_file
from minerva_determinism.suspects import MOST_LINES, causes, suspects

HELPER = """\
import time


def now():
    return time.time()  # CLOCK
"""
CODE = """\
import asyncio
import datetime as dt
import math
import random
import socket
import threading
import time
from collections import Counter
from time import perf_counter as ticks

import numpy as np
from minerva_bus import Agent, EventType, Generator, Vocabulary, on
from numpy import random as chances

from NAME_helper import now

eSun = EventType("eSun", light=float)
START = time.monotonic()  # CLOCK
seen = Counter()
stream = np.random.default_rng(3)
total = 0
names: set[str] = set()
lights = {"a": 1.0}


class Plant(Agent, symbol="APlant"):
    height: float = 0.0
    shared = {}

    @on("eSun")
    def grow(self, sun, moment):
        global total
        self.height += moment.random.random() + now()
        if moment.number < 100:
            return
        later = getattr(time, "time")() + ticks() + dt.datetime.now().second  # CLOCK
        when = np.datetime64("now")  # CLOCK
        at = dt.datetime(2030, 1, 1)
        chance = random.random() + chances.rand() + np.random.default_rng().random()  # CHANCE
        other = __import__("random").choice([1, 2])  # CHANCE
        fine = np.random.default_rng(3).random() + random.Random(5).random()
        for each in {"a", "b"}:  # SETS
            pass
        near = {each for each in "abc"} | names
        first, *_ = list(near)  # SETS
        near.pop()  # SETS
        ordered = sorted(near), len(near), max(each for each in near), sorted(map(list, near))
        texts = ",".join(near)  # SETS
        kept = [each for each in lights.keys() - {"b"}]  # SETS
        fine = [each for each in lights]
        number = id(self) + hash("a")  # IDENTITY
        order = sorted("ab", key=id)  # IDENTITY
        seen.update("a")  # SHARED
        many = seen.most_common()
        total += 1  # SHARED
        lights["b"] = 2.0  # SHARED
        Plant.count = 3  # SHARED
        self.shared["a"] = 1  # SHARED
        type(self).number = 2  # SHARED
        stream.random()  # SHARED
        wave = math.sin(3.0) + np.exp(2.0) + self.height**0.5  # FLOATS
        square = self.height**2 + math.sqrt(2.0) + math.floor(2.5)
        turned = np.eye(2) @ np.eye(2)  # FLOATS
        threading.Thread(target=print).start()  # THREADS
        asyncio.run(None)  # THREADS
        socket.create_connection(("a", 1))  # OUTSIDE
        data = open("x")  # OUTSIDE

    def given(self, time, random, items=[]):  # SHARED
        time.time()
        random.random()
        near, seen = sorted({1, 2}), Counter()
        seen.update("a")
        for each in near:
            pass


class Sun(Generator, events=("eSun",)):
    def generate(self, tick):
        yield eSun(light=1.0)


class Wind(Generator, events=("eSun",), when="freely"):
    def run(self, emit, stop):
        emit(eSun(light=time.time()))


vocabulary = Vocabulary.of(eSun, Plant)
"""
FILE = """\
[world]
string = "APlant#a"
vocabulary = "NAME:vocabulary"

[process]
plants.agents = "NAME:Plant"
sun.service = "NAME:Sun"
wind.service = "NAME:Wind"
"""


def test_each_cause_is_named_with_its_line(tmp_path):
    wanted = set()
    for name, code in (("suspected", CODE), ("suspected_helper", HELPER)):
        path = tmp_path / f"{name}.py"
        path.write_text(code.replace("NAME", "suspected"))
        for number, line in enumerate(code.splitlines(), 1):
            if cause := line.partition("  # ")[2]:
                wanted.add((str(path), number, getattr(module, cause)))
    (tmp_path / "world.toml").write_text(FILE.replace("NAME", "suspected"))
    listed = suspects(read_world_file(tmp_path / "world.toml"))
    assert {(each.file, each.line, each.cause) for each in listed} == wanted
    text = causes(listed)
    assert "moment.time" in text[1]
    assert text[2].endswith("suspected.py:18: time.monotonic()")
    assert len([line for line in text if ".py:" in line]) == MOST_LINES


def test_installed_worlds_have_no_suspects_but_the_files_of_their_options():
    files = [
        read_world_file(find_world(name))
        for name in installed_worlds()
        if name not in ("ros2", "rubble")  # They need what is not installed everywhere.
    ]
    assert {each.cause for file in files for each in suspects(file)} <= {module.OUTSIDE}
    assert not [line for file in files for line in forgotten(file.processes)]
