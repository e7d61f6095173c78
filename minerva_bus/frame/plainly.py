"""Messages for members that decline columns and patches: the same, node by node."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatch

from minerva_bus.frame import messages as m
from minerva_bus.grammar.batch import AnyEvent, single
from minerva_bus.grammar.columns import unfolded


@singledispatch
def plainly(message: m.ToMember) -> m.ToMember:
    """A message without columns; one with patches has to be whole before."""
    return message


@plainly.register
def _(message: m.Fragments) -> m.ToMember:
    return replace(message, given=_scenes(message.given))


@plainly.register
def _(message: m.EvolveRequest) -> m.ToMember:
    return replace(message, events=_events(message.events), visual=_events(message.visual))


@plainly.register
def _(message: m.ViewShown) -> m.ToMember:
    skeleton = None if message.skeleton is None else unfolded(message.skeleton)
    return replace(message, parts=_scenes(message.parts), skeleton=skeleton)


@plainly.register
def _(message: m.Orders) -> m.ToMember:
    return replace(message, events=_events(message.events))


def _scenes(parts: m.Parts) -> m.Parts:
    return {name: unfolded(scene) for name, scene in parts.items()}


def _events(events: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
    return tuple(single(events))
