"""Laws of regions: together they have the string of a single coordinator in every frame."""

from collections import defaultdict
from dataclasses import dataclass, field
from functools import cache
from random import Random
from zlib import crc32

import hypothesis.strategies as st
import nomads
import pytest
from hypothesis import HealthCheck, given, settings

from minerva_bus.errors import WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.grammar.batch import single
from minerva_bus.grammar.columns import packed
from minerva_bus.grammar.scene import Scene
from minerva_bus.regions.merging import in_order, merged
from minerva_bus.regions.messages import from_message, to_message
from minerva_bus.regions.outbox import Outbox
from minerva_bus.regions.part import PartReceiver, PartSender
from minerva_bus.regions.partition import ByFunction, ById, ByPosition
from minerva_bus.regions.region import Region, cut
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.testing.family import (
    FAMILY,
    FAMILY_VOCABULARY,
    Caller,
    Mortal,
    Parent,
    Walker,
    eHit,
)
from minerva_bus.testing.strategies import family_events, family_strings, with_unique_ids
from minerva_bus.wire.codec import Decoder, encode

NEIGHBOURS = 40  # enough neighbours of one kind to be held in columns


def population(kind):
    nodes = [node for n in range(NEIGHBOURS) for node in kind(f"population{n}").string.nodes]
    return packed(Scene(tuple(nodes)))


def restless(name, state):
    """A region that changes with nearly every change of an agent."""
    return crc32(f"{name}{state}".encode()) % 4


PARTITIONS = {
    1: [ById(1)],
    2: [ById(2), ByPosition((0.5,))],
    4: [ById(4), ByPosition((0.5,), (2.5,), ("x", "energy")), ByFunction(4, restless)],
    9: [ById(9), ByPosition((0.0, 1.0), (1.0, 2.0), ("x", "energy"))],
    16: [ById(16), ByPosition((-1.0, 0.0, 1.0), (1.0, 2.0, 3.0), ("x", "energy"))],
}
strings = st.tuples(
    family_strings(),
    st.sampled_from([Scene(), *map(population, (Walker, Parent, Caller))]),
    family_strings(),
).map(lambda parts: FAMILY_VOCABULARY.check(joined(parts)))


def joined(parts):
    first, middle, last = parts
    # Drawn ids are shorter than those of populations.
    pieces = with_unique_ids(first + last).pieces
    cut = len(first.pieces)
    return Scene((*pieces[:cut], *middle.pieces, *pieces[cut:]))


def members(world):
    kinds = FAMILY if world.vocabulary is FAMILY_VOCABULARY else nomads.KINDS
    return [Member("hosts", None, kinds)]


def begin(runner, events):
    """Run one frame with these events of a generator."""
    runner.algorithm.inbox.replace({"generator": events})
    runner.handle(s.Begin())


def digests_of_one(world, frames):
    algorithm = FrameAlgorithm(world)
    runner = InProcessRunner(algorithm, members(world))
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


