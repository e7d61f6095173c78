"""Messages for members that decline columns and patches: the same content, node by node."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatch

from minerva_bus.frame import messages as m
from minerva_bus.grammar.batch import AnyEvent, single
from minerva_bus.grammar.columns import unfolded


@singledispatch
def plain_form(message: m.ToMember) -> m.ToMember:
    """A message without columns; patches must be applied before."""
    return message


@plain_form.register
def _(message: m.Fragments) -> m.ToMember:
    return replace(message, given=_scenes(message.given))


@plain_form.register
def _(message: m.EvolveRequest) -> m.ToMember:
    return replace(message, events=_events(message.events), visual=_events(message.visual))


@plain_form.register
def _(message: m.ViewShown) -> m.ToMember:
    skeleton = None if message.skeleton is None else unfolded(message.skeleton)
    return replace(message, parts=_scenes(message.parts), skeleton=skeleton)


@plain_form.register
def _(message: m.Orders) -> m.ToMember:
    return replace(message, events=_events(message.events))


def _scenes(parts: m.Parts) -> m.Parts:
    return {name: unfolded(scene) for name, scene in parts.items()}


def _events(events: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
    return tuple(single(events))
