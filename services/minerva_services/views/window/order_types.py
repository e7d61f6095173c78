"""Which of a world's event types a window sends, determined by their data alone."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.vocabulary import EventType, Vocabulary


@dataclass(frozen=True, slots=True)
class OrderTypes:
    """The event types of user orders, by how they are triggered.

    `click` has one text, that of the clicked label. `pair` has two, those of two labels. `slide`
    has one real, changed by the arrow keys. Those in `plain` have no data.
    """

    click: EventType | None = None
    pair: EventType | None = None
    slide: EventType | None = None
    plain: tuple[EventType, ...] = ()


def order_types(
    vocabulary: Vocabulary, orders: Collection[str], click: str = "", slide: str = ""
) -> OrderTypes:
    """The order types among those that agents accept; `click` and `slide` override them."""
    taken = [vocabulary.events[name] for name in sorted(orders) if name in vocabulary.events]
    return OrderTypes(
        click=_named(vocabulary, click) or _first(taken, is_click),
        pair=_first(taken, is_pair),
        slide=_named(vocabulary, slide) or _first(taken, is_slide),
        plain=tuple([event for event in taken if not event.fields.names]),
    )


def check_named(service: str, vocabulary: Vocabulary, click: str, slide: str = "") -> None:
    """Raise MisuseError if an option names a type that cannot be sent that way."""
    for option, name, fits, wanted in (
        ("click", click, is_click, "one text"),
        ("slide", slide, is_slide, "one real number"),
    ):
        if name and name not in vocabulary.events:
            close = nearest(name, list(vocabulary.events))
            raise MisuseError(
                f"{service}: {option} is {name!r}, which is not an event type of the world{close}"
            )
        if name and not fits(vocabulary.events[name]):
            raise MisuseError(f"{service}: {option} is {name!r}; its data must be {wanted}")


def is_click(event: EventType) -> bool:
    """True if its only datum is a text."""
    return _kinds(event) == ("text",)


def is_pair(event: EventType) -> bool:
    """True if its data are two texts."""
    return _kinds(event) == ("text", "text")


def is_slide(event: EventType) -> bool:
    """True if its only datum is a real number."""
    return _kinds(event) == ("real",)


def _kinds(event: EventType) -> tuple[str, ...]:
    return tuple(field.type.kind for field in event.fields.all)


def _named(vocabulary: Vocabulary, name: str) -> EventType | None:
    return vocabulary.events.get(name) if name else None


def _first(types: list[EventType], fits: Callable[[EventType], bool]) -> EventType | None:
    return next((event for event in types if fits(event)), None)
