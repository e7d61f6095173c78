"""The events of generators and people that norms permit in a world of regions.

Every region judges them alike, before its agents receive them. The coordinator does so once more,
from the same counts, because its record and the people who ask it have to know the verdicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, cast

from minerva_bus.frame import messages as m
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.collection import report_orders
from minerva_bus.frame.event_sources import is_handed_over, people_of
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.norms import NORMS
from minerva_bus.grammar.batch import AnyEvent

LINES: Final = "norms"
"""Key in the saved data of a region's `ticked` for what its norms have logged in the frame."""


def log_violations(algorithm: FrameAlgorithm, report: m.TickReply) -> None:
    """Log what the norms of a region have logged, as those of one coordinator do."""
    lines: Any = (report.saved or {}).get(LINES)
    for text in cast("list[object]", lines) if isinstance(lines, list) else ():
        algorithm.out.log(NORMS, str(text))


def permitted_events(
    algorithm: FrameAlgorithm, inputs: FrameInputs, people: Sequence[str]
) -> dict[str, Sequence[AnyEvent]]:
    """The events of generators and people that count in a frame, by source; reports all orders.

    `inputs` are those of a region, and `people` the generators that represent people.
    """
    sources: dict[str, Sequence[AnyEvent]] = {}
    handed: dict[str, Sequence[AnyEvent]] = {}
    for name, sent in inputs.taken.items():
        # Orders that a generator takes do not count themselves.
        if is_handed_over(name):
            handed[people_of(name)] = sent
        else:
            sources[name] = sent
    for name, reply in inputs.ticked.items():
        if reply.events:
            sources[name] = [*reply.events, *sources.get(name, ())]
    norms, frame = algorithm.norms, algorithm.frame
    report_orders(algorithm, norms.events(frame, handed))
    permitted = norms.events(frame, sources, people)
    report_orders(algorithm, permitted)
    # Regions log violations, and send the sanctions.
    norms.forget_effects()
    return {name: events for name, events in permitted.items() if events}
