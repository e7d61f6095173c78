"""Messages in world files: types from texts of `.srv` files, requests, and events of messages.

The library of message types ships those of messages only. Types of services that this program uses
itself are here; others come from the world file, or from a folder such as `/opt/ros/jazzy/share`.
"""

# rosbags creates message classes at run time, so their types are unknown statically.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.files import read_text
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.services import WorldInfo
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages.frames import Matrix
from minerva_services.bridges.ros_messages.messages import GRID, POINTS, messages
from minerva_services.bridges.ros_messages.ranges import points_of
from minerva_services.bridges.ros_messages.readings import grid_of, heading_of
from minerva_services.event_factory import event_type
from minerva_services.options import check_positive

_KNOWN: Final = {
    "std_srvs/srv/Empty": "---",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message",
    "action_msgs/srv/CancelGoal": (
        "GoalInfo goal_info\n---\nint8 return_code\nGoalInfo[] goals_canceling"
    ),
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nParameterValue[] values",
    "rcl_interfaces/srv/SetParameters": (
        "Parameter[] parameters\n---\nSetParametersResult[] results"
    ),
}
_MAX_DEFINITION_BYTES: Final = 1 << 20
_EMPTY: Final = "structure_needs_at_least_one_member"


@dataclass(frozen=True, slots=True)
class ServiceType:
    """A type of services, and the names of its types of requests and answers."""

    name: str
    request: str
    answer: str


def service_type(name: str, text: str = "", folder: str = "") -> ServiceType:
    """A type of services by its name, such as `std_srvs/srv/SetBool`.

    `text` is its definition; otherwise it is one of the known types, or in `folder`, which has the
    files `PACKAGE/srv/NAME.srv`. Raises MisuseError.
    """
    package, _, short = name.partition("/srv/")
    if not package or not short.isidentifier():
        raise MisuseError(
            f"ros2: {name!r} is not a type; expected one such as std_srvs/srv/SetBool"
        )
    if not text and folder:
        text = _file(folder, f"{name}.srv")
    text = text or _KNOWN.get(name, "")
    if not text:
        raise MisuseError(
            f"ros2: {name} is not known{nearest(name, list(_KNOWN))}; give the text of its file as"
            ' definition = """...""", or definitions = "/opt/ros/jazzy/share"'
        )
    parts = [part.strip() for part in f"\n{text}\n".split("\n---")]
    if len(parts) != 2:
        raise MisuseError(f"ros2: the definition of {name} has {len(parts)} parts; expected a"
                          " request and an answer with --- between them")  # fmt: skip
    # rosbags knows packages and names only; these names are never on the network.
    request, answer = (f"{package}/msg/{short}_{part}" for part in ("Request", "Response"))
    register({request: parts[0], answer: parts[1]}, folder)
    return ServiceType(name, request, answer)


def register(texts: Mapping[str, str], folder: str = "") -> None:
    """Add message types, and those that they use, from `folder`. Raises MisuseError."""
    from rosbags.typesys import get_types_from_msg  # late: optional dependency (extra "ros")

    store, added, waiting = messages().store, {}, dict(texts)
    while waiting:
        name, text = waiting.popitem()
        try:
            added |= get_types_from_msg(text, name)
        except Exception as error:  # its parser raises many types
            raise MisuseError(f"ros2: the definition of {name} cannot be read: {error}") from None
        for used in _used(added[name][1]):
            if used not in {*added, *waiting, *store.fielddefs}:
                if not folder:
                    raise MisuseError(
                        f"ros2: {name} uses {used}, which is not known;"
                        ' give the folder with its file: definitions = "/opt/ros/jazzy/share"'
                    )
                waiting[used] = _file(folder, f"{used}.msg")
    try:
        store.register(added)
    except Exception as error:
        raise MisuseError(f"ros2: {', '.join(texts)}: another definition exists: {error}") from None


