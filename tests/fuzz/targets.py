"""Fuzzing targets: every reader of external bytes, and the errors that it may raise.

A target takes bytes and raises only its declared errors; it neither hangs nor exhausts memory. Input
that it accepts must satisfy the reader's laws, such as parse(print(w)) = w.
"""

import struct
import sys
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

sys.path += [
    str(Path(__file__).parents[1] / "runtime"),
    str(Path(__file__).parents[2] / "services"),
]
sys.path.append(str(Path(__file__).parents[2] / "agents"))
import yard

from minerva_agents.robot.grid import MapError
from minerva_agents.robot.maps import load_map
from minerva_bus.errors import (
    GrammarError,
    MinervaError,
    MisuseError,
    ProtocolError,
    RecordError,
    SceneError,
    VocabularyError,
    WorldFileError,
)
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.condition import parse_condition
from minerva_bus.grammar.parser import parse
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log.journal import read_journal, resume_from
from minerva_bus.log.record import Record
from minerva_bus.log.recordings import RecordingError
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.plain import unpack
from minerva_bus.wire.status_codec import read_lines, read_status
from minerva_services.bridges.mqtt.rules import InvalidPayload, Pattern, Payload
from minerva_services.bridges.ros_messages import GarbageError, images
from minerva_services.bridges.ros_messages import readings as ros
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.rosbag.bag import open_bag
from minerva_services.sensors.carmen.log import open_log
from minerva_services.sensors.nmea.service import SkippedSentence, read_fix
from minerva_services.sensors.rplidar import packets as rplidar
from minerva_services.sensors.rplidar.packets import (
    ExpressPackets,
    RevolutionBuffer,
    StandardPackets,
    ranges,
)
from minerva_services.sensors.serial_line import LineSplitter

MOST = 500
"""Maximum number of readings or frames to read from one file."""

WORLD = WorldSpec("yard", parse("AWalker#a<x=0> · AWalker#b<x=1>"), yard.vocabulary, seed=7)
_ENTRY = struct.Struct(">II")
_folder = tempfile.TemporaryDirectory(prefix="minerva-fuzz-")


@dataclass(frozen=True)
class Target:
    """`read` may raise `declared`. `longest` is the maximum useful input length in bytes."""

    read: Callable[[bytes], object]
    declared: tuple[type[Exception], ...]
    longest: int = 4096

    def __call__(self, data):
        try:
            self.read(data)
        except self.declared as refused:
            assert str(refused), "it does not say why"
            assert len(str(refused)) < 4000, "it says too much"


def _file(name, data):
    path = Path(_folder.name) / name
    path.write_bytes(data)
    return path


def _text(data):
    return data.decode("utf-8", "replace")


def _pass_over(what, line):
    assert what
    assert line


# --- the bus ---


def _message(data):
    """The first byte selects the sender."""
    kind, body, decoder = data[:1], data[1:], Decoder(yard.vocabulary)
    if kind == b"m":
        decoder.from_member("a", body)
    elif kind == b"c":
        decoder.to_member(body)
    elif kind == b"r":
        decoder.readings("scan", "a", body)
    else:
        decoder.record(body)


def _status(data):
    plain = unpack(data)
    read_lines(plain) if isinstance(plain, list) else read_status(plain)


# --- the language ---


def _scene(data):
    scene = parse(_text(data))
    assert parse(str(scene)) == scene
    yard.vocabulary.check(scene)


def _condition(data):
    condition = parse_condition(_text(data))
    state = {name: {"x": 1.5, "name": "red", "n": 3}.get(name, 2.0) for name in condition.names}
    condition.holds(state)


def _world_file(data):
    read_world_file(_file("yard.toml", data))


# --- files ---


def _map(data):
    load_map(_file("map.yaml", data))


def _image(data):
    load_map(_file("map.pgm", data))


def _record(data):
    with Record(_file("run.mcap", data)) as record:
        for lines in (record.strings(), record.log(), record.sensed()):
            for _ in islice(lines, MOST):
                pass


def _journal(data):
    """Entries by their length fields, with valid checksums so that the reader passes the first."""
    whole, begin = b"", 0
    while begin + _ENTRY.size <= len(data):
        length, _ = _ENTRY.unpack_from(data, begin)
        entry = data[begin + _ENTRY.size : begin + _ENTRY.size + length]
        whole += _ENTRY.pack(len(entry), zlib.crc32(entry)) + entry
        begin += _ENTRY.size + length
    past = read_journal(_file("yard.journal", whole), WORLD)
    if past is not None:
        resume_from(past, FrameAlgorithm(past.world), lambda done: None)


def _carmen(data):
    for _ in islice(open_log(_file("run.log", data), _pass_over).readings(), MOST):
        pass


def _bag(data):
    bag = open_bag(_file("run.mcap", data), _pass_over)
    try:
        for _ in islice(bag.readings(), MOST):
            pass
    finally:
        bag.close()


# --- devices and networks ---

_CDR = {
    b"s": ("sensor_msgs/msg/LaserScan", lambda message: ros.scan_of(message, "r")),
    b"o": ("nav_msgs/msg/Odometry", lambda message: ros.odometry_of(message, "r")),
    b"b": ("sensor_msgs/msg/BatteryState", lambda message: ros.battery_of(message, "r")),
    b"i": ("sensor_msgs/msg/Image", lambda message: images.image_of(message, "r")),
    b"f": ("sensor_msgs/msg/CompressedImage", lambda message: images.file_of(message, "r")),
}


def _cdr(data):
    """The first byte selects the message type."""
    kind, read = _CDR.get(data[:1], _CDR[b"s"])
    read(messages().decode(kind, data[1:]))


def _nmea(data):
    for line in LineSplitter(lambda what: None).feed(data):
        try:
            read_fix(line)
        except SkippedSentence:
            continue


def _rplidar(data):
    if rplidar.read_descriptor(data[:7]) is not None:
        rplidar.read_health(data[7:10].ljust(3, b"\0"))
    packets = (StandardPackets if data[:1] < b"\x80" else ExpressPackets)(lambda what: None)
    turns = RevolutionBuffer(lambda what: None)
    for begin in range(1, len(data), 61):
        for samples in packets.feed(data[begin : begin + 61]):
            for turn in turns.add(samples):
                assert ranges(turn, 90).shape == (90,)


def _mqtt(data):
    """A pattern, a topic and a payload, one per line."""
    pattern, topic, payload, *_ = [*data.split(b"\n", 2), b"", b""]
    Pattern.of(_text(pattern)).levels(_text(topic))
    Payload.of(payload).at("a.0.b")


PROTOCOL = (ProtocolError, SceneError)
TARGETS = {
    "bag": Target(_bag, (RecordingError,), 16384),
    "carmen": Target(_carmen, (RecordingError,)),
    "cdr": Target(_cdr, (GarbageError,)),
    "condition": Target(_condition, (VocabularyError,), 512),
    "image": Target(_image, (MapError,)),
    "journal": Target(_journal, (RecordError, *PROTOCOL), 8192),
    "map": Target(_map, (MapError,)),
    "message": Target(_message, PROTOCOL),
    "mqtt": Target(_mqtt, (MisuseError, InvalidPayload)),
    "nmea": Target(_nmea, ()),
    "record": Target(_record, (RecordError,), 32768),
    "rplidar": Target(_rplidar, (MinervaError,)),
    "scene": Target(_scene, (GrammarError, VocabularyError)),
    "status": Target(_status, (ProtocolError,)),
    "worldfile": Target(_world_file, (WorldFileError, MinervaError)),
}
