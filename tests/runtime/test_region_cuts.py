"""Regions, their coordinator and the links between them in one process: losses, cuts and deaths."""

from collections import defaultdict, deque
from functools import partial
from random import Random

import pytest
from running import write_world

from minerva_bus import EventType, Metres
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch import region_journal
from minerva_bus.launch.in_process import members_of
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.region_journal import RegionJournal
from minerva_bus.launch.region_member import RegionMember
from minerva_bus.launch.region_process import in_regions, source_of
from minerva_bus.log.journal import Journal
from minerva_bus.log.journaled import read_journal, resume_from
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.region_links import ParcelArrived
from minerva_bus.runtime.runner import Runner, Sink
from minerva_bus.settings.overrides import Overrides

FRAMES = 25


class Cluster(Sink):
    """A world in regions whose messages arrive in any order, if the link between two regions is up.

    `disturb` is called before each delivery. `digests` and `orders` are by frame.
    """

    def __init__(self, file, disturb=lambda cluster: None):
        self.file = file
        self.disturb = disturb
        self.chance = Random(1)
        self.cuts = set()
        self.lost = self.seconds = 0
        self.is_ready = False
        self.digests = {}
        self.orders = {}
        self.members = {}
        self.deaths = []
        self.specs = {process.name: process for process in file.processes}
        self.parcels = []
        self.down = defaultdict(deque)
        self.up = defaultdict(deque)
        self.successions = []
        self.path = next(iter(self.specs.values())).journal.with_name("coordinator")
        self.coordinate(FrameAlgorithm(file.world, source_of(file)))
        for name in self.specs:
            self.start(name)

    def run(self):
        while self.runner.ended is None:
            if not self.algorithm.in_frame and self.chance.random() < 0.05:
                self.journal.rewrite()
            self.disturb(self)
            busy = [name for name in self.specs if self.down[name] or self.up[name]]
            if self.is_ready and self.chance.random() < 0.5:
                self.is_ready = False
                self.runner.handle(s.Begin())
            elif self.parcels and (not busy or self.chance.random() < 0.5):
                self.deliver(self.parcels.pop(self.chance.randrange(len(self.parcels))))
            elif busy:
                self.pass_on(self.chance.choice(busy))
            elif not self.is_ready:
                assert self.seconds < 1000, f"it hangs in frame {self.algorithm.frame}"
                self.a_second()
        return self.digests

    def start(self, name):
        """Start the process of a region; what the former one has received last is lost."""
        spec = self.specs[name]
        if name in self.members:
            self.deaths.append(self.algorithm.frame)
            self.runner.handle(s.Vanished(name))
        self.down[name].clear()
        self.up[name].clear()
        self.parcels = [each for each in self.parcels if each[1] != spec.number]
        send, journal = partial(self.parcel, spec.number), RegionJournal(spec.journal)
        self.members[name] = RegionMember(
            name, spec.world_file, spec.number, journal, send, lambda line: None
        )
        self.runner.handle(s.Appeared(name))
        for other in self.members.values():
            other.send_again([spec.number])

    def coordinate(self, algorithm):
        self.algorithm = algorithm
        self.runner = Runner(algorithm, self, [self])
        self.journal = Journal(self.path, len(self.successions), algorithm)

    def succeed(self):
        """Kill the coordinator; each region has received a part of its last messages."""
        self.successions.append(self.algorithm.frame)
        self.is_ready = False
        past = read_journal(self.path, self.file.world)
        algorithm = FrameAlgorithm(past.world, source_of(self.file))
        resume_from(past, algorithm, lambda done: None)
        self.coordinate(algorithm)
        for name in self.specs:
            self.up[name].clear()
            for _ in range(self.chance.randint(0, len(self.down[name]))):
                self.members[name].receive(self.down[name].popleft())
            self.down[name].clear()
            self.runner.handle(s.Appeared(name))

    def publish(self, event):
        self.runner.handle(s.Publish(event, "anna"))
        self.journal.waiting(self.algorithm.ordered)

    # --- links ---

    def parcel(self, source, target, data):
        if {source, target} in self.cuts:
            self.lost += 1
        else:
            self.parcels.append((source, target, data))

    def deliver(self, sent):
        source, target, data = sent
        name = f"region-{target}"
        self.up[name] += self.members[name].parcel(ParcelArrived(source, data))

    def restore(self):
        """Restore all links, which both sides notice."""
        restored, self.cuts = self.cuts, set()
        for a, b in map(tuple, restored):
            self.members[f"region-{a}"].send_again([b])
            self.members[f"region-{b}"].send_again([a])

    def a_second(self):
        self.seconds += 1
        for member in self.members.values():
            member.send_again(member.awaited)

    # --- the coordinator ---

    def pass_on(self, name):
        if self.down[name]:
            self.up[name] += self.members[name].receive(self.down[name].popleft())
        else:
            self.runner.handle(self.up[name].popleft())

    def send(self, to, message):
        for name in self.specs if to in (s.EVERYONE, s.TICKED) else (to,):
            self.down[name].append(message)
        return ()

    def ready(self, notice):
        self.is_ready = True

    def frame_done(self, notice):
        assert notice.frame not in self.digests
        self.journal.frame(notice.inputs)
        self.digests[notice.frame] = notice.record.digest
        for event in notice.events:
            if event.type == "eWish":
                self.orders.setdefault(notice.frame, []).append(event)


