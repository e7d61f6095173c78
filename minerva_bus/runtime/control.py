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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from minerva_bus.errors import MinervaError, ProtocolError, SceneError, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import PART
from minerva_bus.frame.event_log import EventLog
from minerva_bus.frame.members import MemberEntry
from minerva_bus.frame.order_fates import OrderFates
from minerva_bus.frame.orders import listed, refusal_of_order, unknown_value
from minerva_bus.frame.pace import Pace
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.runtime.metrics import Meter
from minerva_bus.runtime.runner import Runner
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.status import StatusMeter
from minerva_bus.wire.keys import is_name
from minerva_bus.wire.plain import as_int, as_list, as_map, as_number, as_text
from minerva_bus.wire.status import plain_lines, plain_orders, plain_series, plain_status
from minerva_bus.wire.values import Reader
from minerva_bus.wire.vocabulary import plain_vocabulary
from minerva_bus.world.operator import FileStatus, MemberStatus, PersonOperation, WorldStatus

if TYPE_CHECKING:
    from minerva_bus.collect.history import SeriesHistory

ASKER: Final = "asker"
"""Name of the certificate of a question, which the coordinator adds; empty without certificates."""

MAX_STEPS = 1_000_000_000
MAX_RATE = 1_000_000.0
MAX_LINES = 1000


@dataclass(frozen=True, slots=True)
class Operated:
    """The parts of a running world that operators' commands use.

    `rejected` gives the number of rejections by sender, `outlook` what the world does with an
    awaited member, and `files` what it writes. `restart` requests a restart of a member, `stack`
    that its stacks are written to its log; both return the reason if that is impossible, otherwise
    an empty string. `orders` has the fates of people's orders, `collected` the collected series, if
    any. `noted` receives each operation of a person.
    """

    runner: Runner
    schedule: FrameSchedule
    event_log: EventLog
    orders: OrderFates
    meter: Meter
    status: StatusMeter
    rejected: Callable[[], Mapping[str, int]]
    restart: Callable[[str], str]
    stack: Callable[[str], str]
    collected: SeriesHistory | None = None
    outlook: Callable[[str], str] = field(default=lambda _: "")
    files: Callable[[], tuple[FileStatus, ...]] = field(default=lambda: ())
    noted: Callable[[PersonOperation], None] = field(default=lambda _: None)

    @property
    def algorithm(self) -> FrameAlgorithm:
        """The frame algorithm."""
        return self.runner.algorithm

    @property
    def pace(self) -> Pace:
        """The frame rate and the number of frames that may begin."""
        return self.schedule.pace


Command: TypeAlias = Callable[[Operated, dict[str, Any]], dict[str, Any]]


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


def status_of(running: Operated, since: int = 0) -> WorldStatus:
    """State of a world, with the log entries since a number."""
    algorithm, pace, hz = running.algorithm, running.pace, running.status.hz
    measured = dict(running.meter.measured())
    waits = {
        name.removeprefix("wait for "): measured.pop(name)
        for name in sorted(measured)
        if name.startswith("wait for ")
    }
    waiting = tuple(algorithm.waiting_for())
    members = [_member(entry, waits.get(entry.name, 0.0)) for entry in algorithm.members]
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
        waiting=waiting,
        waited=running.status.waited,
        members=tuple(
            [
                replace(member, outlook=running.outlook(member.name))
                if member.name in waiting
                else member
                for member in members
            ]
        ),
        events={name: count * hz for name, count in running.event_log.per_frame().items()},
        bytes_in=measured.pop("bytes in", 0.0),
        bytes_out=measured.pop("bytes out", 0.0),
        phases=measured,
        happenings=running.event_log.entries(since),
        refused=running.rejected(),
        late_frames=running.schedule.overruns.count,
        behind=running.schedule.overruns.behind,
        series=0 if running.collected is None else len(running.collected),
        norms=algorithm.norms.status(),
        files=running.files(),
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


def _totals(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"totals": running.meter.counted().plain()}


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


