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

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from queue import Empty, SimpleQueue
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import zenoh

from minerva_bus.errors import BusError, MinervaError, ProtocolError, SceneError, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import PART
from minerva_bus.frame.member_table import MemberEntry
from minerva_bus.frame.sender_rights import MAX_NAMES, MAX_SINGLE_EVENTS, listed, unknown_agent
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import Event, Events, senders_of
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.types import Of, Unfit
from minerva_bus.runtime.admission import Admission
from minerva_bus.runtime.metrics import Metrics, StatusMeter, WorldLog
from minerva_bus.runtime.pace import Pace
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.session import System
from minerva_bus.runtime.session_inbox import Question, question
from minerva_bus.wire.keys import COORDINATOR, is_name, who_asks
from minerva_bus.wire.plain import (
    DEFAULT,
    Limits,
    as_int,
    as_list,
    as_map,
    as_number,
    as_text,
    check,
    pack,
    unpack,
    values_in,
)
from minerva_bus.wire.status_codec import plain_entries, plain_series, plain_status
from minerva_bus.wire.strings_codec import Reader
from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from minerva_bus.world.operator import FileStatus, MemberStatus, PersonOperation, WorldStatus

if TYPE_CHECKING:
    from minerva_bus.collect.collector import SeriesHistory


ANSWER_SECONDS: Final = 2.0
"""Seconds that another thread of this process waits for an answer."""

ASKER: Final = "asker"
"""Name of the certificate of a question, which the coordinator adds; empty without certificates."""