@dataclass
class Regions:
    """Regions that run in any order, with parcels that arrive in any order and repeatedly."""

    world: World
    frames: list
    partitions: list
    chance: Random
    ahead: int = 0
    parcels: list = field(default_factory=list)
    units: dict = field(default_factory=dict)
    ends: list = field(default_factory=list)
    outboxes: dict = field(default_factory=lambda: defaultdict(Outbox))
    parts: list = field(default_factory=list)
    sent: dict = field(default_factory=dict)

    def digests(self):
        first = self.partitions[0]
        self.parts = [(PartSender(), PartReceiver(part)) for part in cut(self.world.scene, first)]
        runners = {}
        for number in range(first.count):
            region = Region(self.world, number, first)
            runners[number] = region, InProcessRunner(region.algorithm, members(self.world))
            runners[number][1].start()
        while any(self.goes_on(region) for region, _ in runners.values()):
            region, runner = runners[self.chance.randrange(first.count)]
            if self.goes_on(region) and not region.missing:
                self.advance(region, runner)
            numbers = [region.frame for region, _ in runners.values()]
            self.ahead = max(self.ahead, max(numbers) - min(numbers))
            self.deliver(runners)
        return [
            state(merged(units).scene, in_order(self.sent[frame]))
            for frame, units in sorted(self.units.items())
        ]

    def goes_on(self, region):
        return region.frame < len(self.frames) and not region.over

    def advance(self, region, runner):
        frame = region.frame
        region.enter()
        if region.over:
            self.ends.append((region.over, region.reached, frame))
            return
        begin(runner, self.frames[frame])
        self.report(region, frame)
        region.partition = self.partitions[(frame + 1) % len(self.partitions)]
        parcels = region.leave()
        self.outboxes[region.number].keep(parcels)
        self.parcels += parcels

    def report(self, region, frame):
        """Send the changes of a region's part to the coordinator, which assembles the string."""
        sender, receiver = self.parts[region.number]
        message = sender.message(frame, region.units, region.sent, region.progress(), b"")
        receiver.apply(Decoder(self.world.vocabulary).part(encode(message)))
        self.units.setdefault(frame, []).append(receiver.units)
        self.sent.setdefault(frame, []).extend(receiver.sent)

    def deliver(self, runners):
        for _ in range(self.chance.randrange(len(self.parcels) + 1)):
            parcel = self.chance.choice(self.parcels)
            if self.chance.random() < 0.8:  # Otherwise it arrives once more.
                self.parcels.remove(parcel)
            if self.chance.random() < 0.1:
                continue  # It is lost.
            message = Decoder(self.world.vocabulary).parcel(encode(to_message(parcel)))
            arrived = from_message(message, parcel.source, parcel.target)
            runners[parcel.target][0].receive(arrived)
            self.outboxes[parcel.target].acknowledge(arrived)
        if self.chance.random() < 0.2:  # A link that was cut is there again.
            self.send_again(self.chance.choice([*runners]), self.chance.choice([*runners]))

    def send_again(self, source, target):
        kept = self.outboxes[source].kept_for(target)
        assert len(kept) <= 2
        self.parcels += kept


FRAMES = [[nomads.eStep(), nomads.eCall(value=n, receivers=["n1", "s2"])] for n in range(5)]


@cache
def nomads_of_one(seed):
    return digests_of_one(World("w", nomads.string(), nomads.VOCABULARY, seed=seed), FRAMES)


@pytest.mark.parametrize(("count", "seed"), [(4, 0), (9, 1), (16, 0)])
def test_regions_keep_births_deaths_calls_and_migration_in_order(count, seed):
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=seed)
    regions = Regions(world, FRAMES, PARTITIONS[count], Random(seed))
    assert regions.digests() == nomads_of_one(seed)
    assert regions.ahead == (count > 1)


@pytest.mark.parametrize("count", [2, 16])
def test_all_regions_end_in_the_frame_of_the_last_arrival(count):
    string = Scene(tuple(nomads.Pilgrim(f"p{n}", left=1 + n % 4).string.nodes[0] for n in range(9)))
    world = World("w", string, nomads.VOCABULARY, until="eArrive")
    regions = Regions(world, FRAMES, PARTITIONS[count], Random(count))
    regions.digests()
    assert regions.ends == [("every agent has sent eArrive", True, 4)] * count


def test_a_region_without_agents_goes_on_until_all_are_empty():
    world = World("w", Scene(), nomads.VOCABULARY)
    regions = Regions(world, FRAMES, [ById(2)], Random(0))
    regions.digests()
    assert regions.ends == [("the string is empty", False, 1)] * 2


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    strings.flatmap(
        lambda w: st.tuples(st.just(w), st.lists(family_events(w), min_size=2, max_size=4))
    ),
    st.sampled_from(sorted(PARTITIONS)).flatmap(lambda count: st.permutations(PARTITIONS[count])),
    st.integers(0, 99),
)
def test_regions_have_the_string_of_one_coordinator_in_every_frame(case, partitions, seed):
    w, frames = case
    world = World("w", w, FAMILY_VOCABULARY, seed=seed)
    regions = Regions(world, frames, partitions, Random(seed))
    assert regions.digests() == digests_of_one(world, frames)
    assert regions.ahead <= 1


def test_a_node_without_an_author_is_refused_in_columns():
    world = World("w", population(Mortal), FAMILY_VOCABULARY)
    region = Region(world, 0, ById(1))
    runner = InProcessRunner(region.algorithm, members(world))
    runner.start()
    region.enter()
    with pytest.raises(WorldStopped, match="AMortal, held in columns"):
        begin(runner, [eHit(amount=2.0, receivers=["population3"])])
