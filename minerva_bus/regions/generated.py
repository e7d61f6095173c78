"""The events of generators in a world in regions, as those of one coordinator.

Region 0 reports them, because most are equal in all regions. A service with a halo runs in each
region and answers for its agents only, so each region reports these events, and the coordinator
sorts them by the places of their receivers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.grammar.batch import Events
from minerva_bus.regions.kept import joined_parts, texts_of
from minerva_bus.regions.merging import PlacedEvent, in_order
from minerva_bus.regions.place_table import joined
from minerva_bus.regions.places import packed_places, unpacked_places


def reported(
    inputs: FrameInputs | None, answered: Mapping[str, Sequence[PlacedEvent]], *, first: bool
) -> FrameInputs | None:
    """The inputs that a region reports of a frame: all if it is the first one.

    `answered` are the events of services with a halo, which are the region's own part.
    """
    if inputs is None:
        return None
    own: dict[str, m.TickReply] = {}
    for name, events in answered.items():
        saved = inputs.ticked[name].saved if name in inputs.ticked else None
        own[name] = m.TickReply(name, inputs.frame, tuple([each.event for each in events]), saved)
    if first:
        return replace(inputs, ticked={**inputs.ticked, **own}).without_replies
    return FrameInputs(inputs.frame, (), own, {}, (), (), {}) if own else None


def packed_answers(answered: Mapping[str, Sequence[PlacedEvent]]) -> m.Saved:
    """The places of the receivers of these events, by service; None without services."""
    return {
        name: packed_places(joined(each.places for each in events))
        for name, events in answered.items()
    } or None


class GeneratedEvents:
    """The events of generators in the frame in progress, from the reports of regions."""

    def __init__(self) -> None:
        self._inputs: FrameInputs | None = None
        self._answers: dict[str, dict[str, list[PlacedEvent]]] = {}
        self._saved: dict[str, dict[str, m.Saved]] = {}

    def add(self, region: str, inputs: FrameInputs, answers: m.Saved, *, first: bool) -> None:
        """Note what a region has reported. Raises ProtocolError if its parts contradict."""
        given = cast("Mapping[str, Any]", answers or {})
        self._answers[region] = {
            name: list(_placed(name, inputs, data)) for name, data in given.items()
        }
        for name in given:
            saved = inputs.ticked[name].saved if name in inputs.ticked else None
            texts_of(saved)
            self._saved.setdefault(name, {})[region] = saved
        if first:
            self._inputs = inputs

    def take(self) -> FrameInputs:
        """Remove and return the inputs of all regions."""
        assert self._inputs is not None
        placed: dict[str, list[PlacedEvent]] = {}
        for _, answers in sorted(self._answers.items()):
            for name, events in answers.items():
                placed.setdefault(name, []).extend(events)
        before, ticked = self._inputs.ticked, dict(self._inputs.ticked)
        for name, events in placed.items():
            reply = before.get(name, m.TickReply(name, self._inputs.frame, ()))
            saved = joined_parts([part for _, part in sorted(self._saved[name].items())])
            ticked[name] = m.TickReply(name, reply.frame, tuple(in_order(events)), saved)
        inputs, self._inputs = replace(self._inputs, ticked=ticked), None
        self._answers, self._saved = {}, {}
        return inputs


def _placed(name: str, inputs: FrameInputs, data: object) -> Sequence[PlacedEvent]:
    if not isinstance(data, bytes):
        raise ProtocolError(f"part: answered has no places for {name[:40]}")
    # Replies without events are not encoded.
    reply = inputs.ticked.get(name, m.TickReply(name, inputs.frame, ()))
    counts = [len(event) if isinstance(event, Events) else 1 for event in reply.events]
    places, end = unpacked_places(data, sum(counts), "answered"), 0
    made: list[PlacedEvent] = []
    for event, count in zip(reply.events, counts, strict=True):
        begin, end = end, end + count
        made.append(PlacedEvent(places[begin:end], event))
    return made
