"""Every message of the bus from bytes and to bytes.

A message is a msgpack list: its name, then its items in order. Who sent it is not in it: the key
that it came on says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar, cast

import msgpack

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.patch import Delta
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.alphabet import (
    plain_kind,
    plain_vocabulary,
    read_kind,
    read_vocabulary,
)
from minerva_bus.wire.columns import is_patch, plain_patch
from minerva_bus.wire.limits import DEFAULT, Limits, check
from minerva_bus.wire.plain import (
    as_bool,
    as_int,
    as_list,
    as_map,
    as_number,
    as_scalar,
    as_text,
    unpack,
)
from minerva_bus.wire.readings import plain_reading, read_reading
from minerva_bus.wire.values import Reader, plain_event, plain_scene
from minerva_bus.wire.weighing import check_weight

_P = ParamSpec("_P")
_T = TypeVar("_T")
_EMPTY = Vocabulary()
_ADVICE = "send those of one type in columns"
_NONE: Mapping[str, Delta] = {}


# --- to bytes ---


def encode(message: m.Message) -> bytes:
    """A message as bytes."""
    name, write = _WRITERS[type(message)]
    return msgpack.packb([name, *write(message)])


def _plain_parts(parts: m.Parts, patches: m.Patches = _NONE) -> dict[str, Any]:
    plain: dict[str, Any] = {name: plain_scene(scene) for name, scene in parts.items()}
    plain.update((name, plain_patch(patch)) for name, patch in patches.items())
    return plain


def _plain_events(events: tuple[AnyEvent, ...]) -> list[Any]:
    return [plain_event(event) for event in events]


def _write_hello(h: m.Hello) -> list[Any]:
    return [
        {
            "version": h.version,
            "service": h.service,
            "kinds": [plain_kind(kind) for kind in h.kinds],
            "generates": list(h.generates),
            "lockstep": h.lockstep,
            "ahead": h.ahead,
            "orders": list(h.orders),
            "people": h.people,
            "draws": list(h.draws),
            "coupled": h.coupled,
            "every": h.every,
            "rate": h.rate,
            "topics": list(h.topics),
            "publishes": list(h.publishes),
            "pid": h.pid,
            "host": h.host,
            "plain": h.plain,
        }
    ]


def _write_evolved(r: m.EvolveReply) -> list[Any]:
    return [
        r.frame,
        r.part,
        _plain_parts(r.changed, r.patched),
        {agent: _plain_events(events) for agent, events in r.emitted.items()},
        {
            event_type: _plain_parts(parts, r.view_patches.get(event_type, {}))
            for event_type, parts in r.views.items()
        },
    ]


def _write_welcome(w: m.Welcome) -> list[Any]:
    return [w.world, plain_vocabulary(w.vocabulary), w.seed, w.dt, w.frame, w.policy, w.saved]


def _write_evolve(r: m.EvolveRequest) -> list[Any]:
    return [
        r.frame,
        list(r.asked),
        _plain_events(r.events),
        _plain_events(r.visual),
        r.part,
        list(r.only),
    ]


def _write_view(v: m.ViewShown) -> list[Any]:
    skeleton = None if v.skeleton is None else plain_scene(v.skeleton)
    return [v.frame, v.sequence, _plain_parts(v.parts, v.patches), skeleton, list(v.halted)]


_WRITERS: dict[type, tuple[str, Callable[[Any], list[Any]]]] = {
    m.Hello: ("hello", _write_hello),
    m.TickReply: ("ticked", lambda r: [r.frame, _plain_events(r.events), r.saved]),
    m.EvolveReply: ("evolved", _write_evolved),
    m.Emitted: ("emitted", lambda e: [_plain_events(e.events)]),
    m.Failed: ("failed", lambda f: [f.frame, f.problem, f.traceback]),
    m.Resync: ("resync", lambda r: [r.event_type]),
    m.Leaving: ("leaving", lambda _: []),
    m.Doing: ("doing", lambda d: [dict(d.figures)]),
    m.Report: ("report", lambda r: [dict(r.figures)]),
    m.Greet: ("greet", lambda _: []),
    m.Welcome: ("welcome", _write_welcome),
    m.Refused: ("refused", lambda r: [r.reason]),
    m.Sources: ("sources", lambda s: [{k: list(v) for k, v in s.publishers.items()}]),
    m.TickRequest: ("tick", lambda r: [r.frame]),
    m.Fragments: ("fragments", lambda f: [_plain_parts(f.given), list(f.dropped)]),
    m.EvolveRequest: ("evolve", _write_evolve),
    m.ViewShown: ("view", lambda v: [v.event_type, *_write_view(v)]),
    m.Orders: ("orders", lambda o: [o.frame, _plain_events(o.events)]),
    m.Repeat: ("repeat", lambda r: [r.topic]),
    m.Stop: ("stop", lambda s: [s.reason]),
    m.FrameRecord: (
        "frame",
        lambda r: [r.frame, _plain_events(r.events), _plain_parts(r.changed), r.digest],
    ),
    m.Readings: ("readings", lambda r: [r.frame, [plain_reading(one) for one in r.readings]]),
}


# --- from bytes ---


def _refusing(read: Callable[_P, _T]) -> Callable[_P, _T]:
    """Turn any error of a reader into a ProtocolError: whatever a sender sends, it is to blame."""

    @wraps(read)
    def checked(*given: _P.args, **named: _P.kwargs) -> _T:
        try:
            return read(*given, **named)
        except (ProtocolError, SceneError):
            raise
        except Exception as error:
            kind = type(error).__name__
            raise ProtocolError(f"it cannot be decoded: {kind}: {error}"[:200]) from error

    return checked


class Decoder:
    """Reads messages; a world's vocabulary makes those readable that hold strings or events.

    Raises ProtocolError or VocabularyError, and nothing else, whatever the bytes are.
    """

    def __init__(self, vocabulary: Vocabulary = _EMPTY, limits: Limits = DEFAULT) -> None:
        self._reader = Reader(vocabulary, limits)
        self._limits = limits

    @_refusing
    def from_member(self, member: str, data: bytes) -> m.FromMember:
        """A message that a member sent to the coordinator; its work is bounded."""
        check_weight(data, self._limits)
        return self._message(_FROM_MEMBER, member, data)

    @_refusing
    def to_member(self, data: bytes) -> m.ToMember:
        """A message that the coordinator sent."""
        return self._message(_TO_MEMBER, "", data)

    @_refusing
    def readings(self, topic: str, member: str, data: bytes) -> m.Readings:
        """A member's readings on a topic."""
        items = as_list(unpack(data, self._limits), "readings")
        if len(items) != 3 or items[0] != "readings":
            raise ProtocolError('readings are ["readings", frame, [reading, ...]]')
        frame = as_int(items[1], "the frame", -1)
        return m.Readings(
            member, topic, frame, tuple(read_reading(one) for one in as_list(items[2], "readings"))
        )

    @_refusing
    def record(self, data: bytes) -> m.FrameRecord:
        """What happened in a frame."""
        items = as_list(unpack(data, self._limits), "a record")
        if len(items) != 5 or items[0] != "frame" or not isinstance(items[4], bytes):
            raise ProtocolError('a record is ["frame", frame, events, changed, digest]')
        return m.FrameRecord(
            as_int(items[1], "the frame"),
            self._reader.events(items[2]),
            _parts(self._reader, items[3], "changed"),
            items[4],
        )

    def _message(self, table: Mapping[str, tuple[int, Any]], member: str, data: bytes) -> Any:
        items = as_list(unpack(data, self._limits), "a message")
        name = as_text(items[0] if items else None, "a message's name")
        count, read = table.get(name, (0, None))
        if read is None:
            raise ProtocolError(
                f"no message {name[:40]!r} is sent here; expected {', '.join(table)}"
            )
        self._reader.columns.rows = self._limits.rows
        if len(items) - 1 != count:
            raise ProtocolError(f"{name} has {count} items, not {len(items) - 1}")
        return read(self._reader, member, items)