class WorldRun(Sink):
    """A running world: what there is once for each run, on a bus or in one process.

    It makes the schedule, metrics, status and log of a run, and answers questions.
    A subclass makes the runner, one of whose sinks it is, and overrides what differs if members are
    other processes.

    Args:
        world: What runs.
        algorithm: Continues a run, or replays one; None: the world begins.
        rate: Frames per second; 0: as many as possible.
        limits: What members may send.
        said: Called with a warning: member, text, and details for the log only.
        system: Clock and threads.
        commands: Questions that operators may ask, by name; None: all.
        keep: Whether to measure every frame for a profile.

    """

    collected: SeriesHistory | None = None
    """Collected series, for dashboards."""

    def __init__(
        self,
        world: WorldSpec,
        algorithm: FrameAlgorithm | None,
        rate: float,
        limits: Limits,
        said: Callable[[str, str, str], None],
        system: System,
        commands: Mapping[str, Command] | None = None,
        *,
        keep: bool = False,
    ) -> None:
        algorithm = FrameAlgorithm(world) if algorithm is None else algorithm
        algorithm.inbox.work.allow(limits.single_events, limits.host_events)
        clock = system.monotonic
        self.algorithm = algorithm
        self.system = system
        self.commands = COMMANDS if commands is None else commands
        self.metrics = Metrics(algorithm, clock, keep)
        self.log = log = WorldLog(algorithm, said, system, self.metrics)
        self.schedule = FrameSchedule(algorithm, rate, clock, partial(log.warn, COORDINATOR))
        self.status = StatusMeter(algorithm, self.schedule.pace, clock())

    @property
    def pace(self) -> Pace:
        """The frame rate and the number of frames that may begin."""
        return self.schedule.pace

    @property
    def result(self) -> s.Ended | None:
        """The end of the world with all figures; None while it runs."""
        ended = self.runner.ended
        if ended is None:
            return None
        # Overruns are measured by the clock, which the algorithm does not have.
        return replace(ended, figures={**ended.figures, **self.schedule.overruns.figures()})

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """Answer a question from any thread. Raises BusError, as a client does."""
        reply = self.reply_to({"ask": question, **details})
        if "error" in reply:
            raise BusError(str(reply["error"]))
        return reply

    def reply_to(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        """The answer of the thread that runs the world. Raises BusError if there is none."""
        asked = LocalQuestion(question)
        self.put_question(asked)
        try:
            return asked.answer.get(timeout=ANSWER_SECONDS)
        except Empty:
            name = self.algorithm.world.name
            raise BusError(f"{name} has not answered for {ANSWER_SECONDS:g} s") from None

    def put_question(self, asked: LocalQuestion) -> None:
        """Let the thread that runs the world `answer` a question; from any thread."""
        raise NotImplementedError

    def answer(self, asked: LocalQuestion) -> None:
        """Answer a question of another thread."""
        asked.answer.put(answer(asked.question, self))

    def restart(self, member: str) -> str:
        """Request a restart of a member; returns the reason if that is impossible, or ""."""
        return "all members run in one process: a single one cannot be restarted"

    def stack(self, member: str) -> str:
        """Request that a member's stacks are written to its log; returns as `restart`."""
        return "all members run in one process: none has a stack of its own"

    def rejected(self) -> Mapping[str, int]:
        """The number of rejections by sender."""
        return {}

    def outlook(self, member: str) -> str:
        """What the world does with an awaited member, and when; "" if nothing."""
        return ""

    def files(self) -> tuple[FileStatus, ...]:
        """The files that the run writes."""
        return ()

    def noted(self, operation: PersonOperation) -> None:
        """Keep an operation of a person."""
        self.log.operated(operation)


Command: TypeAlias = Callable[[WorldRun, dict[str, Any]], dict[str, Any]]


def person_of(asked: Mapping[str, Any]) -> str:
    """The name of the person who asks.

    With certificates it begins with the name of the certificate, which a question cannot change.
    """
    by, asker = as_text(asked.get("by", ""), "by"), as_text(asked.get(ASKER, ""), "the asker")
    if by and not is_name(by):
        raise ProtocolError(f"by: {by[:64]!r} is not a name: use letters, digits, _, - and .")
    return "/".join(dict.fromkeys(name for name in (asker, by) if name))


# --- the state of a world ---


def status_of(running: WorldRun, since: int = 0) -> WorldStatus:
    """State of a world, with the log entries since a number."""
    algorithm, pace, hz = running.algorithm, running.pace, running.status.hz
    measured = dict(running.metrics.measured())
    waits, sizes = [
        {
            name.removeprefix(prefix): measured.pop(name)
            for name in sorted(measured)
            if name.startswith(prefix)
        }
        for prefix in ("wait for ", "bytes of ")
    ]
    waiting = tuple(algorithm.waiting_for())
    members = [
        _member(entry, waits.get(entry.name, 0.0), sizes.get(entry.name, 0.0))
        for entry in algorithm.members
    ]
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
        # Measured a moment ago, when the frame may have waited for members that have answered.
        waited=running.status.waited if waiting else 0.0,
        members=tuple(
            replace(member, outlook=running.outlook(member.name))
            if member.name in waiting
            else member
            for member in members
        ),
        events={name: count * hz for name, count in running.log.event_log.per_frame().items()},
        bytes_in=measured.pop("bytes in", 0.0),
        bytes_out=measured.pop("bytes out", 0.0),
        phases=measured,
        happenings=running.log.event_log.entries(since),
        refused=running.rejected(),
        late_frames=running.schedule.overruns.count,
        behind=running.schedule.overruns.behind,
        series=0 if running.collected is None else len(running.collected),
        norms=algorithm.norms.status(),
        files=running.files(),
        people=algorithm.world.people,
    )


def _member(member: MemberEntry, wait: float, sent: float) -> MemberStatus:
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
        sent=sent,
        figures={**member.figures, **({"dropped": member.dropped} if member.dropped else {})},
    )


MAX_CHARS: Final = 16_384
"""Characters of the data and the condition of an event, which the main thread parses."""


# --- events of people: they are checked, sent, and their fates kept ---


