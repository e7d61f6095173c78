"""The live line and the summary of a run in this process."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.console import Console, live_line
from minerva_bus.launch.summary import RunSummary
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.status import StatusMeter

STATUS_EVERY: Final = 0.1


class InProcessProgress(Sink):
    """Shows the state of the run, and makes its summary."""

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        algorithm: FrameAlgorithm,
        schedule: FrameSchedule,
    ) -> None:
        self.status = StatusMeter(algorithm, schedule.pace, began)
        self._file = file
        self._console = console
        self._began = began
        self._algorithm = algorithm
        self._schedule = schedule
        self._first_frame_at: float | None = None

    def frame_done(self, notice: s.FrameDone) -> None:
        """Show the frame rate every STATUS_EVERY seconds."""
        now = self._schedule.last_frame_at
        if self._first_frame_at is None:
            self._first_frame_at = now
        if now - self.status.at >= STATUS_EVERY:
            rate = self.status.status(now, ()).rate
            frame, frames = self._algorithm.frame, self._file.world.frames
            status = {"frame": frame, "rate": rate, "members": 1, "waiting": (), "waited": 0.0}
            self._console.live(live_line(self._file.world.name, status, frames, self._began))

    def summary(self, ended: s.Ended | None, reason: str) -> RunSummary:
        """The summary of the run; `reason` replaces that of the world."""
        first, algorithm, file = self._first_frame_at, self._algorithm, self._file
        figures = dict(ended.figures) if ended is not None else {}
        return RunSummary(
            world=file.world.name,
            frames=algorithm.frame,
            digest=algorithm.scene.digest.hex(),
            reached=algorithm.reached,
            ended=reason or (ended.reason if ended is not None else ""),
            wall_seconds=0.0 if first is None else self._schedule.last_frame_at - first,
            first_frame_seconds=None if first is None else max(0.0, first - self._began),
            members=len(file.processes),
            seed=file.world.seed,
            startup={},
            figures={**figures, **self._schedule.overruns.figures()},
            before=file.world.past.frame,
        )