def _texts(plain: Any, what: str) -> tuple[str, ...]:
    return tuple([as_text(one, what) for one in as_list(plain, what)])


def _parts(reader: Reader, plain: Any, what: str) -> dict[str, Scene]:
    parts = as_map(plain, what).items()
    return {name: reader.scene(scene) for name, scene in parts if not is_patch(scene)}


def _views(reader: Reader, plain: Any) -> dict[str, Scene]:
    parts = as_map(plain, "views").items()
    return {name: reader.view(scene) for name, scene in parts if not is_patch(scene)}


def _patches(reader: Reader, plain: Any) -> m.Patches:
    parts = as_map(plain, "patches").items()
    return {name: reader.columns.patch(patch) for name, patch in parts if is_patch(patch)}


def _saved(plain: Any) -> Mapping[str, Any] | None:
    return None if plain is None else as_map(plain, "what a member saved")


def _figures(reader: Reader, name: str, plain: Any) -> m.Figures:
    figures = as_map(plain, "figures")
    check(name, len(figures), reader.limits.figures, "figures")
    return {one: as_scalar(value, f"the figure {one[:40]}") for one, value in figures.items()}


def _made(reader: Reader, name: str, plain: Any) -> tuple[AnyEvent, ...]:
    """The events of a generator: few that are not in columns."""
    limits, items = reader.limits, as_list(plain, "events")
    single = _single(items)
    check(name, len(single), limits.single_events, "single events", _ADVICE)
    told = [one for one in single if len(one) == 5]
    receivers = sum(len(cast("list[Any]", one[4])) for one in told if isinstance(one[4], list))
    check(name, receivers, limits.receivers, "receivers of single events", _ADVICE)
    conditions = {one[2] for one in told if isinstance(one[2], str)}
    check(name, sum(map(len, conditions)), limits.conditions, "characters of conditions")
    return reader.events(items)


