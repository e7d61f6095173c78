"""Runs a world with one space in this process, with one frame per step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

from minerva_bus import Event, EventType, Generator, Tick, Vocabulary
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.world.event_collection import Priority
from minerva_fast import Space

eStep = EventType("eStep")


class Clock(Generator, events=("eStep",)):
    """Starts a step in every frame."""

    def generate(self, tick: Tick) -> Iterator[Event]:
        yield eStep()


def world_of(space: Space, steps: int, seed: int) -> WorldSpec:
    """The world with this space, which takes one step in each frame."""
    vocabulary = Vocabulary.of(eStep, type(space))
    expected = frozenset({"host", "clock"})
    return WorldSpec("comparison", space.string, vocabulary, seed=seed, order=Priority(("eStep",)),
                 frames=steps, expected=expected)  # fmt: skip


def members_of(space: Space) -> dict[str, Callable[[], Member]]:
    """The functions that make the members of its world, by name."""
    return {
        "clock": lambda: Member("clock", Clock()),
        "host": lambda: Member("host", agents=[type(space)]),
    }


def stepped(
    space: Space, steps: int, seed: int, watch: Callable[[FrameAlgorithm], object] | None = None
) -> Mapping[str, Any]:
    """The state of the space after some steps; `watch` is called after each."""
    algorithm = FrameAlgorithm(world_of(space, steps, seed))
    members = [make() for make in members_of(space).values()]
    runner = InProcessRunner(algorithm, members, lambda _: None)
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
        if watch is not None:
            watch(algorithm)
    return cast("AgentNode", algorithm.scene.nodes[0]).state
