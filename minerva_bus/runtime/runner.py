"""The runner: passes stimuli to a frame algorithm and executes the instructions it returns.

This is the only place where instructions are executed. A world over Zenoh, a world in one process,
a test and a replay differ only in the transport, which delivers messages to members, and in the
sinks, which observe the run: record, journal, metrics, console and event log. The transport for
members in this process is here, too: it hands messages over as objects.
"""

from __future__ import annotations

import ctypes
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Final, Protocol, TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.runtime.pace import Overruns

# --- freed memory, which a process keeps for its next frame ---

KEPT: Final = 64 * 1024 * 1024
"""Bytes of freed memory that a process does not return to the system."""

LARGEST: Final = 32 * 1024 * 1024
"""Bytes of an allocation from which on the system provides memory for it alone; glibc's maximum."""

_TRIM_THRESHOLD: Final = -1
_MMAP_THRESHOLD: Final = -3
"""Parameters of `mallopt`, in glibc's `malloc.h`."""


@cache
def keep_freed_memory() -> bool:
    """Let this process and its forks reuse freed memory; False if they cannot be told to.

    Each frame allocates the arrays of large populations. By default glibc returns freed arrays to
    the system, which then clears every page again: a quarter of a frame of 100,000 birds. A user
    who has set glibc's own variables is not overruled.
    """
    if any(name.startswith(("MALLOC_", "GLIBC_TUNABLES")) for name in os.environ):
        return False
    # Absent from other C libraries, such as those of macOS and Alpine.
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is None:
        return False
    # Both, because setting either one ends glibc's adjustment of the other.
    return bool(mallopt(_MMAP_THRESHOLD, LARGEST) and mallopt(_TRIM_THRESHOLD, KEPT))


# --- the runner ---

Notice: TypeAlias = s.Notify | s.OrderJudged | s.Ready | s.FrameDone | s.Stopping | s.Ended
"""Instructions that deliver nothing and go to the sinks."""

Hook: TypeAlias = Callable[[s.Stimulus], None]


class Transport(Protocol):
    """Delivers the coordinator's messages to the members.

    Both methods return the stimuli that the delivery itself causes: the answers of members that
    run in this process, nothing if answers arrive later.
    """

    def send(self, to: str, message: m.ToMember) -> Iterable[s.Stimulus]:
        """Deliver a message to a member, or to one of EVERYONE, TICKED and HOSTS."""
        ...

    def show(self, event_type: str, message: m.ToMember, to: str) -> Iterable[s.Stimulus]:
        """Deliver a view to all observers of an event type, or to the observer `to`."""
        ...


