"""What people's commands may ask a running world: one query, one answer, both msgpack maps.

    {"ask": "list"}                       → {"world": ..., "frame": ..., "members": [...]}
    {"ask": "vocabulary"}                 → {"vocabulary": ...}
    {"ask": "scene"}                      → {"scene": text of w, "frame": ...}
    {"ask": "pub", "event": [...], ...}   → {"frame": ...}
    {"ask": "stop"}                       → {}

A wrong question is answered by {"error": text}.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import zenoh

from minerva_bus.errors import MinervaError, ProtocolError, SceneError
from minerva_bus.frame import stimuli as s
from minerva_bus.grammar.condition import parse_condition
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.parser import parse
from minerva_bus.protocol.alphabet import plain_vocabulary
from minerva_bus.protocol.plain import listed, mapped, pack, text, unpack

if TYPE_CHECKING:
    from minerva_bus.bus.coordinator import BusCoordinator


def answer(query: zenoh.Query, coordinator: BusCoordinator) -> None:
    """Answer one query; never raises because of what was asked."""
    try:
        asked = mapped(unpack(query.payload.to_bytes() if query.payload else b""), "a question")
        name = text(asked.get("ask"), "ask")
        if name not in _ANSWERS:
            raise ProtocolError(f"nothing is known about {name[:40]!r}; ask {', '.join(_ANSWERS)}")
        found = _ANSWERS[name](coordinator, asked)
    except MinervaError as error:
        found = {"error": str(error)}
    query.reply(coordinator.keys.control, pack(found))


def _list(coordinator: BusCoordinator, _: dict[str, Any]) -> dict[str, Any]:
    algorithm = coordinator.algorithm
    members = [
        {
            "member": member.name,
            "state": member.state.value,
            "roles": list(member.hello.roles) if member.hello else [],
            "service": member.hello.service if member.hello else "",
            "kinds": [kind.name for kind in member.hello.kinds] if member.hello else [],
            "generates": list(member.hello.generates) if member.hello else [],
            "draws": list(member.hello.draws) if member.hello else [],
            "last_reply": member.last_reply,
            "late": member.late,
            "pid": member.hello.pid if member.hello else 0,
            "host": member.hello.host if member.hello else "",
        }
        for member in algorithm.roster
    ]
    return {
        "world": algorithm.world.name,
        "frame": algorithm.frame,
        "phase": algorithm.phase.value,
        "waiting": algorithm.waiting_for(),
        "agents": len(list(algorithm.composition.agents())),
        "members": members,
    }


def _scene(coordinator: BusCoordinator, _: dict[str, Any]) -> dict[str, Any]:
    algorithm = coordinator.algorithm
    return {"frame": algorithm.frame, "scene": str(algorithm.scene)}


def _vocabulary(coordinator: BusCoordinator, _: dict[str, Any]) -> dict[str, Any]:
    return {"vocabulary": plain_vocabulary(coordinator.algorithm.world.vocabulary)}


def _pub(coordinator: BusCoordinator, asked: dict[str, Any]) -> dict[str, Any]:
    """Send an event: data as texts of the language, for a type that the world must know."""
    algorithm = coordinator.algorithm
    name = text(asked.get("type"), "the type")
    values = {
        one: _value(text(value, one), one)
        for one, value in mapped(asked.get("data", {}), "the data").items()
    }
    receivers = [text(one, "a receiver") for one in listed(asked.get("receivers", []), "receivers")]
    vocabulary = algorithm.world.vocabulary
    declared = vocabulary.events.get(name)
    if declared is None:
        raise ProtocolError(
            f"the world has no event type {name}; it has {', '.join(vocabulary.events)}"
        )
    known = set(algorithm.composition.agents())
    for receiver in receivers:
        if receiver not in known:
            raise ProtocolError(f"there is no agent #{receiver}")
    condition = text(asked.get("condition", ""), "if")
    parse_condition(condition)
    try:
        fitted = declared.fields.values(name, values)
    except Unfit as unfit:
        raise ProtocolError(str(unfit)) from None
    to = tuple(sorted(set(receivers)))
    event = Event(name, declared.fields.names, fitted, condition, receivers=to)
    takers = [member.name for member in algorithm.roster.takers(name)]
    coordinator.tell(s.Order(event))
    return {"frame": algorithm.frame, "event": str(event), "through": takers}


def _value(shown: str, name: str) -> Any:
    """A value as the language writes it; a text may do without its quotes."""
    try:
        (node,) = parse(f"P<value={shown}>", name)
        (value,) = node.values
    except (SceneError, ValueError):
        return shown
    return value


def _stop(coordinator: BusCoordinator, _: dict[str, Any]) -> dict[str, Any]:
    coordinator.inbox.put(s.End("stopped by a person"))
    return {}


_ANSWERS: dict[str, Callable[[BusCoordinator, dict[str, Any]], dict[str, Any]]] = {
    "list": _list,
    "scene": _scene,
    "vocabulary": _vocabulary,
    "pub": _pub,
    "stop": _stop,
}
