"""What norms rejected in recorded frames: events to or from an agent, and its own steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.inputs import is_people
from minerva_bus.frame.norms import Norms
from minerva_bus.grammar.events import AnyEvent, single
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.past_frames import PastFrame, agent_in
from minerva_bus.log.sources import person_behind, sources_of
from minerva_bus.wording import short
from minerva_bus.world.norms import SOURCE, Norm


def rejected_events(world: WorldSpec, past: PastFrame, name: str) -> Iterator[str]:
    """Events of a frame to or from an agent that norms have rejected, in words."""
    norms = [norm for norm in world.norms if norm.on and norm.refuses]
    types = {event_type for norm in norms for event_type in norm.on}
    kept = {each: _of_type(past, each) for each in types}
    composition: Composition | None = None
    for source, events in sorted(sources_of(past).items()):
        for event in single(each for each in events if each.type in types):
            concerned = name == event.sender or not event.receivers or name in event.receivers
            if not concerned or any(event == other for other in single(kept[event.type])):
                continue
            composition = composition or Composition(past.before)
            for norm in norms:
                judged = _norms(world, norm, composition, past).events(
                    past.frame.number, {source: [event]}, past.people
                )
                if not judged[source]:
                    whom = f"#{event.sender}" if event.sender else source
                    if is_people(source):
                        whom = person_behind(source, past.frame.number).text
                    yield f"{_begin(past, norm)} {short(str(event))}, sent by {whom}"
                    break


def rejected_step(world: WorldSpec, past: PastFrame, name: str, result: Scene) -> str:
    """The norm that rejected the result of λ for an agent, in words; empty if none did.

    `result` is what its methods made of the part of the string around it.
    """
    after = agent_in(past.after, name)
    computed = agent_in(result, name)
    if after is not None and computed is not None and after.values == computed.values:
        return ""
    # Each agent is a fragment of its own here, also one in columns.
    composition = Composition(past.before, columns=False)
    home = composition.home(name)
    for norm in [norm for norm in world.norms if not norm.on and norm.refuses]:
        judge = _norms(world, norm, composition, past)
        trial = judge.agents(past.frame.number, {home or name: result}, {})
        if trial is not None and trial.open:
            return f"{_begin(past, norm)} the step of #{name}"
    return ""


def _begin(past: PastFrame, norm: Norm) -> str:
    return f"frame {past.frame.number}: the norm {norm.name} rejected"


def _of_type(past: PastFrame, event_type: str) -> list[AnyEvent]:
    return [event for event in past.frame.events if event.type == event_type]


def _norms(world: WorldSpec, norm: Norm, composition: Composition, past: PastFrame) -> Norms:
    checkpoint = past.checkpoint
    counts: Mapping[str, Any] = {}
    if checkpoint is not None:
        counts = checkpoint.saved.get(SOURCE, counts)
    return Norms((norm,), composition, world.vocabulary, counts)
