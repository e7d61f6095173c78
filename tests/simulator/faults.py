"""Executes the faults of a history when they are due."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from minerva_bus.launch.run_outputs import journal_path
from tests.simulator.history import Fault
from tests.simulator.process import SimulatedProcess

if TYPE_CHECKING:
    from tests.simulator.playing import Play

RESET: Final = 0.02
"""Seconds after which a client notices that its link is cut."""


class Faults:
    """Executes the faults of one history."""

    def __init__(self, play: Play) -> None:
        self._play = play
        self._timeline = play.timeline
        self._network = play.network
        self._journal = journal_path(play.file)
        play.network.crash = self._crash

    def begin(self, frame: int) -> None:
        """Schedule the faults of a frame that begins for the first time."""
        for fault in self._play.history.faults:
            if fault.frame == frame:
                self._timeline.after(fault.delay, lambda fault=fault: self._do(fault))

    def _do(self, fault: Fault) -> None:
        self._timeline.note("fault", str(fault).partition(": ")[2])
        process = self._play.process(fault.target)
        if fault.kind == "attach":
            self._play.attach(fault.target)
        elif fault.kind == "send away":
            self._play.send_away(fault.target)
        elif fault.kind == "lose views of":
            self._network.lossy_until = self._timeline.now + fault.seconds
        elif process is not None:
            self._do_to(process, fault)

    def _do_to(self, process: SimulatedProcess, fault: Fault) -> None:
        if fault.kind == "kill":
            process.kill()
        # Takes effect when the process sends its next messages; see `Network._may_speak`.
        elif fault.kind == "crash":
            self._network.crash_after[process.name] = fault.count
        elif fault.kind == "freeze":
            self._network.freeze(process, fault.seconds)
        elif fault.kind == "echo":
            self._network.echoes_until[process.name] = self._timeline.now + fault.seconds
        else:
            self._to_link(process, fault)

    def _to_link(self, process: SimulatedProcess, fault: Fault) -> None:
        for session in [client for client in self._network.clients if client.process is process]:
            if fault.kind == "cut":
                self._network.cut(session, (RESET, fault.seconds))
            elif session.link is not None:
                session.link.stall(fault.seconds, up=fault.count % 2 == 0, down=True)

    def _crash(self, process: SimulatedProcess) -> None:
        """Kill a process during a turn; its later writes to the journal are lost."""
        # The simulated code continues to the end of its turn; a real process would be dead by then.
        before = _content(self._journal)
        process.after_turn = lambda: _restore(self._journal, before)
        process.kill()


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.exists() else None


def _restore(path: Path, content: bytes | None) -> None:
    if _content(path) == content:
        return
    if content is None:
        path.unlink(missing_ok=True)
    else:
        path.write_bytes(content)