class Sink:
    """Base class of observers of a run; a subclass overrides the methods that it needs.

    The runner calls them in its own thread, in the order of its list of sinks. Only
    overridden methods are called, because a frame of a thousand members has thousands of stimuli.

    `runner` is the runner that the sink observes, which sets it. `follows` is whether `received`,
    `decided` and `executed` are called now; a sink that changes it calls `runner.refresh`.
    """

    runner: Runner
    follows: bool = True

    # --- each stimulus ---

    def received(self, stimulus: s.Stimulus) -> None:
        """Called before the algorithm processes a stimulus."""

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Called after the algorithm has processed it, before its instructions are executed."""

    def executed(self, stimulus: s.Stimulus) -> None:
        """Called after the instructions have been executed."""

    # --- each instruction that delivers nothing ---

    def notify(self, notice: s.Notify) -> None:
        """Called with a warning about a member."""

    def order_judged(self, notice: s.OrderJudged) -> None:
        """Called when an order of a person counts in a frame, or does not."""

    def ready(self, notice: s.Ready) -> None:
        """Called when the next frame may begin."""

    def frame_done(self, notice: s.FrameDone) -> None:
        """Called when a frame is complete."""

    def stopping(self, notice: s.Stopping) -> None:
        """Called when no frame follows."""


_METHODS: Final[Mapping[type[Notice], str]] = {
    s.Notify: "notify",
    s.OrderJudged: "order_judged",
    s.Ready: "ready",
    s.FrameDone: "frame_done",
    s.Stopping: "stopping",
    s.Ended: "",
}


class Runner:
    """Runs one frame algorithm. `ended` is set when the world is over.

    A sink may also be a plain function, which is called with every notice.
    """

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        transport: Transport,
        sinks: Iterable[Sink | Callable[[Notice], None]] = (),
    ) -> None:
        keep_freed_memory()
        self.algorithm = algorithm
        self.transport = transport
        self.ended: s.Ended | None = None
        self._queue: deque[s.Stimulus] = deque()
        self._sinks = tuple(sinks)
        self._executors: dict[type[s.Instruction], list[Callable[[Any], None]]] = {
            notice: self._overridden(name, functions=True) for notice, name in _METHODS.items()
        }
        self._executors |= {s.Send: [self._send], s.Show: [self._show]}
        self._executors[s.Ended].insert(0, self._end)
        for sink in self._sinks:
            if isinstance(sink, Sink):
                sink.runner = self
        self.refresh()

    def refresh(self) -> None:
        """Apply changes of the sinks' `follows`."""
        self._received: list[Hook] = self._overridden("received")
        self._decided: list[Callable[[s.Stimulus, Sequence[s.Instruction]], None]] = (
            self._overridden("decided")
        )
        self._executed: list[Hook] = self._overridden("executed")

    def handle(self, stimulus: s.Stimulus) -> None:
        """Process a stimulus and all stimuli that result from it.

        A member's code that runs during a delivery may call this method; the nested call then
        processes the stimuli that are queued so far.
        """
        queue = self._queue
        # Called from a delivery: stimuli that arrived before this one are processed first.
        if queue:
            queue.append(stimulus)
            stimulus = queue.popleft()
        # One loop without helper functions: a frame has a stimulus for each member, and function
        # calls would be a third of the time between an empty reply and the next one.
        while True:
            for received in self._received:
                received(stimulus)
            instructions = self.algorithm.receive(stimulus)
            for decided in self._decided:
                decided(stimulus, instructions)
            for instruction in instructions:
                for execute in self._executors[type(instruction)]:
                    execute(instruction)
            for executed in self._executed:
                executed(stimulus)
            if not queue:
                return
            stimulus = queue.popleft()

    def _send(self, send: s.Send) -> None:
        # Queued instead of handled at once: all instructions of a
        # stimulus are executed before the next.
        self._queue.extend(self.transport.send(send.to, send.message))

    def _show(self, show: s.Show) -> None:
        self._queue.extend(self.transport.show(show.event_type, show.message, show.to))

    def _end(self, ended: s.Ended) -> None:
        self.ended = ended

    def _overridden(self, name: str, *, functions: bool = False) -> list[Any]:
        """The sinks' own methods of a name; with `functions` also the sinks that are functions."""
        methods: list[Any] = []
        for sink in self._sinks:
            if not isinstance(sink, Sink):
                methods += [sink] if functions else []
            elif name and getattr(type(sink), name) is not getattr(Sink, name):
                methods += [getattr(sink, name)] if functions or sink.follows else []
        return methods


# --- members in this process ---

Deliver: TypeAlias = Callable[[Member, m.ToMember | m.Readings], Iterable[s.Stimulus | m.Readings]]


def receivers(to: str, members: Iterable[Member]) -> list[Member]:
    """Those of `members` that receive a message for `to`, in the order of their names."""
    ordered = sorted(members, key=lambda member: member.name)
    if to == s.TICKED:
        return [member for member in ordered if member.hello().ticks_with_all]
    if to == s.HOSTS:
        return [member for member in ordered if member.host.kinds]
    return [member for member in ordered if to in (s.EVERYONE, member.name)]


