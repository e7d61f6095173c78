"""The hub of a region in a simulation: its hosts answer later, in any order, and may die."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from random import Random
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.launch.worldfile import Process
from minerva_bus.runtime.direct import Deliver, DirectTransport, JointTransport
from minerva_bus.runtime.runner import Notice, Runner

DIES: Final = 0.01
"""How often a host ends before one of its messages arrives."""

LEAVES: Final = 0.3
"""How often a host that ends says so."""


class SimulatedHosts:
    """The processes of a region's hosts, which outlive their region."""

    def __init__(self, specs: Iterable[Process]) -> None:
        self._specs = {spec.name: spec for spec in specs}
        self.members = {name: spec.participant() for name, spec in self._specs.items()}

    def restart(self, name: str) -> None:
        """Replace the process of a host by a new one."""
        self.members[name] = self._specs[name].participant()


class SimulatedHub:
    """Runs the algorithm of a region with members here, and hosts whose messages are under way."""

    def __init__(
        self,
        hosts: SimulatedHosts,
        chance: Random,
        algorithm: FrameAlgorithm,
        members: Iterable[Member],
        observe: Callable[[Notice], None],
        *,
        deliver: Deliver,
    ) -> None:
        members = [*members]
        self._hosts = hosts
        self._chance = chance
        self._own = sorted(member.name for member in members)
        self._down: dict[str, deque[m.ToMember]] = defaultdict(deque)
        self._up: dict[str, deque[s.Stimulus]] = defaultdict(deque)
        joint = JointTransport(DirectTransport(members, deliver=deliver), self)
        self._runner = Runner(algorithm, joint, [observe])

    @property
    def ended(self) -> s.Ended | None:
        """The end of the world, when all members have reported."""
        return self._runner.ended

    def start(self) -> None:
        """Let members here join; hosts appear, those of a former process of the region, too."""
        for name in (*self._own, *self._hosts.members):
            self.handle(s.Appeared(name))

    def outlook(self, member: str) -> str:
        """Nothing, because no host has a time-out here."""
        return ""

    def handle(self, stimulus: s.Stimulus) -> None:
        """Process a stimulus."""
        self._runner.handle(stimulus)

    # --- messages under way ---

    @property
    def busy(self) -> Sequence[str]:
        """The hosts with messages under way."""
        return [name for name in self._hosts.members if self._down[name] or self._up[name]]

    def pass_on(self, name: str) -> None:
        """Let a message to a host or from it arrive, or let the host end and return."""
        if self._chance.random() < DIES:
            self._down[name].clear()
            self._up[name].clear()
            self._hosts.restart(name)
            left = self._chance.random() < LEAVES
            self.handle(m.Leaving(name) if left else s.Vanished(name))
            self.handle(s.Appeared(name))
        elif self._down[name]:
            for answer in self._hosts.members[name].receive(self._down[name].popleft()):
                assert not isinstance(answer, m.Readings)
                self._up[name].append(answer)
        else:
            self.handle(self._up[name].popleft())

    def send(self, to: str, message: m.ToMember) -> tuple[()]:
        """Send a message to hosts."""
        names = self._hosts.members if to in (s.EVERYONE, s.HOSTS) else (to,)
        for name in names:
            self._down[name].append(message)
        return ()

    def show(self, event_type: str, message: m.ToMember, to: str) -> tuple[()]:
        """Do nothing: hosts show nothing."""
        return ()
