"""A small world for runs on a real bus; `write_world` copies it next to its world files."""

import os
import sys
import time
from pathlib import Path

from minerva_bus import (
    Agent,
    Device,
    EventType,
    Generator,
    Metres,
    Primitive,
    Transformation,
    Vocabulary,
    on,
    view,
)
from minerva_bus.grammar.events import Events
from minerva_bus.world.readings import Battery, Sighting, Sightings

PDot = Primitive("PDot", x=Metres)
TAt = Transformation("TAt", x=Metres)
eStep = EventType("eStep", count=int)
eCall = EventType("eCall", x=Metres)
eSeen = EventType("eSeen", ripples=int)
eNoise = EventType("eNoise")
eWish = EventType("eWish", x=Metres, name=str)
eShow = EventType("eShow", visual=True)


class Walker(Agent, symbol="AWalker"):
    x: Metres = 0.0
    heard: int = 0
    wish: str = ""
    births: int = 0

    @on("eStep")
    def walk(self, step, moment):
        self.x += moment.random.normal() + 0.001 * step.count
        if moment.random.random() < 0.3:
            moment.emit(eCall(self.x))
        if self.births == 0 and self.id in ("a", "b") and moment.number > 5:
            return self.string + self.child(x=self.x)
        return None

    @on("eCall")
    def listen(self, call, moment):
        self.heard += call.sender != self.id

    @on("eSeen")
    def shy(self, seen, moment):
        self.x -= 0.001 * (seen.ripples % 7)

    @on("eWish")
    def wishes(self, wish, moment):
        self.x, self.wish = wish.x, wish.name

    @view("eShow")
    def picture(self, event):
        return TAt(self.x)(PDot(float(self.heard)))


class Steps(Generator, events=("eStep",)):
    def __init__(self):
        self.count = 0

    def generate(self, tick):
        self.count += int(tick.random.integers(1, 5))
        return (eStep(self.count),)

    def save(self):
        return {"count": self.count}

    def restore(self, saved):
        self.count = saved["count"]

    def report(self):
        return {"steps": self.count}


class Water(Generator, Device, draws=("eShow",), coupled=True, when="each frame"):
    """A coupled device that publishes in step the number of figures it was shown."""

    publishes = ("sight",)

    def __init__(self):
        self.figures = 0
        self.ripples = 0

    def show(self, view):
        self.figures = len(view.scene)

    def generate(self, tick):
        self.ripples += self.figures
        tick.publish("sight", Sightings("yard", (Sighting("r", float(self.ripples), 0.0),), 0.0))
        return ()

    def save(self):
        return {"ripples": self.ripples}

    def restore(self, saved):
        self.ripples = saved["ripples"]


class Eye(Generator, events=("eSeen",)):
    topics = ("sight",)

    def generate(self, tick):
        return [eSeen(int(sighting.distance)) for r in tick.readings for sighting in r.seen]


class Screen(Device, draws=("eShow",), when="each frame"):
    """An observer that prints its views if `said` is set."""

    def __init__(self, said: bool = False):
        self.said = said
        self.pictures = 0

    def show(self, view):
        self.pictures += 1
        if self.said:
            print(f"frame {view.frame}: {len(view.scene)} figures", flush=True)

    def report(self):
        return {"pictures": self.pictures}


class Painter(Device, draws=("eShow",), when="each 1000 frames"):
    """An observer that is slow to draw a view and to close its file."""

    def __init__(self, drawing: float = 0.0, closing: float = 0.0):
        self.drawing = drawing
        self.closing = closing
        self.drawn = -1

    def show(self, view):
        time.sleep(self.drawing)
        self.drawn = view.frame

    def close(self):
        time.sleep(self.closing)
        Path("painted.txt").write_text(str(self.drawn), encoding="utf-8")


class Noise(Generator, events=("eNoise",), when="freely"):
    """Runs freely and emits events that no agent handles."""

    def run(self, emit, stop):
        while not stop.wait(0.02):
            emit(eNoise())


class Torrent(Generator, events=("eNoise",), when="freely"):
    """Runs freely and emits as fast as it can."""

    def run(self, emit, stop):
        while not stop.is_set():
            emit(Events.repeated(eNoise(), 1000))


class Flood(Generator, events=("eSeen",)):
    """Many events in every frame."""

    def __init__(self, count: int = 10_000):
        self.count = count

    def generate(self, tick):
        return [eSeen(n) for n in range(self.count)]


class Counts(Generator, events=("eNoise",)):
    """Counts frames, and saves nothing."""

    def __init__(self):
        self.count = 0

    def generate(self, tick):
        self.count += 1


class Wishes(Generator, events=("eWish",)):
    """Forwards orders."""

    def takes_orders(self):
        return self.events

    def generate(self, tick):
        return tick.orders


class Rascal(Generator, events=("eNoise",)):
    """Misbehaves from a frame on; only once if it has a file to remember it by."""

    def __init__(self, deed: str, frame: int = 5, memory: str = ""):
        self.deed, self.frame, self.memory = deed, frame, memory

    def generate(self, tick):
        if tick.number >= self.frame and not (self.memory and Path(self.memory).exists()):
            if self.memory:
                Path(self.memory).touch()
            getattr(self, self.deed)()
        return ()

    def raises(self):
        raise ZeroDivisionError("the rascal's own fault")

    def loops(self):
        while True:
            pass

    def sleeps(self):
        while True:
            time.sleep(60)

    def exits(self):
        os._exit(7)

    def leaves(self):
        sys.exit("no more")

    def chatters(self):
        self.deed = "rests"
        for n in range(3000):
            print(f"line {n} " + "x" * 50)

    def rests(self):
        """Do nothing more."""


class Fragile(Agent, symbol="AFragile"):
    """An agent whose activity fails for a certain step, once."""

    n: int = 0
    memory: str = ""

    @on("eStep")
    def live(self, step, moment):
        self.n += 1
        if self.n == 4 and not (self.memory and Path(self.memory).exists()):
            if self.memory:
                Path(self.memory).touch()
            raise KeyError("a lost key")


vocabulary = Vocabulary.of(*(PDot, TAt, eStep, eCall, eSeen, eNoise, eWish, eShow, Walker, Fragile))


class Gauge(Generator, when="freely"):
    """A free-running sensor, ten times as fast as the frames."""

    publishes = ("battery",)

    def run(self, emit, stop):
        count = 0
        while not stop.wait(0.01):
            count += 1
            emit.publish("battery", Battery("r", 1.0, 12.0, float(count)))


class Reader(Generator, events=("eSeen",)):
    """Counts its readings, and checks that none was skipped or repeated."""

    topics = ("battery",)

    def __init__(self, takes: str = "newest"):
        self.takes = takes
        self.read, self.last, self.ordered = 0, None, True

    def generate(self, tick):
        for reading in tick.readings:
            self.ordered &= self.last is None or reading.time == self.last + 1
            self.read, self.last = self.read + 1, reading.time
        return ()

    def report(self):
        return {"read": self.read, "in order": self.ordered}
