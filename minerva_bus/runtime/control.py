"""Questions of operators to a running world: one query, one answer, both msgpack maps.

    {"ask": "status", "since": 0}         → {"status": {...}}
    {"ask": "totals"}                     → {"totals": {...}}
    {"ask": "series"}                     → {"series": [...]}
    {"ask": "vocabulary"}                 → {"vocabulary": ...}
    {"ask": "scene"}                      → {"scene": text of w, "frame": ...}
    {"ask": "fragment", "agent": id}      → {"fragment": text, "frame": ...}
    {"ask": "pub", "type": ..., ...}      → {"frame": ..., "by": person, ...}
    {"ask": "order", "event": [...], ...} → {"frame": ..., "by": person, ...}
    {"ask": "pause", "by": person}        → {"frame": ...}; also resume, stop
    {"ask": "step", "frames": 1}          → {"frame": the frame that follows them}
    {"ask": "rate", "rate": 30.0}         → {"rate": ...}
    {"ask": "restart", "member": name}    → {}
    {"ask": "stack", "member": name}      → {}
    {"ask": "drain", "member": name}      → {"to": [hosts]}
    {"ask": "logs", "since": 0, ...}      → {"lines": [...]}
    {"ask": "orders", "since": 0}         → {"orders": [...]}

An invalid question is answered with {"error": text}.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from minerva_bus.errors import MinervaError, ProtocolError, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.composition import PART
from minerva_bus.grammar.scene import Scene
from minerva_bus.runtime.operated import Command, Operated, person_of
from minerva_bus.runtime.publishing import order, publish
from minerva_bus.runtime.world_status import status_of
from minerva_bus.wire.plain import as_int, as_map, as_number, as_text
from minerva_bus.wire.status_codec import plain_lines, plain_orders, plain_series, plain_status
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_bus.world.operator import PersonOperation

MAX_STEPS = 1_000_000_000
MAX_RATE = 1_000_000.0
MAX_LINES = 1000


def answer(
    asked: Mapping[str, Any], running: Operated, commands: Mapping[str, Command] | None = None
) -> dict[str, Any]:
    """Answer one question with `commands`, by default COMMANDS; errors are part of the answer."""
    commands = COMMANDS if commands is None else commands
    try:
        name = as_text(asked.get("ask"), "ask")
        if name not in commands:
            raise ProtocolError(f"unknown question {name[:40]!r}; expected {', '.join(commands)}")
        return commands[name](running, as_map(asked, "a question"))
    except MinervaError as error:
        return {"error": str(error)}


def _status(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    return {"status": plain_status(status_of(running, as_int(asked.get("since", 0), "since")))}


def _totals(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"totals": running.metrics.counted().plain()}


def _series(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    collected = running.collected
    return {"series": [] if collected is None else plain_series(collected.series())}


def _scene(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    algorithm = running.algorithm
    return {"frame": algorithm.frame, "scene": str(algorithm.scene)}


def _fragment(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    """The text of the outermost agent with an id, or of one in a population."""
    composition, agent = running.algorithm.composition, as_text(asked.get("agent"), "the agent")
    # Names of parts are internal, and change when hosts join or leave.
    node = composition.agent(agent) if not agent.startswith(PART) else None
    if node is None:
        raise ProtocolError(f"there is no agent #{agent[:64]}")
    return {"frame": running.algorithm.frame, "fragment": str(Scene((node,)))}


def _note(running: Operated, asked: Mapping[str, Any], value: object = "") -> None:
    """Note that a person operates the world, with an effect."""
    running.noted(
        PersonOperation(
            running.algorithm.frame, as_text(asked["ask"], "ask"), str(value), person_of(asked)
        )
    )


def _pause(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    if not running.pace.paused:
        _note(running, asked)
    running.schedule.pause()
    return {"frame": running.schedule.pauses_before}


def _resume(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    if running.pace.left is not None:
        _note(running, asked)
    running.pace.resume()
    running.schedule.repace()
    return {"frame": running.algorithm.frame}


def _step(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    frames = as_int(asked.get("frames", 1), "frames", 1)
    if frames > MAX_STEPS:
        raise ProtocolError(f"frames must be a whole number up to {MAX_STEPS}, not {frames}")
    _note(running, asked, frames)
    last = running.schedule.pauses_before + frames
    running.pace.step(frames)
    running.schedule.repace()
    return {"frame": last}


def _rate(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    rate = as_number(asked.get("rate"), "rate")
    if not 0 <= rate <= MAX_RATE:
        raise ProtocolError(f"rate must be frames per second from 0 to {MAX_RATE:g}, not {rate:g}")
    if rate != running.pace.rate:
        _note(running, asked, f"{rate:g}")
    running.pace.change(rate)
    running.schedule.repace()
    return {"rate": rate}


def _restart(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    member = _own_process(running, asked, "restart it where it runs")
    done = _accepted(running.restart(member))
    _note(running, asked, member)
    return done


def _stack(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Let a process write the stacks of its threads to its log, where `logs` finds them."""
    return _accepted(running.stack(_own_process(running, asked, "its stack is not known here")))


