"""Collects the instructions that follow from one stimulus."""

from __future__ import annotations

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.members import Members
from minerva_bus.frame.plain import plain_form


class Instructions:
    """Instructions in the order in which they must be carried out."""

    def __init__(self, members: Members) -> None:
        self._members = members
        self._list: list[s.Instruction] = []

    def add(self, instruction: s.Instruction) -> None:
        """Append an instruction."""
        self._list.append(instruction)

    def send(self, to: str, message: m.ToMember) -> None:
        """Send a message, without columns where the member declines them."""
        plain = self._members.declines_columns(to)
        self._list.append(s.Send(to, plain_form(message) if plain else message))

    def log(self, member: str, text: str, details: str = "") -> None:
        """Log a line about a member; `details` appear in the log file only."""
        self._list.append(s.Notify(member, text, details))

    def take(self) -> list[s.Instruction]:
        """Return the instructions collected so far and start a new list."""
        taken, self._list = self._list, []
        return taken
