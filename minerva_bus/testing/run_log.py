"""What a run in memory leaves behind: its trace, its frames and its messages."""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.runtime.runner import Sink
from minerva_bus.testing.trace_lines import trace_line


class RunLog(Sink):
    """Keeps the stimuli, instructions, frames and messages of a run."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._unwritten: list[tuple[s.Stimulus, Sequence[s.Instruction]]] = []
        self.records: list[m.FrameRecord] = []
        self.inputs: list[FrameInputs] = []
        self.said: list[str] = []
        self.is_ready = False

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Keep a stimulus and its instructions for the trace."""
        self._unwritten.append((stimulus, instructions))

    @property
    def trace(self) -> list[str]:
        """Stimuli and instructions as lines, written on demand: few runs need their trace."""
        for stimulus, instructions in self._unwritten:
            self._lines.append(f"> {trace_line(stimulus)}")
            self._lines += [f"    {line}" for line in map(trace_line, instructions) if line]
        self._unwritten.clear()
        return self._lines

    def frame_done(self, notice: s.FrameDone) -> None:
        """Keep the record and the inputs of a frame."""
        self.records.append(notice.record)
        if notice.inputs is not None:
            self.inputs.append(notice.inputs)

    def ready(self, notice: s.Ready) -> None:
        """Note that the next frame may begin."""
        self.is_ready = True

    def notify(self, notice: s.Notify) -> None:
        """Keep a warning."""
        self.said.append(f"{notice.member}: {notice.text}")
