"""A whole world in one process: the same frame algorithm, messages handed over directly."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.participant import Participant

Watcher = Callable[[s.Instruction], None]


class InProcess:
    """Coordinator and members of a world without a bus between them."""

    def __init__(
        self, algorithm: FrameAlgorithm, participants: Iterable[Participant], watch: Watcher
    ) -> None:
        self.algorithm = algorithm
        self._participants = {one.name: one for one in participants}
        self._queue: deque[s.Stimulus] = deque()
        self._watch = watch
        self.running: Participant | None = None
        """Whose code runs, or ran last."""

        self.ended: s.Ended | None = None
        self.hear: Callable[[m.Readings], None] | None = None
        """Told of what comes on sensor topics."""

    def start(self) -> None:
        """Let all members join."""
        for name in sorted(self._participants):
            self.tell(s.Appeared(name))

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and carry out all that follows from it."""
        self._queue.append(stimulus)
        while self._queue:
            for instruction in self.algorithm.receive(self._queue.popleft()):
                self._carry_out(instruction)

    def pass_on(self, readings: m.Readings) -> None:
        """Give a publisher's readings to all who listen to their topic."""
        if self.hear is not None:
            self.hear(readings)
        self._deliver(self._listeners(readings.topic), readings)

    def _carry_out(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            self._deliver(self._addressed(instruction.to), instruction.message)
        elif isinstance(instruction, s.Show):
            devices = self.algorithm.members.devices(instruction.event_type)
            observers = [member.name for member, hello in devices if not hello.coupled]
            self._deliver([self._participants[one] for one in observers], instruction.message)
        else:
            if isinstance(instruction, s.Ended):
                self.ended = instruction
            self._watch(instruction)

    def _addressed(self, to: str) -> list[Participant]:
        members = [self._participants[name] for name in sorted(self._participants)]
        if to == s.TICKED:
            return [one for one in members if (hello := one.hello()).ticks and not hello.ahead]
        if to == s.HOSTS:
            return [member for member in members if member.host.kinds]
        return [member for member in members if to in (s.EVERYONE, member.name)]

    def _deliver(self, to: list[Participant], message: m.ToMember | m.Readings) -> None:
        for participant in to:
            self.running = participant
            answers = participant.receive(message)
            participant.show()
            for answer in answers:
                if isinstance(answer, m.Readings):
                    self.pass_on(answer)
                else:
                    self._queue.append(answer)

    def _listeners(self, topic: str) -> list[Participant]:
        return [one for one in self._participants.values() if topic in one.topics]
