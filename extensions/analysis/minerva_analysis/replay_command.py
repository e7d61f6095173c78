"""`minerva replay`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from minerva_analysis.frame_texts import frames_after
from minerva_analysis.records import replay
from minerva_analysis.replays import read_replay
from minerva_bus.cli.output import (
    FAILED,
    INTERRUPTED,
    checking,
    print_answer,
    print_message,
    print_result,
)
from minerva_bus.launch.console import Console, progress_bar
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import Overrides


def show_frames(file: Path, begin: int, as_json: bool) -> None:
    """Print each frame of a record from one on; no code is run. Raises RecordError."""
    with Record(file) as record:
        for done in frames_after(record, begin):
            print_result(json.dumps(done.plain()) if as_json else "\n".join(done.lines()))


def replay_record(
    path: Path,
    world: str,
    overrides: Overrides,
    began: float,
    *,
    begin: int,
    speed: float,
    as_json: bool,
    quiet: bool,
) -> int:
    """Replay a record to its end; returns the exit code. Raises RecordError and WorldFileError."""
    played = read_replay(path, world, overrides, begin=begin, speed=speed)
    console = Console(quiet=quiet or (as_json and not sys.stderr.isatty()))
    supervisor = Supervisor(played.file, console, began, coordinator=played.coordinator)
    summary = supervisor.run()
    if not summary.digest:
        print_message(f"minerva: {played.file.world.name}: {summary.ended}")
    if as_json or not quiet:
        print_answer(summary, as_json)
    if summary.ended in ("interrupted", "terminated"):
        return INTERRUPTED
    return FAILED if supervisor.failure or summary.incomplete else 0


def recompute_record(path: Path, world: str, as_json: bool) -> int:
    """Run λ on a record again and print the first difference; returns the exit code.

    Raises RecordError and WorldFileError, and ActivityError if user code raises.
    """
    with checking(path), progress_bar("recompute") as report:
        result = replay(path, world, report)
    if result.same and not as_json:
        print_result(f"the same: all {result.frames:,} recomputed frames match the record")
    else:
        print_answer(result, as_json)
    return 0 if result.same else FAILED
