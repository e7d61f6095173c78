"""The process of members: it runs them to the end of their world."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.frame.member import Unready
from minerva_bus.launch.forking import UNREADY
from minerva_bus.launch.pipes import ReportPipe
from minerva_bus.launch.profiling import Profiling, profile_path, sampled
from minerva_bus.launch.worldfile import Process
from minerva_bus.runtime.arrival import STARTED_HERE
from minerva_bus.runtime.member import MemberProcess


@dataclass(frozen=True, slots=True)
class MemberStart:
    """Arguments of a process: its name, its members, and the endpoint of their world."""

    name: str
    members: tuple[Process, ...]
    world: str
    endpoint: str
    shared: bool
    profiling: Profiling


def run_member(start: MemberStart, reports: ReportPipe) -> int:
    """Run members of a world to its end; returns the exit code.

    It reports if one cannot take part.
    """
    process = _process(start)
    try:
        named = start.profiling.member in {member.name for member in start.members}
        path = profile_path(start.world, start.profiling.member)
        return sampled(process.run, path) if named else process.run()
    except Unready as error:
        name = process.running.name
        reports.send("unready", member=name, reason=str(error).removeprefix(f"{name} "))
        return UNREADY


def _process(start: MemberStart) -> MemberProcess:
    def log(line: str) -> None:
        print(line, flush=True)  # noqa: T201

    # With STARTED_HERE members wait for their greetings without limit: the launcher takes into
    # account how many processes start at the same time, and kills late ones.
    return MemberProcess(
        [member.participant() for member in start.members],
        start.world,
        start.endpoint,
        log,
        shared=start.shared,
        arrival=STARTED_HERE,
    )
