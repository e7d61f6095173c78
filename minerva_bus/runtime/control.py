"""What people's commands may ask a running world: one query, one answer, both msgpack maps.

    {"ask": "status", "since": 0}         → {"status": {...}}
    {"ask": "totals"}                     → {"totals": {...}}
    {"ask": "vocabulary"}                 → {"vocabulary": ...}
    {"ask": "scene"}                      → {"scene": text of w, "frame": ...}
    {"ask": "fragment", "agent": id}      → {"fragment": text, "frame": ...}
    {"ask": "pub", "event": [...], ...}   → {"frame": ...}
    {"ask": "order", "event": [...]}      → {"frame": ...}
    {"ask": "pause"}                      → {"frame": ...}; also resume, stop
    {"ask": "step", "frames": 1}          → {"frame": the frame that follows them}
    {"ask": "rate", "rate": 30.0}         → {"rate": ...}
    {"ask": "restart", "member": name}    → {}
    {"ask": "drain", "member": name}      → {"to": [hosts]}
    {"ask": "logs", "since": 0, ...}      → {"lines": [...]}

A wrong question is answered by {"error": text}.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from minerva_bus.errors import MinervaError, ProtocolError, SceneError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import PART
from minerva_bus.frame.diary import Diary
from minerva_bus.frame.members import MemberEntry
from minerva_bus.frame.overruns import Overruns
from minerva_bus.frame.pacing import Pace
from minerva_bus.frame.people import refusal_of_order, unknown_value
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene
from minerva_bus.runtime.totals import Totals
from minerva_bus.wire.plain import as_int, as_list, as_map, as_number, as_text
from minerva_bus.wire.status import plain_lines, plain_status
from minerva_bus.wire.values import Reader
from minerva_bus.wire.vocabulary import plain_vocabulary
from minerva_bus.world.operator import MemberStatus, WorldStatus

MOST_STEPS = 1_000_000_000
MOST_RATE = 1_000_000.0
MOST_LINES = 1000


class Running(Protocol):
    """A running world, as those who operate it need it."""

    algorithm: FrameAlgorithm
    pace: Pace
    diary: Diary
    overruns: Overruns

    @property
    def hz(self) -> float:
        """Frames per second, as reached lately."""
        ...

    @property
    def waited(self) -> float:
        """For how many seconds the frame has waited."""
        ...

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus."""
        ...

    def repace(self) -> None:
        """The pace has changed."""
        ...

    def measured(self) -> Mapping[str, float]:
        """The parts of a frame, in microseconds, and its bytes; from now on they are wanted."""
        ...

    def counted(self) -> Totals:
        """What has been counted since somebody began to ask; from now on it is wanted."""
        ...

    def refused(self) -> Mapping[str, int]:
        """How much was refused, by whose it was."""
        ...

    def restart(self, member: str) -> str:
        """Start a process anew; why that cannot be, or the empty text."""
        ...


def answer(asked: Mapping[str, Any], running: Running) -> dict[str, Any]:
    """Answer one question; never raises because of what was asked."""
    try:
        name = as_text(asked.get("ask"), "ask")
        if name not in _ANSWERS:
            raise ProtocolError(f"nothing is known about {name[:40]!r}; ask {', '.join(_ANSWERS)}")
        return _ANSWERS[name](running, as_map(asked, "a question"))
    except MinervaError as error:
        return {"error": str(error)}


