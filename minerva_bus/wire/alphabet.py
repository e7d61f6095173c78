"""A vocabulary as msgpack, readable by people too.

vocabulary     = {primitives: [...], transformations: [...], kinds: [...], events: [...]}
primitive      = [name, [field], shape or nil]
transformation = [name, [field], motion or nil]
kind           = [name, [field], [subscribed], [visual event types], [attribute at rest]]
subscribed     = event type | [event type, probability]
                                       probability: from 0 to 1, or an attribute's name
event type     = [name, [field], visual]
field          = [name, type, default]     the type as `real m`; the default as a text of the
                                       language (`0.5`, `"red"`, `{PFox}`) or nil
shape, motion  = [form's name, its measures in order]
"""

from __future__ import annotations

from dataclasses import fields as form_fields
from typing import Any, cast

from minerva_bus.errors import MisuseError, ProtocolError, SceneError
from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.forms import Disc, Form, Label, Line, Motion, Raster
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.printer import value_text
from minerva_bus.grammar.symbols import AgentKind, EventType, Primitive, Transformation
from minerva_bus.grammar.types import Unfit, parse_type
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.plain import as_bool, as_list, as_map, as_number, as_text

_SAID = 300
_FORMS: dict[str, type[Form]] = {
    "disc": Disc,
    "line": Line,
    "label": Label,
    "raster": Raster,
    "motion": Motion,
}


def plain_vocabulary(vocabulary: Vocabulary) -> dict[str, Any]:
    """A vocabulary in what msgpack knows."""
    return {
        "primitives": [
            [p.name, _plain_fields(p.fields), _plain_form(p.shape)]
            for p in vocabulary.primitives.values()
        ],
        "transformations": [
            [t.name, _plain_fields(t.fields), _plain_form(t.motion)]
            for t in vocabulary.transformations.values()
        ],
        "kinds": [plain_kind(kind) for kind in vocabulary.kinds.values()],
        "events": [[e.name, _plain_fields(e.fields), e.visual] for e in vocabulary.events.values()],
    }


def plain_kind(kind: AgentKind) -> list[Any]:
    """An agent kind in what msgpack knows."""
    chances = dict(kind.chances)
    subscribed = [[one, chances[one]] if one in chances else one for one in sorted(kind.subscribes)]
    return [
        kind.name, _plain_fields(kind.fields), subscribed, sorted(kind.views), list(kind.rest)
    ]  # fmt: skip


def _plain_fields(fields: Fields) -> list[Any]:
    return [
        [one.name, str(one.type), None if one.default is None else value_text(one.default)]
        for one in fields.all
    ]


def _plain_form(form: Form | None) -> list[Any] | None:
    if form is None:
        return None
    name = type(form).__name__.lower()
    return [name, *(getattr(form, one.name) for one in form_fields(form))]


def read_vocabulary(plain: Any) -> Vocabulary:
    """A vocabulary from what msgpack held. Raises ProtocolError."""
    parts = as_map(plain, "a vocabulary")
    try:
        return Vocabulary.of(
            *(_primitive(one) for one in as_list(parts.get("primitives"), "primitives")),
            *(_transformation(one) for one in as_list(parts.get("transformations"), "motions")),
            *(_kind(one) for one in as_list(parts.get("kinds"), "kinds")),
            *(_event_type(one) for one in as_list(parts.get("events"), "event types")),
        )
    except (MisuseError, SceneError, Unfit, ValueError, TypeError) as error:
        raise ProtocolError(f"this is no vocabulary: {error}"[:_SAID]) from None


def _items(plain: Any, count: int, what: str) -> list[Any]:
    items = as_list(plain, what)
    if len(items) != count:
        raise ProtocolError(f"{what} has {count} items, not {len(items)}")
    return items


def _primitive(plain: Any) -> Primitive:
    name, fields, shape = _items(plain, 3, "a primitive")
    made = Primitive(as_text(name, "a primitive's name"))
    made.fields = _fields(fields)
    form = _form(shape)
    if isinstance(form, Motion):
        raise ProtocolError(f"{made.name} is a primitive and cannot be a motion")
    made.shape = form
    return made


def _transformation(plain: Any) -> Transformation:
    name, fields, motion = _items(plain, 3, "a transformation")
    made = Transformation(as_text(name, "a transformation's name"))
    made.fields = _fields(fields)
    form = _form(motion)
    if form is not None and not isinstance(form, Motion):
        raise ProtocolError(f"{made.name} is a transformation and has no shape")
    made.motion = form
    return made


def read_kind(plain: Any) -> AgentKind:
    """An agent kind from what msgpack held. Raises ProtocolError."""
    try:
        return _kind(plain)
    except (MisuseError, SceneError, Unfit, ValueError, TypeError) as error:
        raise ProtocolError(f"this is no agent kind: {error}"[:_SAID]) from None


def _kind(plain: Any) -> AgentKind:
    given = as_list(plain, "an agent kind")
    if len(given) == 4:  # A record of before kinds said how they rest.
        given.append([])
    name, fields, subscribes, views, rest = _items(given, 5, "an agent kind")
    subscribed = dict(map(_subscribed, as_list(subscribes, "event types")))
    chances = tuple(sorted((one, h) for one, h in subscribed.items() if h != 1.0))
    return AgentKind(
        as_text(name, "a kind's name"), _fields(fields), frozenset(subscribed), _names(views),
        chances,
        tuple(as_text(one, "an attribute") for one in as_list(rest, "attributes at rest")),
    )  # fmt: skip


def _subscribed(plain: Any) -> tuple[str, float | str]:
    if not isinstance(plain, list):
        return as_text(plain, "an event type"), 1.0
    name, probability = _items(plain, 2, "an event type with a probability")
    if not isinstance(probability, str):
        probability = as_number(probability, "a probability")
    return as_text(name, "an event type"), probability


def _names(plain: Any) -> frozenset[str]:
    return frozenset(as_text(one, "an event type") for one in as_list(plain, "event types"))


def _event_type(plain: Any) -> EventType:
    name, fields, visual = _items(plain, 3, "an event type")
    made = EventType(as_text(name, "an event type's name"), visual=as_bool(visual, "visual"))
    made.fields = _fields(fields)
    return made


def _fields(plain: Any) -> Fields:
    found = tuple([_field(one) for one in as_list(plain, "fields")])
    names = [one.name for one in found]
    if len(set(names)) != len(names):
        raise ProtocolError(f"two fields have one name: {', '.join(names)}"[:_SAID])
    return Fields(found)


def _field(plain: Any) -> Field:
    name, kind, default = _items(plain, 3, "a field")
    made = Field.of(as_text(name, "a field's name"), parse_type(as_text(kind, "a type")))
    if default is None:
        return made
    value = parse_value(as_text(default, "a default"), f"the default of {name}")
    return Field(made.name, made.type, made.type.fit(value))


def _form(plain: Any) -> Form | None:
    if plain is None:
        return None
    items = as_list(plain, "a form")
    form = _FORMS.get(as_text(items[0] if items else None, "a form's name"))
    if form is None or len(items) != 1 + len(form_fields(form)):
        raise ProtocolError(f"no form {str(items[:1])[:40]}; there are {', '.join(_FORMS)}")
    return form(*(_measure(item) for item in items[1:]))


def _measure(plain: Any) -> Any:
    if isinstance(plain, str | bool):
        return plain
    if isinstance(plain, list):
        pairs = [_items(one, 2, "a colour") for one in cast("list[Any]", plain)]
        return tuple(
            (int(as_number(least, "a value")), as_text(color, "a colour")) for least, color in pairs
        )
    return as_number(plain, "a measure")