def _single(items: list[Any]) -> list[list[Any]]:
    """Those events that are not in columns."""
    lists = [cast("list[Any]", one) for one in items if isinstance(one, list)]
    return [one for one in lists if len(one) != 6]


def _kinds(reader: Reader, plain: Any) -> tuple[AgentKind, ...]:
    items = as_list(plain, "kinds")
    check("a hello", len(items), reader.limits.kinds, "kinds")
    fields = sum(len(cast("list[Any]", one[1])) for one in items if _has_fields(one))
    check("a hello", fields, reader.limits.fields, "attributes of kinds")
    return tuple([read_kind(one) for one in items])


def _has_fields(kind: Any) -> bool:
    return isinstance(kind, list) and len(cast("list[Any]", kind)) > 1 and isinstance(kind[1], list)


def _names(reader: Reader, hello: Mapping[str, Any], key: str) -> tuple[str, ...]:
    items = as_list(hello[key], key)
    check("a hello", len(items), reader.limits.names, f"names in {key}")
    return _texts(items, key)


def _read_hello(reader: Reader, member: str, items: list[Any]) -> m.Hello:
    h = as_map(items[1], "a hello")
    try:
        return m.Hello(
            member,
            as_int(h["version"], "the version"),
            as_text(h["service"], "the service"),
            _kinds(reader, h["kinds"]),
            _names(reader, h, "generates"),
            as_bool(h["lockstep"], "lockstep"),
            as_bool(h.get("ahead", False), "ahead"),
            _names(reader, h, "orders"),
            _names(reader, h, "draws"),
            as_bool(h["coupled"], "coupled"),
            as_int(h["every"], "every"),
            _rate(h.get("rate", 0.0)),
            _names(reader, h, "topics"),
            _names(reader, h, "publishes"),
            as_int(h["pid"], "the pid"),
            as_text(h["host"], "the host"),
            as_bool(h.get("people", False), "people"),
            as_bool(h.get("plain", False), "plain"),
        )
    except KeyError as missing:
        raise ProtocolError(f"a hello needs {missing}") from None
    except ValueError as error:
        raise ProtocolError(f"a hello's kinds: {error}") from None


def _rate(plain: Any) -> float:
    rate = as_number(plain, "rate")
    if rate < 0:
        raise ProtocolError(f"rate must be a number from 0, not {rate}")
    return rate


