"""Measured costs of this machine for benchmarks/scale_model.py, from short runs.

The frames of a world run in one process, with separate times for the coordinator and for a host of
agents; messages are encoded and decoded as on the bus. The cost of a member is the slope of an
empty lockstep over real processes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any, cast

import numpy as np
import zenoh

from benchmarks.forked import task
from benchmarks.models import plain, wealth
from benchmarks.scale_model import Costs, Kind
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import open_client, open_hub
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.world.order import Order

FRAMES, WARM_UP = 12, 4
SIZES = (4_000, 40_000)
MEMBERS = (1, 8)
STEPS = 300
TURNS = 3
LARGE = 4_000_000
MODELS: dict[str, ModuleType] = {"in columns, all send": wealth, "one by one": plain}


class Weighed(InProcessRunner, Sink):
    """A world in one process, with the times of both sides and the bytes between them."""

    def __init__(self, algorithm: FrameAlgorithm, members: list[Member]) -> None:
        super().__init__(algorithm, members, self, deliver=self._answers)
        self.ours = self.theirs = self.bytes = 0.0
        self.rows: list[tuple[float, float, float]] = []
        self._began = 0.0
        self._sent: tuple[Any, bytes] = None, b""
        self._decoders = {member.name: Decoder(algorithm.world.vocabulary) for member in members}
        self._decoder = Decoder(algorithm.world.vocabulary)

    def run(self, frames: int) -> list[tuple[float, float, float]]:
        """Seconds of the coordinator and of its members, and bytes, for each frame."""
        self.start()
        for _ in range(frames):
            self.ours = self.theirs = self.bytes = 0.0
            self.handle(s.Begin())
            self.rows.append((self.ours, self.theirs, self.bytes))
        return self.rows

    def received(self, stimulus: s.Stimulus) -> None:
        """Start the coordinator's time when the algorithm receives a stimulus."""
        self._began = time.perf_counter()

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Stop the coordinator's time when the algorithm has decided."""
        self.ours += time.perf_counter() - self._began

    def _answers(self, member: Member, message: Any) -> Iterator[Any]:
        if message is not self._sent[0]:
            self._sent = message, self._as_ours(lambda: encode(message))
        data = self._sent[1]
        self.bytes += len(data)
        began = time.perf_counter()
        decoder = self._decoders[member.name]
        if isinstance(message, m.Welcome):
            self._decoders[member.name] = Decoder(message.vocabulary)
        answers = member.receive(decoder.to_member(data))
        sent = [encode(answer) for answer in answers]
        self.theirs += time.perf_counter() - began
        for answer in sent:
            self.bytes += len(answer)
            yield self._as_ours(
                lambda answer=answer: self._decoder.from_member(member.name, answer)
            )

    def _as_ours(self, work: Callable[[], Any]) -> Any:
        began = time.perf_counter()
        done = work()
        self.ours += time.perf_counter() - began
        return done


def world_of(model: ModuleType, agents: int) -> Weighed:
    """A model's world with one host, ready to run."""
    members = [Member(name, make()) for name, make in model.services(agents).items()]
    members.append(Member("host", None, model.kinds))
    world = World(
        model.NAME, model.scene(agents, 7), model.vocabulary, seed=7, order=Order(model.order),
        expected=frozenset(member.name for member in members),
    )  # fmt: skip
    return Weighed(FrameAlgorithm(world), members)


def kind(model: ModuleType) -> Kind:
    """Costs of an agent of a model: the slope between two sizes."""
    rows = [np.min(world_of(model, size).run(WARM_UP + FRAMES)[WARM_UP:], axis=0) for size in SIZES]
    slope = np.maximum((rows[1] - rows[0]) / (SIZES[1] - SIZES[0]), 1e-12)
    ours, theirs, size = (float(number) for number in slope)
    return Kind(ours, theirs, size)


def lockstep(members: int) -> dict[str, float]:
    """Results of an empty lockstep with this number of processes, in microseconds."""
    return task("benchmarks.lockstep", members, STEPS)


def seconds_per_byte() -> float:
    """Cost of a byte between two sessions, from messages of some megabytes."""
    session, endpoint = open_hub("hub")
    with session, open_client("member", endpoint) as member:
        channel = member.declare_subscriber("minerva/scale", zenoh.handlers.FifoChannel(4))
        publisher = session.declare_publisher(
            "minerva/scale", congestion_control=zenoh.CongestionControl.BLOCK
        )
        until = time.monotonic() + 5
        while not cast("Any", publisher.matching_status).matching and time.monotonic() < until:
            time.sleep(0.01)
        took = []
        for _ in range(20):
            began = time.perf_counter()
            publisher.put(bytes(LARGE))
            channel.recv()
            took.append(time.perf_counter() - began)
    return min(took) / LARGE


def lockstep_costs() -> Costs:
    """Costs of an empty frame and of each member; the minimum of several turns counts."""
    turns = [{count: lockstep(count) for count in MEMBERS} for _ in range(TURNS)]
    medians = [1e-6 * min(turn[count]["us_per_step_median"] for turn in turns) for count in MEMBERS]
    member = max((medians[-1] - medians[0]) / (MEMBERS[-1] - MEMBERS[0]), 1e-6)
    results = [turn[count] for turn in turns for count in MEMBERS]
    spread = min(result["us_per_step_p99"] / result["us_per_step_median"] for result in results)
    return Costs(max(medians[0] - member * MEMBERS[0], 1e-6), member, 0.0, spread)


def measure() -> Costs:
    """Measure all costs of this machine; takes half a minute.

    The minimum over several turns excludes the effects of other load.
    """
    kinds = {name: kind(model) for name, model in MODELS.items()}
    return replace(lockstep_costs(), byte=seconds_per_byte(), kinds=kinds)
