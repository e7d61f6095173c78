"""Where the time of a frame goes, at the coordinator: `minerva run --profile`, `minerva top`.

A coordinator that looks at the clock wherever something begins and ends, for as long as somebody
wants to know.
"""

from __future__ import annotations

import statistics
from array import array
from collections import deque
from collections.abc import Mapping
from time import perf_counter
from typing import Any

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import Phase
from minerva_bus.frame.description import World
from minerva_bus.runtime.coordinator import BusCoordinator
from minerva_bus.runtime.totals import Totals
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.limits import Limits

MICRO = 1e6
RECENT = 64
Figures = dict[str, float]


class Tally:
    """What was measured of each frame, by name: sums within a frame, then one figure a frame."""

    def __init__(self, keep: bool) -> None:
        self.keep = keep
        self._sums: dict[str, float] = {}
        self._frames: dict[str, array[float]] = {}
        self._recent: deque[dict[str, float]] = deque(maxlen=RECENT)
        self.totals = Totals()

    def add(self, name: str, amount: float) -> None:
        """Count an amount towards this frame."""
        self._sums[name] = self._sums.get(name, 0.0) + amount

    def close(self) -> None:
        """The frame is over."""
        sums, self._sums = self._sums, {}
        self._recent.append(sums)
        self.totals.add(sums)
        for name, amount in sums.items() if self.keep else ():
            self._frames.setdefault(name, array("d")).append(amount)

    def recent(self) -> dict[str, float]:
        """The mean of each over the last frames, also over those in which it did not occur."""
        total: dict[str, float] = {}
        for sums in self._recent:
            for name, amount in sums.items():
                total[name] = total.get(name, 0.0) + amount
        return {name: total[name] / len(self._recent) for name in sorted(total)}

    def clear(self) -> None:
        """Forget the last frames: those that follow may be much later."""
        self._sums.clear()
        self._recent.clear()

    def plain(self) -> dict[str, Figures]:
        """Mean, median and 99th percentile over the frames in which it occurred, greatest first."""
        found = {name: _figures(amounts) for name, amounts in self._frames.items()}
        return dict(sorted(found.items(), key=lambda item: (-item[1]["mean"], item[0])))


def _figures(amounts: array[float]) -> Figures:
    ordered = sorted(amounts)
    return {
        "mean": round(statistics.fmean(ordered), 1),
        "p50": round(ordered[len(ordered) // 2], 1),
        "p99": round(ordered[min(len(ordered) - 1, len(ordered) * 99 // 100)], 1),
        "frames": len(ordered),
    }


class TimedDecoder(Decoder):
    """A decoder that counts its time."""

    def __init__(self, world: World, tally: Tally, limits: Limits) -> None:
        super().__init__(world.vocabulary, limits)
        self._tally = tally

    def from_member(self, member: str, data: bytes) -> m.FromMember:
        """A message that a member sent to the coordinator."""
        began = perf_counter()
        try:
            return super().from_member(member, data)
        finally:
            self._tally.add("decode", MICRO * (perf_counter() - began))


class MeasuringCoordinator(BusCoordinator):
    """Runs a world as its base does, and keeps a tally of it, in microseconds and bytes.

    tick, evolve   from the request until the last answer is there
    wait for NAME  from a request until this member's answer, both requests together; nothing where
                   it had answered before the frame began
    collect        what follows from the last answer to a tick: steps 2 to 4
    commit         what ends a frame: the changes put into w, the digest, what comes next
    encode, view   messages to bytes; of these, views with their sending
    decode         answers from bytes, but for those that say nothing, which are not read
    frame          from one end to the next, so with what was waited for between them

    With `keep` it measures from the first frame to the last; else only while a status is asked for.
    """

    def __init__(self, world: World, *others: Any, keep: bool = False, **options: Any) -> None:
        super().__init__(world, *others, **options)
        self.tally = Tally(keep)
        self._measuring = False
        self._asked_at = self._ended_at = perf_counter()
        self._plain_decoder = self._decoder
        self._timed_decoder: Decoder = TimedDecoder(world, self.tally, self.limits)
        self._measure(keep)

    def profile(self) -> Mapping[str, Figures]:
        """What was measured."""
        return self.tally.plain()

    def measured(self) -> Mapping[str, float]:
        """The means of the last frames; whoever asks has the next ones measured, too."""
        super().measured()
        self._measure(True)
        return self.tally.recent()

    def counted(self) -> Totals:
        """What was counted of the frames while somebody asked; so will be the next ones."""
        self.measured()
        return self.tally.totals

    def _measure(self, measuring: bool) -> None:
        self._decoder = self._timed_decoder if measuring else self._plain_decoder
        if measuring and not self._measuring:
            self._asked_at = self._ended_at = perf_counter()
        self._measuring = measuring

    def _look_at_the_clock(self) -> None:
        if self._measuring and not self.tally.keep and not self.watched:
            self._measure(False)
            self.tally.clear()
        super()._look_at_the_clock()

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and do what it says."""
        if not self._measuring:
            super().tell(stimulus)
            return
        self._look_at(stimulus)
        phase, began = self.algorithm.phase, perf_counter()
        answers = isinstance(stimulus, m.TickReply | m.EvolveReply)
        if answers and stimulus.frame == self.algorithm.frame:
            self.tally.add(f"wait for {stimulus.member}", MICRO * (began - self._asked_at))
        instructions = self.algorithm.receive(stimulus)
        ended = perf_counter()
        done = any(isinstance(one, s.FrameDone) for one in instructions)
        if done or self.algorithm.phase is not phase:
            self._note_step(phase, began, ended, done)
        for instruction in instructions:
            self._do(instruction)
        if done:
            self._close()
        elif self.algorithm.phase is not phase:
            self._asked_at = perf_counter()

    def _note_step(self, phase: Phase, began: float, ended: float, done: bool) -> None:
        if phase in (Phase.TICK, Phase.EVOLVE):
            name = "tick" if phase is Phase.TICK else "evolve"
            self.tally.add(name, MICRO * (began - self._asked_at))
        if done or phase is Phase.TICK:
            self.tally.add("commit" if done else "collect", MICRO * (ended - began))

    def _close(self) -> None:
        now = perf_counter()
        self.tally.add("frame", MICRO * (now - self._ended_at))
        self._ended_at = now
        self.tally.close()

    def _do(self, instruction: s.Instruction) -> None:
        if not self._measuring:
            super()._do(instruction)
            return
        began = perf_counter()
        if isinstance(instruction, s.FrameDone):
            self.tally.totals.count(instruction.events)
        super()._do(instruction)
        shows = isinstance(instruction, s.Send | s.Show)
        if shows and isinstance(instruction.message, m.ViewShown):
            self.tally.add("view", MICRO * (perf_counter() - began))

    def _encode(self, message: m.ToMember | m.FrameRecord) -> bytes:
        if not self._measuring:
            return super()._encode(message)
        began = perf_counter()
        data = super()._encode(message)
        self.tally.add("encode", MICRO * (perf_counter() - began))
        self.tally.add("bytes out", len(data))
        return data

    def _decoded_in(self, seconds: float) -> None:
        if self._measuring:
            self.tally.add("decode", MICRO * seconds)

    def _heard(self, member: str, data: bytes) -> None:
        if self._measuring:
            self.tally.add("bytes in", len(data))
        super()._heard(member, data)
