"""Records of frames that need not be from one run, and files of records."""

import io
from dataclasses import replace
from typing import Any

from minerva_bus.log.record_writer import RecordWriter
from tests.log.recorded_runs import description, happened


def files(folder, *data) -> tuple[Any, Any]:
    a, b = (folder / f"{name}.mcap" for name in "ab")
    for path, content in zip((a, b), data, strict=False):
        path.write_bytes(content)
    return a, b


def written(frames, **changed):
    """A record of these frames, as bytes; `changed`: of its world."""
    file, _ = happened("meadow")
    described = description(file)
    stream = io.BytesIO()
    writer = RecordWriter(stream, replace(described, world=replace(described.world, **changed)))
    for record, string in frames:
        writer.frame(replace(record, digest=string.digest), string, 0.0, {})
    writer.finish()
    return stream.getvalue()