def _read_evolved(reader: Reader, member: str, items: list[Any]) -> m.EvolveReply:
    emitted = as_map(items[4], "emitted")
    views = as_map(items[5], "views")
    single = sum(len(_single(as_list(events, "events"))) for events in emitted.values())
    check("evolved", single, reader.limits.host_events, "single events", _ADVICE)
    return m.EvolveReply(
        member,
        as_int(items[1], "the frame"),
        as_int(items[2], "the part"),
        _parts(reader, items[3], "changed"),
        {agent: reader.events(events) for agent, events in emitted.items()},
        {event_type: _views(reader, parts) for event_type, parts in views.items()},
        _patches(reader, items[3]),
        {name: some for name, parts in views.items() if (some := _patches(reader, parts))},
    )


def _read_welcome(reader: Reader, member: str, items: list[Any]) -> m.Welcome:
    return m.Welcome(
        as_text(items[1], "the world"),
        read_vocabulary(items[2]),
        as_int(items[3], "the seed", -(1 << 63)),
        as_number(items[4], "dt"),
        as_int(items[5], "the frame"),
        as_text(items[6], "the policy"),
        _saved(items[7]),
    )


def _read_evolve(reader: Reader, member: str, items: list[Any]) -> m.EvolveRequest:
    return m.EvolveRequest(
        as_int(items[1], "the frame"),
        _texts(items[2], "asked"),
        reader.events(items[3]),
        reader.events(items[4]),
        as_int(items[5], "the part"),
        _texts(items[6], "only"),
    )


def _read_view(reader: Reader, member: str, items: list[Any]) -> m.ViewShown:
    return m.ViewShown(
        as_int(items[2], "the frame"),
        as_text(items[1], "the event type"),
        as_int(items[3], "the sequence"),
        _views(reader, items[4]),
        None if items[5] is None else reader.skeleton(items[5]),
        _patches(reader, items[4]),
        _texts(items[6], "halted"),
    )


def _read_sources(reader: Reader, member: str, items: list[Any]) -> m.Sources:
    publishers = as_map(items[1], "sources")
    return m.Sources({topic: _texts(names, "publishers") for topic, names in publishers.items()})


_FROM_MEMBER: dict[str, tuple[int, Callable[[Reader, str, list[Any]], m.FromMember]]] = {
    "hello": (1, _read_hello),
    "ticked": (
        3,
        lambda r, who, i: m.TickReply(
            who, as_int(i[1], "the frame"), _made(r, "ticked", i[2]), _saved(i[3])
        ),
    ),
    "evolved": (5, _read_evolved),
    "emitted": (1, lambda r, who, i: m.Emitted(who, _made(r, "emitted", i[1]))),
    "failed": (
        3,
        lambda r, who, i: m.Failed(
            who,
            as_int(i[1], "the frame", -1),
            as_text(i[2], "the problem"),
            as_text(i[3], "the traceback"),
        ),
    ),
    "resync": (1, lambda r, who, i: m.Resync(who, as_text(i[1], "the event type"))),
    "leaving": (0, lambda r, who, i: m.Leaving(who)),
    "doing": (1, lambda r, who, i: m.Doing(who, _figures(r, "doing", i[1]))),
    "report": (1, lambda r, who, i: m.Report(who, _figures(r, "report", i[1]))),
}

_TO_MEMBER: dict[str, tuple[int, Callable[[Reader, str, list[Any]], m.ToMember]]] = {
    "greet": (0, lambda r, who, i: m.Greet()),
    "welcome": (7, _read_welcome),
    "refused": (1, lambda r, who, i: m.Refused(as_text(i[1], "the reason"))),
    "sources": (1, _read_sources),
    "tick": (1, lambda r, who, i: m.TickRequest(as_int(i[1], "the frame"))),
    "fragments": (
        2,
        lambda r, who, i: m.Fragments(_parts(r, i[1], "fragments"), _texts(i[2], "dropped")),
    ),
    "evolve": (6, _read_evolve),
    "view": (6, _read_view),
    "orders": (2, lambda r, who, i: m.Orders(as_int(i[1], "the frame"), r.events(i[2]))),
    "repeat": (1, lambda r, who, i: m.Repeat(as_text(i[1], "the topic"))),
    "stop": (1, lambda r, who, i: m.Stop(as_text(i[1], "the reason"))),
}
