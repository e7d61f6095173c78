"""`minerva info` and `minerva recover`."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from minerva_analysis.record_summary import info_of, moment_of, recover, recovered_name, written
from minerva_bus.cli.output import (
    FAILED,
    Done,
    checking,
    print_answer,
    print_message,
    print_result,
)
from minerva_bus.collect.table_parts import read_parts
from minerva_bus.errors import MisuseError
from minerva_bus.log.record import Record
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


def recover_record(file: Path, output: Path | None, as_json: bool) -> int:
    """Write what is intact in a record into a new one; returns the exit code, 1 after damage.

    Of a folder with the parts of tables, write the tables. Raises RecordError and MisuseError.
    """
    if file.is_dir():
        _recover_tables(file, output, as_json)
        return 0
    done = recover(file, output or recovered_name(file))
    print_answer(done, as_json)
    return FAILED if done.losses.damage else 0


def _recover_tables(folder: Path, output: Path | None, as_json: bool) -> None:
    if output is not None:
        raise MisuseError(f"--output is of records; the tables of {folder} have names of their own")
    files = read_parts(folder).join()
    text = "\n".join(f"{path}  {name}" for name, path in files.items())
    tables = {name: {"file": str(path)} for name, path in files.items()}
    print_answer(Done(text, {"tables": tables}), as_json)