def _status(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    return {"status": plain_status(status_of(running, as_int(asked.get("since", 0), "since")))}


def status_of(running: Running, since: int = 0) -> WorldStatus:
    """How a world is doing."""
    algorithm, pace, hz = running.algorithm, running.pace, running.hz
    measured = dict(running.measured())
    waits = {
        name.removeprefix("wait for "): measured.pop(name)
        for name in sorted(measured)
        if name.startswith("wait for ")
    }
    return WorldStatus(
        world=algorithm.world.name,
        frame=algorithm.frame,
        dt=algorithm.world.dt,
        phase=algorithm.phase.value,
        paused=pace.paused,
        left=pace.left or 0,
        rate=pace.rate,
        hz=hz,
        agents=algorithm.composition.count,
        waiting=tuple(algorithm.waiting_for()),
        waited=running.waited,
        members=tuple([_member(one, waits.get(one.name, 0.0)) for one in algorithm.members]),
        events={name: count * hz for name, count in running.diary.per_frame().items()},
        bytes_in=measured.pop("bytes in", 0.0),
        bytes_out=measured.pop("bytes out", 0.0),
        phases=measured,
        happenings=running.diary.happenings(since),
        refused=running.refused(),
        late_frames=running.overruns.count,
        behind=running.overruns.behind,
    )


def _member(member: MemberEntry, wait: float) -> MemberStatus:
    hello = member.hello
    if hello is None:
        return MemberStatus(member.name, member.state.value, expected=member.expected)
    return MemberStatus(
        name=member.name,
        state="drained" if member.active and member.drained else member.state.value,
        roles=hello.roles,
        service=hello.service,
        kinds=tuple([kind.name for kind in hello.kinds]),
        generates=hello.generates,
        orders=hello.orders,
        draws=hello.draws,
        last_reply=member.last_reply,
        late=member.late,
        pid=hello.pid,
        host=hello.host,
        expected=member.expected,
        joins=member.joins,
        wait=wait,
        figures={**member.figures, **({"dropped": member.dropped} if member.dropped else {})},
    )


def _totals(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"totals": running.counted().plain()}


def _scene(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    algorithm = running.algorithm
    return {"frame": algorithm.frame, "scene": str(algorithm.scene)}


def _fragment(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    """The outermost agent of an id, or one of a population."""
    composition, agent = running.algorithm.composition, as_text(asked.get("agent"), "the agent")
    node = composition.agent(agent) if not agent.startswith(PART) else None
    if node is None:
        raise ProtocolError(f"there is no agent #{agent[:64]}")
    return {"frame": running.algorithm.frame, "fragment": str(Scene((node,)))}


def _order(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    reader = Reader(running.algorithm.world.vocabulary)
    event = reader.event(asked.get("event"))
    if not isinstance(event, Event) or event.sender:
        raise ProtocolError("an order is one event, of people: it has no sender")
    return _send(running, event)


def _send(running: Running, event: Event) -> dict[str, Any]:
    algorithm = running.algorithm
    for receiver in event.receivers:
        if algorithm.composition.agent(receiver) is None:
            raise ProtocolError(f"there is no agent #{receiver[:64]}")
    refusal = refusal_of_order(algorithm, event.type)
    refusal = refusal or unknown_value(algorithm, event)
    if refusal:
        raise ProtocolError(refusal)
    takers = [member.name for member in algorithm.members.takers(event.type)]
    running.tell(s.Order(event))
    return {"frame": algorithm.frame, "event": str(event), "through": takers}


def _pause(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    running.pace.pause()
    running.repace()
    return {"frame": running.algorithm.frame}


def _resume(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    running.pace.resume()
    running.repace()
    return {"frame": running.algorithm.frame}


def _step(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    frames = as_int(asked.get("frames", 1), "frames", 1)
    if frames > MOST_STEPS:
        raise ProtocolError(f"frames must be a whole number up to {MOST_STEPS}, not {frames}")
    algorithm = running.algorithm
    begun = 1 if algorithm.in_frame else 0
    last = algorithm.frame + begun + (running.pace.left or 0) + frames
    running.pace.step(frames)
    running.repace()
    return {"frame": last}


def _rate(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    rate = as_number(asked.get("rate"), "rate")
    if not 0 <= rate <= MOST_RATE:
        raise ProtocolError(f"rate must be frames per second from 0 to {MOST_RATE:g}, not {rate:g}")
    running.pace.change(rate)
    running.repace()
    return {"rate": rate}


def _restart(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    member = as_text(asked.get("member"), "the member")
    members = running.algorithm.members
    if not members.knows(member):
        names = ", ".join(one.name for one in members)
        raise ProtocolError(f"there is no member {member[:64]!r}; there are {names}")
    if not members.get(member).expected:
        raise ProtocolError(f"{member} is no process of the world file: restart it where it runs")
    refused = running.restart(member)
    if refused:
        raise ProtocolError(refused)
    return {}


def _drain(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    member, offers = as_text(asked.get("member"), "the member"), running.algorithm.offers()
    if member not in offers:
        hosts = ", ".join(offers) or "none"
        raise ProtocolError(f"{member[:64]!r} hosts no agents now; hosts are {hosts}")
    others = {name: kinds for name, kinds in offers.items() if name != member}
    alone = sorted(offers[member].difference(*others.values()))
    if alone:
        raise ProtocolError(
            f"nobody else offers {', '.join(alone)}: attach a host of it first"
            " (minerva attach module:Class)"
        )
    running.tell(s.Drain(member))
    return {"to": [name for name, kinds in others.items() if kinds & offers[member]]}


def _logs(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    member = as_text(asked.get("member", ""), "the member")
    lines = running.diary.lines(as_int(asked.get("since", 0), "since"), member)
    return {"lines": plain_lines(lines[-MOST_LINES:])}


def _vocabulary(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"vocabulary": plain_vocabulary(running.algorithm.world.vocabulary)}


def _pub(running: Running, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event: data as texts of the language, for a type that the world must know."""
    algorithm = running.algorithm
    name = as_text(asked.get("type"), "the type")
    values = {
        one: _value(as_text(value, one), one)
        for one, value in as_map(asked.get("data", {}), "the data").items()
    }
    receivers = [
        as_text(one, "a receiver") for one in as_list(asked.get("receivers", []), "receivers")
    ]
    vocabulary = algorithm.world.vocabulary
    declared = vocabulary.events.get(name)
    if declared is None:
        raise ProtocolError(
            f"the world has no event type {name}; it has {', '.join(vocabulary.events)}"
        )
    condition = as_text(asked.get("condition", ""), "if")
    vocabulary.check_condition(name, condition, "pub")
    try:
        fitted = declared.fields.values(name, values)
    except Unfit as unfit:
        raise ProtocolError(str(unfit)) from None
    to = tuple(sorted(set(receivers)))
    return _send(running, Event(name, declared.fields.names, fitted, condition, receivers=to))


def _value(shown: str, name: str) -> Any:
    """A value as the language writes it; a text may do without its quotes."""
    try:
        (node,) = parse(f"P<value={shown}>", name)
        (value,) = node.values
    except (SceneError, ValueError):
        return shown
    return value


def _seek(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    raise ProtocolError("this is no replay: only a replay can go on from another frame")


def _stop(running: Running, _: Mapping[str, Any]) -> dict[str, Any]:
    running.tell(s.End("stopped by a person"))
    return {}


_ANSWERS: dict[str, Callable[[Running, dict[str, Any]], dict[str, Any]]] = {
    "status": _status,
    "totals": _totals,
    "scene": _scene,
    "fragment": _fragment,
    "vocabulary": _vocabulary,
    "pub": _pub,
    "order": _order,
    "pause": _pause,
    "resume": _resume,
    "step": _step,
    "rate": _rate,
    "restart": _restart,
    "drain": _drain,
    "seek": _seek,
    "logs": _logs,
    "stop": _stop,
}