def _used(fields: Sequence[tuple[str, Any]]) -> list[str]:
    """The message types of the fields of another."""
    used = list[str]()
    for _, (kind, of) in fields:
        while kind.name in ("ARRAY", "SEQUENCE"):
            kind, of = of[0]
        if kind.name == "NAME":
            used.append(of)
    return used


def _file(folder: str, name: str) -> str:
    try:
        # An empty file is a message without fields.
        return read_text(Path(folder) / name, _MAX_DEFINITION_BYTES) or "\n"
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise MisuseError(f"ros2: {Path(folder) / name}: {reason}") from None


def built(message: str, values: Mapping[str, Any]) -> Any:
    """A message with these values by field; other fields are 0, empty or false.

    Raises MisuseError, which names the field.
    """
    _, fields = messages().store.fielddefs[message]
    names = [name for name, _ in fields if name != _EMPTY]
    for name in values:
        if name not in names:
            listed = ", ".join(names) or "no fields"
            raise MisuseError(
                f"{message} has no field {name}{nearest(name, names)}; it has {listed}"
            )
    made = {
        name: _value(f"{message}: {name}", kind, of, values.get(name))
        for name, (kind, of) in fields
        if name != _EMPTY
    }
    return messages().make(message, **made)


def _value(where: str, kind: Any, of: Any, given: Any) -> Any:
    if kind.name == "NAME":
        if given is not None and not isinstance(given, Mapping):
            raise MisuseError(f"{where} is a {of}; expected a table of its fields")
        return built(of, cast("Mapping[str, Any]", given or {}))
    if kind.name == "BASE":
        return _basic(where, of[0], given)
    (element, type_of_element), count = of
    items = given
    if given is None:
        items = [None] * count if kind.name == "ARRAY" else []
    if not isinstance(items, list | tuple) or (kind.name == "ARRAY" and len(items) != count):
        raise MisuseError(f"{where} is a list{f' of {count}' if kind.name == 'ARRAY' else ''}")
    values = [_value(where, element, type_of_element, item) for item in items]
    if element.name == "BASE" and type_of_element[0] != "string":
        return np.array(values, _dtype(type_of_element[0]))
    return values


