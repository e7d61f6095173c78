"""The process of members: it runs them to the end of their world, and profiles one of them."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import check_output, write_output
from minerva_bus.frame.member import Unready
from minerva_bus.launch.child_processes import UNREADY, ReportPipe
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.joining import STARTED_HERE
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.wording import install


@dataclass(frozen=True, slots=True)
class MemberStart:
    """Arguments of a process: its name, its members, and the endpoint of their world."""

    name: str
    members: tuple[ProcessSpec, ...]
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
        [member.make_member() for member in start.members],
        start.world,
        start.endpoint,
        log,
        shared=start.shared,
        arrival=STARTED_HERE,
    )


@dataclass(frozen=True, slots=True)
class Profiling:
    """Scope of a profile: the `frames`, and the code of a `member` ("": of none)."""

    frames: bool = False
    member: str = ""

    def check(self, file: WorldFile) -> None:
        """Check that the member can be profiled. Raises MisuseError."""
        if not self.member:
            return
        known = {process.name: process for process in file.processes}
        if self.member not in known:
            hint = nearest(self.member, list(known), f"there are {', '.join(known)}")
            raise MisuseError(f"--profile-member: there is no process {self.member!r}{hint}")
        if known[self.member].command:
            raise MisuseError(
                f"--profile-member: {self.member} is a command; only members that run Python code"
                " in the launcher's processes can be profiled"
            )
        if importlib.util.find_spec("pyinstrument") is None:
            raise MisuseError(f"--profile-member needs pyinstrument: {install('profile')}")
        check_output(profile_path(file.world.name, self.member), "profile")


NOTHING: Final = Profiling()


def profile_path(world: str, member: str) -> Path:
    """The file for a member's profile, in the current folder."""
    return Path.cwd() / f"{world}-{member}.html"


def sampled(body: Callable[[], int], path: Path) -> int:
    """Run `body` under a sampling profiler and write its flame graph."""
    profiler: Any = importlib.import_module("pyinstrument").Profiler()
    profiler.start()
    try:
        return body()
    finally:
        profiler.stop()
        write_output(path, str(profiler.output_html()).encode(), "profile")
        print(f"profile written to {path}", flush=True)  # noqa: T201