def order(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event or a batch of people; in this process as it is, otherwise in wire form."""
    given, vocabulary = asked.get("event"), running.algorithm.world.vocabulary
    event = (
        vocabulary.check_any(given, "order")
        if isinstance(given, Event | Events)
        else Reader(vocabulary).event(given)
    )
    # Agents trust the sender of an event, so an operator must not set one.
    if senders_of(event) is not None:
        raise ProtocolError("an order is an event or a batch of people: it has no sender")
    if isinstance(event, Events):
        return _send_batch(running, event, person_of(asked))
    return _send(running, event, person_of(asked))


def _send_batch(running: WorldRun, batch: Events, person: str) -> dict[str, Any]:
    """Send the events of a batch; their fates are not kept."""
    algorithm = running.algorithm
    takers = algorithm.members.takers(batch.type)
    types = algorithm.world.vocabulary.events[batch.type].fields.all
    # Generators take single orders, and values that the string has are compared one by one.
    if takers or any(field.type.source is not None for field in types):
        advice = "send events in columns of a type that no generator takes, or fewer at once"
        check(f"an order of {batch.type}", batch.count, MAX_SINGLE_EVENTS, "events", advice)
        known = dict[Of, set[str]]()
        for event in batch:
            _send(running, event, person, known)
    else:
        missing = algorithm.composition.first_missing(batch.receivers)
        refusal = algorithm.orders.refusal_of_order(batch.type)
        refusal = refusal or ("" if missing is None else _no_agent(running, missing))
        refusal = refusal or algorithm.inbox.too_much_work(batch, person)
        if refusal:
            raise ProtocolError(refusal)
        running.runner.handle(s.Publish(batch, person))
    frame, sent = algorithm.frame, f"{batch.count} {batch.type}"
    return {"frame": frame, "event": sent, "through": takers, "by": person}


def _no_agent(running: WorldRun, receiver: str) -> str:
    composition = running.algorithm.composition
    few = composition.count <= MAX_NAMES
    several = listed(sorted(composition.agents())) if few else f"{composition.count} agents"
    return f"there is no agent {unknown_agent(composition, receiver, f'there are {several}')}"


def _send(
    running: WorldRun, event: Event, person: str, known: dict[Of, set[str]] | None = None
) -> dict[str, Any]:
    algorithm = running.algorithm
    check(f"an order of {event.type}", len(event.receivers), DEFAULT.receivers, "receivers")
    # Not `agent`, which makes the node of an agent in columns.
    homes = algorithm.composition.home_of_each(event.receivers)
    for receiver in event.receivers:
        if receiver not in homes:
            raise ProtocolError(_no_agent(running, receiver))
    refusal = algorithm.orders.refusal_of_order(event.type)
    refusal = refusal or algorithm.orders.unknown_value(event, known)
    refusal = refusal or algorithm.inbox.too_much_work(event, person)
    if refusal:
        raise ProtocolError(refusal)
    takers = algorithm.members.takers(event.type)
    note = algorithm.orders.without_effect(event)
    kinds, composition = algorithm.world.vocabulary.kinds, algorithm.composition
    counts = [
        *composition.single.items(),
        *((p.symbol, p.count) for p in composition.parts.values()),
    ]
    able = sum(count for kind, count in counts if event.type in kinds[kind].subscribes)
    number = running.log.orders.arrive(event, person, algorithm.frame, able)
    running.runner.handle(s.Publish(event, person))
    return {
        "frame": algorithm.frame, "event": str(event), "through": takers, "by": person,
        "number": number, **({"note": note} if note else {}),
    }  # fmt: skip


def publish(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event of a type in the vocabulary; its data are texts in the notation of strings."""
    algorithm = running.algorithm
    name = as_text(asked.get("type"), "the type")
    texts = {
        field: as_text(value, field)
        for field, value in as_map(asked.get("data", {}), "the data").items()
    }
    condition = as_text(asked.get("condition", ""), "if")
    size, advice = sum(map(len, [condition, *texts.values()])), "send it by the Python API"
    check("the data of an event", size, MAX_CHARS, "characters", advice)
    values = {field: _value(text, field) for field, text in texts.items()}
    receivers = [
        as_text(name, "a receiver") for name in as_list(asked.get("receivers", []), "receivers")
    ]
    vocabulary = algorithm.world.vocabulary
    declared = vocabulary.events.get(name)
    if declared is None:
        known = list(vocabulary.events)
        hint = nearest(name, known, f"it has {', '.join(known)}")
        raise ProtocolError(f"the world has no event type {name}{hint}")
    # A condition that no agent can fulfil is an error of the operator.
    vocabulary.check_condition(name, condition, "pub")
    try:
        fitted = declared.fields.values(name, values)
    except Unfit as unfit:
        raise ProtocolError(str(unfit)) from None
    to = tuple(sorted(set(receivers)))
    event = Event(name, declared.fields.names, fitted, condition, receivers=to)
    return _send(running, event, person_of(asked))


def _value(shown: str, name: str) -> Any:
    """A value in the notation of strings; quotes around a text are optional."""
    try:
        return parse_value(shown, name)
    except (SceneError, ValueError):
        return shown


MAX_STEPS = 1_000_000_000
MAX_RATE = 1_000_000.0
MAX_LINES = 1000


# --- questions ---


def answer(asked: Mapping[str, Any], running: WorldRun) -> dict[str, Any]:
    """Answer one question; errors are part of the answer."""
    commands = running.commands
    try:
        name = as_text(asked.get("ask"), "ask")
        if name not in commands:
            raise ProtocolError(f"unknown question {name[:40]!r}; expected {', '.join(commands)}")
        return commands[name](running, as_map(asked, "a question"))
    except MinervaError as error:
        return {"error": str(error)}


def _status(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    return {"status": plain_status(status_of(running, as_int(asked.get("since", 0), "since")))}


def _totals(running: WorldRun, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"totals": running.metrics.counted().plain()}


def _series(running: WorldRun, _: Mapping[str, Any]) -> dict[str, Any]:
    collected = running.collected
    return {"series": [] if collected is None else plain_series(collected.series())}


def _scene(running: WorldRun, _: Mapping[str, Any]) -> dict[str, Any]:
    algorithm = running.algorithm
    return {"frame": algorithm.frame, "scene": str(algorithm.scene)}


def _fragment(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    """The text of the outermost agent with an id, or of one in a population."""
    composition, agent = running.algorithm.composition, as_text(asked.get("agent"), "the agent")
    # Names of parts are internal, and change when hosts join or leave.
    node = composition.agent(agent) if not agent.startswith(PART) else None
    if node is None:
        raise ProtocolError(_no_agent(running, agent))
    return {"frame": running.algorithm.frame, "fragment": str(Scene((node,)))}


def _note(running: WorldRun, asked: Mapping[str, Any], value: object = "") -> None:
    """Note that a person operates the world, with an effect."""
    frame, operation = running.algorithm.frame, as_text(asked["ask"], "ask")
    running.noted(PersonOperation(frame, operation, str(value), person_of(asked)))


def _pause(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    if not running.pace.paused:
        _note(running, asked)
    running.schedule.pause()
    return {"frame": running.schedule.pauses_before}


def _resume(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    if running.pace.left is not None:
        _note(running, asked)
    running.pace.resume()
    running.schedule.repace()
    return {"frame": running.algorithm.frame}


def _step(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    frames = as_int(asked.get("frames", 1), "frames", 1)
    if frames > MAX_STEPS:
        raise ProtocolError(f"frames must be a whole number up to {MAX_STEPS}, not {frames}")
    _note(running, asked, frames)
    last = running.schedule.pauses_before + frames
    running.pace.step(frames)
    running.schedule.repace()
    return {"frame": last}


def _rate(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    rate = as_number(asked.get("rate"), "rate")
    if not 0 <= rate <= MAX_RATE:
        raise ProtocolError(f"rate must be frames per second from 0 to {MAX_RATE:g}, not {rate:g}")
    if rate != running.pace.rate:
        _note(running, asked, f"{rate:g}")
    running.pace.change(rate)
    running.schedule.repace()
    return {"rate": rate}


def _restart(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    member = _own_process(running, asked, "restart it where it runs")
    done = _accepted(running.restart(member))
    _note(running, asked, member)
    return done


def _stack(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Let a process write the stacks of its threads to its log, where `logs` finds them."""
    return _accepted(running.stack(_own_process(running, asked, "its stack is not known here")))


def _accepted(refused: str) -> dict[str, Any]:
    if refused:
        raise ProtocolError(refused)
    return {}


def _own_process(running: WorldRun, asked: Mapping[str, Any], otherwise: str) -> str:
    """The name of a process of the world file. Raises ProtocolError."""
    member = as_text(asked.get("member"), "the member")
    expected = {entry.name: entry.expected for entry in running.algorithm.members}
    if member not in expected:
        hint = nearest(member, list(expected), f"there are {', '.join(expected)}")
        raise ProtocolError(f"there is no member {member[:64]!r}{hint}")
    if not expected[member]:
        raise ProtocolError(f"{member} is not a process of the world file: {otherwise}")
    return member


def _drain(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    member, algorithm = as_text(asked.get("member"), "the member"), running.algorithm
    offers = algorithm.members.allowed_offers(algorithm.world.placement)
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


def _logs(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    member = as_text(asked.get("member", ""), "the member")
    lines = running.log.event_log.lines(as_int(asked.get("since", 0), "since"), member)
    return {"lines": plain_entries(lines[-MAX_LINES:])}


def _orders(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
    since = as_int(asked.get("since", 0), "since")
    return {"orders": plain_entries(running.log.orders.changed_since(since))}


def _vocabulary(running: WorldRun, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"vocabulary": plain_vocabulary(running.algorithm.world.vocabulary)}


def _seek(running: WorldRun, _: Mapping[str, Any]) -> dict[str, Any]:
    raise ProtocolError("this is not a replay; only a replay can continue from another frame")


def _stop(running: WorldRun, asked: Mapping[str, Any]) -> dict[str, Any]:
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


MAX_VALUES: Final = 25_000
"""Values of a question: the main thread reads an order at once, and prints it for people."""

PAUSE_FACTOR: Final = 2.0
"""Pause after an answer, as a multiple of the time that the answer took."""


# --- over the bus with the rights of the operator, and from other threads ---


@dataclass(frozen=True, slots=True)
class LocalQuestion:
    """A question from another thread of this process, and the queue for its answer."""

    question: Mapping[str, Any]
    answer: SimpleQueue[Mapping[str, Any]] = field(default_factory=SimpleQueue[Mapping[str, Any]])


Sender: TypeAlias = str | bytes
"""The name of a certificate, or without one, what a question says of its session."""


class Turns:
    """Questions that wait: those of a sender in order of arrival, those of several in turns.

    A sender may have as many as all others leave room for: `most` if it is alone, and some while
    others ask as fast as they can. `queues` is empty if none waits.
    """

    def __init__(self, most: int) -> None:
        self._room = 2 * most
        self._lock = Lock()  # Several threads of Zenoh admit questions.
        self._admitted = Counter[Sender]()
        self.queues: dict[Sender, deque[Question]] = {}

    def admits(self, sender: Sender) -> bool:
        """Whether one more question of a sender may wait, which counts until `answered`."""
        with self._lock:
            if self._admitted[sender] >= self._room - self._admitted.total():
                return False
            self._admitted[sender] += 1
            return True

    def add(self, sender: Sender, asked: Question) -> None:
        """Queue an admitted question."""
        self.queues.setdefault(sender, deque()).append(asked)

    def take(self) -> tuple[Sender, Question]:
        """Remove and return the next question, with its sender."""
        sender = next(iter(self.queues))
        # Inserted again: the order of the dict is the order of the turns.
        queue = self.queues.pop(sender)
        asked = queue.popleft()
        if queue:
            self.queues[sender] = queue
        return sender, asked

    def answered(self, sender: Sender) -> None:
        """Note that a question waits no more."""
        with self._lock:
            self._admitted[sender] -= 1
            self._admitted += Counter()  # Forgets senders without questions.


class Answers:
    """Checks and queues the questions to one world and answers them.

    At most `limits.questions` of one sender wait at the same time, and as many of those who may not
    operate the world, which come last. Answering takes at most a third of the coordinator's time,
    so that questions cannot stop the frames. `operated` is called before an answer is sent.
    `waiting` has the questions without an answer.
    """

    def __init__(
        self, world: WorldRun, admission: Admission, limits: Limits, operated: Callable[[], None]
    ) -> None:
        self._readers, self._operators = Turns(limits.questions), Turns(limits.questions)
        self.waiting = self._readers.queues, self._operators.queues
        self._world = world
        self._admission = admission
        self._limits = limits
        self._operated = operated
        self._clock = world.system.monotonic
        self._next_at = 0.0

    def admit(self, query: zenoh.Query) -> Question | None:
        """The question of a query, or None if too many wait; called in a thread of Zenoh."""
        # Checked in Zenoh's thread, so that a flood of questions does
        # not fill the coordinator's inbox, nor its memory.
        most, most_bytes = self._limits.questions, self._limits.small_bytes
        asked, size = question(query, most_bytes), len(query.payload) if query.payload else 0
        waiting, sender, key = self._turns(asked)
        if size > most_bytes:
            problem = f"a question has {size} bytes, over {most_bytes}"
        elif not waiting.admits(sender):
            problem = f"{most} questions wait for an answer already; ask again in a moment"
        else:
            return asked
        asked.reply(key, pack({"error": problem}))
        return None

    def add(self, asked: Question) -> None:
        """Queue an admitted question."""
        waiting, sender, _ = self._turns(asked)
        waiting.add(sender, asked)

    @property
    def wait(self) -> float:
        """Seconds until the next question may be answered; 0: now."""
        # Callers sleep for this time, and the clock may pass the end between two of their calls.
        return max(0.0, self._next_at - self._clock())

    def answer_due(self) -> None:
        """Answer the next question once the pause after the previous answer is over."""
        if not any(self.waiting) or self.wait > 0:
            return
        began = self._clock()
        waiting = self._operators if self._operators.queues else self._readers
        sender, asked = waiting.take()
        try:
            self._answer(asked)
        finally:
            waiting.answered(sender)
            now = self._clock()
            # In proportion to the answer, so that expensive questions are answered less often.
            self._next_at = now + PAUSE_FACTOR * (now - began)

    def _answer(self, question: Question) -> None:
        asker, orders, key = self._asker(question)
        try:
            most = min(self._limits.values, MAX_VALUES)
            check("a question", values_in(question.data, most), most, "values")
            asked = as_map(unpack(question.data), "a question")
            objection = self._admission.objection_to_question(asker, orders, asked.get("ask"))
            reply = (
                {"error": objection} if objection else answer({**asked, ASKER: asker}, self._world)
            )
        except MinervaError as error:
            reply = {"error": str(error)}
        self._operated()  # The journal must contain the change before the operator is notified.
        question.reply(key, pack(reply))

    def _turns(self, question: Question) -> tuple[Turns, Sender, str]:
        """Where a question waits, its sender, and the key of its answer."""
        asker, orders, key = self._asker(question)
        return self._operators if orders else self._readers, asker or question.session, key

    def _asker(self, question: Question) -> tuple[str, bool, str]:
        return who_asks(question.key, self._world.algorithm.world.name)
