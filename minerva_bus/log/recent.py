"""The recent past of a running world, of which its journal has the inputs, as a record."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from minerva_bus.errors import RecordError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.log.entries import Kept
from minerva_bus.log.journaled import read_described, resume_from
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter


@contextmanager
def recent_record(journal: Path, folder: Path, begin: int = 0) -> Generator[Record]:
    """A record of the frames in a journal, made in a folder: the frame algorithm repeats them.

    It starts at the last keyframe that is not after frame `begin`, or at the first. The journal may
    be that of a running world; it is only read.

    Raises:
        RecordError: there is no such journal, it is damaged, or no frame is in it.

    """
    # A device would be read forever; the name may be from another machine.
    if not journal.is_file():
        raise RecordError(f"{journal}: there is no journal on this machine")
    described, journaled = read_described(journal, begin)
    if not journaled.inputs:
        raise RecordError(f"{journal}: no frame has ended since it was begun; try again")
    description = replace(described, world=journaled.world, frame=journaled.keyframe.number)
    path = folder / f"{description.world.name}.mcap"
    algorithm = FrameAlgorithm(journaled.world)
    with path.open("wb") as stream:
        writer = RecordWriter(stream, description)

        def write(done: s.FrameDone) -> None:
            writer.frame(done, algorithm.scene, 0.0, {}, Kept.of(algorithm.checkpoint))

        resume_from(journaled, algorithm, write)
        writer.finish()
    with Record(path) as record:
        # Messages name the world, not a file that is removed.
        record.path = Path(description.world.name)
        yield record