def observers(event_type: str, members: Iterable[Member]) -> list[Member]:
    """Members that draw the views of an event type outside of the frames, ordered by name."""
    ordered = sorted(members, key=lambda member: member.name)
    hellos = [(member, member.hello()) for member in ordered]
    return [member for member, h in hellos if event_type in h.draws and not h.coupled]


def deliver(
    member: Member, message: m.ToMember | m.Readings
) -> Iterable[m.FromMember | m.Readings]:
    """Let a member process a message and draw; returns its answers."""
    answers = member.receive(message)
    # On the bus an observer draws when its inbox is empty, which it always is here.
    member.show()
    return answers


def timed(overruns: Overruns, clock: Callable[[], float]) -> Deliver:
    """As `deliver`; notes how long each member runs in frames with a given duration."""

    def deliver_timed(
        member: Member, message: m.ToMember | m.Readings
    ) -> Iterable[m.FromMember | m.Readings]:
        if not overruns.measures:
            return deliver(member, message)
        began = clock()
        answers = deliver(member, message)
        overruns.took(member.name, clock() - began)
        return answers

    return deliver_timed


class DirectTransport:
    """Delivers messages by calling the members, which are in this process.

    `running` is the member whose code runs, or ran last. `on_readings` is called with everything
    published on sensor topics. `deliver` replaces the function that passes one message to one
    member, for tests and benchmarks.
    """

    def __init__(
        self,
        members: Iterable[Member],
        on_readings: Callable[[m.Readings], None] | None = None,
        deliver: Deliver = deliver,
    ) -> None:
        self.members = {member.name: member for member in members}
        self.running: Member | None = None
        self._on_readings = on_readings
        self._deliver = deliver
        # A hello is costly to make, and the messages that a member receives do not change.
        self._receivers: dict[str, list[Member]] = {}
        self._observers: dict[str, list[Member]] = {}

    def add(self, member: Member) -> None:
        """Add a member, or replace the one of the same name."""
        self.members[member.name] = member
        self._receivers.clear()
        self._observers.clear()

    def send(self, to: str, message: m.ToMember) -> Iterator[s.Stimulus]:
        """Deliver a message; yields the answers one by one, as the members give them."""
        group = self._receivers.get(to)
        if group is None:
            group = self._receivers[to] = receivers(to, self.members.values())
        return self._deliver_to(group, message)

    def show(self, event_type: str, message: m.ToMember, to: str) -> Iterator[s.Stimulus]:
        """Deliver a view to its observers."""
        group = self._observers.get(event_type)
        if group is None:
            group = self._observers[event_type] = observers(event_type, self.members.values())
        return self._deliver_to(group, message)

    def publish(self, readings: m.Readings) -> Iterator[s.Stimulus]:
        """Deliver a publisher's readings to the members that subscribe to their topic."""
        if self._on_readings is not None:
            self._on_readings(readings)
        subscribed = [member for member in self.members.values() if readings.topic in member.topics]
        return self._deliver_to(subscribed, readings)

    def _deliver_to(
        self, members: Iterable[Member], message: m.ToMember | m.Readings
    ) -> Iterator[s.Stimulus]:
        for member in members:
            # Set before the call, so that an error in the member's code can be attributed to it.
            self.running = member
            for answer in self._deliver(member, message):
                if isinstance(answer, m.Readings):
                    yield from self.publish(answer)
                else:
                    yield answer


class InProcessRunner(Runner):
    """A runner whose members are all in this process."""

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        members: Iterable[Member],
        *sinks: Sink | Callable[[Notice], None],
        on_readings: Callable[[m.Readings], None] | None = None,
        deliver: Deliver = deliver,
    ) -> None:
        self.direct = DirectTransport(members, on_readings, deliver)
        super().__init__(algorithm, self.direct, sinks)

    def start(self) -> None:
        """Let all members join, in the order of their names."""
        for name in sorted(self.direct.members):
            self.handle(s.Appeared(name))

    def publish(self, readings: m.Readings) -> None:
        """Deliver the readings of a free-running publisher."""
        for stimulus in self.direct.publish(readings):
            self.handle(stimulus)
