"""Observations of a history while it is played, independent of its members' own views."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import Phase
from minerva_bus.frame.stimuli import FrameInputs
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.runtime.coordinator import Coordinator, Watchers
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import System
from tests.simulator.history import Operation
from tests.simulator.process import SimulatedSystem
from tests.simulator.timeline import Timeline


@dataclass(frozen=True, slots=True)
class ObservedFrame:
    """A frame ended by the coordinator with this `epoch`."""

    number: int
    epoch: int
    time: float
    digest: str
    events: tuple[AnyEvent, ...]
    inputs: FrameInputs


@dataclass(frozen=True, slots=True)
class Asked:
    """A query of a person with its times and answer; None: no answer, or not sent."""

    act: Operation
    at: float
    sent: bool
    done: float
    answer: Mapping[str, Any] | None

    @property
    def confirmed(self) -> bool:
        """Whether the world confirmed it."""
        return self.answer is not None and "error" not in self.answer


@dataclass(slots=True)
class Observed:
    """Observations of a history; `shown` has the screen's drawings by frame."""

    frames: list[ObservedFrame] = field(default_factory=list[ObservedFrame])
    begun: list[tuple[float, int]] = field(default_factory=list[tuple[float, int]])
    asked: list[Asked] = field(default_factory=list[Asked])
    shown: dict[int, str] = field(default_factory=dict[int, str])
    problems: list[str] = field(default_factory=list[str])


Watch = Callable[[Coordinator], None]


class _FrameSink(Sink):
    """Notes the frames of one coordinator as they begin and end."""

    coordinator: Coordinator

    def __init__(
        self,
        timeline: Timeline,
        observed: Observed,
        begins: Callable[[int], None],
        ended: Watch,
        system: System,
    ) -> None:
        self._timeline = timeline
        self._observed = observed
        self._begins = begins
        self._ended = ended
        self._system = system

    @property
    def _lives(self) -> bool:
        """Whether the process runs: effects after a kill during a turn do not count."""
        return isinstance(self._system, SimulatedSystem) and self._system.lives

    def received(self, stimulus: s.Stimulus) -> None:
        """A frame begins."""
        algorithm = self.coordinator.algorithm
        # A frame begins only in this phase; in others the stimulus has no effect.
        ready = algorithm.phase is Phase.READY
        if isinstance(stimulus, s.Begin) and ready and self._lives:
            self._timeline.note("coordinator", f"begins frame {algorithm.frame}")
            self._observed.begun.append((self._timeline.now, algorithm.frame))
            self._begins(algorithm.frame)

    def frame_done(self, notice: s.FrameDone) -> None:
        """A frame ends."""
        # A process that was killed during its turn cannot have ended the frame.
        if not self._lives:
            return
        digest, inputs = notice.record.digest.hex(), notice.inputs
        assert inputs is not None
        self._timeline.note("coordinator", f"ends frame {notice.frame}, {digest[:8]}")
        now, epoch = self._timeline.now, self.coordinator.transport.epoch
        frame = ObservedFrame(notice.frame, epoch, now, digest, notice.events, inputs)
        self._observed.frames.append(frame)
        self._ended(self.coordinator)


def observing(
    timeline: Timeline, observed: Observed, begins: Callable[[int], None], ended: Watch
) -> Callable[..., Coordinator]:
    """A factory of observed coordinators; `begins` and `ended` are called for each frame."""

    def make(
        world: WorldSpec, watchers: Watchers, *, system: System, **options: Any
    ) -> Coordinator:
        sink = _FrameSink(timeline, observed, begins, ended, system)
        sink.coordinator = Coordinator(world, watchers, sinks=[sink], system=system, **options)
        return sink.coordinator

    return make
