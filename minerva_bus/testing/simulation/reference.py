"""The undisturbed run of the simulated world: in one process, with the same orders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import count

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.grammar.events import Event
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.testing.simulation.worlds import ORDERS, eCry, processes, world

Orders = tuple[tuple[int, tuple[tuple[str, int], ...]], ...]
"""What people sent, by frame: event types with their numbers."""


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """The digest and the events of each frame, and what its screen has drawn."""

    digests: tuple[str, ...]
    events: tuple[tuple[str, ...], ...]
    shown: Mapping[int, str]


@lru_cache(512)
def undisturbed(frames: int, orders: Orders) -> Undisturbed:
    """The run of so many frames, with these orders."""
    digests: list[str] = []
    events: list[tuple[str, ...]] = []
    shown: dict[int, str] = {}

    def watch(instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            digests.append(instruction.record.digest.hex())
            events.append(tuple(map(str, instruction.events)))

    due = dict(orders)
    members = _members(shown)
    runner = InProcessRunner(FrameAlgorithm(world(frames)), members, watch)
    runner.start()
    while runner.ended is None:
        for event_type, number in due.get(len(digests), ()):
            runner.handle(s.Order(ORDERS[event_type](number)))
        runner.handle(s.Begin())
    return Undisturbed(tuple(digests), tuple(events), shown)


def _members(shown: dict[int, str]) -> list[Member]:
    return [process.participant() for process in processes(shown, count(1))]


def orders_in(events: Iterator[Event]) -> tuple[tuple[str, int], ...]:
    """Those of a frame's events that people sent."""
    return tuple((one.type, one.data["n"]) for one in events if one.type in ORDERS)


def cries_in(events: Iterator[Event]) -> tuple[int, ...]:
    """The numbers of the gulls' cries among a frame's events."""
    return tuple(one.data["n"] for one in events if one.type == eCry.name)
