"""`minerva determinism`: run a world in two layouts of processes and compare the records.

In all layouts a world must have the same strings, frame by frame: an agent evolves by its state,
its events and its stream of random numbers (equation 3) only, so the result must not depend on the
process, the hash seed or the time zone. Each run has its own Python process, because Python chooses
its hash seed at start.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from minerva_analysis.comparing import compare
from minerva_bus.cli.options import RunOptions
from minerva_bus.cli.output import (
    FAILED,
    INTERRUPTED,
    WRONG,
    print_json,
    print_message,
    print_result,
)
from minerva_bus.cli.run_choice import run_world
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.world_files import Access, WorldFile, read_world_file
from minerva_bus.log.comparison import Difference
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import BusSettings, RecordSettings, WatchSettings
from minerva_bus.wording import counted
from minerva_bus.world.services import Generator, when_of

OMITTED: Final = "omitted.json"

ADVICE: Final = (
    "usual causes, and what to use instead:",
    "  the time of day (time.time, datetime.now): moment.time; in a service tick.time",
    "  global random numbers (random, numpy.random): moment.random, moment.chance; tick.random",
    "  the order of a set, hash(text), id(object): sorted(...), a number or a text of your own",
    "  state of a module or a class, which each process has for itself: attributes of the agent",
    "  files, networks, real devices: a service that runs freely, which is not compared",
)


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout of processes for one run of a world.

    `hosts`: number of processes for each process of agents. `in_process`: all members in one
    process, unless one of them is a command.
    """

    name: str
    in_process: bool
    hosts: int
    hash_seed: str
    time_zone: str

    @property
    def environment(self) -> dict[str, str]:
        """The environment variables of its processes."""
        return {"PYTHONHASHSEED": self.hash_seed, "TZ": self.time_zone}

    def runs_in_process(self, file: WorldFile) -> bool:
        """Whether a world file runs in one process here."""
        return self.in_process and not any(process.command for process in file.processes)


LAYOUTS: Final = (
    Layout("one process for all members", True, 1, "5", "MNVA+12"),
    Layout("two processes for each kind of agents", False, 2, "36", "MNVB-14"),
)
"""Chosen to reveal mistakes: local dates always differ between the two layouts. Sets of two to
four short texts such as {"a", "b"} have different orders with these seeds, unlike with many others.
"""


def left_out(file: WorldFile) -> dict[str, str]:
    """Processes that cannot be compared, by name, with the reason."""
    reasons = {process.name: _reason(process) for process in file.processes}
    return {name: reason for name, reason in reasons.items() if reason}


def _reason(process: ProcessSpec) -> str:
    if process.make_service is None:
        return ""
    service = process.make_service()
    if service.interactive or (isinstance(service, Generator) and service.people):
        return "people operate it"
    when = when_of(service)
    if isinstance(service, Generator) and not when.is_awaited:
        return "it runs freely"
    if when.rate > 0:
        return "it requests views by the clock"
    return "" if isinstance(service, Generator) else "it only shows views"


def laid_out(
    file: WorldFile, layout: Layout, omitted: Mapping[str, str], frames: int, record: Path
) -> WorldFile:
    """A world file for a run of `frames` in a layout: recorded, and closed to other members."""
    processes = tuple(
        replace(process, name=name, elsewhere=False)
        for process in file.processes
        if process.name not in omitted
        for name in _names(process, layout.hosts)
    )
    return replace(
        file,
        world=replace(
            file.world,
            frames=min(frames, file.world.frames or frames),
            expected=frozenset(process.name for process in processes),
        ),
        rate=0.0,
        processes=processes,
        bus=BusSettings(shared_memory=file.bus.shared_memory),
        access=Access(),
        record=RecordSettings(str(record)),
        watch=WatchSettings(),
    )


