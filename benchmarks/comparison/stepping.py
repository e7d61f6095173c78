"""Runs a world with one space in this process, with one frame per step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, cast

from minerva_bus import Event, EventType, Generator, Tick, Vocabulary
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.space import Space
from minerva_bus.world.order import Order

eStep = EventType("eStep")


class Clock(Generator, events=("eStep",)):
    """Starts a step in every frame."""

    def generate(self, tick: Tick) -> Iterator[Event]:
        yield eStep()


def stepped(space: Space, steps: int, seed: int, *, digests: bool = False) -> Mapping[str, Any]:
    """The state of the space after some steps; `digests` computes that of every frame."""
    kind = type(space)
    vocabulary = Vocabulary.of(eStep, kind)
    expected = frozenset({"host", "clock"})
    world = World("comparison", space.string, vocabulary, seed=seed, order=Order(("eStep",)),
                  frames=steps, expected=expected)  # fmt: skip
    algorithm = FrameAlgorithm(world)
    members = [Member("clock", Clock()), Member("host", agents=[kind])]
    runner = InProcessRunner(algorithm, members, lambda _: None)
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
        if digests:
            assert algorithm.scene.digest
    return cast("AgentNode", algorithm.scene.nodes[0]).state
