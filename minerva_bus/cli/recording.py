"""`minerva info`, `recover` and `replay`: records."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from pathlib import Path

from minerva_analysis.record_summary import frames_after, info_of, moment_of, written
from minerva_bus.api.records import replay
from minerva_bus.cli.output import (
    FAILED,
    INTERRUPTED,
    Done,
    checking,
    print_answer,
    print_message,
    print_result,
    progress_bar,
)
from minerva_bus.collect.table_parts import read_parts
from minerva_bus.errors import MisuseError
from minerva_bus.launch.console import Console
from minerva_bus.launch.replays import read_replay
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import recover, recovered_name
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.wording import counted


def show_info(file: Path, check: bool, as_json: bool) -> int:
    """Print the contents of a record; returns the exit code. Raises RecordError."""
    with checking(file) if check else nullcontext(), Record(file) as record:
        info = info_of(record, check)
    print_answer(info, as_json)
    if not check or info.checked:
        return 0
    right = f"the digests of {counted(info.frames, 'frame')} are right, but the file is damaged"
    print_message(f"minerva: {file}: {right if info.frames else 'there is no frame to check'}")
    return FAILED


def show_moment(file: Path, frame: int | None, string: bool, as_json: bool) -> None:
    """Print what a frame begins with and what happens in it, or its string alone.

    Raises RecordError.
    """
    with Record(file) as record:
        moment = moment_of(record, frame)
    if string and not as_json:
        print_result(written(moment.string))
    else:
        print_answer(moment, as_json)


def show_frames(file: Path, begin: int, as_json: bool) -> None:
    """Print each frame of a record from one on; no code is run. Raises RecordError."""
    with Record(file) as record:
        for done in frames_after(record, begin):
            print_result(json.dumps(done.plain()) if as_json else "\n".join(done.lines()))


def recover_record(file: Path, output: Path | None, as_json: bool) -> None:
    """Write what is intact in a record into a new one. Raises RecordError and MisuseError.

    Of a folder with the parts of tables, write the tables.
    """
    if file.is_dir():
        _recover_tables(file, output, as_json)
        return
    done = recover(file, output or recovered_name(file))
    print_answer(done, as_json)


def _recover_tables(folder: Path, output: Path | None, as_json: bool) -> None:
    if output is not None:
        raise MisuseError(f"--output is of records; the tables of {folder} have names of their own")
    files = read_parts(folder).join()
    text = "\n".join(f"{path}  {name}" for name, path in files.items())
    tables = {name: {"file": str(path)} for name, path in files.items()}
    print_answer(Done(text, {"tables": tables}), as_json)


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
    return FAILED if supervisor.failure else 0


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