def _accepted(refused: str) -> dict[str, Any]:
    if refused:
        raise ProtocolError(refused)
    return {}


def _own_process(running: Operated, asked: Mapping[str, Any], otherwise: str) -> str:
    """The name of a process of the world file. Raises ProtocolError."""
    member = as_text(asked.get("member"), "the member")
    expected = {entry.name: entry.expected for entry in running.algorithm.members}
    if member not in expected:
        hint = nearest(member, list(expected), f"there are {', '.join(expected)}")
        raise ProtocolError(f"there is no member {member[:64]!r}{hint}")
    if not expected[member]:
        raise ProtocolError(f"{member} is not a process of the world file: {otherwise}")
    return member


def _drain(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    member, offers = as_text(asked.get("member"), "the member"), running.algorithm.offers()
    if member not in offers:
        hosts = ", ".join(offers) or "none"
        raise ProtocolError(f"{member[:64]!r} hosts no agents now; hosts are {hosts}")
    others = {name: kinds for name, kinds in offers.items() if name != member}
    # The host would have to keep these agents, so it could not be stopped.
    alone = sorted(offers[member].difference(*others.values()))
    if alone:
        raise ProtocolError(
            f"no other host offers {', '.join(alone)}: attach a host of it first"
            " (minerva attach module:Class)"
        )
    running.runner.handle(s.Drain(member))
    _note(running, asked, member)
    return {"to": [name for name, kinds in others.items() if kinds & offers[member]]}


def _logs(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    member = as_text(asked.get("member", ""), "the member")
    lines = running.event_log.lines(as_int(asked.get("since", 0), "since"), member)
    return {"lines": plain_lines(lines[-MAX_LINES:])}


def _orders(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    since = as_int(asked.get("since", 0), "since")
    return {"orders": plain_orders(running.orders.changed_since(since))}


def _vocabulary(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"vocabulary": plain_vocabulary(running.algorithm.world.vocabulary)}


def _seek(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    raise ProtocolError("this is not a replay; only a replay can continue from another frame")


def _stop(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    _note(running, asked)
    running.schedule.stop(s.End("stopped by a person"))
    return {}


COMMANDS: Final[Mapping[str, Command]] = {
    "status": _status,
    "totals": _totals,
    "series": _series,
    "scene": _scene,
    "fragment": _fragment,
    "vocabulary": _vocabulary,
    "pub": publish,
    "order": order,
    "pause": _pause,
    "resume": _resume,
    "step": _step,
    "rate": _rate,
    "restart": _restart,
    "stack": _stack,
    "drain": _drain,
    "seek": _seek,
    "logs": _logs,
    "orders": _orders,
    "stop": _stop,
}
