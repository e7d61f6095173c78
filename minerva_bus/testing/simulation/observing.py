"""What can be seen of a history while it is played, beside its members' own views."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import Phase
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.runtime.coordinator import BusCoordinator
from minerva_bus.runtime.profile import MeasuringCoordinator
from minerva_bus.testing.simulation.history import Act
from minerva_bus.testing.simulation.process import SimulatedSystem
from minerva_bus.testing.simulation.timeline import Timeline


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame that a coordinator has ended; `epoch` is the coordinator's."""

    number: int
    epoch: int
    time: float
    digest: str
    events: tuple[AnyEvent, ...]
    inputs: FrameInputs


@dataclass(frozen=True, slots=True)
class Asked:
    """What a person has asked: when, and what was answered; None: nothing, or it was not sent."""

    act: Act
    at: float
    sent: bool
    done: float
    answer: Mapping[str, Any] | None

    @property
    def confirmed(self) -> bool:
        """Whether the world says that it was done."""
        return self.answer is not None and "error" not in self.answer


@dataclass(slots=True)
class Observed:
    """A history as it went; `shown` is what the screen has drawn of which frame."""

    frames: list[Frame] = field(default_factory=list[Frame])
    begun: list[tuple[float, int]] = field(default_factory=list[tuple[float, int]])
    asked: list[Asked] = field(default_factory=list[Asked])
    shown: dict[int, str] = field(default_factory=dict[int, str])
    problems: list[str] = field(default_factory=list[str])


Watch = Callable[[BusCoordinator], None]


def observing(
    timeline: Timeline, observed: Observed, begins: Callable[[int], None], ended: Watch
) -> Callable[..., BusCoordinator]:
    """What makes coordinators that are observed; `begins` and `ended` are called for each frame."""

    class Observing(MeasuringCoordinator):
        """The real one, whose frames are noted as they begin and end."""

        @property
        def _lives(self) -> bool:
            return isinstance(self._system, SimulatedSystem) and self._system.lives

        def tell(self, stimulus: s.Stimulus) -> None:
            """Give the algorithm a stimulus, and do what it says."""
            ready = self.algorithm.phase is Phase.READY
            if isinstance(stimulus, s.Begin) and ready and self._lives:
                frame = self.algorithm.frame
                timeline.note("coordinator", f"begins frame {frame}")
                observed.begun.append((timeline.now, frame))
                begins(frame)
            super().tell(stimulus)

        def _end_frame(self, instruction: s.FrameDone) -> None:
            super()._end_frame(instruction)
            if not self._lives:
                return  # What it does after it was killed amid a turn is seen by nobody.
            digest, inputs = instruction.record.digest.hex(), instruction.inputs
            assert inputs is not None
            timeline.note("coordinator", f"ends frame {instruction.frame}, {digest[:8]}")
            now, events = timeline.now, instruction.events
            frame = Frame(instruction.frame, self.epoch, now, digest, events, inputs)
            observed.frames.append(frame)
            ended(self)

    return Observing
