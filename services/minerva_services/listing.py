"""Options that list names in one text, with commas between them."""

from __future__ import annotations

from minerva_bus.errors import MisuseError


def names_in(listed: str) -> tuple[str, ...]:
    """The names in a text with commas between them, each once."""
    return tuple(dict.fromkeys(one.strip() for one in listed.split(",") if one.strip()))


def event_types(service: str, listed: str) -> tuple[str, ...]:
    """Visual event types from the option `draws` of a service. Raises MisuseError for none."""
    types = names_in(listed)
    if not types:
        raise MisuseError(
            f"{service}: draws is {listed!r}; expected visual event types, as ePicture"
        )
    return types
