"""Runs a world as regions in this process: `minerva run --regions N --in-process`."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from weakref import WeakSet

from minerva_bus.errors import WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member import Member, Unready
from minerva_bus.frame.pace import Pace
from minerva_bus.launch.compiling import compile_agents
from minerva_bus.launch.console import Console
from minerva_bus.launch.failures import CodeFailure
from minerva_bus.launch.free_running import FreeRunning, close_services
from minerva_bus.launch.in_process import POLL_SECONDS
from minerva_bus.launch.in_process_parts import members_of
from minerva_bus.launch.interrupts import interrupts_deferred
from minerva_bus.launch.printed import MEMBERS, printed
from minerva_bus.launch.summary import RunSummary
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.regions.attached import HOME, Replies
from minerva_bus.regions.balancing import balanced, is_due
from minerva_bus.regions.merging import Units, merged
from minerva_bus.regions.norms import total_figures
from minerva_bus.regions.progress import RegionsGoal
from minerva_bus.regions.region import Region
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.runner import Notice


@dataclass(frozen=True, slots=True)
class _Part:
    """A region with its members."""

    region: Region
    members: list[Member]
    runner: InProcessRunner


class _AllRegions:
    """Passes the output of services that run freely to all regions; they exist once, in `HOME`."""

    def __init__(self, runners: Sequence[InProcessRunner]) -> None:
        self.direct = runners[HOME].direct
        self._runners = runners

    def handle(self, stimulus: s.Stimulus) -> None:
        """Let each region process a stimulus, so that it counts in the same frame in all."""
        for runner in self._runners:
            runner.handle(stimulus)

    def publish(self, readings: m.Readings) -> None:
        """Deliver readings to the services that are there, too."""
        self._runners[HOME].publish(readings)


class RegionRun:
    """One world as regions: the same digests as with one coordinator.

    `run` runs it to its end. Each region has a member for each process of the world file, so a
    generator makes its events in each region, equally.
    """

    def __init__(self, file: WorldFile, console: Console, began: float) -> None:
        """`file` has a partition; `began` is the program's start, on the monotonic clock."""
        self._file = file
        self._console = console
        self._began = began
        self._parts: list[_Part] = []
        self._pace = Pace(file.rate)
        self._frame = 0
        self._ending: RegionsGoal | None = None
        self._units: list[Units] = []
        self._first_at: float | None = None
        self._last_at = began
        self._reason = ""
        self._services: FreeRunning | None = None

    @property
    def failed(self) -> bool:
        """Whether an error has ended the world, without an exception."""
        return any(part.region.algorithm.failed for part in self._parts)

    def run(self) -> RunSummary:
        """Run the world to its end. Raises WorldStopped if user code fails."""
        with printed(self._print, WeakSet()):
            try:
                with self._reporting():
                    self._open()
                    with interrupts_deferred() as pending:
                        while not self._reason and not pending():
                            self._wait(pending)
                            self._advance()
            except KeyboardInterrupt:
                self._end("interrupted")
            finally:
                if self._services is not None:
                    self._services.stop()
                self._console.end()
                for part in self._parts:
                    elsewhere = part.region.services.elsewhere
                    members = (each for each in part.members if not elsewhere(each))
                    close_services(members, self._console.log)
            return self.summary()

    def summary(self) -> RunSummary:
        """The summary of the run, also of one that has failed."""
        first, file = self._first_at, self._file
        ends = [part.runner.ended for part in self._parts]
        figures = total_figures([ended.figures for ended in ends if ended is not None])
        for part in self._parts[1:] if figures else ():
            for name, value in part.region.services.nearby.figures().items():
                figures[name] = figures.get(name, 0) + value
        scene = merged(self._units).scene if self._units else file.world.scene
        return RunSummary(
            world=file.world.name,
            frames=self._frame,
            digest=scene.digest.hex(),
            reached=self._ending is not None and self._ending.reached,
            ended=self._reason,
            wall_seconds=0.0 if first is None else self._last_at - first,
            first_frame_seconds=None if first is None else max(0.0, first - self._began),
            members=len(file.processes),
            seed=file.world.seed,
            startup={},
            figures={"regions": len(self._parts), **figures},
        )

    def _open(self) -> None:
        file, partition = self._file, self._file.partition
        assert partition is not None
        compile_agents(file.processes, self._console.progress)
        for note in file.notes:
            self._console.note(f"{file.world.name}: {note}")
        for number in range(partition.count):
            members = members_of(file)
            region = Region(file.world, number, partition, members)
            region.services.send = self._receive_replies
            observe, deliver = self._observer(number), region.services.deliver
            runner = InProcessRunner(region.algorithm, members, observe, deliver=deliver)
            self._parts.append(_Part(region, members, runner))
        for part in self._parts:
            part.runner.start()
        home = self._parts[HOME]
        self._services = FreeRunning(
            _AllRegions([each.runner for each in self._parts]), home.members
        )
        self._services.start()
        self._units = [part.region.units for part in self._parts]
        strings = [part.region.algorithm.composition for part in self._parts]
        self._ending = RegionsGoal(file.world, strings)

    def _receive_replies(self, replies: Sequence[Replies]) -> None:
        for each in replies:
            self._parts[each.target].region.receive(each)

    def _observer(self, number: int) -> Callable[[Notice], None]:
        def observe(notice: Notice) -> None:
            if isinstance(notice, s.Notify):
                self._log(f"{notice.member}, region {number}", notice.text, "warning")
            elif isinstance(notice, s.Stopping) and not self._reason:
                # Only a failure ends the algorithm of a region by itself.
                self._reason = notice.reason

        return observe

    def _wait(self, interrupted: Callable[[], bool]) -> None:
        """Wait until the next frame is due; at rest, frames are as rare as with one coordinator."""
        due = self._pace.due(time.monotonic()) or 0.0
        while not self._reason and not interrupted():
            self._pass_on()
            at_rest = all(part.region.algorithm.at_rest for part in self._parts)
            rest = self._pace.rest(self._last_at, float("inf")) if at_rest else 0.0
            remaining = max(due, rest) - time.monotonic()
            if remaining <= 0:
                return
            time.sleep(min(remaining, POLL_SECONDS))

    def _pass_on(self) -> None:
        """Pass on what services that run freely have sent."""
        assert self._services is not None
        self._services.deliver()
        self._services.pulse()

    def _advance(self) -> None:
        """Run one frame in all regions, or end the world."""
        if self._reason:
            return
        assert self._ending is not None
        over = self._ending.why_over(self._frame)
        if over:
            self._show_last()
            self._end(over)
            return
        self._enter(last=False)
        self._balance()
        for part in self._parts:
            part.runner.handle(s.Begin())
            if self._reason:
                return
        units = [part.region.units for part in self._parts]
        self._ending.learn([part.region.progress() for part in self._parts])
        self._exchange()
        # Together, so that an interrupted frame does not count.
        self._frame, self._units = self._parts[0].region.frame, units
        self._last_at = time.monotonic()
        self._first_at = self._last_at if self._first_at is None else self._first_at

    def _show_last(self) -> None:
        """Make the views of the last string."""
        self._enter(last=True)
        for part in self._parts:
            part.region.settle()
            part.region.give(m.RegionRequest(self._frame, views=True))
            part.runner.handle(s.Begin())
        self._exchange()

    def _enter(self, *, last: bool) -> None:
        for_all = [event for part in self._parts for event in part.region.for_all]
        for part in self._parts:
            part.region.enter(lambda: for_all, last=last)

    def _exchange(self) -> None:
        """Pass on the parcels of the frame that is over in all regions."""
        parcels = [parcel for part in self._parts for parcel in part.region.leave()]
        for number, part in enumerate(self._parts):
            sources = [each.source for each in parcels if each.target == number]
            part.region.expect({part.region.frame - 1: sources})
        for parcel in parcels:
            self._parts[parcel.target].region.receive(parcel)

    def _balance(self) -> None:
        """Move the borders, if that is due before this frame."""
        partition = self._parts[0].region.partition
        if is_due(partition, self._frame):
            scene = merged(part.region.units for part in self._parts).scene
            present = partition.moved(balanced(partition, scene))
            for part in self._parts:
                part.region.partition = present

    def _end(self, reason: str) -> None:
        self._reason = reason
        # An interrupted frame may have left some without parcels.
        if not any(part.region.missing for part in self._parts):
            self._enter(last=True)
        for part in self._parts:
            part.region.settle()
            part.region.end()
            part.runner.handle(s.End(reason))

    @contextmanager
    def _reporting(self) -> Generator[None]:
        """Turn errors in a member's code into WorldStopped."""
        try:
            yield
        except WorldStopped:
            raise  # The world does not support regions.
        except Unready as error:
            # No failure of code either: a service cannot run in this world.
            raise WorldStopped(str(error)) from None
        except Exception as error:
            running = (part.region.services.running for part in self._parts)
            # Without one it is the function that assigns regions, or an error of ours.
            member = next(filter(None, running), "regions")
            failure = CodeFailure.of(error, member, self._frame)
            self._reason = failure.reason
            raise failure.stops(self._console) from error

    def _print(self, text: str) -> None:
        self._log(MEMBERS, text, "info")

    def _log(self, member: str, text: str, level: str) -> None:
        self._console.frame = self._frame
        self._console.log(member, text, level)
