"""How big anything may be that comes over the bus, and how much of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds at the protocol's border; whatever is over one is refused, its sender named.

    `messages` and `bytes` are of one member in a second, and do not count answers that a frame
    waits for. `items` are those of all lists and maps of a message, one within another.
    """

    message_bytes: int = 64 * 1024 * 1024
    nodes: int = 5_000_000
    depth: int = 100_000
    events: int = 1_000_000
    messages: int = 5_000
    bytes: int = 128 * 1024 * 1024
    items: int = 64 * 1024 * 1024


DEFAULT: Final = Limits()