def _order(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    reader = Reader(running.algorithm.world.vocabulary)
    event = reader.event(asked.get("event"))
    # Agents trust the sender of an event, so an operator must not set one.
    if event.senders is not None if isinstance(event, Events) else event.sender:
        raise ProtocolError("an order is an event or a batch of people: it has no sender")
    if isinstance(event, Events):
        return _send_batch(running, event, _person(asked))
    return _send(running, event, _person(asked))


def _send_batch(running: Operated, batch: Events, person: str) -> dict[str, Any]:
    """Send the events of a batch; their fates are not kept."""
    algorithm = running.algorithm
    takers = [member.name for member in algorithm.members.takers(batch.type)]
    types = algorithm.world.vocabulary.events[batch.type].fields.all
    # Generators take single orders, and values that the string has are compared one by one.
    if takers or any(field.type.source is not None for field in types):
        for event in batch:
            _send(running, event, person)
    else:
        refusal = refusal_of_order(algorithm, batch.type)
        if refusal:
            raise ProtocolError(refusal)
        missing = algorithm.composition.first_missing(batch.receivers)
        if missing is not None:
            raise ProtocolError(_no_agent(running, missing))
        running.runner.handle(s.Publish(batch, person))
    frame, sent = algorithm.frame, f"{batch.count} {batch.type}"
    return {"frame": frame, "event": sent, "through": takers, "by": person}


def _no_agent(running: Operated, receiver: str) -> str:
    known = sorted(node.id for node in agents(running.algorithm.scene))
    hint = nearest(receiver, known) or f"; there are {listed(known)}"
    return f"there is no agent #{receiver[:64]}{hint}"


def _person(asked: Mapping[str, Any]) -> str:
    """The name of the person who asks.

    With certificates it begins with the name of the certificate, which a question cannot change.
    """
    by, asker = as_text(asked.get("by", ""), "by"), as_text(asked.get(ASKER, ""), "the asker")
    if by and not is_name(by):
        raise ProtocolError(f"by: {by[:64]!r} is not a name: use letters, digits, _, - and .")
    return "/".join(dict.fromkeys(name for name in (asker, by) if name))


def _send(running: Operated, event: Event, person: str) -> dict[str, Any]:
    algorithm = running.algorithm
    for receiver in event.receivers:
        # Not `agent`, which makes the node of an agent in columns.
        if algorithm.composition.home(receiver) is None:
            raise ProtocolError(_no_agent(running, receiver))
    refusal = refusal_of_order(algorithm, event.type)
    refusal = refusal or unknown_value(algorithm, event)
    if refusal:
        raise ProtocolError(refusal)
    takers = [member.name for member in algorithm.members.takers(event.type)]
    number = running.orders.arrive(event, person, algorithm.frame)
    running.runner.handle(s.Publish(event, person))
    return {
        "frame": algorithm.frame,
        "event": str(event),
        "through": takers,
        "by": person,
        "number": number,
    }


def _note(running: Operated, asked: Mapping[str, Any], value: object = "") -> None:
    """Note that a person operates the world, with an effect."""
    running.noted(
        PersonOperation(
            running.algorithm.frame, as_text(asked["ask"], "ask"), str(value), _person(asked)
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
    members = running.algorithm.members
    # `get` would create an entry for any name.
    if not members.knows(member):
        names = ", ".join(entry.name for entry in members)
        raise ProtocolError(f"there is no member {member[:64]!r}; there are {names}")
    if not members.get(member).expected:
        raise ProtocolError(f"{member} is no process of the world file: {otherwise}")
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


def _pub(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event of a type in the vocabulary; its data are texts in the notation of strings."""
    algorithm = running.algorithm
    name = as_text(asked.get("type"), "the type")
    values = {
        field: _value(as_text(value, field), field)
        for field, value in as_map(asked.get("data", {}), "the data").items()
    }
    receivers = [
        as_text(name, "a receiver") for name in as_list(asked.get("receivers", []), "receivers")
    ]
    vocabulary = algorithm.world.vocabulary
    declared = vocabulary.events.get(name)
    if declared is None:
        raise ProtocolError(
            f"the world has no event type {name}; it has {', '.join(vocabulary.events)}"
        )
    condition = as_text(asked.get("condition", ""), "if")
    # A condition that no agent can fulfil is an error of the operator.
    vocabulary.check_condition(name, condition, "pub")
    try:
        fitted = declared.fields.values(name, values)
    except Unfit as unfit:
        raise ProtocolError(str(unfit)) from None
    to = tuple(sorted(set(receivers)))
    event = Event(name, declared.fields.names, fitted, condition, receivers=to)
    return _send(running, event, _person(asked))


def _value(shown: str, name: str) -> Any:
    """A value in the notation of strings; quotes around a text are optional."""
    try:
        (node,) = parse(f"P<value={shown}>", name)
        (value,) = node.values
    except (SceneError, ValueError):
        return shown
    return value


def _seek(running: Operated, _: Mapping[str, Any]) -> dict[str, Any]:
    raise ProtocolError("this is not a replay; only a replay can continue from another frame")


def _stop(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    _note(running, asked)
    running.runner.handle(s.End("stopped by a person"))
    return {}


COMMANDS: Final[Mapping[str, Command]] = {
    "status": _status,
    "totals": _totals,
    "series": _series,
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
    "stack": _stack,
    "drain": _drain,
    "seek": _seek,
    "logs": _logs,
    "orders": _orders,
    "stop": _stop,
}
