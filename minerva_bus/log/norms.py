"""Norms in a record.

norm = {name, applies: [...], on: [...], when, where, most, per, then, sanction: event or nil}
"""

from __future__ import annotations

from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.events import Event
from minerva_bus.wire.plain import as_int, as_list, as_map, as_text
from minerva_bus.wire.values import Reader, plain_event
from minerva_bus.world.norms import Norm, Then


def plain_norm(norm: Norm) -> dict[str, Any]:
    """A norm in what msgpack knows."""
    return {
        "name": norm.name,
        "applies": list(norm.applies),
        "on": list(norm.on),
        "when": norm.when,
        "where": norm.where,
        "most": norm.most,
        "per": norm.per,
        "then": norm.then.value,
        "sanction": None if norm.sanction is None else plain_event(norm.sanction),
    }


def read_norms(plain: Any, reader: Reader) -> tuple[Norm, ...]:
    """Norms from what msgpack held. Raises ProtocolError, VocabularyError and ValueError."""
    return tuple([_norm(as_map(norm, "a norm"), reader) for norm in as_list(plain, "norms")])


def _norm(plain: dict[str, Any], reader: Reader) -> Norm:
    sanction = None if plain["sanction"] is None else reader.event(plain["sanction"])
    if sanction is not None and not isinstance(sanction, Event):
        raise ProtocolError("a sanction is one event")
    return Norm(
        as_text(plain["name"], "a norm's name"),
        _texts(plain["applies"]),
        _texts(plain["on"]),
        as_text(plain["when"], "when"),
        as_text(plain["where"], "where"),
        as_int(plain["most"], "most"),
        as_int(plain["per"], "per", 1),
        Then(as_text(plain["then"], "then")),
        sanction,
    )


def _texts(plain: Any) -> tuple[str, ...]:
    return tuple([as_text(name, "a name") for name in as_list(plain, "names")])
