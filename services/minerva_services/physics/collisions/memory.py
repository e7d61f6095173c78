"""What touched in the view before: which contacts begin, and which go on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

_SAME: Final = 0.7
"""The cosine of the angle up to which two touches of scenery are one: about 45 degrees."""


@dataclass(frozen=True, slots=True)
class Contact:
    """An agent touches another one, or scenery (""); the normal points to the agent."""

    agent: str
    other: str
    nx: float
    ny: float


class Memory:
    """Knows what touches. Of scenery an agent may touch several things, told apart by direction."""

    def __init__(self, contacts: Sequence[Contact] = ()) -> None:
        self._known: dict[tuple[str, str], list[Contact]] = {}
        for one in contacts:
            self._known.setdefault((one.agent, one.other), []).append(one)

    def knows(self, contact: Contact) -> bool:
        """Whether it goes on, and does not begin."""
        known = self._known.get((contact.agent, contact.other), [])
        if contact.other:
            return bool(known)
        return any(contact.nx * one.nx + contact.ny * one.ny >= _SAME for one in known)

    def save(self) -> list[list[Any]]:
        """All of it in plain values."""
        every = [one for known in self._known.values() for one in known]
        return [[one.agent, one.other, one.nx, one.ny] for one in every]

    @staticmethod
    def restored(saved: list[list[Any]]) -> Memory:
        """From plain values. Raises TypeError and ValueError where they are something else."""
        return Memory([Contact(str(a), str(b), float(nx), float(ny)) for a, b, nx, ny in saved])
