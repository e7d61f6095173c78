"""A world in regions: its coordinator, its regions and all links between them in one process."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Final

from minerva_bus.errors import MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Outgoing
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.events import Event
from minerva_bus.launch.journaling import journal_path
from minerva_bus.launch.regions.layout import RegionSpec, source_of
from minerva_bus.launch.regions.member import RegionMember
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.log.journal import Journal
from minerva_bus.log.journaled import read_journal, resume_from
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.region_links import ParcelArrived
from minerva_bus.runtime.runner import Runner, Sink
from minerva_bus.testing.simulation.hub import SimulatedHosts, SimulatedHub
from minerva_bus.wire.keys import name_of_region

MAX_SECONDS: Final = 1000
"""Simulated seconds within which a world must have ended."""

REWRITTEN: Final = 0.05
"""How often the coordinator's journal is rewritten before a delivery between frames."""


@dataclass(frozen=True, slots=True)
class DoneFrame:
    """A finished frame, with the digest of the string after it."""

    number: int
    events: tuple[AnyEvent, ...]
    digest: str


class Hangs(MinervaError):
    """The world does not end."""


class SimulatedLinks:
    """Messages under way: `down` to regions, `up` from them, and `parcels` between them.

    A parcel has its source and target. `cuts` are the pairs of regions without a link, `lost`
    counts the parcels lost there. `forge` changes a parcel that a region sends to another one.
    """

    def __init__(self) -> None:
        self.down: dict[str, deque[m.ToMember]] = defaultdict(deque)
        self.up: dict[str, deque[Outgoing]] = defaultdict(deque)
        self.parcels: list[tuple[int, int, bytes]] = []
        self.cuts: set[frozenset[int]] = set()
        self.forge: Callable[[int, int, bytes], bytes] = lambda source, target, data: data
        self.lost: int = 0


