"""The undisturbed run of a simulated world in one process, with the same orders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import count

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.grammar.events import Event
from minerva_bus.regions.lag import RegionLag
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.testing.simulation.worlds import ORDERS, eCry, processes, running_ahead, world

Orders = tuple[tuple[int, tuple[tuple[str, int], ...]], ...]
"""Orders of people and cries of gulls by frame: event types with their numbers."""


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """Digest, events and drawing of each frame, and what members have reported at the end."""

    digests: tuple[str, ...]
    events: tuple[tuple[str, ...], ...]
    shown: Mapping[int, str]
    figures: m.Figures


# Many histories have the same length and no orders.
@lru_cache(512)
def undisturbed(frames: int, orders: Orders, lag: RegionLag | None = None) -> Undisturbed:
    """Run the world for some frames with these orders, and perhaps as regions run ahead in it."""
    digests: list[str] = []
    events: list[tuple[str, ...]] = []
    shown: dict[int, str] = {}

    def watch(instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            digests.append(instruction.record.digest.hex())
            events.append(tuple(map(str, instruction.events)))

    due = dict(orders)
    present = world(frames) if lag is None else running_ahead(world(frames), lag)
    members = [each for each in _members(shown) if each.name in present.expected]
    runner = InProcessRunner(FrameAlgorithm(present), members, watch)
    runner.start()
    while runner.ended is None:
        # The number of finished frames is the number of the next one.
        for event_type, number in due.get(len(digests), ()):
            is_cry = event_type == eCry.name
            runner.handle(
                m.Emitted("gulls", (eCry(number),))
                if is_cry
                else s.Publish(ORDERS[event_type](number))
            )
        runner.handle(s.Begin())
    return Undisturbed(tuple(digests), tuple(events), shown, runner.ended.figures)


def _members(shown: dict[int, str]) -> list[Member]:
    return [process.participant() for process in processes(shown, count(1))]


def orders_in(events: Iterator[Event]) -> tuple[tuple[str, int], ...]:
    """Events of a frame that people sent."""
    return tuple((event.type, event.data["n"]) for event in events if event.type in ORDERS)


def cries_in(events: Iterator[Event]) -> tuple[int, ...]:
    """Numbers of the gulls' cries among the events of a frame."""
    return tuple(event.data["n"] for event in events if event.type == eCry.name)
