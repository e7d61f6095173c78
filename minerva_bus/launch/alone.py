"""Running a world in this very process: `minerva run --in-process`."""

from __future__ import annotations

import time
import traceback

from minerva_bus.errors import MinervaError, WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.pacing import Pace
from minerva_bus.launch.console import Console, live_line
from minerva_bus.launch.inprocess import InProcess
from minerva_bus.launch.summary import Summary
from minerva_bus.launch.worldfile import WorldFile


class Alone:
    """One world without a bus: the same frames, the same digests."""

    def __init__(self, file: WorldFile, console: Console, began: float) -> None:
        self._file = file
        self._console = console
        self._began = began
        self._status_at = began
        self._status_frame: int = 0
        self._first_frame = 0.0
        self._last_frame = 0.0
        self.algorithm = FrameAlgorithm(file.world)

    def run(self) -> Summary:
        """Run the world to its end. Raises WorldStopped where user code failed."""
        outside = [process.name for process in self._file.processes if process.command]
        if outside:
            raise MinervaError(f"{outside[0]} is a command of its own: run without --in-process")
        participants = [process.participant() for process in self._file.processes]
        runner = InProcess(self.algorithm, participants, self._watch)
        pace = Pace(self._file.rate)
        reason = ""
        try:
            runner.start()
            while runner.ended is None:
                self._sleep_until(pace.due(time.monotonic()))
                runner.tell(s.Begin())
        except KeyboardInterrupt:
            reason = "interrupted"
            runner.tell(s.End(reason))
        except MinervaError as error:
            self._console.log("in-process", traceback.format_exc())
            raise WorldStopped(f"frame {self.algorithm.frame}: {error}") from error
        finally:
            self._console.end()
            for participant in participants:
                if participant.service is not None:
                    participant.service.close()
        return self._summary(runner, reason)

    def _sleep_until(self, due: float) -> None:
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(wait)

    def _watch(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Say):
            self._console.log(instruction.member, instruction.text)
        elif isinstance(instruction, s.FrameDone):
            now = self._last_frame = time.monotonic()
            if not self._first_frame:
                self._first_frame = now
            if now - self._status_at >= 0.1:
                self._show(now)

    def _show(self, now: float) -> None:
        frame = self.algorithm.frame
        rate = (frame - self._status_frame) / (now - self._status_at)
        self._status_at, self._status_frame = now, frame
        status = {"frame": frame, "rate": rate, "members": 1, "waiting": (), "waited": 0.0}
        self._console.live(
            live_line(self._file.world.name, status, self._file.world.frames, self._began)
        )

    def _summary(self, runner: InProcess, reason: str) -> Summary:
        ended = runner.ended
        return Summary(
            world=self._file.world.name,
            frames=self.algorithm.frame,
            digest=self.algorithm.scene.digest.hex(),
            reached=self.algorithm.reached,
            ended=reason or (ended.reason if ended is not None else ""),
            wall_seconds=self._last_frame - self._first_frame,
            first_frame_seconds=max(0.0, self._first_frame - self._began),
            members=len(self._file.processes),
            seed=self._file.world.seed,
            startup={},
            figures=dict(ended.figures) if ended is not None else {},
        )
