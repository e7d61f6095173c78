"""The undisturbed run of a simulated world in one process, with the same orders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import count

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.grammar.events import Event
from minerva_bus.runtime.runner import InProcessRunner
from tests.simulator.worlds import ORDERS, eCry, processes, world

Orders = tuple[tuple[int, tuple[tuple[str, int], ...]], ...]
"""Orders of people by frame: event types with their numbers."""


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """Digest, events and drawing of each frame."""

    digests: tuple[str, ...]
    events: tuple[tuple[str, ...], ...]
    shown: Mapping[int, str]


# Many histories have the same length and no orders.
@lru_cache(512)
def undisturbed(frames: int, orders: Orders, *, norms: bool, divided: int) -> Undisturbed:
    """Run the world for some frames with these orders, norms and divided generators."""
    digests: list[str] = []
    events: list[tuple[str, ...]] = []
    shown: dict[int, str] = {}

    def watch(instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            digests.append(instruction.record.digest.hex())
            events.append(tuple(map(str, instruction.events)))

    due = dict(orders)
    algorithm = FrameAlgorithm(world(frames, norms=norms, divided=divided))
    runner = InProcessRunner(algorithm, _members(shown, divided), watch)
    runner.start()
    while runner.ended is None:
        # The number of finished frames is the number of the next one.
        for event_type, number in due.get(len(digests), ()):
            runner.handle(s.Publish(ORDERS[event_type](number)))
        runner.handle(s.Begin())
    return Undisturbed(tuple(digests), tuple(events), shown)


def _members(shown: dict[int, str], divided: int) -> list[Member]:
    return [process.make_member() for process in processes(shown, count(1), divided)]


def orders_in(events: Iterator[Event]) -> tuple[tuple[str, int], ...]:
    """Events of a frame that people sent."""
    return tuple((event.type, event.data["n"]) for event in events if event.type in ORDERS)


def cries_in(events: Iterator[Event]) -> tuple[int, ...]:
    """Numbers of the gulls' cries among the events of a frame."""
    return tuple(event.data["n"] for event in events if event.type == eCry.name)
