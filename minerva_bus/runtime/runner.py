"""The runner: passes stimuli to a frame algorithm and executes the instructions it returns.

This is the only place where instructions are executed. A world over Zenoh, a world in one process,
a test and a replay differ only in the transport, which delivers messages to members, and in the
sinks, which observe the run: record, journal, metrics, console and event log.
"""

from __future__ import annotations

import ctypes
import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Final, Protocol, TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm

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
        """Called when an order of a person counts in a frame, or a norm rejects it."""

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
        self._observers: dict[type[Notice], list[Callable[[Any], None]]] = {
            notice: self._overridden(name, functions=True) for notice, name in _METHODS.items()
        }
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
                self._execute(instruction)
            for executed in self._executed:
                executed(stimulus)
            if not queue:
                return
            stimulus = queue.popleft()

    def _execute(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            # Queued instead of handled at once: all instructions of a
            # stimulus are executed before the next.
            self._queue.extend(self.transport.send(instruction.to, instruction.message))
            return
        if isinstance(instruction, s.Show):
            event_type, message = instruction.event_type, instruction.message
            self._queue.extend(self.transport.show(event_type, message, instruction.to))
            return
        if isinstance(instruction, s.Ended):
            self.ended = instruction
        for observe in self._observers[type(instruction)]:
            observe(instruction)

    def _overridden(self, name: str, *, functions: bool = False) -> list[Any]:
        """The sinks' own methods of a name; with `functions` also the sinks that are functions."""
        methods: list[Any] = []
        for sink in self._sinks:
            if not isinstance(sink, Sink):
                methods += [sink] if functions else []
            elif name and getattr(type(sink), name) is not getattr(Sink, name):
                methods += [getattr(sink, name)] if functions or sink.follows else []
        return methods
