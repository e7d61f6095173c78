"""Codecs of message fields, by declared type.

`_CODECS` has an entry for each type that a message may declare: functions that write values as
plain data and that read and check them, and the name of the type in PROTOCOL.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from itertools import chain
from typing import Any, Final, TypeAlias, cast

import numpy as np

from minerva_bus.errors import MisuseError, ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import AtLeast, AtMost, Mark, Note
from minerva_bus.grammar.columns import Delta
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.columns_codec import is_patch, plain_patch
from minerva_bus.wire.plain import (
    OF_A_HOST,
    as_bool,
    as_bytes,
    as_event_type,
    as_int,
    as_items,
    as_list,
    as_map,
    as_number,
    as_scalar,
    as_text,
    as_topic,
    check,
    lists_in,
)
from minerva_bus.wire.strings_codec import Reader, plain_event_list, plain_scene
from minerva_bus.wire.vocabulary_codec import (
    plain_kind,
    plain_vocabulary,
    read_kind,
    read_vocabulary,
)
from minerva_bus.world.readings import (
    ENCODINGS,
    Battery,
    Displacement,
    Image,
    Mount,
    Odometry,
    Position,
    Reading,
    Scan,
    Sighting,
    Sightings,
)
from minerva_bus.world.services import When

_OF_CONDITIONS: Final = "characters of conditions"
_ADVICE: Final = "send those of one type in columns"

MAX_SHOWN: Final = 200
"""Characters of a text about a member, for people."""

Read: TypeAlias = Callable[[Reader, Any], Any]
Write: TypeAlias = Callable[..., Any]


@fast_dataclass
class FieldCodec:
    """Codec of one field: `read` checks plain data, `write` makes it; None: values are plain.

    `text`: its type in PROTOCOL.md.
    """

    text: str
    read: Read
    write: Write | None = None


@fast_dataclass
class DeclaredField:
    """A field of a message: its name, its type and its marks."""

    message: str
    name: str
    type: Any
    marks: tuple[object, ...] = ()
    default: Any = None
    what: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "what", f"{self.message}: {self.name}")

    def has(self, mark: Mark) -> bool:
        """Whether the field has a mark."""
        return mark in self.marks

    @property
    def note(self) -> str:
        """Its description in PROTOCOL.md."""
        return next((mark.text for mark in self.marks if isinstance(mark, Note)), "")

    @property
    def least(self) -> int | None:
        """Minimum of a number, or None."""
        return next((mark.value for mark in self.marks if isinstance(mark, AtLeast)), None)

    @property
    def travels(self) -> bool:
        """Whether its value is part of the message."""
        return not (self.has(Mark.FROM_KEY) or self.has(Mark.LOCAL))

    def check_count(self, reader: Reader, count: int) -> None:
        """Raise ProtocolError if a list or map has more values than its limit allows."""
        for mark in self.marks:
            if isinstance(mark, AtMost):
                unit = mark.limit if mark.limit == self.name else f"{mark.limit} in {self.name}"
                check(self.message, count, getattr(reader.limits, mark.limit), unit)


def field_codec(declared: DeclaredField) -> FieldCodec:
    """The codec of a field. Raises TypeError for a type without a codec."""
    make = _CODECS.get(declared.type)
    if make is None:
        raise TypeError(f"{declared.what}: {declared.type} does not travel in messages")
    return make(declared)


# --- strings, whole or as patches: fragments, views and the skeleton ---


def _write_parts(parts: m.Changes) -> dict[str, Any]:
    return {
        name: plain_patch(part) if isinstance(part, Delta) else plain_scene(part)
        for name, part in parts.items()
    }


def parts(of: DeclaredField) -> FieldCodec:
    """Strings by id, or patches if the field allows them."""
    what, view, patches = of.what, of.has(Mark.VIEW), of.type != m.Parts

    def read(reader: Reader, plain: Any) -> m.Changes:
        scene = reader.view if view else reader.scene
        return {
            name: reader.patch(part) if patches and is_patch(part) else scene(part)
            for name, part in as_map(plain, what).items()
        }

    return FieldCodec(f"{{id: string{' or patch' if patches else ''}}}", read, _write_parts)


def views(of: DeclaredField) -> FieldCodec:
    """Strings or patches by id for each visual event type."""
    of_a_type = parts(of)

    def read(reader: Reader, plain: Any) -> Mapping[str, m.Changes]:
        return {name: of_a_type.read(reader, v) for name, v in as_map(plain, of.what).items()}

    def write(views: Mapping[str, m.Changes]) -> Any:
        return {name: _write_parts(view) for name, view in views.items()}

    return FieldCodec(f"{{event type: {of_a_type.text}}}", read, write)


def skeleton_or_nil(of: DeclaredField) -> FieldCodec:
    """A string, with slots if the field allows them, or nil."""

    def read(reader: Reader, plain: Any) -> Scene | None:
        if plain is None:
            return None
        return reader.skeleton(plain) if of.has(Mark.SLOTS) else reader.scene(plain)

    def write(scene: Scene | None) -> Any:
        return None if scene is None else plain_scene(scene)

    return FieldCodec("string or nil", read, write)


# --- numbers, text, lists of text ---


def _int(of: DeclaredField) -> FieldCodec:
    what, least = of.what, of.least or 0

    def read(_: Reader, plain: Any) -> int:
        # The first case is the usual one and saves a call per number.
        return plain if type(plain) is int and plain >= least else as_int(plain, what, least)

    return FieldCodec("int", read)


def _float(of: DeclaredField) -> FieldCodec:
    what, least = of.what, of.least

    def read(_: Reader, plain: Any) -> float:
        value = as_number(plain, what)
        if least is not None and value < least:
            raise ProtocolError(f"{what} must be a number from {least}, not {value!r}")
        return value

    return FieldCodec("number", read)


def _checked(text: str, check: Callable[[Any, str], Any]) -> Callable[[DeclaredField], FieldCodec]:
    """A codec of values that are plain data, and only have to be checked."""
    return lambda of: FieldCodec(text, lambda _, plain: check(plain, of.what))


def _texts(of: DeclaredField) -> FieldCodec:
    what = of.what
    read_text = as_topic if of.has(Mark.TOPICS) else as_text
    read_text = as_event_type if of.has(Mark.EVENT_TYPES) else read_text

    def read(reader: Reader, plain: Any) -> tuple[str, ...]:
        items = as_list(plain, what)
        of.check_count(reader, len(items))
        return tuple([read_text(item, what) for item in items])

    return FieldCodec("[text]", read, list)


# --- maps of plain values ---


def _saved(of: DeclaredField) -> FieldCodec:
    def read(_: Reader, plain: Any) -> Mapping[str, Any] | None:
        return None if plain is None else as_map(plain, of.what)

    return FieldCodec("{text: any} or nil", read)


def _figures(of: DeclaredField) -> FieldCodec:
    def read(reader: Reader, plain: Any) -> m.Figures:
        figures = as_map(plain, of.what)
        of.check_count(reader, len(figures))
        for text in (*figures, *figures.values()) if of.has(Mark.SHOWN) else ():
            if isinstance(text, str) and not (text.isprintable() and len(text) <= MAX_SHOWN):
                raise ProtocolError(
                    f"{of.what}: {text[:MAX_SHOWN]!r:.100} must be one line of printable text, at"
                    f" most {MAX_SHOWN} characters"
                )
        return {
            name: as_scalar(value, f"{of.what}: {name[:40]}") for name, value in figures.items()
        }

    return FieldCodec("{text: finite number, text or bool}", read, dict)


def _text_lists(of: DeclaredField) -> FieldCodec:
    texts = _texts(of)

    def read(reader: Reader, plain: Any) -> Mapping[str, tuple[str, ...]]:
        return {name: texts.read(reader, item) for name, item in as_map(plain, of.what).items()}

    def write(lists: Mapping[str, tuple[str, ...]]) -> Any:
        return {name: list(texts) for name, texts in lists.items()}

    return FieldCodec("{text: [text]}", read, write)


def _when(of: DeclaredField) -> FieldCodec:
    def read(_: Reader, plain: Any) -> When:
        try:
            return When.read(as_text(plain, of.what))
        except MisuseError as error:
            raise ProtocolError(f"{of.message}: {error}") from None

    return FieldCodec("text", read, str)


# --- kinds and vocabularies ---


def _kinds(of: DeclaredField) -> FieldCodec:
    def read(reader: Reader, plain: Any) -> tuple[AgentKind, ...]:
        kinds = as_list(plain, of.what)
        of.check_count(reader, len(kinds))
        # Counted in the plain data, because reading a kind takes
        # much longer than its bytes suggest.
        attributes = sum(len(cast("list[Any]", kind[1])) for kind in kinds if _has_fields(kind))
        check(of.message, attributes, reader.limits.fields, "attributes of kinds")
        return tuple([read_kind(kind) for kind in kinds])

    def write(kinds: tuple[AgentKind, ...]) -> Any:
        return [plain_kind(kind) for kind in kinds]

    return FieldCodec("[kind]", read, write)


def _has_fields(kind: Any) -> bool:
    return isinstance(kind, list) and len(cast("list[Any]", kind)) > 1 and isinstance(kind[1], list)


# --- events ---


def _single(plain: Any, what: str) -> list[list[Any]]:
    """The events of a list that are not in columns."""
    # Six items are a batch in columns.
    return [item for item in lists_in(as_list(plain, what)) if len(item) != 6]


def _events(of: DeclaredField) -> FieldCodec:
    generated = of.has(Mark.GENERATED)

    def read(reader: Reader, plain: Any) -> tuple[AnyEvent, ...]:
        if generated and plain != []:  # Most replies to a tick have none.
            _check_generated(of, reader, plain)
        return reader.events(plain)

    return FieldCodec("[event]", read, plain_event_list)


def _check_generated(of: DeclaredField, reader: Reader, plain: Any) -> None:
    """Raise ProtocolError for more single events than a generator may send in a message.

    Each costs the coordinator a hundred times as much as a row of columns.
    """
    limits, single = reader.limits, _single(plain, of.what)
    check(of.message, len(single), limits.single_events, "single events", _ADVICE)
    # Most events have two items, and only those of five have receivers or a condition.
    if len(single) == len(plain) and max(map(len, single)) < 5:
        return
    receivers = sum(map(len, lists_in([item[4] for item in single if len(item) == 5])))
    check(of.message, receivers, limits.receivers, "receivers of single events", _ADVICE)
    check(of.message, _characters([plain]), limits.conditions, _OF_CONDITIONS)


def _characters(lists: Iterable[Any]) -> int:
    """The characters of the different conditions of events: equal ones are parsed once."""
    # The third item from the end, of an event of five items and of a batch of six.
    events = lists_in(chain.from_iterable(lists_in(lists)))
    given = [item[-3] for item in events if len(item) > 4]
    return sum(map(len, {text for text in given if isinstance(text, str)}))


def _events_by_sender(of: DeclaredField) -> FieldCodec:
    def read(reader: Reader, plain: Any) -> m.SentBy:
        senders = as_map(plain, of.what)
        if of.has(Mark.EMITTED) and senders:
            # A total, because a host may have any number of agents that send a few events each.
            count = sum(len(_single(events, of.what)) for events in senders.values())
            advice = f"{_ADVICE}, or raise host_events in [limits]"
            check(of.message, len(senders), reader.limits.host_events, "senders of events", advice)
            check(of.message, count, reader.limits.host_events, "single events", advice)
            most = OF_A_HOST * reader.limits.conditions
            check(of.message, _characters(senders.values()), most, _OF_CONDITIONS)
        return {name: reader.events(events) for name, events in senders.items()}

    def write(senders: m.SentBy) -> Any:
        return {name: plain_event_list(events) for name, events in senders.items()}

    return FieldCodec("{id: [event]}", read, write)


# --- readings: section 11 of PROTOCOL.md ---


def _readings(of: DeclaredField) -> FieldCodec:
    def read(_: Reader, plain: Any) -> tuple[Reading, ...]:
        return tuple([read_reading(reading) for reading in as_list(plain, of.what)])

    def write(readings: tuple[Reading, ...]) -> Any:
        return [plain_reading(reading) for reading in readings]

    return FieldCodec("[reading]", read, write)


_DEPTHS: Final = {"rgb8": 3, "mono8": 1, "32FC1": 4}


def plain_reading(reading: Reading) -> list[Any]:
    """A reading as plain data: its kind, robot and time, and its measurements."""
    kind, write = _WRITERS[type(reading)]
    # A scan with a beam time of 0 is sent as `scan` (PROTOCOL.md, section 11).
    if isinstance(reading, Scan) and reading.beam_time:
        return ["sweep", reading.robot, reading.time, *_write_sweep(reading)]
    return [kind, reading.robot, reading.time, *write(reading)]


def read_reading(plain: Any) -> Reading:
    """A reading from plain data. Raises ProtocolError."""
    items = as_list(plain, "a reading")
    known = _READERS.get(items[0] if items and isinstance(items[0], str) else "")
    if known is None:
        shown = str(items[0] if items else None)[:40]
        raise ProtocolError(f"no reading {shown!r}; expected {', '.join(_READERS)}")
    count, read = known
    as_items(items, f"a {items[0]}", count + 3)
    return read(as_text(items[1], "the robot"), as_number(items[2], "the time"), items[3:])


def _write_scan(scan: Scan) -> list[Any]:
    return [
        np.ascontiguousarray(scan.ranges, "<f4").tobytes(),
        scan.first,
        scan.step,
        scan.range_max,
        [scan.mount_x, scan.mount_y, scan.mount_angle],
    ]


def _write_sweep(scan: Scan) -> list[Any]:
    path = [[place.seconds, place.x, place.y, place.angle] for place in scan.path]
    return [*_write_scan(scan), scan.beam_time, path]


def _write_image(image: Image) -> list[Any]:
    mount = image.mount
    return [image.encoding, image.width, image.height, image.data, [mount.x, mount.y, mount.angle]]


def _numbers(plain: Any, what: str, names: str) -> list[float]:
    """The numbers of a list with these names, in brackets and separated by commas."""
    numbers = [as_number(item, what) for item in as_list(plain, what)]
    if len(numbers) != names.count(",") + 1:
        raise ProtocolError(f"{what} is {names}")
    return numbers


def _mount(plain: Any, what: str) -> Mount:
    return Mount(*_numbers(plain, f"the mount of {what}", "[x, y, angle]"))


def _scan(robot: str, time: float, items: Sequence[Any]) -> Scan:
    data, mount = items[0], _mount(items[4], "a scan")
    if not isinstance(data, bytes) or len(data) % 4:
        raise ProtocolError("the ranges of a scan are float32 as bytes")
    first, step, most = (as_number(item, "a number of a scan") for item in items[1:4])
    ranges = np.frombuffer(data, "<f4")
    # The protocol defines values for beams without a hit, so a NaN is an error of the sensor.
    if np.isnan(ranges).any():
        raise ProtocolError("a range of a scan is not a number; 0 means that nothing was hit")
    if not step and len(ranges) > 1:
        raise ProtocolError("the beams of a scan are 0 degrees apart: all have one direction")
    if most <= 0:
        raise ProtocolError(f"the range_max of a scan is {most:g}; expected metres above 0")
    return Scan(robot, ranges, first, step, most, time, mount.x, mount.y, mount.angle)


def _sweep(robot: str, time: float, items: Sequence[Any]) -> Scan:
    beam_time = as_number(items[5], "the time of a beam")
    path = tuple([_displacement(place) for place in as_list(items[6], "the path of a scan")])
    seconds = [place.seconds for place in path]
    # Positions between two places are interpolated, which requires distinct ascending times.
    if sorted(set(seconds)) != seconds:
        raise ProtocolError("the seconds of the path of a scan must rise")
    return replace(_scan(robot, time, items), beam_time=beam_time, path=path)


def _displacement(plain: Any) -> Displacement:
    return Displacement(*_numbers(plain, "a place of the path of a scan", "[seconds, x, y, angle]"))


def _sightings(robot: str, time: float, items: Sequence[Any]) -> Sightings:
    seen = [as_list(item, "a sighting") for item in as_list(items[0], "sightings")]
    return Sightings(robot, tuple(map(_sighting, seen)), time)


def _sighting(items: list[Any]) -> Sighting:
    if len(items) != 3:
        raise ProtocolError("a sighting is [marker, distance, angle]")
    return Sighting(
        as_text(items[0], "the marker"),
        as_number(items[1], "a distance"),
        as_number(items[2], "an angle"),
    )


def _image(robot: str, time: float, items: Sequence[Any]) -> Image:
    encoding, data = as_text(items[0], "the encoding"), items[3]
    width, height = as_int(items[1], "the width", 1), as_int(items[2], "the height", 1)
    if encoding not in ENCODINGS:
        raise ProtocolError(f"no encoding {encoding[:40]!r}; expected {', '.join(ENCODINGS)}")
    if not isinstance(data, bytes):
        raise ProtocolError("the data of an image are bytes")
    if encoding in _DEPTHS and len(data) != width * height * _DEPTHS[encoding]:
        raise ProtocolError(f"{len(data)} bytes are no {encoding} image of {width}×{height} pixels")
    return Image(robot, data, encoding, width, height, time, _mount(items[4], "an image"))


def _odometry(robot: str, time: float, items: Sequence[Any]) -> Odometry:
    x, y, angle, speed, turn = (as_number(item, "odometry") for item in items)
    return Odometry(robot, x, y, angle, speed, turn, time)


def _battery(robot: str, time: float, items: Sequence[Any]) -> Battery:
    return Battery(robot, as_number(items[0], "the charge"), as_number(items[1], "the volts"), time)


def _position(robot: str, time: float, items: Sequence[Any]) -> Position:
    latitude, longitude = (as_number(degrees, "a position") for degrees in items[:2])
    altitude, accuracy = (_known_number(metres, "a position") for metres in items[2:])
    return Position(robot, latitude, longitude, altitude, accuracy, time)


def _known_number(plain: Any, what: str) -> float | None:
    """A finite number, or None for nil: the sensor does not report it. Raises ProtocolError."""
    return None if plain is None else as_number(plain, what)


_WRITERS: dict[type, tuple[str, Callable[[Any], list[Any]]]] = {
    Scan: ("scan", _write_scan),
    Sightings: ("sightings", lambda s: [[[o.marker, o.distance, o.angle] for o in s.seen]]),
    Image: ("image", _write_image),
    Odometry: ("odometry", lambda o: [o.x, o.y, o.angle, o.speed, o.turn]),
    Battery: ("battery", lambda b: [b.charge, b.volts]),
    Position: ("position", lambda p: [p.latitude, p.longitude, p.altitude, p.accuracy]),
}

_READERS: dict[str, tuple[int, Callable[[str, float, Sequence[Any]], Reading]]] = {
    "scan": (5, _scan),
    "sweep": (7, _sweep),
    "sightings": (1, _sightings),
    "image": (5, _image),
    "odometry": (5, _odometry),
    "battery": (2, _battery),
    "position": (4, _position),
}


# --- all types ---

_CODECS: Final[dict[Any, Callable[[DeclaredField], FieldCodec]]] = {
    int: _int,
    float: _float,
    bool: _checked("bool", as_bool),
    str: _checked("text", as_text),
    bytes: _checked("binary", as_bytes),
    When: _when,
    tuple[str, ...]: _texts,
    m.Saved: _saved,
    m.Figures: _figures,
    Mapping[str, tuple[str, ...]]: _text_lists,
    tuple[AgentKind, ...]: _kinds,
    Vocabulary: lambda _: FieldCodec(
        "vocabulary", lambda _, plain: read_vocabulary(plain), plain_vocabulary
    ),
    tuple[AnyEvent, ...]: _events,
    m.SentBy: _events_by_sender,
    m.Parts: parts,
    m.Changes: parts,
    Mapping[str, m.Changes]: views,
    Scene | None: skeleton_or_nil,
    tuple[Reading, ...]: _readings,
}
