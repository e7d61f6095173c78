"""Codecs of message fields, by declared type.

`_CODECS` has an entry for each type that a message may declare: functions that write values as
plain data and that read and check them, and the name of the type in PROTOCOL.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import MisuseError, ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import AtLeast, AtMost, Mark, Note, Within
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.columns_codec import is_patch, plain_patch
from minerva_bus.wire.message_limits import OF_A_HOST, check
from minerva_bus.wire.plain import (
    as_bool,
    as_event_type,
    as_int,
    as_list,
    as_map,
    as_number,
    as_scalar,
    as_text,
    as_topic,
    name_of,
)
from minerva_bus.wire.readings_codec import plain_reading, read_reading
from minerva_bus.wire.strings_codec import Reader, plain_event_list, plain_scene
from minerva_bus.wire.vocabulary_codec import (
    plain_kind,
    plain_vocabulary,
    read_kind,
    read_vocabulary,
)
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import When

_OF_CONDITIONS: Final = "characters of conditions"
_ADVICE: Final = "send those of one type in columns"

MAX_SHOWN: Final = 200
"""Characters of a text about a member, for people."""

Read: TypeAlias = Callable[[Reader, Any], Any]
Write: TypeAlias = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """Codec of one field: `read` checks plain data, `write` makes it; None: values are plain.

    `text`: its type in PROTOCOL.md. `write` also takes the values of the fields `Within` this one.
    """

    text: str
    read: Read
    write: Write | None = None


@dataclass(frozen=True, slots=True)
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
    def host(self) -> str:
        """The field whose map it shares, or empty if it has its own item."""
        return next((mark.field for mark in self.marks if isinstance(mark, Within)), "")

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


# --- strings, whole or patched: fragments, views and the skeleton ---

_NO_PATCHES: Final[m.Patches] = {}


def _write_parts(parts: m.Parts, patches: m.Patches = _NO_PATCHES) -> dict[str, Any]:
    plain: dict[str, Any] = {}
    if parts:
        plain = {name: plain_scene(scene) for name, scene in parts.items()}
    # Encoded in one map with whole strings: a fragment or view is either changed or patched.
    if patches:
        plain.update((name, plain_patch(patch)) for name, patch in patches.items())
    return plain


def whole_parts(of: DeclaredField) -> FieldCodec:
    """Strings by id, without the patches in the same map."""
    what, view = of.what, of.has(Mark.VIEW)

    def read(reader: Reader, plain: Any) -> m.Parts:
        scene = reader.view if view else reader.scene
        parts = as_map(plain, what)
        if not parts:
            return {}
        # Strings and patches share one map; the field for patches reads the others.
        return {name: scene(part) for name, part in parts.items() if not is_patch(part)}

    return FieldCodec("{id: string}", read, _write_parts)


def part_patches(of: DeclaredField) -> FieldCodec:
    """Patches by id, without the whole strings in the same map."""

    def read(reader: Reader, plain: Any) -> m.Patches:
        parts = as_map(plain, of.what)
        if not parts:
            return {}
        return {name: reader.columns.patch(part) for name, part in parts.items() if is_patch(part)}

    return FieldCodec("{id: patch}", read)


def whole_views(of: DeclaredField) -> FieldCodec:
    """Strings by id for each visual event type, without patches."""
    parts = whole_parts(of)

    def read(reader: Reader, plain: Any) -> Mapping[str, m.Parts]:
        return {name: parts.read(reader, view) for name, view in as_map(plain, of.what).items()}

    def write(views: Mapping[str, m.Parts], patches: Mapping[str, m.Patches]) -> Any:
        if not views:
            return {}
        # Every type with patches is in `views` as well, if only with an empty map.
        return {
            name: _write_parts(view, patches.get(name, _NO_PATCHES)) for name, view in views.items()
        }

    return FieldCodec("{event type: {id: string}}", read, write)


def view_patches(of: DeclaredField) -> FieldCodec:
    """Patches by id for each visual event type, without whole strings."""
    patches = part_patches(of)

    def read(reader: Reader, plain: Any) -> Mapping[str, m.Patches]:
        views = {name: patches.read(reader, v) for name, v in as_map(plain, of.what).items()}
        return {name: view for name, view in views.items() if view}

    return FieldCodec("{event type: {id: patch}}", read)


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


def _bool(of: DeclaredField) -> FieldCodec:
    return FieldCodec("bool", lambda _, plain: as_bool(plain, of.what))


def _text(of: DeclaredField) -> FieldCodec:
    what = of.what
    return FieldCodec("text", lambda _, plain: as_text(plain, what))


def _bytes(of: DeclaredField) -> FieldCodec:
    def read(_: Reader, plain: Any) -> bytes:
        if not isinstance(plain, bytes):
            raise ProtocolError(f"{of.what} must be binary, not {name_of(plain)}")
        return plain

    return FieldCodec("binary", read)


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


def _vocabulary(_: DeclaredField) -> FieldCodec:
    return FieldCodec("vocabulary", lambda _, plain: read_vocabulary(plain), plain_vocabulary)


# --- events ---


def _single(plain: Any, what: str) -> list[list[Any]]:
    """The events of a list that are not in columns."""
    items = [cast("list[Any]", item) for item in as_list(plain, what) if isinstance(item, list)]
    # Six items are a batch in columns.
    return [item for item in items if len(item) != 6]


def _events(of: DeclaredField) -> FieldCodec:
    def read(reader: Reader, plain: Any) -> tuple[AnyEvent, ...]:
        return reader.events(plain)

    def read_generated(reader: Reader, plain: Any) -> tuple[AnyEvent, ...]:
        if plain != []:  # Most replies to a tick have none.
            _check_generated(of, reader, plain)
        return reader.events(plain)

    return FieldCodec(
        "[event]", read_generated if of.has(Mark.GENERATED) else read, plain_event_list
    )


def _check_generated(of: DeclaredField, reader: Reader, plain: Any) -> None:
    """Raise ProtocolError for more single events than a generator may send in a message.

    Each costs the coordinator a hundred times as much as a row of columns.
    """
    limits, single = reader.limits, _single(plain, of.what)
    check(of.message, len(single), limits.single_events, "single events", _ADVICE)
    full = [item for item in single if len(item) == 5]
    receivers = sum(len(cast("list[Any]", item[4])) for item in full if isinstance(item[4], list))
    check(of.message, receivers, limits.receivers, "receivers of single events", _ADVICE)
    check(of.message, _characters([plain]), limits.conditions, _OF_CONDITIONS)


def _characters(lists: Iterable[Any]) -> int:
    """The characters of the different conditions of events: equal ones are parsed once."""
    events = [cast("list[Any]", each) for each in lists if isinstance(each, list)]
    items = [cast("list[Any]", item) for each in events for item in each if isinstance(item, list)]
    # The third item from the end, of an event of five items and of a batch of six.
    given = [item[-3] for item in items if len(item) > 4]
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


# --- readings ---


def _readings(of: DeclaredField) -> FieldCodec:
    def read(_: Reader, plain: Any) -> tuple[Reading, ...]:
        return tuple([read_reading(reading) for reading in as_list(plain, of.what)])

    def write(readings: tuple[Reading, ...]) -> Any:
        return [plain_reading(reading) for reading in readings]

    return FieldCodec("[reading]", read, write)


_CODECS: Final[dict[Any, Callable[[DeclaredField], FieldCodec]]] = {
    int: _int,
    float: _float,
    bool: _bool,
    str: _text,
    bytes: _bytes,
    When: _when,
    tuple[str, ...]: _texts,
    m.Saved: _saved,
    m.Figures: _figures,
    Mapping[str, tuple[str, ...]]: _text_lists,
    tuple[AgentKind, ...]: _kinds,
    Vocabulary: _vocabulary,
    tuple[AnyEvent, ...]: _events,
    m.SentBy: _events_by_sender,
    m.Parts: whole_parts,
    m.Patches: part_patches,
    Mapping[str, m.Parts]: whole_views,
    Mapping[str, m.Patches]: view_patches,
    Scene | None: skeleton_or_nil,
    tuple[Reading, ...]: _readings,
}
