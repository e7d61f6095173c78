"""What of a run is measured: the frames at the coordinator, and one member's Python code."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.outputs import check_output, write_output


@dataclass(frozen=True, slots=True)
class Profiling:
    """`frames`: where the time of frames goes; `member`: whose code to sample, or nobody's."""

    frames: bool = False
    member: str = ""

    def check(self, file: WorldFile) -> None:
        """Complain of what cannot be measured. Raises MisuseError."""
        if not self.member:
            return
        known = {process.name: process for process in file.processes}
        if self.member not in known:
            raise MisuseError(
                f"--profile-member: there is no process {self.member!r}"
                f"{nearest(self.member, list(known))}; there are {', '.join(known)}"
            )
        if known[self.member].command:
            raise MisuseError(
                f"--profile-member: {self.member} is a command of its own, whose code is not seen"
                " from here"
            )
        if importlib.util.find_spec("pyinstrument") is None:
            raise MisuseError(
                "--profile-member needs pyinstrument: pip install 'minerva-bus[profile]'"
            )
        check_output(profile_of(file.world.name, self.member), "profile")


NOTHING = Profiling()


def profile_of(world: str, member: str) -> Path:
    """The file that a member's profile is written to, in the folder of the run."""
    return Path.cwd() / f"{world}-{member}.html"


def sampled(body: Callable[[], int], path: Path) -> int:
    """Run `body` and write a page that shows where its time went."""
    profiler: Any = importlib.import_module("pyinstrument").Profiler()
    profiler.start()
    try:
        return body()
    finally:
        profiler.stop()
        write_output(path, str(profiler.output_html()).encode(), "profile")
        print(f"its profile is in {path}", flush=True)  # noqa: T201
