"""Milliseconds from a sensor reading to the end of the frame in which agents process it.

    python -m benchmarks.sensors [--lidars 3] [--beams 720] [--hertz 40] [--rate 30] [--seconds 10]
                                 [--json]

Free-running lidars and a camera (30 images per second, 640 × 480, JPEG of 40 kB) publish readings,
each in a separate process. A generator for each lidar converts each beam with a hit into an event,
and an agent counts these events, while the world runs at its rate. A reading has the machine's
monotonic time. One event per frame carries the time of the oldest reading to the coordinator, which
compares it with the clock at the end of the frame.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import threading
import time
from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.command import options
from benchmarks.forked import Members, coordinator
from minerva_bus import Agent, Context, Event, EventType, Generator, Metres, Tick, Vocabulary, on
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.types import Degrees
from minerva_bus.world.readings import Image, Scan
from minerva_bus.world.services import Emit
from minerva_services.sensors.laser import Laser

IMAGE_BYTES, IMAGE_HERTZ = 40_000, 30.0
WARM_UP = 1.0
eLaser = EventType("eLaser", dist=Metres, angle=Degrees)
eStamp = EventType("eStamp", time=float)
eLook = EventType("eLook", time=float)


class Watcher(Agent, symbol="AWatcher"):
    """Counts the events that it receives."""

    hits: int = 0

    @on("eLaser")
    def see(self, laser: Event, moment: Context) -> None:
        self.hits += 1


VOCABULARY = Vocabulary.of(eLaser, eStamp, eLook, Watcher)


class Lidar(Generator, when="freely"):
    """Publishes the scans of a lidar."""

    def __init__(self, topic: str, beams: int, hertz: float) -> None:
        self.publishes = (topic,)
        self._beams, self._hertz = beams, hertz

    def run(self, emit: Emit, stop: threading.Event) -> None:
        ranges = np.full(self._beams, 2.0, np.float32)
        due = time.monotonic()
        while not stop.wait(max(0.0, due - time.monotonic())):
            due += 1 / self._hertz
            step, now = 360.0 / self._beams, time.monotonic()
            emit.publish(self.publishes[0], Scan("a", ranges, 0.0, step, 8.0, now))


class Eye(Generator, when="freely"):
    """Publishes images."""

    publishes = ("image",)

    def run(self, emit: Emit, stop: threading.Event) -> None:
        data = os.urandom(IMAGE_BYTES)
        while not stop.wait(1 / IMAGE_HERTZ):
            emit.publish("image", Image("a", data, "jpeg", 640, 480, time.monotonic()))


class Stamps(Generator):
    """Emits an event with the time of the oldest reading of the frame."""

    def __init__(self, topic: str, event: EventType) -> None:
        self.topics = (topic,)
        self._event = event

    def generates(self) -> tuple[str, ...]:
        return (self._event.name,)

    def generate(self, tick: Tick) -> Iterator[Event]:
        if tick.readings:
            yield self._event(tick.readings[0].time)


def members(lidars: int, beams: int, hertz: float) -> list[Member]:
    topics = [f"scan{i}" for i in range(lidars)]
    return [
        *(Member(f"lidar{i}", Lidar(topic, beams, hertz)) for i, topic in enumerate(topics)),
        *(Member(f"laser{i}", Laser(topic=topic)) for i, topic in enumerate(topics)),
        Member("camera", Eye()),
        Member("scans", Stamps(topics[0], eStamp)),
        Member("images", Stamps("image", eLook)),
        Member("host", None, [Watcher]),
    ]


def _same(member: Member) -> Member:
    return member


def measured(options: argparse.Namespace) -> dict[str, float]:
    """Run the world; returns times in ms."""
    parts = members(options.lidars, options.beams, options.hertz)
    processes = Members("sensors", {part.name: partial(_same, part) for part in parts})
    stamps: dict[str, list[float]] = {"eStamp": [], "eLook": []}
    frames: list[float] = []

    def frame_done(done: s.FrameDone) -> None:
        now = time.monotonic()
        frames.append(now)
        if now - frames[0] < WARM_UP:
            return
        for event in done.events:
            if isinstance(event, Event) and event.type in stamps:
                stamps[event.type].append(1e3 * (now - event.time))
        if now - frames[0] > WARM_UP + options.seconds:
            hub.inbox.put(s.End("measured"))

    world = WorldSpec(
        "sensors",
        VOCABULARY.read("AWatcher#a"),
        VOCABULARY,
        dt=1 / options.rate,
        expected=frozenset(part.name for part in parts),
    )
    hub = coordinator(world, processes.connect, frame_done, rate=options.rate)
    hub.run()
    processes.wait()
    return figures(stamps, frames)


def figures(stamps: dict[str, list[float]], frames: list[float]) -> dict[str, float]:
    row = {"frames_per_s": round((len(frames) - 1) / (frames[-1] - frames[0]), 1)}
    for name, event_type in (("scan", "eStamp"), ("image", "eLook")):
        times = sorted(stamps[event_type])
        row[f"{name}s"] = len(times)
        for part, of in (("p50", 0.5), ("p90", 0.9), ("p99", 0.99)):
            row[f"{name}_ms_{part}"] = round(times[int(of * (len(times) - 1))], 1)
        row[f"{name}_ms_mean"] = round(statistics.fmean(times), 1)
    bins = np.histogram(stamps["eStamp"], [0, 5, 10, 15, 20, 25, 30, 35, 40, 50, 75, 100, 1e9])[0]
    row["scan_histogram"] = bins.tolist()  # type: ignore[assignment]
    return row


def shown(row: dict[str, float]) -> str:
    edges = ["5", "10", "15", "20", "25", "30", "35", "40", "50", "75", "100", "more"]
    counts: list[int] = row.pop("scan_histogram")  # type: ignore[assignment]
    greatest = max(counts)
    lines = [f"{name:>16} {value:>10,}" for name, value in row.items()]
    lines.append("scan to the end of its frame, ms up to:")
    lines += [
        f"{e:>16} {n:>6} {'█' * (40 * n // greatest)}" for e, n in zip(edges, counts, strict=True)
    ]
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    chosen = options(__doc__, lidars=3, beams=720, hertz=40.0, rate=30.0, seconds=10.0)
    row = measured(chosen)
    settings = {name: getattr(chosen, name) for name in ("lidars", "beams", "hertz", "rate")}
    print(json.dumps({**settings, **row}) if chosen.json else shown(row))


if __name__ == "__main__":
    main()
