"""Running a world in this very process: `minerva run --in-process`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NoAnswer
from queue import Empty, SimpleQueue
from typing import Any

from minerva_bus.blame import blamed, report, whole
from minerva_bus.errors import BusError, MinervaError, UserCodeError, WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.diary import Diary
from minerva_bus.frame.overruns import Overruns, real_period
from minerva_bus.frame.pacing import Glances, Pace
from minerva_bus.frame.participant import Participant, Unready
from minerva_bus.launch.console import Console, live_line
from minerva_bus.launch.exporting import exported
from minerva_bus.launch.printed import MEMBERS, printed
from minerva_bus.launch.recording import recording
from minerva_bus.launch.summary import Summary
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.control import answer
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.notices import Outlet, Published
from minerva_bus.runtime.operating import AskingOperator
from minerva_bus.runtime.runner import Notice, Sink
from minerva_bus.runtime.totals import Totals
from minerva_bus.source import handler_name
from minerva_bus.world.services import Generator, Service

NAP = 0.01
ANSWERED_WITHIN = 1.0
MICRO = 1e6


def close_services(participants: Iterable[Participant]) -> None:
    """Close all services; raises UserCodeError for the first that fails, when all are closed."""
    failures: list[UserCodeError] = []
    for participant in participants:
        if participant.service is not None:
            try:
                with blamed(participant.service.close):
                    participant.service.close()
            except UserCodeError as error:
                failures.append(error)
    for failure in failures[:1]:
        raise failure


class Alone:
    """One world without a bus: the same frames, the same digests."""

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        *sinks: Sink | Callable[[Notice], None],
    ) -> None:
        self._file = file
        self._sinks = sinks
        self._console = console
        self._began = began
        self._status_at = began
        self._status_frame: int = 0
        self._first_frame: float | None = None
        self._last_frame = 0.0
        self.algorithm = FrameAlgorithm(file.world)
        self.pace = Pace(file.rate)
        self.diary = Diary()
        self.overruns = Overruns()
        self._totals = Totals()
        self.hz = 0.0
        self.waited = 0.0
        self._due: float | None = began
        self._glances = Glances()
        self._asked: SimpleQueue[tuple[dict[str, Any], Future[dict[str, Any]]]] = SimpleQueue()
        self._thread = threading.get_ident()
        self._pulsed: dict[str, float] = {}
        self._pulsing: list[tuple[str, Service]] = []
        self._said: SimpleQueue[tuple[Participant, Any]] = SimpleQueue()
        self._outlets: dict[str, Outlet] = {}
        self._stop = threading.Event()

    def run(self) -> Summary:
        """Run the world to its end. Raises WorldStopped where user code failed."""
        with printed(self._log):
            return self._run()

    def _run(self) -> Summary:
        outside = [process.name for process in self._file.processes if process.command]
        if outside:
            raise MinervaError(f"{outside[0]} is a command of its own: run without --in-process")
        elsewhere = [process.name for process in self._file.processes if process.elsewhere]
        if elsewhere:
            raise MinervaError(f"{elsewhere[0]} runs elsewhere: run without --in-process")
        participants = [process.participant() for process in self._file.processes]
        for participant in participants:
            participant.operator = AskingOperator(self._ask)
        record = self._record = recording(
            self._file, self.algorithm, lambda text: self._console.log("record", text)
        )
        on_readings = record.sensed if record.topics else None
        runner = self._runner = InProcessRunner(
            self.algorithm, participants, self._watch, *self._sinks, on_readings=on_readings
        )
        reason = ""
        try:
            for note in self._file.notes:
                self._note(note)
            runner.start()
            self._run_freely(participants)
            self._pulsing = [
                (one.name, one.service)
                for one in participants
                if one.service is not None and one.service.pulse_every
            ]
            with exported(self._file.world.name, self._file.watch.metrics, self._ask, self._note):
                while runner.ended is None:
                    self._turn()
        except KeyboardInterrupt:
            reason = "interrupted"
            runner.handle(s.End(reason))
        except Unready as error:
            raise WorldStopped(str(error)) from None
        except Exception as error:
            raise self._failed(error) from error
        finally:
            self._stop.set()
            self._record.close()
            self._console.end()
            close_services(participants)
        return self._summary(runner, reason)

    def _failed(self, error: Exception) -> WorldStopped:
        """Show an error in a member's code, and why the world stops."""
        running = self._runner.direct.running
        member = MEMBERS if running is None else running.name
        frame = max(self.algorithm.frame if running is None else running.frame, 0)
        self._console.frame = frame
        told = report(error)
        text = f"failed in frame {frame}: {told}"
        self._console.log(member, text, "error")
        self._console.details(member, whole(error))
        self._record.said(member, f"{text}\n{whole(error)}")
        what = told.partition("\n")[0]
        hint = "" if self._console.traceback else " (--traceback shows all frames)"
        return WorldStopped(f"{member} failed in frame {frame}: {what}; the world stops{hint}")

    def _log(self, text: str) -> None:
        self._console.frame = self.algorithm.frame
        self._console.log(MEMBERS, text)

    def _note(self, text: str) -> None:
        self._console.note(f"{self._file.world.name}: {text}")

    # --- one turn: a frame, or a nap until it is due ---

    def _turn(self) -> None:
        self._serve()
        self._hear()
        self._pulse()
        now, due = time.monotonic(), self._next_at()
        if due is None or due > now:
            time.sleep(NAP if due is None else min(due - now, NAP))
            return
        self.pace.began()
        self.overruns.began(real_period(self.pace.rate, self.algorithm.world), now)
        rates = self.algorithm.members.index.rates
        self.tell(s.Begin(self._glances.due(now, rates) if rates else ()))
        self.repace()

    def _next_at(self) -> float | None:
        """When the next frame begins, as things stand."""
        if self._due is None or not self.algorithm.at_rest:
            return self._due
        view = self._glances.next(self.algorithm.members.index.rates)
        return max(self._due, self.pace.rest(self._last_frame, view))

    def _pulse(self) -> None:
        now = time.monotonic()
        for name, service in self._pulsing:
            if now >= self._pulsed.get(name, 0.0) + service.pulse_every:
                self._pulsed[name] = now
                with blamed(service.pulse):
                    service.pulse()
                with blamed(service.leaves):
                    leaves = service.leaves()
                if leaves:
                    self.tell(s.End(f"{name} was closed"))

    # --- free-running generators, each in a thread of its own ---

    def _run_freely(self, participants: list[Participant]) -> None:
        for one in participants:
            if isinstance(one.service, Generator) and not one.service.lockstep:
                threading.Thread(
                    target=self._emit_all, args=(one, one.service), daemon=True
                ).start()

    def _emit_all(self, participant: Participant, service: Generator) -> None:
        try:
            outlet = Outlet(lambda said: self._said.put((participant, said)), self._stop)
            self._outlets[participant.name] = outlet
            service.run(outlet, self._stop)
        except (Exception, SystemExit) as error:
            failure = UserCodeError(handler_name(service.run), service.run)
            failure.__cause__ = error
            self._said.put((participant, failure))

    def _hear(self) -> None:
        for _ in range(self._said.qsize()):  # What comes meanwhile has to wait for a frame.
            participant, said = self._said.get()
            self._runner.direct.running = participant
            if isinstance(said, Exception):
                raise said
            if isinstance(said, Published):
                self._runner.publish(participant.published(said.topic, said.reading))
            else:
                self.tell(participant.emitted(said))
            self._outlets[participant.name].taken()

    # --- what those who operate it need ---

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and carry out all that follows from it."""
        self._runner.handle(stimulus)

    def repace(self) -> None:
        """The pace has changed: the next frame may begin now, later, or not at all."""
        self._due = self.pace.due(time.monotonic())

    def measured(self) -> Mapping[str, float]:
        """The parts of a frame: in one process, nothing is waited for."""
        return {}

    def counted(self) -> Totals:
        """Frames and events; in one process there are no bytes."""
        return self._totals

    def refused(self) -> Mapping[str, int]:
        """Nothing: nobody comes from outside."""
        return {}

    def restart(self, member: str) -> str:
        """Why a member cannot be started anew."""
        return "all members are in one process: none can be started anew alone"

    def _ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """Answer a question, asked in any thread, between two frames."""
        asked = {"ask": question, **details}
        if threading.get_ident() == self._thread:
            found = answer(asked, self)
        else:
            later: Future[dict[str, Any]] = Future()
            self._asked.put((asked, later))
            try:
                found = later.result(ANSWERED_WITHIN)
            except NoAnswer:
                raise BusError(f"{self._file.world.name} has not answered for a second") from None
        if "error" in found:
            raise BusError(str(found["error"]))
        return found

    def _serve(self) -> None:
        while True:
            try:
                asked, later = self._asked.get_nowait()
            except Empty:
                return
            later.set_result(answer(asked, self))

    def _watch(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Notify):
            self._console.frame = self.algorithm.frame
            self._console.log(instruction.member, instruction.text, "warning")
            said = f"{instruction.text}\n{instruction.details}".rstrip()
            self._record.said(instruction.member, said)
            frame = self.algorithm.frame
            self.diary.said(time.time(), instruction.member, instruction.text, frame, "warning")
        elif isinstance(instruction, s.FrameDone):
            self._record.frame(instruction)
            now = time.monotonic()
            self._count(instruction, now - (self._last_frame or now))
            self._last_frame = now
            late = self.overruns.done(instruction.frame, now)
            if late:
                self._watch(s.Notify("coordinator", late))
            self.diary.frame(instruction.frame, instruction.events)
            if self._first_frame is None:
                self._first_frame = now
            if now - self._status_at >= 0.1:
                self._show(now)

    def _count(self, done: s.FrameDone, seconds: float) -> None:
        self._totals.add({"frame": MICRO * seconds})
        self._totals.count(done.events)

    def _show(self, now: float) -> None:
        frame = self.algorithm.frame
        rate = (frame - self._status_frame) / (now - self._status_at)
        self._status_at, self._status_frame = now, frame
        self.hz = rate
        status = {"frame": frame, "rate": rate, "members": 1, "waiting": (), "waited": 0.0}
        self._console.live(
            live_line(self._file.world.name, status, self._file.world.frames, self._began)
        )

    def _summary(self, runner: InProcessRunner, reason: str) -> Summary:
        ended, first = runner.ended, self._first_frame
        return Summary(
            world=self._file.world.name,
            frames=self.algorithm.frame,
            digest=self.algorithm.scene.digest.hex(),
            reached=self.algorithm.reached,
            ended=reason or (ended.reason if ended is not None else ""),
            wall_seconds=0.0 if first is None else self._last_frame - first,
            first_frame_seconds=None if first is None else max(0.0, first - self._began),
            members=len(self._file.processes),
            seed=self._file.world.seed,
            startup={},
            figures={**(ended.figures if ended else {}), **self.overruns.figures()},
            before=self._file.world.past.frame,
        )
