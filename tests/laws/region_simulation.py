"""Regions that run in any order, with messages that are lost, repeated and reordered, and kills."""

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain
from random import Random

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import World
from minerva_bus.grammar.batch import single
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.launch.regions.for_all import packed_for_all, unpacked_for_all
from minerva_bus.regions.dividing import cut
from minerva_bus.regions.merging import Merger, in_order, merged
from minerva_bus.regions.messages import from_message, packed_pairs, sources_in, to_message
from minerva_bus.regions.outbox import Outbox
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.part import PartReceiver, PartSender
from minerva_bus.regions.progress import RegionsGoal
from minerva_bus.regions.region import Region
from minerva_bus.regions.schedule import Schedule
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.wire.codec import Decoder, encode


def begin(runner, events):
    """Run one frame with these events of a generator."""
    runner.algorithm.inbox.replace({"generator": events} if events else {})
    runner.handle(s.Begin())


def digests_of_one(world, frames, members):
    algorithm = FrameAlgorithm(world)
    runner = InProcessRunner(algorithm, members())
    runner.start()
    digests = []
    for events in frames:
        if runner.ended:
            break
        begin(runner, events)
        digests.append(state(algorithm.scene, algorithm.inbox.emitted))
    return digests


def state(scene, emitted):
    """What has to be equal after a frame: the string, and the events that agents have sent."""
    # The order of types is that of a frame's collection.
    events = sorted(single(emitted), key=lambda event: event.type)
    return scene.digest, [(str(event), event.sender) for event in events]


def exchanged(regions):
    """End a frame of regions that run one after another; returns the digest of their string."""
    digest = merged([region.units for region in regions]).scene.digest
    parcels = [parcel for region in regions for parcel in region.leave()]
    for region in regions:
        to_it = [parcel for parcel in parcels if parcel.target == region.number]
        region.expect({region.frame - 1: [parcel.source for parcel in to_it]})
    for parcel in parcels:
        regions[parcel.target].receive(parcel)
    return digest


class Process:
    """A region with its members, which can be killed: then its journal is all that remains.

    That is its last checkpoint, if it has `saved` one, and what has arrived since then.
    """

    def __init__(self, regions, number, journal=(), saved=None):
        self.regions = regions
        self.journal = list(journal)
        self.saved = saved
        # Others have what the former process has sent, or request it.
        self.repeats = bool(journal or saved)
        members = regions.members()
        first = regions.partitions[0]
        region = Region(regions.world, number, first, members, ahead=regions.schedule.ahead)
        self.outbox = Outbox()
        self.sent = []
        self.parts = PartSender()
        self.begin(region, members)
        if saved is not None:
            self.restore(saved)
        for message in journal:
            self.advance_all()
            self.region.receive(message)
        if self.repeats:
            self.advance_all()
            self.repeats = False

    def begin(self, region, members):
        self.region = region
        region.services.send = self.send
        deliver = region.services.deliver
        self.runner = InProcessRunner(region.algorithm, members, deliver=deliver)
        self.runner.start()

    def save(self):
        """Replace the journal by what another process needs to continue before this frame."""
        region = self.region
        checkpoint = RegionCheckpoint.of(region, []).encoded()
        kept = [each for to in range(region.partition.count) for each in self.outbox.kept_for(to)]
        self.saved, self.journal = (checkpoint, region.partition, region.arrived, kept), []

    def restore(self, saved):
        checkpoint, partition, arrived, kept = saved
        regions, members = self.regions, self.regions.members()
        number, ahead = self.region.number, regions.schedule.ahead
        decoded = RegionCheckpoint.decoded(checkpoint)
        self.begin(decoded.region(regions.world, number, partition, members, ahead), members)
        self.outbox = Outbox()
        self.outbox.keep(kept)
        for message in arrived:
            self.region.receive(message)

    def send(self, messages):
        self.regions.check_sanctions(messages)
        self.outbox.keep(messages)
        if not self.repeats:
            self.sent += messages

    def receive(self, message):
        if self.region.receive(message):
            self.journal.append(message)

    def advance_all(self):
        while self.advance():
            pass

    def advance(self):
        """Run one frame if everything for it has arrived."""
        region, regions = self.region, self.regions
        frame = region.frame
        if frame not in regions.requests:
            return False
        self.outbox.acknowledge(frame - 2 * region.schedule.ahead)
        region.expect(regions.requests[frame][region.number])
        if region.missing:
            return False
        region.enter(lambda: regions.for_all[frame - 1])
        if region.missing:
            return False
        if not self.repeats and regions.chance.random() < regions.checkpoints:
            self.save()
            if not regions.kills or regions.chance.random() < 0.5:
                self.restore(self.saved)
                region = self.region
        events = {"generator": tuple(regions.frames[frame])} if regions.frames[frame] else {}
        region.give(m.RegionRequest(frame, (), events), again=self.repeats)
        self.runner.handle(s.Begin())
        units, sent, progress = region.units, region.sent, region.progress()
        region.partition = regions.partitions[(frame + 1) % len(regions.partitions)]
        parcels = region.leave()
        self.send(parcels)
        targets = [parcel.target for parcel in parcels]
        for_all = packed_for_all(region)
        message = self.parts.message(frame, units, sent, progress, targets, b"", for_all=for_all)
        regions.report(frame, region.number, message, progress)
        return True


