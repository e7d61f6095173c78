"""Runs of a world in layouts: processes, environments and faults that its strings do not depend on.

In all layouts a world must have the same strings, frame by frame: an agent evolves by its state,
its events and its stream of random numbers (equation 3) only, so the result must not depend on the
process, the hash seed or the time zone. Each run has its own Python process, because Python chooses
its hash seed at start.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from minerva_analysis.comparing import Difference, apart, same_events
from minerva_bus.cli.options import RunOptions
from minerva_bus.cli.output import INTERRUPTED, WRONG
from minerva_bus.cli.run_choice import run_world
from minerva_bus.errors import MinervaError
from minerva_bus.files import reason_of
from minerva_bus.launch.child_processes import end_signals, handled
from minerva_bus.launch.past import Past, continued
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.world_files import Access, WorldFile, read_world_file
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import BusSettings, RecordSettings, WatchSettings
from minerva_bus.world.services import Generator as EventGenerator
from minerva_bus.world.services import when_of

OMITTED: Final = "omitted.json"
KILLED: Final = "killed.txt"
"""Files beside a record: the processes that were left out, and the names of those killed."""
KILLED_RATE: Final = 10.0
"""Frames per second of a world whose processes are killed: it must not end before."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a run of a world is laid out.

    Args:
        name: in words.
        hosts: the number of processes for each process of agents; 0: all members in one process,
            unless one of them is a command.
        environment: environment variables of its processes.
        umask: of its processes.
        begin: the frame of `past` from which the run continues.
        past: a record; "": the run begins with the initial string.
        kills: a process is killed in every `kills`-th frame, the members' and the coordinator's in
            turn; 0: none.

    """

    name: str
    hosts: int
    environment: Mapping[str, str] = field(default_factory=dict[str, str])
    umask: int = 0o022
    begin: int = 0
    past: str = ""
    kills: int = 0

    def runs_in_process(self, file: WorldFile) -> bool:
        """Whether a world file runs in one process here."""
        return not self.hosts and not any(process.command for process in file.processes)


ALONE: Final = Layout("one process for all members", 0, {"PYTHONHASHSEED": "5", "TZ": "MNVA+12"})
APART: Final = Layout(
    "two processes for each kind of agents",
    2,
    {"PYTHONHASHSEED": "36", "TZ": "MNVB-14", "LC_ALL": "C"},
    umask=0o077,
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
    if service.interactive or (isinstance(service, EventGenerator) and service.people):
        return "people operate it"
    # Declared by services as an attribute of their class.
    if outside := getattr(service, "outside", ""):
        return f"it needs {outside}"
    when = when_of(service)
    if isinstance(service, EventGenerator) and not when.is_awaited:
        return "it runs freely"
    if when.rate > 0:
        return "it requests views by the clock"
    return "" if isinstance(service, EventGenerator) else "it only shows views"


def laid_out(
    file: WorldFile, hosts: int, omitted: Mapping[str, str], frames: int, record: str = ""
) -> WorldFile:
    """A world file for a run of `frames` in a layout: recorded, and closed to other members."""
    processes = tuple(
        replace(process, name=name, elsewhere=False)
        for process in file.processes
        if process.name not in omitted
        for name in _names(process, hosts)
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
        record=RecordSettings(record),
        watch=WatchSettings(),
    )


def _names(process: ProcessSpec, hosts: int) -> list[str]:
    several = [f"{process.name}-of-{hosts}-{number}" for number in range(2, hosts + 1)]
    return [process.name, *several] if process.agents else [process.name]


def run_in_layout(
    path: Path, frames: int, layout: Layout, record: Path
) -> subprocess.CompletedProcess[str]:
    """Run a world in a layout, in a new Python process with the runtime folder of the record.

    Every signal that ends this process becomes KeyboardInterrupt, which ends that one, too.
    """
    environment = {**os.environ, **layout.environment, "MINERVA_RUNTIME_DIR": str(record.parent)}
    words = [str(path), str(frames), json.dumps(asdict(layout)), str(record)]
    interrupt = dict.fromkeys(end_signals(), signal.default_int_handler)
    with handled(interrupt), _killer(layout, environment, record.parent / KILLED):
        return subprocess.run(  # noqa: S603
            [sys.executable, "-m", "minerva_determinism.layouts", *words],
            env=environment,
            umask=layout.umask,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            check=False,
        )


@contextmanager
def _killer(layout: Layout, environment: Mapping[str, str], file: Path) -> Generator[None]:
    """A process that kills those of the world while it runs, if the layout has kills."""
    if not layout.kills:
        yield
        return
    words = [sys.executable, "-m", "minerva_determinism.killer", str(layout.kills), str(file)]
    with subprocess.Popen(words, env=environment, stdin=subprocess.PIPE) as killer:  # noqa: S603
        try:
            yield
        finally:
            killer.kill()


def first_difference(base: Path, other: Path, sides: tuple[str, str]) -> Difference:
    """The first frame of another record that differs from the same frame of the base.

    The other one may begin later, but must reach the end of the base. Raises RecordError.
    """
    with Record(base) as a, Record(other) as b:
        frames = {frame.number: frame for frame in a.frames()}
        count, last = 0, -1
        for count, frame in enumerate(b.frames(), 1):
            last, expected = frame.number, frames.get(frame.number)
            if expected is None:
                return Difference(None, count - 1, ended=f"frame {last} is in {sides[1]} alone")
            same = frame.digest == expected.digest
            if not same or not same_events(frame.events, expected.events):
                strings = None if same else (a.string(last + 1), b.string(last + 1))
                events = expected.events, frame.events
                # A record that continues another one begins with a later string.
                scenes = a.description.world.scene, b.description.world.scene
                renewed = last == count - 1 and scenes[0] != scenes[1]
                before = ("the initial strings differ",) if renewed else ()
                difference = apart(a.description.world.vocabulary, expected, strings, events, sides)
                return replace(difference, frames=count - 1, before=before)
        damage = tuple(text for record in (a, b) if (text := record.damage()))
        missing = last != max(frames, default=-1)
        ended = f"{sides[1]} ends after frame {last}, {sides[0]} later" if missing else ""
        return Difference(None, count, ended=ended, damage=damage)


# --- in the new Python process ---


def _run(path: Path, frames: int, layout: Layout, record: Path) -> None:
    file = read_world_file(path)
    if layout.past:
        with Record(Path(layout.past)) as past:
            state = Past(past, file).state(layout.begin)
            file = replace(file, world=continued(file.world, state, past.description.world))
    omitted = left_out(file)
    (record.parent / OMITTED).write_text(json.dumps(omitted), encoding="utf-8")
    laid = laid_out(file, layout.hosts, omitted, frames, str(record))
    if layout.kills:
        often = tuple(replace(process, restarts=frames) for process in laid.processes)
        laid = replace(laid, processes=often, rate=KILLED_RATE)
    options = RunOptions(in_process=layout.runs_in_process(file), quiet=True)
    run_world(laid, time.monotonic(), options)


def main() -> None:
    """Run a world in the layout that the arguments describe."""
    import typer

    path, frames, layout, record = sys.argv[1:]
    try:
        _run(Path(path), int(frames), Layout(**json.loads(layout)), Path(record))
    except typer.Exit as ended:
        sys.exit(ended.exit_code)
    except MinervaError as error:
        print(error, file=sys.stderr)  # noqa: T201
        sys.exit(WRONG)
    except OSError as error:
        print(f"{error.filename or record}: {reason_of(error)}", file=sys.stderr)  # noqa: T201
        sys.exit(WRONG)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
