"""What all regions have sent in a frame, as the checkpoint of one coordinator has it.

One coordinator judges the events of agents in the next frame, and a region before it sends them.
"""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.checkpoint import HALTED
from minerva_bus.frame.lag import divided, note_homes, note_sent
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.regions.merging import in_order
from minerva_bus.regions.norms import judged, total_counts
from minerva_bus.regions.part import PartReceiver
from minerva_bus.world.norms import SOURCE


class SentEvents:
    """The events of agents: all of them for the checkpoint, and those that norms permit."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm
        self._all: Sequence[AnyEvent] = ()
        self._allowed: Sequence[AnyEvent] = ()
        self._permitted = judged(algorithm.world)

    def take(self) -> Sequence[AnyEvent]:
        """The permitted events for the frame in progress; those for a later one wait for it."""
        algorithm, inbox = self._algorithm, self._algorithm.inbox
        (near, late), frame = self._permitted, algorithm.frame
        due = inbox.take_postponed(frame)
        if algorithm.world.lag is not None:
            later = frame + algorithm.world.lag.frames
            inbox.take_postponed(later)  # All that have been sent.
            inbox.postpone(later, late)
        return [*due, *near]

    def note(self, parts: Sequence[PartReceiver]) -> None:
        """Note what all regions have sent, and what norms have counted before these events."""
        algorithm, inbox = self._algorithm, self._algorithm.inbox
        self._all = self._allowed = in_order(event for part in parts for event in part.sent)
        note_homes(algorithm)
        if not algorithm.world.norms:
            return
        saved = algorithm.members.saved
        self._all = in_order(event for part in parts for event in part.unjudged)
        inbox.sanctions = [event for part in parts for event in part.norms.sanctions]
        saved[SOURCE] = total_counts(part.norms.counts or {} for part in parts)
        algorithm.norms.count_from(saved[SOURCE])
        halted = sorted(name for part in parts for name in part.norms.halted)
        if halted:
            saved[HALTED] = {"frame": algorithm.frame, "agents": halted}

    def queue(self) -> None:
        """Queue what has been noted, when the frame is complete."""
        noted = note_sent(self._algorithm, self._all)
        same = self._allowed is self._all
        self._permitted = noted if same else divided(self._algorithm, self._allowed)
