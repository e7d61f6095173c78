"""A bus in memory that delays, reorders and loses on demand: a world under any schedule.

    bus = MemoryBus(world, {"steps": lambda: Participant("steps", Steps()), ...})
    bus.start()
    bus.run()
    assert bus.digests == ...

Each member has a link up to the hub and one down from it, on which messages keep their order, as
they do on a real bus; between links nothing is in order. Readings go up, and down to those who
listen. Whether a member is there comes on a link of its own. What goes next is up to `settle` (a
fixed order) or to the test: `ready` names all that could happen next, `step` lets one of it
happen. Members that raise end as a process would.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm, Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.participant import Outgoing, Participant, Refusal
from minerva_bus.testing.telling import told

Maker: TypeAlias = Callable[[], Participant]
Link: TypeAlias = tuple[str, str]

BEGIN: Final[Link] = ("begin", "")
CLOCK: Final[Link] = ("clock", "")
TWICE: Final = (m.TickRequest, m.EvolveRequest, m.TickReply, m.EvolveReply, m.Readings)
_KINDS: Final = ("down", "up", "there")


class MemoryBus:
    """A world's coordinator and members, with every message in a queue until it is let through.

    `makers` makes a member's participant anew each time that it appears.
    """

    def __init__(self, world: World, makers: Mapping[str, Maker]) -> None:
        self.algorithm = FrameAlgorithm(world)
        self.inputs: list[FrameInputs] = []
        self.makers = dict(makers)
        self.alive: dict[str, Participant] = {}
        self.records: list[m.FrameRecord] = []
        self.ended: s.Ended | None = None
        self.said: list[str] = []
        self.trace: list[str] = []
        self._queues: dict[Link, deque[Any]] = {}
        self._held: set[Link] = set()
        self._began = True

    # --- members come and go ------------------------------------------------------------------

    def start(self) -> None:
        """Let all members appear."""
        for name in sorted(self.makers):
            self.appear(name)

    def appear(self, name: str) -> None:
        """Start a member's process."""
        self.alive[name] = self.makers[name]()
        self._queue("there", name).append(s.Appeared(name))

    def vanish(self, name: str) -> None:
        """End a member's process: what it has not heard yet is lost, what it said is not."""
        if self.alive.pop(name, None) is None:
            return
        self._queue("down", name).clear()
        self._queue("there", name).append(s.Vanished(name))

    def restart(self, name: str) -> None:
        """Let a member vanish and appear again."""
        self.vanish(name)
        self.appear(name)

    def leave(self, name: str) -> None:
        """Let a member go of its own will."""
        self._queue("up", name).append(m.Leaving(name))
        self.vanish(name)

    def kill_coordinator(self, successor: FrameAlgorithm | None = None) -> None:
        """Let another coordinator go on after the last whole frame; members stay.

        A missing `successor` is computed from the inputs of all frames. What is under way is lost,
        in both directions.
        """
        before = self.algorithm
        if successor is None:
            successor = FrameAlgorithm(before.world)
            for inputs in self.inputs:
                successor.feed(inputs)
        successor.expect(member.name for member in before.members.active())
        self.algorithm = successor
        self._queues.clear()
        self._began = True
        self.trace.append("the coordinator was killed")
        for name in sorted(self.alive):
            self._queue("there", name).append(s.Appeared(name))

    # --- one thing after another --------------------------------------------------------------

    def ready(self) -> list[Link]:
        """All that could happen next, sorted: to members, from them, and whether they are there."""
        waiting = sorted(filter(self._may_pass, self._queues), key=_place)
        if not waiting and self.algorithm.phase is Phase.STOPPING and self._mourned():
            return [CLOCK]
        return waiting if self._began or self.ended else [BEGIN, *waiting]

    def step(self, link: Link) -> None:
        """Let the first message of a link through, or the next frame begin."""
        if link in (BEGIN, CLOCK):
            self._began = True
            self.tell(s.Begin() if link == BEGIN else s.Silent())
            return
        message, (kind, name) = self._queues[link].popleft(), link
        if kind == "down":
            self._hear(name, message)
        elif isinstance(message, m.Readings):
            self._pass_on(message)
        else:
            self.tell(message)

    def _may_pass(self, link: Link) -> bool:
        """Whether there is something on a link.

        A departure may overtake last words; a successor appears when they have long been heard.
        """
        queue, (kind, name) = self._queues[link], link
        if kind == "there" and queue and isinstance(queue[0], s.Appeared):
            return not self._queues.get(("up", name))
        return bool(queue)

    def _mourned(self) -> bool:
        """Whether the coordinator waits for last words of somebody who is dead."""
        return any(name not in self.alive for name in self.algorithm.waiting_for())

    def hold(self, *links: Link) -> None:
        """Hold up what is on these links, until `release`; `step` lets it through all the same."""
        self._held.update(links)

    def release(self) -> None:
        """Hold up nothing any more."""
        self._held.clear()

    def settle(self) -> None:
        """Let all messages through that are not held up, in a fixed order; begin no frame."""
        while links := [one for one in self.ready() if one != BEGIN and one not in self._held]:
            self.step(links[0])

    def frame(self) -> None:
        """Begin a frame, and let all messages through that are not held up."""
        self.step(BEGIN)
        self.settle()

    def run(self, frames: int = 1000) -> None:
        """Run to the world's end, for so many frames, or to where the world waits."""
        self.settle()
        for _ in range(frames):
            if self.ended is not None or self._began:
                return
            self.frame()

    def repeat(self, link: Link) -> None:
        """Let the first message of a link come once more, behind all that is on its way there.

        Only what a frame asks and what is answered comes twice; all else a link says once.
        """
        message = self._queues[link][0]
        if isinstance(message, TWICE):
            self._queues[link].append(message)

    def drop(self, link: Link) -> None:
        """Lose the first message of a link."""
        self._queues[link].popleft()

    def put(self, message: Outgoing) -> None:
        """Say something in a member's name."""
        self._queue("up", message.member).append(message)

    # --- what follows ---------------------------------------------------------------------------

    @property
    def digests(self) -> list[str]:
        """The digest of each frame, in hexadecimal."""
        return [record.digest.hex() for record in self.records]

    @property
    def stuck(self) -> list[str]:
        """For whom a world waits that will never go on: all are alive, and nothing is under way.

        A world that waits for nobody and goes on no more names itself.
        """
        if self.ended is not None or self.ready():
            return []
        awaited = self.algorithm.waiting_for()
        return [] if any(name not in self.alive for name in awaited) else awaited or ["the world"]

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and queue what it says."""
        self.trace.append(f"> {told(stimulus)}")
        for instruction in self.algorithm.receive(stimulus):
            if line := told(instruction):
                self.trace.append(f"    {line}")
            self._carry_out(instruction)

    def _carry_out(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            for name in self._addressed(instruction.to):
                self._queue("down", name).append(instruction.message)
        elif isinstance(instruction, s.Show):
            for name in self._observers(instruction.event_type):
                self._queue("down", name).append(instruction.message)
        elif isinstance(instruction, s.FrameDone):
            self.records.append(instruction.record)
            if instruction.inputs is not None:
                self.inputs.append(instruction.inputs)
        elif isinstance(instruction, s.Ready):
            self._began = False
        elif isinstance(instruction, s.Say):
            self.said.append(f"{instruction.member}: {instruction.text}")
        elif isinstance(instruction, s.Ended):
            self.ended = instruction

    def _addressed(self, to: str) -> list[str]:
        """The members that listen to a key: by what they are, not by what anyone knows of them."""
        if to == s.TICKED:
            hellos = [(name, one.hello()) for name, one in sorted(self.alive.items())]
            return [name for name, hello in hellos if hello.ticks and not hello.ahead]
        if to == s.HOSTS:
            return [name for name, one in sorted(self.alive.items()) if one.host.kinds]
        return [name for name in sorted(self.alive) if to in (s.EVERYONE, name)]

    def _observers(self, event_type: str) -> list[str]:
        hellos = [(name, one.hello()) for name, one in sorted(self.alive.items())]
        return [name for name, h in hellos if event_type in h.draws and not h.coupled]

    def _hear(self, name: str, message: m.ToMember | m.Readings) -> None:
        member = self.alive[name]
        try:
            answers = member.receive(message)
            member.show()
        except Refusal:
            self.vanish(name)
            return
        except Exception as error:
            self.put(m.Failed(name, member.frame, f"{type(error).__name__}: {error}"))
            self.vanish(name)
            return
        for answer in answers:
            self.put(answer)
        if member.stopped:
            self.vanish(name)

    def _pass_on(self, readings: m.Readings) -> None:
        for name, member in sorted(self.alive.items()):
            if readings.topic in member.topics:
                self._queue("down", name).append(readings)

    def _queue(self, kind: str, name: str) -> deque[Any]:
        return self._queues.setdefault((kind, name), deque())


def _place(link: Link) -> tuple[int, str]:
    return _KINDS.index(link[0]), link[1]
