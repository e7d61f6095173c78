"""A member's process: it runs a member of a world to its end."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.frame.member import Unready
from minerva_bus.launch.forking import UNREADY
from minerva_bus.launch.pipes import ReportPipe
from minerva_bus.launch.profiling import Profiling, profile_path, sampled
from minerva_bus.launch.regions.layout import RegionSpec
from minerva_bus.launch.regions.process import RegionProcess
from minerva_bus.launch.worldfile import Process
from minerva_bus.runtime.arrival import STARTED_HERE
from minerva_bus.runtime.member import MemberProcess


@dataclass(frozen=True, slots=True)
class MemberStart:
    """Arguments of a member's process: its description and the endpoint of its world."""

    process: Process
    world: str
    endpoint: str
    shared: bool
    profiling: Profiling


def run_member(start: MemberStart, reports: ReportPipe) -> int:
    """Run a member of a world to its end; returns the exit code.

    It sends `reports` if it cannot take part, and a region about its hosts.
    """
    try:
        return _run(start, reports)
    except Unready as error:
        name = start.process.name
        reports.send("unready", member=name, reason=str(error).removeprefix(f"{name} "))
        return UNREADY


def _run(start: MemberStart, reports: ReportPipe) -> int:
    process, world = start.process, start.world

    def log(line: str) -> None:
        print(line, flush=True)  # noqa: T201

    # With STARTED_HERE the member waits for its greeting without limit: the launcher takes into
    # account how many processes start at the same time, and kills late ones.
    member = (
        RegionProcess(process, start.endpoint, log, shared=start.shared, reports=reports)
        if isinstance(process, RegionSpec)
        else MemberProcess(
            process.participant(),
            world,
            start.endpoint,
            log,
            shared=start.shared,
            arrival=STARTED_HERE,
        )
    )
    if process.name == start.profiling.member:
        return sampled(member.run, profile_path(world, process.name))
    return member.run()