@pytest.fixture
def file(tmp_path):
    path = write_world(tmp_path, frames=FRAMES)
    return read_world_file(path, Overrides(regions=3))


def digests_of_one(file, orders):
    """The digests with one coordinator, if these orders count in these frames."""
    algorithm = FrameAlgorithm(file.world)
    runner, digests = InProcessRunner(algorithm, members_of(file)), {}
    runner.start()
    while runner.ended is None:
        for event in orders.get(algorithm.frame, ()):
            runner.handle(s.Publish(event, "anna"))
        frame = algorithm.frame
        runner.handle(s.Begin())
        digests[frame] = algorithm.scene.digest
    return digests


@pytest.mark.parametrize("seconds", [1, 10])
def test_a_cut_link_delays_regions_and_nothing_else(file, seconds):
    def disturb(cluster):
        if cluster.seconds == seconds:
            cluster.restore()
        elif not cluster.seconds and cluster.algorithm.frame == 5:
            cluster.cuts = {frozenset((0, 1)), frozenset((1, 2))}

    with in_regions(file) as regions:
        cluster = Cluster(regions, disturb)
        assert cluster.run() == digests_of_one(file, {})
    # In each direction two parcels at most are kept, which are repeated once a second.
    assert 4 <= cluster.lost <= 4 * 2 * (seconds + 1)


@pytest.mark.parametrize(("seed", "frames"), [(1, 200), (2, 3)])
def test_orders_count_once_whatever_dies_or_is_cut(file, seed, frames, monkeypatch):
    """A process that continues runs all frames again, or those since a checkpoint."""
    monkeypatch.setattr(region_journal, "CHECKPOINT_FRAMES", frames)
    chance, orders = Random(seed), []

    def disturb(cluster):
        if cluster.algorithm.in_frame and chance.random() < 0.02:
            cluster.cuts.add(frozenset(chance.sample(range(3), 2)))
        elif cluster.cuts and chance.random() < 0.05:
            cluster.restore()
        elif chance.random() < 0.02:
            cluster.start(f"region-{chance.randrange(3)}")
        elif chance.random() < 0.02:
            cluster.succeed()
        elif cluster.algorithm.frame and chance.random() < 0.02:
            orders.append(wish(len(orders), chance.choice("abcd")))
            cluster.publish(orders[-1])

    with in_regions(file) as regions:
        cluster = Cluster(regions, disturb)
        digests = cluster.run()
        entries = [next(RegionJournal(each.journal).read()) for each in regions.processes]
    assert len(cluster.deaths) > 1
    assert len(cluster.successions) > 1
    checkpoints = [entry.source == region_journal.CHECKPOINT for entry in entries]
    assert checkpoints == [frames < FRAMES] * 3
    counted = [event for _, events in sorted(cluster.orders.items()) for event in events]
    assert counted == orders[: len(counted)]
    assert len(counted) > 1
    assert digests == digests_of_one(file, cluster.orders)


def wish(number, receiver):
    return EventType("eWish", x=Metres, name=str)(x=number, name="hill", receivers=[receiver])
