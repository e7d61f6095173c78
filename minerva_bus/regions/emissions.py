"""What all regions have sent in a frame, as the checkpoint of one coordinator has it.

One coordinator judges the events of agents in the next frame, and a region before it sends them.
"""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.checkpoint import HALTED
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.regions.merging import in_order
from minerva_bus.regions.norms import total_counts
from minerva_bus.regions.part import PartReceiver
from minerva_bus.world.norms import SOURCE


def take_events(
    algorithm: FrameAlgorithm, parts: Sequence[PartReceiver]
) -> tuple[Sequence[AnyEvent], Sequence[AnyEvent]]:
    """All that agents have sent, for the checkpoint, and what norms permit of it.

    The checkpoint also has what norms have counted before they judged these events.
    """
    inbox, saved = algorithm.inbox, algorithm.members.saved
    permitted = in_order(event for part in parts for event in part.sent)
    if not algorithm.norms:
        return permitted, permitted
    sent = in_order(event for part in parts for event in part.unjudged)
    inbox.sanctions = [event for part in parts for event in part.norms.sanctions]
    saved[SOURCE] = total_counts(part.norms.counts or {} for part in parts)
    algorithm.norms.count_from(saved[SOURCE])
    halted = sorted(name for part in parts for name in part.norms.halted)
    if halted:
        saved[HALTED] = {"frame": algorithm.frame, "agents": halted}
    return sent, permitted