def _names(process: ProcessSpec, hosts: int) -> list[str]:
    several = [f"{process.name}-of-{hosts}-{number}" for number in range(2, hosts + 1)]
    return [process.name, *several] if process.agents else [process.name]


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result: the exit code, the difference if both runs ended, or how one of them failed.

    `omitted`: the processes that were left out, with the reasons.
    """

    code: int
    difference: Difference | None = None
    error: str = ""
    omitted: dict[str, str] | None = None

    def plain(self) -> dict[str, Any]:
        """The verdict as a JSON object."""
        plain: dict[str, Any] = {"ok": not self.code, "not_compared": self.omitted or {}}
        if self.error:
            plain["error"] = self.error
        return plain | (self.difference.plain() if self.difference is not None else {})

    def lines(self) -> list[str]:
        """The verdict as text."""
        omitted = [f"not compared: {name} ({why})" for name, why in (self.omitted or {}).items()]
        if self.difference is None:
            return [*self.error.split("\n"), *omitted]
        if self.difference.same:
            return [f"the same in both runs: {counted(self.difference.frames, 'frame')}", *omitted]
        if self.difference.frame is None and not self.difference.frames:
            return [*self.difference.lines(), *omitted]
        sides = [f"  {side}: {layout.name}" for side, layout in zip("AB", LAYOUTS, strict=True)]
        return ["two runs differ", *sides, *self.difference.lines(), *omitted, *ADVICE]


def check_determinism(spec: str, frames: int, as_json: bool) -> int:
    """Run a world twice and print the first difference; returns the exit code.

    Raises WorldFileError if there is no such world, and MisuseError if it is not a world.
    """
    if Path(spec).suffix == ".mnv":
        raise MisuseError(f"{spec}: determinism runs a world, and a string alone is none")
    path = find_world(spec)
    with TemporaryDirectory(prefix="minerva-") as folder:
        verdict = _verdict(path, frames, Path(folder))
    if as_json:
        print_json({"file": spec, **verdict.plain()})
    else:
        first, *rest = verdict.lines()
        (print_message if verdict.code else print_result)("\n".join([f"{spec}: {first}", *rest]))
    return verdict.code


def _verdict(path: Path, frames: int, folder: Path) -> Verdict:
    records = [folder / f"{number}.mcap" for number in range(len(LAYOUTS))]
    for number, record in enumerate(records):
        # One after the other, because both worlds have the same name and runtime folder.
        done = _started(path, frames, number, record)
        if done.returncode:
            text = done.stderr.strip() or "it ended without a message"
            how = f"it fails in {LAYOUTS[number].name}:\n{text}"
            wrong = done.returncode == WRONG
            return Verdict(done.returncode if wrong else FAILED, error=text if wrong else how)
    omitted = json.loads((folder / OMITTED).read_text(encoding="utf-8"))
    with Record(records[0]) as first, Record(records[1]) as second:
        difference = compare(first, second)
    return Verdict(0 if difference.same else FAILED, difference, omitted=omitted)


def _started(
    path: Path, frames: int, number: int, record: Path
) -> subprocess.CompletedProcess[str]:
    """Run the world in a layout, in a new Python process with its own runtime folder."""
    environment = {
        **os.environ,
        **LAYOUTS[number].environment,
        "MINERVA_RUNTIME_DIR": str(record.parent),
    }
    words = [str(path), str(frames), str(number), str(record)]
    return subprocess.run(  # noqa: S603
        [sys.executable, "-m", "minerva_authoring.determinism", *words],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        check=False,
    )


# --- in the new Python process ---


def _run(path: Path, frames: int, layout: Layout, record: Path) -> None:
    file = read_world_file(path)
    omitted = left_out(file)
    (record.parent / OMITTED).write_text(json.dumps(omitted), encoding="utf-8")
    in_process = layout.runs_in_process(file)
    laid = laid_out(file, layout, omitted, frames, record)
    run_world(laid, time.monotonic(), RunOptions(in_process=in_process, quiet=True))


def main() -> None:
    """Run a world in the layout that the arguments select."""
    import typer

    path, frames, number, record = sys.argv[1:]
    try:
        _run(Path(path), int(frames), LAYOUTS[int(number)], Path(record))
    except typer.Exit as ended:
        sys.exit(ended.exit_code)
    except MinervaError as error:
        print(error, file=sys.stderr)  # noqa: T201
        sys.exit(WRONG)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
