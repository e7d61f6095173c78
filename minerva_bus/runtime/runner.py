"""The runner: passes stimuli to a frame algorithm and executes the instructions it returns.

This is the only place where instructions are executed. What differs between a world over Zenoh, a
world in one process, a test and a replay is the transport, which delivers messages to members, and
the sinks, which observe the run: record, journal, metrics, console and event log.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol, TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm

Notice: TypeAlias = s.Notify | s.Ready | s.FrameDone | s.Stopping | s.Ended
"""Instructions that deliver nothing: they concern the sinks."""

Hook: TypeAlias = Callable[[s.Stimulus], None]


class Transport(Protocol):
    """Delivers the coordinator's messages to the members.

    Both methods return the stimuli that the delivery itself causes: the answers of members that
    run in this process, nothing where answers arrive later.
    """

    def send(self, to: str, message: m.ToMember) -> Iterable[s.Stimulus]:
        """Deliver a message to a member, or to one of EVERYONE, TICKED and HOSTS."""
        ...

    def show(self, event_type: str, message: m.ToMember, to: str) -> Iterable[s.Stimulus]:
        """Deliver a view to all observers of an event type, or to the observer `to`."""
        ...


class Sink:
    """Base class of observers of a run; a subclass overrides the methods that it needs.

    The runner calls them in its own thread, in the order in which it was given the sinks.
    """

    def received(self, stimulus: s.Stimulus) -> None:
        """Called before the algorithm processes a stimulus."""

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Called after the algorithm has processed it, before its instructions are executed."""

    def executed(self, stimulus: s.Stimulus) -> None:
        """Called after the instructions have been executed."""

    def observe(self, notice: Notice) -> None:
        """Called for each instruction that is not a delivery."""


class Runner:
    """Runs one frame algorithm. `ended` is set when the world is over.

    A sink may also be a plain function, which is called with the notices.
    """

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        transport: Transport,
        sinks: Iterable[Sink | Callable[[Notice], None]] = (),
    ) -> None:
        self.algorithm = algorithm
        self.transport = transport
        self.ended: s.Ended | None = None
        self._queue: deque[s.Stimulus] = deque()
        sinks = tuple(sinks)
        objects = [sink for sink in sinks if isinstance(sink, Sink)]
        # Only overridden methods: a frame of a thousand members has thousands of stimuli.
        self._received: list[Hook] = _overridden(objects, "received")
        self._decided: list[Callable[[s.Stimulus, Sequence[s.Instruction]], None]] = _overridden(
            objects, "decided"
        )
        self._executed: list[Hook] = _overridden(objects, "executed")
        self._observe = [sink.observe if isinstance(sink, Sink) else sink for sink in sinks]

    def handle(self, stimulus: s.Stimulus) -> None:
        """Process a stimulus and everything that follows from it.

        A member's code that runs during a delivery may call this method; the nested call then
        processes what is queued so far.
        """
        queue = self._queue
        queue.append(stimulus)
        while queue:
            self._process(queue.popleft())

    def _process(self, stimulus: s.Stimulus) -> None:
        for received in self._received:
            received(stimulus)
        instructions = self.algorithm.receive(stimulus)
        for decided in self._decided:
            decided(stimulus, instructions)
        for instruction in instructions:
            self._execute(instruction)
        for executed in self._executed:
            executed(stimulus)

    def _execute(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            self._queue.extend(self.transport.send(instruction.to, instruction.message))
            return
        if isinstance(instruction, s.Show):
            event_type, message = instruction.event_type, instruction.message
            self._queue.extend(self.transport.show(event_type, message, instruction.to))
            return
        if isinstance(instruction, s.Ended):
            self.ended = instruction
        for observe in self._observe:
            observe(instruction)


def _overridden(sinks: Iterable[Sink], name: str) -> list[Any]:
    """The bound methods of that name, without those that do nothing."""
    return [
        getattr(sink, name)
        for sink in sinks
        if getattr(type(sink), name) is not getattr(Sink, name)
    ]