@dataclass
class Regions:
    """`members` makes the members of one region; `kills` is the probability of a kill per turn.

    `checkpoints` is the probability of a checkpoint before a frame, with which the region itself
    continues, too: always without kills, and else in half of the cases.
    """

    world: World
    frames: list
    partitions: list
    chance: Random
    members: object
    kills: float = 0.0
    checkpoints: float = 0.0
    ahead: int = 0
    killed: int = 0
    messages: list = field(default_factory=list)
    parts: list = field(default_factory=list)
    reports: dict = field(default_factory=lambda: defaultdict(dict))
    progress: dict = field(default_factory=lambda: defaultdict(list))
    requests: dict = field(default_factory=dict)
    done: int = 0
    targets: dict = field(default_factory=lambda: defaultdict(dict))
    for_all: dict = field(default_factory=lambda: defaultdict(list))
    schedule: Schedule = field(default_factory=Schedule)
    parcels: int = 0
    sanctions: int = 0
    end: tuple = ()

    def digests(self):
        count, chance = self.partitions[0].count, self.chance
        self.decoder = Decoder(self.world.vocabulary)
        self.parts = [PartReceiver(part) for part in cut(self.world.scene, self.partitions[0])]
        self.processes = [Process(self, number) for number in range(count)]
        self.request()
        while self.goes_on():
            number = chance.randrange(count)
            if chance.random() < self.kills:
                self.killed += 1
                killed = self.processes[number]
                self.processes[number] = Process(self, number, killed.journal, killed.saved)
            self.processes[number].advance()
            frames = [process.region.frame for process in self.processes]
            self.ahead = max(self.ahead, max(frames) - min(frames))
            self.deliver()
        merger = Merger()
        return [
            state(
                merger.merge(units for units, _ in parts).scene,
                in_order(chain(*(sent for _, sent in parts))),
            )
            for parts in ([*self.reports[frame].values()] for frame in range(self.done))
        ]

    def goes_on(self):
        """Request frames when all regions have reported an earlier one, unless the world ends."""
        reports = self.reports[self.done]
        if len(reports) < len(self.parts):
            return True
        self.done += 1
        ending = RegionsGoal(
            self.world, [Composition(merged(u for u, _ in reports.values()).scene)]
        )
        for frame in range(self.done):
            ending.learn(self.progress[frame])
        if reason := ending.why_over(self.done):
            self.end = reason, ending.reached, self.done
        if reason or self.done == len(self.frames):
            return False
        self.request()
        return True

    def request(self):
        """Request the frames that can run before the next one is done, with earlier parcels."""
        last = min(self.schedule.last(self.done), len(self.frames) - 1)
        for frame in range(len(self.requests), last + 1):
            numbers = range(len(self.parts))
            new = [
                (past, packed_pairs(self.targets[past].get(each, ()) for each in numbers))
                for past in self.schedule.new(frame)
            ]
            self.requests[frame] = [
                {past: sources_in(pairs, number) for past, pairs in new} for number in numbers
            ]

    def report(self, frame, number, message, progress):
        """Send the changes of a region's part to the coordinator, which assembles the string."""
        if number not in self.reports[frame]:  # Otherwise a new process repeats the frame.
            receiver = self.parts[number]
            receiver.apply(self.decoder.part(encode(message)))
            self.reports[frame][number] = receiver.units, receiver.sent
            self.progress[frame].append(progress)
            self.targets[frame][number] = receiver.targets
            self.for_all[frame] += unpacked_for_all(self.decoder, receiver.for_all, number, frame)
            self.parcels += len(receiver.targets)

    def deliver(self):
        chance = self.chance
        for process in self.processes:
            self.messages += process.sent
            process.sent = []
        for _ in range(chance.randrange(len(self.messages) + 1)):
            message = chance.choice(self.messages)
            if chance.random() < 0.8:  # Otherwise it arrives once more.
                self.messages.remove(message)
            if chance.random() < 0.1:
                continue  # It is lost.
            received = self.decoder.parcel(encode(to_message(message)))
            arrived = from_message(received, message.source, message.target)
            self.processes[message.target].receive(arrived)
        if chance.random() < 0.2:  # A link that was cut is there again.
            self.send_again(chance.choice(self.processes), chance.choice(self.processes))

    def check_sanctions(self, messages):
        """Sanctions are for agents, which stay in their region unless agents can move."""
        for message in messages:
            if isinstance(message, Parcel) and not self.schedule.waits(message.frame + 1):
                assert message.target == message.source or not message.norms.sanctions
                self.sanctions += len(message.norms.sanctions)

    def send_again(self, source, target):
        kept = source.outbox.kept_for(target.region.number)
        assert len(kept) <= 9 + 4 * self.schedule.ahead
        self.messages += kept
