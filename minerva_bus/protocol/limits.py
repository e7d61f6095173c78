"""How big anything may be that comes over the bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds at the protocol's border; whatever is over one is refused, its sender named."""

    message_bytes: int = 64 * 1024 * 1024
    nodes: int = 5_000_000
    depth: int = 100_000
    events: int = 1_000_000


DEFAULT: Final = Limits()