def _dtype(name: str) -> str:
    return {"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(name, name)


def _basic(where: str, name: str, given: Any) -> Any:
    wanted = str if "string" in name else bool if name == "bool" else float
    if given is None:
        return wanted() if wanted is not float or "float" in name else 0
    is_bool = isinstance(given, bool)
    fits = isinstance(given, wanted) if wanted is not float else not is_bool
    if not fits or (wanted is float and not isinstance(given, int | float)):
        raise MisuseError(f"{where} is a {name}, not {given!r:.40}")
    if wanted is not float or "float" in name:
        return wanted(given)
    info = np.iinfo(_dtype(name))
    if given != int(given) or not info.min <= given <= info.max:
        raise MisuseError(f"{where} is a {name} from {info.min} to {info.max}, not {given!r:.40}")
    return int(given)


def at(message: Any, path: str) -> Any:
    """The value of a message at a path such as `results.0.successful`. Raises GarbageError."""
    value = message
    for step in path.split("."):
        try:
            if step.isdigit():
                value = value[int(step)]
            else:
                value = value[step] if isinstance(value, Mapping) else getattr(value, step)
        except (AttributeError, IndexError, KeyError, TypeError):
            raise GarbageError(f"it has no {path}") from None
    is_list = isinstance(value, np.generic | np.ndarray) and value.ndim < 2
    return value.tolist() if is_list else value


SECONDS: Final = Type("real", "s")
DEGREES: Final = Type("real", "deg")
METRES: Final = Type("real", "m")
"""Types of data whose units are known; those of fields of messages are not."""

_KINDS: Final = {
    "bool": "bool", "string": "text", "wstring": "text", "float32": "real", "float64": "real",
}  # fmt: skip
"""Kinds of types of values by basic type; all others are whole numbers."""


def shape_of(message: str) -> Mapping[str, Any]:
    """The fields of a message type: a `Type`, a list with the shape of its items, or a mapping."""
    fields = messages().store.fielddefs[message][1]
    return {name: _shape(*field) for name, field in fields if name != _EMPTY}


def _shape(kind: Any, of: Any) -> Any:
    if kind.name == "NAME":
        return shape_of(of)
    if kind.name == "BASE":
        return Type(_KINDS.get(of[0], "int"))
    element, _ = of
    return [_shape(*element)]


def _within(shape: Any, path: str) -> Any:
    """The shape at a path; the first item of a list stands for all. Raises GarbageError."""
    for step in path.split("."):
        if isinstance(shape, list) and step.isdigit():
            shape = cast("list[Any]", shape)[0]
        elif isinstance(shape, Mapping) and step in shape:
            shape = cast("Mapping[str, Any]", shape)[step]
        elif shape is not None:
            raise GarbageError(f"it has no {path}")
    return shape


def _type_of(shape: Any) -> Type:
    """The type of the values of a shape, as `_plain` makes them. Raises GarbageError."""
    if isinstance(shape, list):
        return Type("list", item=_type_of(cast("list[Any]", shape)[0]))
    if isinstance(shape, Mapping):
        fields = cast("Mapping[str, Any]", shape)
        if "nanosec" in fields or "w" in fields:
            return SECONDS if "nanosec" in fields else DEGREES
        raise GarbageError(f"it consists of {', '.join(fields)}; add the path of one to data")
    return shape


def _accepts(wanted: Type, made: Type) -> bool:
    if wanted.item is not None and made.item is not None:
        return _accepts(wanted.item, made.item)
    fits = wanted.unit == made.unit or not (wanted.unit and made.unit)
    return fits and (wanted.kind == made.kind or (wanted.kind, made.kind) == ("real", "int"))


class MessageEvents:
    """Makes events of a type of the world from messages, or from mappings.

    `data` are the paths by datum; without one, a datum is the field of its name.
    """

    def __init__(
        self, where: str, declared: EventType, data: Mapping[str, str], shape: Mapping[str, Any]
    ) -> None:
        """`shape` is that of all messages; None stands for values of any type.

        Raises MisuseError for data that messages do not have, or have in another type.
        """
        self._declared, self._paths = declared, dict(data)
        for name in data:
            if name not in declared.fields.names:
                listed = ", ".join(declared.fields.names) or "none"
                raise MisuseError(
                    f"{where}: {declared.name} has no {name} among its data ({listed})"
                )
        for field in declared.fields.all:
            path = self._paths.setdefault(field.name, field.name)
            try:
                there = _within(shape, path)
            except GarbageError as error:
                if field.name in data:
                    raise MisuseError(
                        f"{where}: {field.name} of {declared.name}: {error}"
                    ) from None
                if field.default is None:
                    raise MisuseError(
                        f"{where}: {declared.name} needs {field.name}: {error}; add its path to"
                        " data, or a default to the vocabulary"
                    ) from None
                del self._paths[field.name]
            else:
                _check(where, declared, field, path, there)

    def __call__(self, message: Any, receivers: Sequence[str]) -> Event:
        """The event of a message for these agents. Raises GarbageError."""
        values = {name: _plain(at(message, path)) for name, path in self._paths.items()}
        try:
            return cast("Event", self._declared(**values, receivers=list(receivers)))
        except MinervaError as error:
            raise GarbageError(str(error)) from None


def _check(where: str, declared: EventType, field: Field, path: str, shape: Any) -> None:
    """Raise MisuseError if a datum cannot have the values of a shape."""
    if shape is None:
        return
    try:
        made = _type_of(shape)
    except GarbageError as error:
        raise MisuseError(f"{where}: {field.name} of {declared.name}: {path}: {error}") from None
    if not _accepts(field.type, made):
        raise MisuseError(
            f"{where}: {declared.name} declares {field.name} as {field.type}, but {path} is {made};"
            f' declare {field.name}="{made}", or add another path to data'
        )


def _plain(value: Any) -> Any:
    """A value for an event: of an orientation its heading in degrees, of a time its seconds."""
    if hasattr(value, "nanosec"):
        return float(value.sec + value.nanosec * 1e-9)
    return heading_of(value) if hasattr(value, "w") else value


_TOPIC_KEYS: Final[Mapping[str, Any]] = {
    "type": str, "definition": str, "event": str, "data": Mapping, "rate": int | float,
    "qos": str, "cube": int | float,
}  # fmt: skip
_RATE: Final = 10.0
_CUBE: Final = 0.1
_COMPUTED: Final[Mapping[str, Mapping[str, Type]]] = {
    POINTS: {"points": Type("matrix")},
    GRID: {
        "cells": Type("cells"), "cell": METRES, "x": METRES, "y": METRES, "angle": DEGREES,
    },
}  # fmt: skip
"""Data that messages of a type have beside their fields."""


class MessageTopic:
    """A topic whose messages become events, from its table in a world file.

    `where` begins its errors. Raises MisuseError for other tables.
    """

    def __init__(self, where: str, given: Any) -> None:
        self._where = where
        table = checked_table(where, given, _TOPIC_KEYS, ("type", "event"))
        self.kind, self.event = str(table["type"]), str(table["event"])
        self.qos: str | None = table.get("qos")
        self._definition, self._data = table.get("definition", ""), table.get("data", {})
        self._seconds = 1.0 / check_positive(where, "rate", table.get("rate", _RATE))
        self._cube = check_positive(where, "cube", table.get("cube", _CUBE))
        self._latest = -math.inf
        self._events: MessageEvents | None = None

    def check(self, world: WorldInfo) -> None:
        """Raise MisuseError if the type of its messages or of its events does not fit."""
        if self._definition:
            register({self.kind: self._definition})
        known = messages().store.fielddefs
        if self.kind not in known:
            near = nearest(self.kind, list(known), '; give the text of its file as "definition"')
            raise MisuseError(f"{self._where}: the type {self.kind} is not known{near}")
        declared = event_type(self._where, world, self.event)
        shape = {**shape_of(self.kind), **_COMPUTED.get(self.kind, {})}
        self._events = MessageEvents(self._where, declared, self._data, shape)

    def is_due(self, now: float) -> bool:
        """Whether a message at this time is not above the rate."""
        # A clock that steps back does not stop it.
        return not self._latest <= now < self._latest + self._seconds

    def made(
        self, message: Any, agent: str, placed: Callable[[str], Matrix], reach: float, now: float
    ) -> Event:
        """The event of a message, which is the latest then. Raises GarbageError.

        The points of a cloud are those within `reach` metres, as `placed` on the robot.
        """
        values = message
        if self.kind == POINTS:
            points = points_of(message, placed(message.header.frame_id), reach, self._cube)
            values = {**vars(message), "points": points}
        elif self.kind == GRID:
            grid = grid_of(message)
            place = dict(zip(("x", "y", "angle"), grid.corner, strict=True))
            values = {**vars(message), "cells": grid.cells, "cell": grid.cell, **place}
        if self._events is None:
            raise MisuseError(f"{self._where} was not checked")
        event = self._events(values, [agent])
        self._latest = now
        return event


def checked_table(
    where: str, given: Any, keys: Mapping[str, Any], needed: Sequence[str]
) -> Mapping[str, Any]:
    """A table of a world file with these keys and their types. Raises MisuseError."""
    if not isinstance(given, Mapping):
        raise MisuseError(f"{where} must be a table with {', '.join(needed)}")
    table = cast("Mapping[str, Any]", given)
    for key, value in table.items():
        if key not in keys:
            near = nearest(key, list(keys))
            raise MisuseError(f"{where} has no {key!r}{near}; it may have {', '.join(keys)}")
        expected = keys[key]
        if not isinstance(value, expected) or (expected is not object and isinstance(value, bool)):
            raise MisuseError(f"{where}: {key} is {value!r:.40}, which is of another type")
    for key in needed:
        if not table.get(key):
            raise MisuseError(f"{where}: {key} is missing; expected {', '.join(needed)}")
    return table
