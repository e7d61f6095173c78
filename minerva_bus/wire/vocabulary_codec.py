"""Vocabularies as plain data: section 4 of PROTOCOL.md.

vocabulary     = {primitives: [...], transformations: [...], kinds: [...], events: [...],
                  meanings: {primitive: [text]}, marks: [primitive], spatial: {symbol: [measure]},
                  completes: {event type: [order]}, fails: {event type: [order]},
                  replaces: {event type: [order]}}
                                       the last six may be absent
primitive      = [name, [field], shape or nil]
transformation = [name, [field], motion or nil]
kind           = [name, [field], [subscribed], [visual event types], [attribute at rest]]
subscribed     = event type | [event type, probability]
                                       probability: from 0 to 1, or an attribute's name
event type     = [name, [field], visual]
field          = [name, type, default]     the type as `real m`; the default as a text of the
                                       language (`0.5`, `"red"`, `{PFox}`) or nil
shape, motion  = [form's name, its measures in order]
meanings       = texts of the legend, one for each colour of a shape
marks          = primitives whose labels give their colour to other labels
spatial        = a symbol's form in space: its name, then its measures
completes      = event types of orders that agents report as carried out by an event of this type;
                 fails: as given up
replaces       = event types of orders that agents drop for an order of this type
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields as form_fields
from functools import lru_cache
from typing import Any, cast

from minerva_bus.errors import MisuseError, ProtocolError, SceneError
from minerva_bus.grammar.appearance import Disc, Form, Label, Line, Motion, Raster, Shape
from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.grammar.types import Unfit, parse_type
from minerva_bus.grammar.vocabulary import (
    AgentKind,
    EventType,
    Primitive,
    Transformation,
    Vocabulary,
)
from minerva_bus.wire.plain import (
    as_bool,
    as_event_type,
    as_items,
    as_list,
    as_map,
    as_number,
    as_text,
    as_texts,
    on_screen,
    pack,
    unpack,
)

_MAX_ERROR_CHARS = 300
# Forms are encoded by the names of their classes; their measures are the fields in order.
_FORMS: dict[str, type[Form]] = {
    form.__name__.lower(): form for form in (Disc, Line, Label, Raster, Motion)
}
_ENDS = ("completes", "fails", "replaces")
_APART = frozenset(("meaning", "meanings", "marks", "spatial"))
"""Fields of forms with optional keys of their own, which older members do not know."""


def plain_vocabulary(vocabulary: Vocabulary) -> dict[str, Any]:
    """A vocabulary as plain data."""
    shapes = {p.name: p.shape for p in vocabulary.primitives.values() if p.shape is not None}
    forms = shapes | {t.name: t.motion for t in vocabulary.transformations.values() if t.motion}
    apart = {
        "meanings": {n: list(_meanings(shape)) for n, shape in shapes.items() if _meanings(shape)},
        "marks": [n for n, shape in shapes.items() if isinstance(shape, Label) and shape.marks],
        "spatial": {n: list(form.spatial) for n, form in forms.items() if form.spatial},
        **{key: _ended_orders(vocabulary, key) for key in _ENDS},
    }
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
        **{key: given for key, given in apart.items() if given},
    }


def _ended_orders(vocabulary: Vocabulary, key: str) -> dict[str, list[str]]:
    """The event types of orders that each event type completes, fails or replaces."""
    ended = {event.name: list(getattr(event, key)) for event in vocabulary.events.values()}
    return {name: orders for name, orders in ended.items() if orders}


def plain_kind(kind: AgentKind) -> list[Any]:
    """An agent kind as plain data."""
    chances = dict(kind.chances)
    # Sorted, so that equal vocabularies are equal bytes: the key of a journal is a digest of them.
    subscribed = [
        [name, chances[name]] if name in chances else name for name in sorted(kind.subscribes)
    ]
    return [
        kind.name, _plain_fields(kind.fields), subscribed, sorted(kind.views), list(kind.rest)
    ]  # fmt: skip


def _plain_fields(fields: Fields) -> list[Any]:
    return [
        [of.name, str(of.type), None if of.default is None else value_text(of.default)]
        for of in fields.all
    ]


def _plain_form(form: Form | None) -> list[Any] | None:
    if form is None:
        return None
    return [type(form).__name__.lower(), *(getattr(form, name) for name in _measures(type(form)))]


def _measures(form: type[Form]) -> list[str]:
    return [of.name for of in form_fields(form) if of.name not in _APART]


def _meanings(shape: Shape) -> tuple[str, ...]:
    if isinstance(shape, Raster):
        return shape.meanings
    return (shape.meaning,) if shape.meaning else ()


def read_vocabulary(plain: Any) -> Vocabulary:
    """A vocabulary from plain data; from equal data the same object. Raises ProtocolError."""
    return _read(pack(plain))


@lru_cache(maxsize=1)
def _read(data: bytes) -> Vocabulary:
    parts = as_map(unpack(data), "a vocabulary")
    try:
        transformations = as_list(parts.get("transformations"), "motions")
        return Vocabulary.of(
            *(_primitive(item, parts) for item in as_list(parts.get("primitives"), "primitives")),
            *(_transformation(item, parts) for item in transformations),
            *(_kind(item) for item in as_list(parts.get("kinds"), "kinds")),
            *(_event_type(item, parts) for item in as_list(parts.get("events"), "event types")),
        )
    except (MisuseError, SceneError, Unfit, ValueError, TypeError) as error:
        raise ProtocolError(f"invalid vocabulary: {error}"[:_MAX_ERROR_CHARS]) from None


def _primitive(plain: Any, parts: Mapping[str, Any]) -> Primitive:
    name, fields, shape = as_items(plain, "a primitive", 3)
    declared = Primitive(as_text(name, "a primitive's name"))
    declared.fields = _fields(fields)
    form = _form(shape, declared.name, parts)
    # Forms share one namespace on the wire, but a motion draws nothing.
    if isinstance(form, Motion):
        raise ProtocolError(f"{declared.name} is a primitive and cannot be a motion")
    declared.shape = form
    return declared


def _transformation(plain: Any, parts: Mapping[str, Any]) -> Transformation:
    name, fields, motion = as_items(plain, "a transformation", 3)
    declared = Transformation(as_text(name, "a transformation's name"))
    declared.fields = _fields(fields)
    form = _form(motion, declared.name, parts)
    if form is not None and not isinstance(form, Motion):
        raise ProtocolError(f"{declared.name} is a transformation and has no shape")
    declared.motion = form
    return declared


def read_kind(plain: Any) -> AgentKind:
    """An agent kind from plain data. Raises ProtocolError."""
    try:
        return _kind(plain)
    except (MisuseError, SceneError, Unfit, ValueError, TypeError) as error:
        # The text may quote any part of the kind, and the member that sent it may print it.
        problem = on_screen(f"invalid agent kind: {error}"[:_MAX_ERROR_CHARS])
        raise ProtocolError(problem) from None


def _kind(plain: Any) -> AgentKind:
    items = as_list(plain, "an agent kind")
    if len(items) == 4:  # From a record older than the attributes at rest.
        items.append([])
    name, fields, subscribes, views, rest = as_items(items, "an agent kind", 5)
    subscribed = dict(map(_subscribed, as_list(subscribes, "event types")))
    chances = tuple(sorted((name, chance) for name, chance in subscribed.items() if chance != 1.0))
    return AgentKind(
        as_event_type(name, "a kind's name"), _fields(fields), frozenset(subscribed),
        frozenset([as_event_type(view, "an event type") for view in as_list(views, "event types")]),
        chances, as_texts(rest, "attributes at rest"),
    )  # fmt: skip


def _subscribed(plain: Any) -> tuple[str, float | str]:
    if not isinstance(plain, list):
        return as_event_type(plain, "an event type"), 1.0
    name, probability = as_items(plain, "an event type with a probability", 2)
    if not isinstance(probability, str):
        probability = as_number(probability, "a probability")
    return as_event_type(name, "an event type"), probability


def _event_type(plain: Any, parts: Mapping[str, Any]) -> EventType:
    name, fields, visual = as_items(plain, "an event type", 3)
    declared = EventType(
        as_text(name, "an event type's name"),
        as_bool(visual, "visual"),
        *(as_texts(as_map(parts.get(key, {}), key).get(name, []), key) for key in _ENDS),
    )
    declared.fields = _fields(fields)
    return declared


def _fields(plain: Any) -> Fields:
    fields = tuple([_field(item) for item in as_list(plain, "fields")])
    names = [of.name for of in fields]
    if len(set(names)) != len(names):
        raise ProtocolError(f"two fields have the same name: {', '.join(names)}"[:_MAX_ERROR_CHARS])
    return Fields(fields)


def _field(plain: Any) -> Field:
    name, kind, default = as_items(plain, "a field", 3)
    declared = Field.of(as_text(name, "a field's name"), parse_type(as_text(kind, "a type")))
    if default is None:
        return declared
    value = parse_value(as_text(default, "a default"), f"the default of {name}")
    return Field(declared.name, declared.type, declared.type.fit(value))


def _form(plain: Any, symbol: str, parts: Mapping[str, Any]) -> Form | None:
    if plain is None:
        return None
    items = as_list(plain, "a form")
    form = _FORMS.get(as_text(items[0] if items else None, "a form's name"))
    if form is None or len(items) != 1 + len(_measures(form)):
        raise ProtocolError(f"no form {str(items[:1])[:40]}; there are {', '.join(_FORMS)}")
    apart = _apart(symbol, parts)
    own = {of.name: apart[of.name] for of in form_fields(form) if of.name in apart}
    return form(*(_measure(item) for item in items[1:]), **own)


def _apart(symbol: str, parts: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a symbol's form that have keys of their own."""
    meanings = as_map(parts.get("meanings", {}), "meanings").get(symbol, [])
    texts = as_texts(meanings, "the meanings of a primitive")
    marks = symbol in as_texts(parts.get("marks", []), "marks")
    spatial = as_map(parts.get("spatial", {}), "spatial").get(symbol, [])
    measures = tuple([_measure(item) for item in as_list(spatial, "a form in space")])
    return {"meaning": "".join(texts[:1]), "meanings": texts, "marks": marks, "spatial": measures}


def _measure(plain: Any) -> Any:
    if isinstance(plain, (str, bool)):
        return plain
    if isinstance(plain, list):
        pairs = [as_items(pair, "a colour", 2) for pair in cast("list[Any]", plain)]
        return tuple(
            (int(as_number(least, "a value")), as_text(color, "a colour")) for least, color in pairs
        )
    return as_number(plain, "a measure")