class Cluster(Sink):
    """Runs the world of a file of `in_regions`; messages of different links arrive in any order.

    `seconds` counts the simulated ones. `done` has the finished frames, `deaths` and `successions`
    the frames in which a region's process, or the coordinator's, died.
    """

    def __init__(self, file: WorldFile, chance: Random, guests: Iterable[Process] = ()) -> None:
        """`guests` are hosts in each region of agents that it also evolves itself."""
        self.chance = chance
        self.links = SimulatedLinks()
        self.seconds: int = 0
        self.done: list[DoneFrame] = []
        self.deaths: list[int] = []
        self.specs = {each.name: each for each in file.processes if isinstance(each, RegionSpec)}
        self.successions: list[int] = []
        self._file = file
        self._is_ready = False
        self._members: dict[str, RegionMember] = {}
        outside = [each for each in file.processes if not each.hub]
        others = [each for each in outside if each.name not in self.specs]
        extra = [replace(each, name=f"guest-{each.name}") for each in guests]
        self._hosts = {
            name: SimulatedHosts([*spec.hosts, *extra]) for name, spec in self.specs.items()
        }
        self._hubs: dict[str, SimulatedHub] = {}
        self._outside = {each.name: each.participant() for each in others}
        self._coordinate(FrameAlgorithm(file.world, source_of(file)))
        for name in self.specs:
            self.start(name)
        self._greet_outside()

    def run(self, disturb: Callable[[Cluster], None] | None = None) -> None:
        """Run the world to its end; `disturb` is called before each delivery. Raises Hangs."""
        while self.runner.ended is None:
            if not self.algorithm.in_frame and self.chance.random() < REWRITTEN:
                self._journal.rewrite()
            if disturb is not None:
                disturb(self)
            names = *self.specs, *self._outside
            busy = [name for name in names if self.links.down[name] or self.links.up[name]]
            hubs = [name for name, hub in self._hubs.items() if hub.busy]
            if self._is_ready and self.chance.random() < 0.5:
                self._is_ready = False
                self.runner.handle(s.Begin())
            elif self.links.parcels and (not busy or self.chance.random() < 0.5):
                self._deliver(
                    *self.links.parcels.pop(self.chance.randrange(len(self.links.parcels)))
                )
            elif hubs and (not busy or self.chance.random() < 0.5):
                self._pass_on_to_host(self.chance.choice(hubs))
            elif busy:
                self._pass_on(self.chance.choice(busy))
            elif not self._is_ready:
                self._wait()

    @property
    def algorithm(self) -> FrameAlgorithm:
        """That of the present coordinator."""
        return self.runner.algorithm

    @property
    def _journal_path(self) -> Path:
        """The coordinator's journal, beside those of the regions unless it keeps these."""
        beside = next(iter(self.specs.values())).journal
        return journal_path(self._file) if beside is None else beside.with_name("coordinator")

    @property
    def members(self) -> Mapping[str, RegionMember]:
        """The processes of the regions, by name."""
        return self._members

    @property
    def frames(self) -> list[int]:
        """The frame of each region."""
        return [member.region.frame for member in self._members.values()]

    # --- faults ---

    def start(self, name: str) -> None:
        """Start the process of a region; what the former one has received last is lost."""
        if name in self._members:
            self.deaths.append(self.algorithm.frame)
            self.runner.handle(s.Vanished(name))
        self._begin_process(name)
        self.runner.handle(s.Appeared(name))

    def _begin_process(self, name: str) -> None:
        spec = self.specs[name]
        self.links.down[name].clear()
        self.links.up[name].clear()
        self.links.parcels = [parcel for parcel in self.links.parcels if parcel[1] != spec.number]
        send = partial(self._send_parcel, spec.number)
        make = partial(self._make_hub, name) if self._hosts[name].members else InProcessRunner
        self._members[name] = RegionMember(spec, send, lambda about, text, details: None, make)
        for other in self._members.values():
            other.send_again([spec.number])

    def succeed(self) -> None:
        """Kill the coordinator; each region has received a part of its last messages."""
        self.successions.append(self.algorithm.frame)
        self._is_ready = False
        past = read_journal(self._journal_path, self._file.world)
        assert past is not None
        algorithm = FrameAlgorithm(past.world, source_of(self._file))
        resume_from(past, algorithm, lambda done: None)
        self._coordinate(algorithm)
        for name in self.specs:
            self.links.up[name].clear()
            for _ in range(self.chance.randint(0, len(self.links.down[name]))):
                self._members[name].receive(self.links.down[name].popleft())
            self.links.down[name].clear()
            if self._members[name].stopped:  # Its process has ended, and another one follows.
                self._begin_process(name)
            self.runner.handle(s.Appeared(name))
        self._greet_outside()

    def _greet_outside(self) -> None:
        """Let the members outside of all regions appear, as new ones."""
        for name in self._outside:
            self.links.down[name].clear()
            self.links.up[name].clear()
            self.runner.handle(s.Appeared(name))

    def _coordinate(self, algorithm: FrameAlgorithm) -> None:
        self.runner = Runner(algorithm, self, [self])
        self._journal = Journal(self._journal_path, len(self.successions), algorithm)

    def publish(self, event: Event) -> None:
        """Accept an order of a person, who gets a confirmation."""
        self.runner.handle(s.Publish(event, "anna"))
        self._journal.waiting(self.algorithm.ordered)

    def emit(self, name: str, event: Event) -> None:
        """Let a generator that runs freely emit an event, if it takes part in the world."""
        member = self._outside[name]
        if member.world is not None:
            self.links.up[name].append(member.emitted(event))

    def repeat(self, name: str) -> None:
        """Request the present frame of a region again, as if its token had been lost for a moment.

        It sends its report again, which may arrive when the frame is over.
        """
        if self.algorithm.in_frame:
            member = self.algorithm.members.get(name)
            self.algorithm.source.ask(member)

    def restore(self) -> None:
        """Restore all links, which both sides notice."""
        restored, self.links.cuts = self.links.cuts, set()
        for a, b in map(sorted, restored):
            self._members[name_of_region(a)].send_again([b])
            self._members[name_of_region(b)].send_again([a])

    # --- links ---

    def send(self, to: str, message: m.ToMember) -> tuple[()]:
        """Send a message of the coordinator."""
        names = {s.EVERYONE: (*self.specs, *self._outside), s.TICKED: self.specs}.get(to, (to,))
        for name in names:
            self.links.down[name].append(message)
        return ()

    def show(self, event_type: str, message: m.ToMember, to: str) -> tuple[()]:
        """Do nothing: regions draw no views of the coordinator."""
        return ()

    def _pass_on(self, name: str) -> None:
        if self.links.down[name]:
            member = {**self._members, **self._outside}[name]
            self.links.up[name] += member.receive(self.links.down[name].popleft())
            return
        message = self.links.up[name].popleft()
        assert not isinstance(message, m.Readings)
        # The real coordinator does not even decode a large reply for which no frame waits.
        if not isinstance(message, m.TickReply) or self.algorithm.awaits(name):
            self.runner.handle(message)

    def _make_hub(self, name: str, *of_region: Any, **options: Any) -> SimulatedHub:
        # The one made last is that of the region, which may continue from a checkpoint.
        hub = SimulatedHub(self._hosts[name], self.chance, *of_region, **options)
        self._hubs[name] = hub
        return hub

    def _pass_on_to_host(self, name: str) -> None:
        hub = self._hubs[name]
        hub.pass_on(self.chance.choice(hub.busy))
        self.links.up[name] += self._members[name].hosts_answered()

    def _send_parcel(self, source: int, target: int, data: bytes) -> None:
        if frozenset((source, target)) in self.links.cuts:
            self.links.lost += 1
        else:
            self.links.parcels.append((source, target, self.links.forge(source, target, data)))

    def _deliver(self, source: int, target: int, data: bytes) -> None:
        name = name_of_region(target)
        self.links.up[name] += self._members[name].parcel(ParcelArrived(source, data))

    def _wait(self) -> None:
        """A second passes in which nothing arrives."""
        self.seconds += 1
        if self.seconds > MAX_SECONDS:
            waits = {name: each.awaited for name, each in sorted(self._members.items())}
            raise Hangs(f"it hangs in frame {self.algorithm.frame}; awaited regions: {waits}")
        for name, member in self._members.items():
            self.links.up[name] += member.a_second_later()

    # --- notices ---

    def fixed(self, notice: s.Fixed) -> None:
        """Write the outside events of a frame into the journal."""
        self._journal.waiting(self.algorithm.ordered)

    def ready(self, notice: s.Ready) -> None:
        """Note that the next frame may begin."""
        self._is_ready = True

    def frame_done(self, notice: s.FrameDone) -> None:
        """Keep the frame."""
        assert notice.inputs is not None
        self._journal.frame(notice.inputs)
        # The digest is that of the present string.
        digest = notice.record.digest.hex()
        self.done.append(DoneFrame(notice.frame, tuple(notice.events), digest))
