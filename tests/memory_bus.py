"""An in-memory bus that delays, reorders and loses messages on demand, under any schedule.

    bus = MemoryBus(world, {"steps": lambda: Member("steps", Steps()), ...})
    bus.start()
    bus.run()
    assert bus.digests == ...

Each member has an uplink to the coordinator and a downlink from it. Messages on one link keep their
order, as on a real bus; between links there is no order. Readings go up, and down to the members
that subscribe to them. Liveliness changes have a link of their own. `settle` delivers everything in
a fixed order; a test with another schedule lists the possible steps with `ready` and executes
one with `step`. A member whose code raises ends, as its process would.

A run leaves its trace, with the messages as lines of text, its frames and its messages to users.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm, Phase
from minerva_bus.frame.member_side import Member, Outgoing, Refusal
from minerva_bus.frame.stimuli import FrameInputs
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import AnyEvent, single
from minerva_bus.runtime.runner import Notice, Runner, Sink, observers, receivers


def trace_line(what: object) -> str:
    """A stimulus or an instruction as a line; empty for one without information."""
    match what:
        case s.Send(to, message):
            line = _sent(message)
            return f"{to} ← {line}" if line else ""
        case s.Show(event_type, message):
            return f"observers of {event_type} ← {_sent(message)}"
        case s.Notify(member, text):
            return f"says {member}: {text.strip()}"
        case s.Ready(frame):
            return f"ready for frame {frame}"
        case s.FrameDone():
            record = what.record
            changed = ", ".join(
                f"#{name}: {state}" for name, state in sorted(record.changed.items())
            )
            return f"frame {record.frame} done: {_events(record.events)}; {changed or 'no change'}"
        case s.Ended(reason, figures):
            return f"ended: {reason} {dict(figures) or ''}".rstrip()
        case s.Appeared(member) | s.Vanished(member):
            return f"{member} {type(what).__name__.lower()}"
        case s.Skip(member):
            return f"skip {member}"
        case s.Drain(member):
            return f"drain {member}"
        case s.Abandoned(member):
            return f"{member} is given up"
        case s.Violation(member, reason):
            return f"{member} breaks the protocol: {reason}"
        case s.Publish(event):
            return f"order: {event}"
        case s.End(reason=reason):
            return f"end: {reason}"
        case s.OrderJudged():
            return ""  # The log has a line about orders, and members get the events.
        case s.Begin() | s.Silent() | s.Stopping():
            return type(what).__name__.lower()
        case _:
            return _received(what)


def _sent(message: m.ToMember) -> str:
    match message:
        case m.Sources(publishers):
            pairs = [f"{topic} by {', '.join(who)}" for topic, who in sorted(publishers.items())]
            return f"sources: {'; '.join(pairs)}" if pairs else ""
        case m.Welcome(frame=frame, saved=saved):
            return f"welcome to frame {frame}" + (f", saved {dict(saved)}" if saved else "")
        case m.Refused(reason) | m.Stop(reason):
            return f"{type(message).__name__.lower()}: {reason}"
        case m.TickRequest(frame):
            return f"tick {frame}"
        case m.Fragments(given, dropped):
            lost = f", without {_ids(dropped)}" if dropped else ""
            return f"fragments {_ids(given)}{lost}"
        case m.EvolveRequest(frame, asked, events, visual, _, only):
            whose = f" ({_ids(only)} only)" if only else ""
            return f"evolve {frame} on {', '.join(asked)}{whose}: {_events((*events, *visual))}"
        case m.ViewShown(event_type, frame, sequence, parts, skeleton):
            # A view with a skeleton is a keyframe.
            whole = "all of " if skeleton is not None else ""
            return f"view {frame} of {event_type}, number {sequence}: {whole}{_ids(parts)}"
        case m.Orders(_, events):
            return f"orders: {_events(events)}"
        case m.Repeat(topic):
            return f"repeat {topic}"
        case _:
            return type(message).__name__.lower()


def _received(message: object) -> str:
    match message:
        case m.Hello(member=member):
            return f"{member}: hello, {', '.join(message.roles) or 'nothing'}"
        case m.TickReply(member, frame, events):
            return f"{member}: ticked {frame}: {_events(events)}"
        case m.EvolveReply(member, frame, _, changed, emitted):
            sent = [event for _, events in sorted(emitted.items()) for event in events]
            more = f", emitting {_events(sent)}" if sent else ""
            return f"{member}: evolved {frame}: {_ids(changed)}{more}"
        case m.Emitted(member, events):
            return f"{member}: emitted {_events(events)}"
        case m.Failed(member, frame, problem):
            return f"{member}: failed in frame {frame}: {problem}"
        case m.Resync(member, event_type):
            return f"{member}: resync {event_type}"
        case m.MemberMetrics(member, figures):
            return f"{member} does {dict(figures)}"
        case m.Report(member, figures):
            return f"{member}: report {dict(figures) or ''}".rstrip()
        case m.Leaving(member):
            return f"{member}: leaving"
        case _:
            return str(message)


def _events(events: Iterable[AnyEvent]) -> str:
    return ", ".join(map(str, single(events))) or "no events"


def _ids(names: Iterable[str]) -> str:
    return " ".join(f"#{name}" for name in sorted(names)) or "nothing"


class RunLog(Sink):
    """Keeps the stimuli, instructions, frames and messages of a run."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._unwritten: list[tuple[s.Stimulus, Sequence[s.Instruction]]] = []
        self.records: list[m.FrameRecord] = []
        self.inputs: list[FrameInputs] = []
        self.said: list[str] = []
        self.is_ready = False

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Keep a stimulus and its instructions for the trace."""
        self._unwritten.append((stimulus, instructions))

    @property
    def trace(self) -> list[str]:
        """Stimuli and instructions as lines, written on demand: few runs need their trace."""
        for stimulus, instructions in self._unwritten:
            self._lines.append(f"> {trace_line(stimulus)}")
            self._lines += [f"    {line}" for line in map(trace_line, instructions) if line]
        self._unwritten.clear()
        return self._lines

    def frame_done(self, notice: s.FrameDone) -> None:
        """Keep the record and the inputs of a frame."""
        self.records.append(notice.record)
        if notice.inputs is not None:
            self.inputs.append(notice.inputs)

    def ready(self, notice: s.Ready) -> None:
        """Note that the next frame may begin."""
        self.is_ready = True

    def notify(self, notice: s.Notify) -> None:
        """Keep a warning."""
        self.said.append(f"{notice.member}: {notice.text}")


Link: TypeAlias = tuple[str, str]
"""Kind of a link, and name of the member."""


class QueueTransport:
    """Queues every message until the schedule delivers it. `alive` are the running members."""

    def __init__(self) -> None:
        self.alive: dict[str, Member] = {}
        self.queues: dict[Link, deque[Any]] = {}

    def queue(self, kind: str, name: str) -> deque[Any]:
        """The queue of one link: "down", "up" or "there" (liveliness) of a member."""
        return self.queues.setdefault((kind, name), deque())

    def send(self, to: str, message: m.ToMember) -> tuple[()]:
        """Queue a message for the members that subscribe to it, whether or not they have joined."""
        for member in receivers(to, self.alive.values()):
            self.queue("down", member.name).append(message)
        return ()

    def show(self, event_type: str, message: m.ToMember, to: str) -> tuple[()]:
        """Queue a view for its observers."""
        for member in observers(event_type, self.alive.values()):
            self.queue("down", member.name).append(message)
        return ()

    def publish(self, readings: m.Readings) -> None:
        """Queue readings for the members that subscribe to their topic."""
        # Sorted, so that equal schedules give equal traces.
        for name, member in sorted(self.alive.items()):
            if readings.topic in member.topics:
                self.queue("down", name).append(readings)


MemberFactory: TypeAlias = Callable[[], Member]

BEGIN: Final[Link] = ("begin", "")
CLOCK: Final[Link] = ("clock", "")
TWICE: Final = (m.TickRequest, m.EvolveRequest, m.TickReply, m.EvolveReply, m.Readings)
_KINDS: Final = ("down", "up", "there")


class MemoryBus:
    """A coordinator and its members, with every message queued until it is delivered.

    `makers` creates a member each time it appears; `sinks` observe the run like those of a runner.
    """

    def __init__(
        self,
        world: WorldSpec,
        makers: Mapping[str, MemberFactory],
        sinks: Iterable[Sink | Callable[[Notice], None]] = (),
    ) -> None:
        self.makers = dict(makers)
        self._sinks = tuple(sinks)
        self._transport = QueueTransport()
        self._log = RunLog()
        self._held: set[Link] = set()
        self._run(FrameAlgorithm(world))

    def _run(self, algorithm: FrameAlgorithm) -> None:
        self._runner = Runner(algorithm, self._transport, [self._log, *self._sinks])
        self._log.is_ready = False

    # --- start and end of members -------------------------------------------------------------

    def start(self) -> None:
        """Start all members' processes."""
        for name in sorted(self.makers):
            self.appear(name)

    def appear(self, name: str) -> None:
        """Start a member's process."""
        self.alive[name] = self.makers[name]()
        self._transport.queue("there", name).append(s.Appeared(name))

    def vanish(self, name: str) -> None:
        """End a member's process: messages to it are lost, messages from it are not."""
        if self.alive.pop(name, None) is None:
            return
        self._transport.queue("down", name).clear()
        self._transport.queue("there", name).append(s.Vanished(name))

    def restart(self, name: str) -> None:
        """Let a member vanish and appear again."""
        self.vanish(name)
        self.appear(name)

    def leave(self, name: str) -> None:
        """Let a member leave on its own initiative."""
        self._transport.queue("up", name).append(m.Leaving(name))
        self.vanish(name)

    def kill_coordinator(self, successor: FrameAlgorithm | None = None) -> None:
        """Let another coordinator continue after the last complete frame; members stay.

        Without a `successor`, one is computed from the inputs of all frames. Messages in transit
        are lost in both directions.
        """
        before = self.algorithm
        if successor is None:
            successor = FrameAlgorithm(before.world)
            for inputs in self.inputs:
                # As from a journal: the inputs of each frame give the same string again.
                successor.receive(s.Begin(inputs=inputs))
        # Members that were active are awaited, so that no frame begins without them.
        successor.expect(member.name for member in before.members.index.active)
        # The queues belong to the sessions of the former coordinator.
        self._transport.queues.clear()
        self._run(successor)
        self.trace.append("the coordinator was killed")
        for name in sorted(self.alive):
            self._transport.queue("there", name).append(s.Appeared(name))

    # --- one step at a time -------------------------------------------------------------------

    def ready(self) -> list[Link]:
        """All steps that could happen next, sorted: to members, from members, liveliness."""
        queues = self._transport.queues
        waiting = sorted(filter(self._may_pass, queues), key=_place)
        # Only the clock ends this wait: nothing that is still in transit can.
        if not waiting and self.algorithm.phase is Phase.STOPPING and self._awaits_the_dead():
            return [CLOCK]
        return [BEGIN, *waiting] if self._log.is_ready and not self.ended else waiting

    def step(self, link: Link) -> None:
        """Deliver the first message of a link, or begin the next frame."""
        if link in (BEGIN, CLOCK):
            self._log.is_ready = False
            self.handle(s.Begin() if link == BEGIN else s.Silent())
            return
        message, (kind, name) = self._transport.queues[link].popleft(), link
        if kind == "down":
            self._deliver(name, message)
        elif isinstance(message, m.Readings):
            self._transport.publish(message)
        else:
            self.handle(message)

    def _may_pass(self, link: Link) -> bool:
        """Whether the first message of a link may be delivered now.

        A departure may overtake a member's last messages; a successor appears only after they have
        been delivered, because the new process starts later than the old one ended.
        """
        queue, (kind, name) = self._transport.queues[link], link
        if kind == "there" and queue and isinstance(queue[0], s.Appeared):
            return not self._transport.queues.get(("up", name))
        return bool(queue)

    def _awaits_the_dead(self) -> bool:
        """Whether the coordinator waits for the report of a member that has ended."""
        return any(name not in self.alive for name in self.algorithm.waiting_for())

    def hold(self, *links: Link) -> None:
        """Let `settle` skip these links until `release`; `step` still delivers from them."""
        self._held.update(links)

    def release(self) -> None:
        """Release all links."""
        self._held.clear()

    def settle(self) -> None:
        """Deliver all messages of links that are not held, in a fixed order; begin no frame."""
        while links := [link for link in self.ready() if link != BEGIN and link not in self._held]:
            self.step(links[0])

    def frame(self) -> None:
        """Begin a frame and deliver all messages of links that are not held."""
        self.step(BEGIN)
        self.settle()

    def run(self, frames: int = 1000) -> None:
        """Run until the world ends or waits, for at most `frames` frames."""
        self.settle()
        for _ in range(frames):
            if self.ended is not None or not self._log.is_ready:
                return
            self.frame()

    def repeat(self, link: Link) -> None:
        """Deliver the first message of a link a second time, after all others on the link.

        Only requests of a frame and their replies can be duplicated; a link sends all else once.
        """
        queue = self._transport.queues[link]
        if isinstance(queue[0], TWICE):
            queue.append(queue[0])

    def drop(self, link: Link) -> None:
        """Lose the first message of a link."""
        self._transport.queues[link].popleft()

    def put(self, message: Outgoing) -> None:
        """Send a message on behalf of a member."""
        self._transport.queue("up", message.member).append(message)

    def handle(self, stimulus: s.Stimulus) -> None:
        """Pass a stimulus to the algorithm and queue the messages it sends."""
        self._runner.handle(stimulus)

    # --- results --------------------------------------------------------------------------------

    def __repr__(self) -> str:
        """The trace."""
        return "\n".join(self.trace)

    @property
    def algorithm(self) -> FrameAlgorithm:
        """The frame algorithm of the coordinator that runs now."""
        return self._runner.algorithm

    @property
    def alive(self) -> dict[str, Member]:
        """The running members, by name."""
        return self._transport.alive

    @property
    def ended(self) -> s.Ended | None:
        """The end of the world; None before it."""
        return self._runner.ended

    @property
    def trace(self) -> list[str]:
        """Every stimulus, followed by its instructions, one line each."""
        return self._log.trace

    @property
    def records(self) -> list[m.FrameRecord]:
        """The record of each frame."""
        return self._log.records

    @property
    def inputs(self) -> list[FrameInputs]:
        """The inputs of each frame."""
        return self._log.inputs

    @property
    def said(self) -> list[str]:
        """All log lines about members, as "name: text"."""
        return self._log.said

    @property
    def digests(self) -> list[str]:
        """The digest of each frame, in hexadecimal."""
        return [record.digest.hex() for record in self.records]

    @property
    def stuck(self) -> list[str]:
        """Members for which the world waits forever: all are alive, and no message is in transit.

        A world that waits for no member and does not continue is listed under its own name.
        """
        if self.ended is not None or self.ready():
            return []
        awaited = self.algorithm.waiting_for()
        return [] if any(name not in self.alive for name in awaited) else awaited or ["the world"]

    def _deliver(self, name: str, message: m.ToMember | m.Readings) -> None:
        member = self.alive[name]
        try:
            answers = member.receive(message)
            member.show()
        # A refused member exits, as its process would.
        except Refusal:
            self.vanish(name)
            return
        except Exception as error:
            # The report of the failure is queued before the member disappears.
            self.put(m.Failed(name, member.frame, f"{type(error).__name__}: {error}"))
            self.vanish(name)
            return
        for answer in answers:
            self.put(answer)
        # Only after its last replies, which are still delivered.
        if member.stopped:
            self.vanish(name)


def _place(link: Link) -> tuple[int, str]:
    return _KINDS.index(link[0]), link[1]
