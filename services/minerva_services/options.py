"""Options that list names in one string, separated by commas."""

from __future__ import annotations

from minerva_bus.errors import MisuseError


def names_in(text: str) -> tuple[str, ...]:
    """The names in a comma-separated string, without duplicates."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def event_types(service: str, text: str) -> tuple[str, ...]:
    """Visual event types from the option `draws` of a service. Raises MisuseError if empty."""
    types = names_in(text)
    if not types:
        raise MisuseError(f"{service}: draws is {text!r}; expected visual event types, as ePicture")
    return types
