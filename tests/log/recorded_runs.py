"""In-process runs of worlds, and their records."""

import io
import json
from functools import cache
from pathlib import Path
from typing import Any

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import WorldFile, read_world_file
from minerva_bus.log.entries import Kept, RecordHeader
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides

ROOT = Path(__file__).parents[2]
WORLDS = {
    "meadow": (ROOT / "worlds/minerva_worlds/meadow/meadow.toml", {"frames": 60}),
    "flock": (
        ROOT / "worlds/minerva_worlds/flock/flock.toml",
        {"frames": 40, "options": {"birds": "80"}},
    ),
    "robot": ("robot", {"frames": 12}),
}

CHECKPOINTS = {}
"""Checkpoints after each frame, by world and seed."""


def world_file(world, **overrides):
    path = world if isinstance(world, Path) else find_world(world)
    return read_world_file(path, Overrides(**overrides))


def run(file, watch):
    """Run a world file to its end.

    Calls `watch(record, string after the frame, checkpoint)` for each frame.
    """
    algorithm = FrameAlgorithm(file.world)

    def told(instruction):
        if isinstance(instruction, s.FrameDone):
            watch(instruction.record, algorithm.scene, algorithm.checkpoint)

    runner = InProcessRunner(algorithm, [process.make_member() for process in file.processes], told)
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())


def description(file):
    text = file.path.read_text(encoding="utf-8")
    return RecordHeader(file.world, text, file.rate, {"start": "1"}, began=1_700_000_000 * 10**9)


@cache
def happened(name, seed=None) -> tuple[WorldFile, list[tuple[Any, Any]]]:
    """A run of one of the worlds: its file, and its frames with the strings after them."""
    world, overrides = WORLDS[name]
    file, frames = world_file(world, seed=seed, **overrides), []
    checkpoints = CHECKPOINTS[name, seed] = []

    def watch(record, string, checkpoint):
        frames.append((record, string))
        checkpoints.append(Kept.of(checkpoint))

    run(file, watch)
    return file, frames


def strings_of(name):
    """The initial string, and the string after each frame."""
    file, frames = happened(name)
    return [file.world.scene, *(string for _, string in frames)]


@cache
def bytes_of(name, flush_every=8, finished=True, seed=None):
    """The record of a run, with a chunk every `flush_every` frames."""
    file, frames = happened(name, seed)
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for (record, string), kept in zip(frames, CHECKPOINTS[name, seed], strict=True):
        writer.log(record.frame, 0.01 * record.frame, "steps", f"begins {record.frame}", False)
        writer.frame(record, string, 0.01 * record.frame, {"evolve": 0.001}, kept)
        if record.frame % flush_every == flush_every - 1:
            writer.flush()
    if finished:
        writer.finish()
    return stream.getvalue()


def record_of(data, folder):
    path = folder / "run.mcap"
    path.write_bytes(data)
    return Record(path)


def others(data):
    """The messages by topic, read by a generic MCAP reader."""
    from mcap.reader import make_reader

    channels = {}
    for schema, channel, message in make_reader(
        io.BytesIO(data), validate_crcs=True
    ).iter_messages():
        shown = json.loads(message.data) if channel.message_encoding == "json" else message.data
        channels.setdefault(channel.topic, []).append((schema, message, shown))
    return channels


def fits(value, schema):
    """Check a value against a subset of JSON schema: required members and their types."""
    kinds = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float)}
    assert isinstance(value, kinds[schema["type"]])
    for name, inner in schema.get("properties", {}).items():
        fits(value[name], inner)
    for item in value if schema["type"] == "array" else ():
        fits(item, schema["items"])
