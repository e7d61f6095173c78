"""Microseconds from an event to its view in an idle world, compared with bare Zenoh.

    python -m benchmarks.latency [--events 500] [--turns 3] [--json]

A free-running generator emits one event, and a device records the arrival of the view that results
from it. `view`: the event is visual, so the view is from the same frame; the path is generator,
coordinator, host, coordinator, device. `change`: the event changes an agent, which emits a visual
event; the view is from the next frame, with two requests to the host. `zenoh`: a message of 100
bytes goes through a hub in Python, from generator to hub to device. Each runs in separate
processes; both ends read the machine's monotonic clock.
"""

from __future__ import annotations

import json
import os
import statistics
import struct
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import zenoh
from zenoh.handlers import FifoChannel

from benchmarks.command import Table, options
from benchmarks.forked import coordinator, forked
from minerva_bus import (
    Agent,
    Context,
    Device,
    Event,
    EventType,
    Generator,
    Primitive,
    Scene,
    View,
    Vocabulary,
    on,
    view,
)
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.runtime.session import open_client, open_hub

WARM_UP = 50
PAUSE = 0.002
COLUMNS = {"system": "<10", "µs": ">8.0f", "p99": ">8.0f", "ratio": ">6.2f"}
STAMP = struct.Struct("<d")
PTouched = Primitive("PTouched", times=int)
eTouch = EventType("eTouch")
eShow = EventType("eShow", visual=True)


class Touched(Agent, symbol="ATouched"):
    """An agent that counts its events and requests a view after each."""

    times: int = 0

    @on("eTouch")
    def touch(self, event: Event, moment: Context) -> None:
        self.times += 1
        moment.emit(eShow())

    @view("eShow")
    def shown(self, event: Event) -> Scene:
        return PTouched(self.times)


class Finger(Generator, events=("eTouch", "eShow"), when="freely"):
    """Emits an event on request through a pipe, and reports the time."""

    def __init__(self, event: EventType, delivered: int, stamps: int) -> None:
        self.event, self.delivered, self.stamps = event, delivered, stamps

    def run(self, emit, stop) -> None:
        while os.read(self.delivered, 1):
            os.write(self.stamps, STAMP.pack(time.monotonic()))
            emit(self.event())


class Eye(Device, draws=("eShow",)):
    """Reports the time of each view through a pipe."""

    def __init__(self, stamps: int) -> None:
        self.stamps = stamps

    def show(self, view: View) -> None:
        os.write(self.stamps, STAMP.pack(time.monotonic()))


VOCABULARY = Vocabulary.of(PTouched, eTouch, eShow, Touched)


class Pipes:
    """Pipes between processes: requests, times of events and views, endpoints and readiness."""

    def __init__(self, others: int) -> None:
        self.delivered, self.tell = os.pipe()
        self.emitted, self.emits = os.pipe()
        self.seen, self.sees = os.pipe()
        self.endpoints = [os.pipe() for _ in range(others)]
        self.ready, self.is_ready = os.pipe()

    def listening(self, endpoint: str) -> None:
        for _, write in self.endpoints:
            os.write(write, endpoint.encode())

    def endpoint(self, number: int) -> str:
        return os.read(self.endpoints[number][0], 1000).decode()

    def drive(self, events: int) -> list[float]:
        """Trigger one event at a time; returns the µs from each to its view."""
        os.read(self.ready, 1)
        delays: list[float] = []
        for _ in range(WARM_UP + events):
            time.sleep(PAUSE)
            os.write(self.tell, b"x")
            (began,) = STAMP.unpack(os.read(self.emitted, STAMP.size))
            (ended,) = STAMP.unpack(os.read(self.seen, STAMP.size))
            delays.append(1e6 * (ended - began))
        return delays[WARM_UP:]


def minerva(event: EventType, events: int) -> list[float]:
    """Latencies of a world with one agent, a `Finger` and an `Eye`."""
    pipes = Pipes(3)
    members = [
        Member("finger", Finger(event, pipes.delivered, pipes.emits)),
        Member("host", None, [Touched]),
        Member("eye", Eye(pipes.sees)),
    ]

    def take_part(number: int, member: Member) -> int:
        return MemberProcess([member], "latency", pipes.endpoint(number), print).run()

    children = [forked(partial(take_part, n, member)) for n, member in enumerate(members)]
    children.append(forked(lambda: coordinate(pipes, [member.name for member in members])))
    return driven(pipes, children, events)


