"""Collects the instructions that result from one stimulus."""

from __future__ import annotations

from dataclasses import replace

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.members import Members
from minerva_bus.grammar.columns import unfolded
from minerva_bus.grammar.events import AnyEvent, single


class Instructions:
    """Instructions in the order of their execution; `pending` is their list."""

    def __init__(self, members: Members) -> None:
        self._members = members
        self.pending: list[s.Instruction] = []

    def add(self, instruction: s.Instruction) -> None:
        """Append an instruction."""
        self.pending.append(instruction)

    def send(self, to: str, message: m.ToMember) -> None:
        """Send a message, without columns if the member declines them."""
        plain = self._members.declines_columns(to)
        self.pending.append(s.Send(to, plain_form(message) if plain else message))

    def log(self, member: str, text: str, details: str = "") -> None:
        """Log a line about a member; `details` appear in the log file only."""
        self.pending.append(s.Notify(member, text, details))


def plain_form(message: m.ToMember) -> m.ToMember:
    """The same message node by node, without columns; patches must be applied before."""
    match message:
        case m.Fragments():
            return replace(message, given=_scenes(message.given))
        case m.EvolveRequest():
            return replace(message, events=_events(message.events), visual=_events(message.visual))
        case m.ViewShown():
            skeleton = None if message.skeleton is None else unfolded(message.skeleton)
            return replace(message, parts=_scenes(message.parts), skeleton=skeleton)
        case m.Orders():
            return replace(message, events=_events(message.events))
        case _:
            return message


def _scenes(parts: m.Parts) -> m.Parts:
    return {name: unfolded(scene) for name, scene in parts.items()}


def _events(events: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
    return tuple(single(events))
