"""The contacts of the previous view, to tell new ones from lasting ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

_SAME: Final = 0.7
"""Cosine of the angle (about 45 degrees) within which two touches of scenery count as the same."""


@dataclass(frozen=True, slots=True)
class ContactPair:
    """An agent touches another, or scenery (""); the unit normal points to the agent."""

    agent: str
    other: str
    nx: float
    ny: float


class ContactMemory:
    """Current contacts. Several touches of scenery by one agent are told apart by direction."""

    def __init__(self, contacts: Sequence[ContactPair] = ()) -> None:
        self._known: dict[tuple[str, str], list[ContactPair]] = {}
        for contact in contacts:
            self._known.setdefault((contact.agent, contact.other), []).append(contact)

    def knows(self, contact: ContactPair) -> bool:
        """True if the contact existed in the previous view."""
        known = self._known.get((contact.agent, contact.other), [])
        if contact.other:
            return bool(known)
        return any(contact.nx * other.nx + contact.ny * other.ny >= _SAME for other in known)

    def save(self) -> list[list[Any]]:
        """All contacts as plain values."""
        contacts = [contact for known in self._known.values() for contact in known]
        return [[item.agent, item.other, item.nx, item.ny] for item in contacts]

    @staticmethod
    def restored(saved: list[list[Any]]) -> ContactMemory:
        """Inverse of `save`. Raises TypeError and ValueError for other values."""
        return ContactMemory(
            [ContactPair(str(a), str(b), float(nx), float(ny)) for a, b, nx, ny in saved]
        )