def coordinate(pipes: Pipes, names: list[str]) -> None:
    world = WorldSpec(
        "latency", VOCABULARY.read("ATouched#a"), VOCABULARY, expected=frozenset(names)
    )

    def frame_done(done: s.FrameDone) -> None:
        if done.frame == 0:
            os.write(pipes.is_ready, b"x")

    coordinator(world, pipes.listening, frame_done).run()


def bare(events: int) -> list[float]:
    """Latencies of two hops of Zenoh."""
    pipes = Pipes(2)
    children = [
        forked(lambda: finger(pipes)),
        forked(lambda: eye(pipes)),
        forked(lambda: hub(pipes)),
    ]
    return driven(pipes, children, events)


def finger(pipes: Pipes) -> None:
    with open_client("finger", pipes.endpoint(0)) as session:
        publisher = session.declare_publisher("a", congestion_control=zenoh.CongestionControl.BLOCK)
        token = session.liveliness().declare_token("alive/finger")
        while os.read(pipes.delivered, 1):
            os.write(pipes.emits, STAMP.pack(time.monotonic()))
            publisher.put(b"x" * 100)
        token.undeclare()


def eye(pipes: Pipes) -> None:
    with open_client("eye", pipes.endpoint(1)) as session:
        received = session.declare_subscriber("b", FifoChannel(16))
        token = session.liveliness().declare_token("alive/eye")
        while received.recv().payload.to_bytes():
            os.write(pipes.sees, STAMP.pack(time.monotonic()))
        token.undeclare()


def hub(pipes: Pipes) -> None:
    session, endpoint = open_hub("hub")
    with session:
        received = session.declare_subscriber("a", FifoChannel(16))
        publisher = session.declare_publisher("b", congestion_control=zenoh.CongestionControl.BLOCK)
        alive = session.liveliness().declare_subscriber("alive/*", FifoChannel(16), history=True)
        pipes.listening(endpoint)
        alive.recv(), alive.recv()
        os.write(pipes.is_ready, b"x")
        while True:
            publisher.put(received.recv().payload.to_bytes())


def driven(pipes: Pipes, children: list[int], events: int) -> list[float]:
    """Drive the processes and kill them at the end."""
    try:
        return pipes.drive(events)
    finally:
        for child in children:
            os.kill(child, 9)
            os.waitpid(child, 0)


SYSTEMS: dict[str, Callable[[int], list[float]]] = {
    "zenoh": bare,
    "view": lambda events: minerva(eShow, events),
    "change": lambda events: minerva(eTouch, events),
}


def measured(system: str, events: int) -> list[float]:
    """Latencies of one system; a separate process forks the others before it opens a session."""
    read, write = os.pipe()

    def body() -> None:
        os.close(read)
        Path(f"/dev/fd/{write}").write_text(json.dumps(SYSTEMS[system](events)))

    child = forked(body)
    os.close(write)
    with os.fdopen(read) as pipe:
        delays = json.loads(pipe.read() or "[]")
    os.waitpid(child, 0)
    return delays


def main() -> None:
    """Measure in turns and print a table; ratios are to bare Zenoh."""
    arguments = options(__doc__, events=500, turns=3)
    turns: dict[str, list[list[float]]] = {system: [] for system in SYSTEMS}
    for _ in range(arguments.turns):
        for system in SYSTEMS:
            turns[system].append(measured(system, arguments.events))
    floor = statistics.median(map(statistics.median, turns["zenoh"]))
    table = Table(COLUMNS, as_json=arguments.json)
    for system, rows in turns.items():
        middle = statistics.median(map(statistics.median, rows))
        slow = statistics.median(statistics.quantiles(row, n=100)[98] for row in rows)
        table.row({"system": system, "us": middle, "us_p99": slow, "ratio": middle / floor})


if __name__ == "__main__":
    main()
