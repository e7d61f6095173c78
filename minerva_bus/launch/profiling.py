"""Profiles of a run: the frames at the coordinator, and the Python code of one member."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.outputs import check_output, write_output
from minerva_bus.wording import install


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
