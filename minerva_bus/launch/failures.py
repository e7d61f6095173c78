"""Errors in the code of a member that end a run in which members have no processes of their own."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.blame import report, whole
from minerva_bus.errors import WorldStopped
from minerva_bus.launch.console import Console
from minerva_bus.uncaught import VARIABLE


@dataclass(frozen=True, slots=True)
class CodeFailure:
    """An error in the code of a member: its report, and all of its frames as `details`."""

    member: str
    frame: int
    problem: str
    details: str

    @staticmethod
    def of(error: Exception, member: str, frame: int) -> CodeFailure:
        """The failure that an exception is."""
        return CodeFailure(member, frame, report(error), whole(error))

    @property
    def reason(self) -> str:
        """Why the world ends, for its summary: the same words as on the bus."""
        what = self.problem.partition("\n")[0]
        return f"{self._failed}: {what}"

    def stops(self, console: Console) -> WorldStopped:
        """Show the failure; returns the exception that stops the world."""
        console.frame = self.frame
        console.log(self.member, f"failed in frame {self.frame}: {self.problem}", "error")
        console.details(self.member, self.details)
        hint = "" if console.traceback else " (--traceback shows all frames)"
        return WorldStopped(
            f"{self.reason}; the world stops ({VARIABLE}=1 shows all frames)",
            f"{self._failed}; the world stops{hint}",
        )

    @property
    def _failed(self) -> str:
        return f"{self.member} failed in frame {self.frame}"
