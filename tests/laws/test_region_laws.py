"""Laws of regions: together they have the string of a single coordinator in every frame."""

from collections import Counter
from dataclasses import replace
from functools import cache
from random import Random
from types import SimpleNamespace
from typing import Any
from zlib import crc32

import hypothesis.strategies as st
import nomads
import pytest
from hypothesis import HealthCheck, given, settings
from region_simulation import Regions, begin, digests_of_one, exchanged

from minerva_bus.errors import WorldStopped
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.description import World
from minerva_bus.frame.lag import saved_strays
from minerva_bus.frame.member import Member
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import AgentNode, Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.rejections import rejected_events
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.partition import ByFunction, ById, ByPosition
from minerva_bus.regions.region import Region
from minerva_bus.regions.schedule import Schedule
from minerva_bus.regions.tree import ByTree, Split
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
from minerva_bus.world.marking import on
from minerva_bus.world.norms import Norm, Then

NEIGHBOURS = 40  # enough neighbours of one kind to be held in columns


def population(kind):
    nodes = [node for n in range(NEIGHBOURS) for node in kind(f"population{n}").string.nodes]
    return packed(Scene(tuple(nodes)))


def restless(name, state):
    """A region that changes with nearly every change of an agent."""
    return crc32(f"{name}{state}".encode()) % 4


TREE = Split(
    "x",
    0.0,
    Split("energy", 2.0, Split("x", -1.0), Split("x", -2.0)),
    Split("energy", 1.0, Split("x", 1.0), Split("x", 1.5, above=Split("energy", 2.0))),
)
PARTITIONS = {
    1: [ById(1)],
    2: [ById(2), ByPosition((0.5,))],
    4: [ById(4), ByPosition((0.5,), (2.5,), ("x", "energy")), ByFunction(4, restless)],
    9: [ById(9), ByPosition((0.0, 1.0), (1.0, 2.0), ("x", "energy")), ByTree(TREE)],
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


def nomad_hosts():
    return [Member("hosts", None, nomads.KINDS)]


def family_hosts():
    return [Member("hosts", None, FAMILY)]


FRAMES = [[nomads.eStep(), nomads.eCall(value=n, receivers=["n1", "s2"])] for n in range(5)]


@cache
def nomads_of_one(seed):
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=seed)
    return digests_of_one(world, FRAMES, nomad_hosts)


@pytest.mark.parametrize(
    ("count", "seed"), [(4, 0), (9, 1), pytest.param(16, 0, marks=pytest.mark.slow)]
)
def test_regions_keep_births_deaths_calls_and_migration_in_order(count, seed):
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=seed)
    regions = Regions(world, FRAMES, PARTITIONS[count], Random(seed), nomad_hosts, 0.005)
    assert regions.digests() == nomads_of_one(seed)
    assert regions.ahead == (count > 1)


@pytest.mark.parametrize(
    "partition",
    [
        ByPosition((-1.0, 0.0, 1.0), by_condition=True),
        ByPosition((-2.0, 2.0), (-1.0, 1.0), by_condition=True),
        ByTree(Split("x", 0.0, Split("x", -1.0), Split("x", 1.0)), by_condition=True),
    ],
)
def test_events_reach_only_the_regions_where_their_condition_can_hold(partition):
    settlers = [
        node for n in range(60) for node in nomads.Settler(f"s{n}", x=n % 9 - 4.0).string.nodes
    ]
    world = World("w", packed(Scene(tuple(settlers))), nomads.VOCABULARY, seed=3)
    regions = Regions(world, FRAMES, [partition], Random(0), nomad_hosts)
    assert regions.digests() == digests_of_one(world, FRAMES, nomad_hosts)


LAG_FRAMES = [*FRAMES, *FRAMES[:2]]


@pytest.mark.parametrize(
    ("partition", "frames", "every"),
    [
        (PARTITIONS[4][1], 1, 3),
        (ByPosition((0.5,)), 3, 1),
        (ById(2), 3, 4),
        (ByPosition((0.5,)), 3, 9),
        *(pytest.param(each, 1, 1, marks=pytest.mark.slow) for each in PARTITIONS[9]),
        *(pytest.param(each, 3, 4, marks=pytest.mark.slow) for each in PARTITIONS[9]),
    ],
)
def test_a_lag_is_that_of_one_coordinator(partition, frames, every):
    """With restarts from a checkpoint, or kills, and agents that move while events wait for them."""
    lag = RegionLag(frames, partition, every)
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=1, lag=lag)
    kills = 0.01 if frames == 1 else 0.0
    schedule = Schedule(every, min(frames, every - 1))
    regions = Regions(
        world,
        LAG_FRAMES,
        [partition],
        Random(4),
        nomad_hosts,
        kills,
        checkpoints=not kills,
        schedule=schedule,
    )
    # One coordinator adds older events to those of the last frame.
    strings = [digest for digest, _ in regions.digests()]
    assert strings == [digest for digest, _ in digests_of_one(world, LAG_FRAMES, nomad_hosts)]
    assert strings[2:5] != [digest for digest, _ in nomads_of_one(1)][2:]
    assert 1 <= regions.ahead <= schedule.ahead + 1


class Mother(nomads.Settler, symbol="AMother"):
    @on("eStep")
    def act(self, step, moment):
        self.x += moment.chance.uniform(-1.0, 1.0)
        child = self.child(x=self.x)
        (newborn,) = child.nodes
        assert isinstance(newborn, AgentNode)
        moment.emit(nomads.eCall(value=50, receivers=[newborn.id]))
        return self.string + child


def test_an_event_follows_a_newborn_that_moves_while_it_waits():
    mothers = Scene(tuple(Mother(f"m{n}").string.nodes[0] for n in range(3)))
    partition = ByPosition((0.0,))
    vocabulary = Vocabulary.of(nomads.eStep, nomads.eCall, Mother)
    world = World("w", mothers, vocabulary, lag=RegionLag(1, partition))
    frames = [[nomads.eStep()]] * 5

    def hosts():
        return [Member("hosts", None, (Mother,))]

    regions = Regions(world, frames, [partition], Random(0), hosts)
    strings = [digest for digest, _ in regions.digests()]
    assert strings == [digest for digest, _ in digests_of_one(world, frames, hosts)]


@pytest.mark.parametrize("every", [1, 5])
def test_a_lag_continues_with_regions_from_the_checkpoint_of_one_coordinator(every):
    """Agents have moved, and others have been born, since they could change regions."""
    partition = ByPosition((0.5,))
    lag = RegionLag(2, partition, every)
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=1, lag=lag)
    algorithm = FrameAlgorithm(world)
    runner = InProcessRunner(algorithm, nomad_hosts())
    runner.start()
    for events in LAG_FRAMES[:3]:
        begin(runner, events)
    assert any(source[1:].isdecimal() for source in algorithm.checkpoint.inbox)
    assert bool(saved_strays(algorithm.checkpoint.saved)) == (every > 1)
    past = replace(world, scene=algorithm.scene, past=algorithm.checkpoint)
    regions = [Region(past, number, partition) for number in range(2)]
    runners = [InProcessRunner(each.algorithm, nomad_hosts()) for each in regions]
    for each in runners:
        each.start()
    for events in LAG_FRAMES[3:]:
        for_all = [event for region in regions for event in region.for_all]
        for region, each in zip(regions, runners, strict=True):
            region.enter(for_all.copy)
            begin(each, events)
        begin(runner, events)
        assert exchanged(regions) == algorithm.scene.digest


def test_regions_send_nothing_where_there_is_nothing():
    world = World("w", nomads.string(), nomads.VOCABULARY)
    sent = []
    for events in ([], [nomads.eStep()]):
        regions = Regions(world, [events] * 3, [ById(4)], Random(0), nomad_hosts)
        regions.digests()
        sent.append(regions.parcels)
    to_themselves = 4 * 3
    assert sent[1] > sent[0] == to_themselves


def test_reach_by_condition_finds_no_agents_within_others():
    world = World("w", nomads.string(), nomads.VOCABULARY)
    partition = ByPosition((0.0,), by_condition=True)
    regions = Regions(world, FRAMES, [partition], Random(0), nomad_hosts)
    with pytest.raises(WorldStopped, match='expected a string without them, or reach = "every'):
        regions.digests()


NORMS = (
    Norm("far", when="x > 1 and was.x > 0", most=1, per=4, sanction=nomads.eCall(value=5)),
    Norm("beside", when="#n0.x > -2.5 and y < 0", then=Then.SANCTION, sanction=nomads.eCall(value=7)),
    Norm("loud", on=("eCall",), when="event.value > 40", most=1, per=3,
         sanction=nomads.eCall(value=9)),
)  # fmt: skip


@pytest.mark.parametrize(
    ("count", "seed", "checkpoints"),
    [(4, 0, True), (9, 1, False), pytest.param(16, 1, False, marks=pytest.mark.slow)],
)
def test_norms_reject_the_same_acts_in_regions(count, seed, checkpoints):
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=seed, norms=NORMS)
    kills = 0.0 if checkpoints else 0.005
    regions = Regions(
        world, FRAMES, PARTITIONS[count], Random(seed), nomad_hosts, kills, checkpoints
    )
    # Regions judge events when they are sent, one coordinator when the next frame begins.
    strings = [digest for digest, _ in regions.digests()]
    assert strings == [digest for digest, _ in digests_of_one(world, FRAMES, nomad_hosts)]
    assert strings != [digest for digest, _ in nomads_of_one(seed)]
    broken = broken_in(regions)
    assert broken == broken_in_one(world, FRAMES)
    assert set(broken) == {"far", "beside", "loud"}


def broken_in(regions):
    broken = Counter()
    for process in regions.processes:
        process.region.end()
        broken.update(process.region.algorithm.norms.broken)
    return broken


def broken_in_one(world, frames):
    runner = InProcessRunner(FrameAlgorithm(world), nomad_hosts())
    runner.start()
    for events in frames:
        begin(runner, events)
    return runner.algorithm.norms.broken


OWN_NORMS = (
    NORMS[0],
    Norm("below", when="y < 0", then=Then.SANCTION, sanction=nomads.eCall(value=7)),
)


@pytest.mark.parametrize("checkpoints", [True, False])
def test_regions_run_ahead_under_norms_on_what_agents_are(checkpoints):
    partition = ByPosition((0.5,))
    lag = RegionLag(2, partition, 3)
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=1, norms=OWN_NORMS, lag=lag)
    kills = 0.0 if checkpoints else 0.01
    regions = Regions(
        world, LAG_FRAMES, [partition], Random(5), nomad_hosts, kills, checkpoints,
        schedule=Schedule.of(lag, 2),
    )  # fmt: skip
    strings = [digest for digest, _ in regions.digests()]
    assert strings == [digest for digest, _ in digests_of_one(world, LAG_FRAMES, nomad_hosts)]
    assert regions.ahead > 1
    assert broken_in(regions) == broken_in_one(world, LAG_FRAMES)
    assert set(broken_in(regions)) == {"far", "below"}
    assert regions.sanctions


ACT_NORMS = (
    NORMS[0],
    Norm("loud", on=("eCall",), when="event.value > 40 and x > -1", most=1, per=3,
         sanction=nomads.eCall(value=9)),
    Norm("low", on=("eCall",), when="event.value < 10", then=Then.SANCTION,
         sanction=nomads.eCall(value=70)),
)  # fmt: skip


@pytest.mark.parametrize(
    ("partition", "frames", "every", "seed"),
    [
        (ByPosition((0.5,)), 2, 3, 1),
        (PARTITIONS[4][1], 1, 1, 2),
        (PARTITIONS[9][2], 2, 2, 3),
        *(pytest.param(PARTITIONS[9][1], 3, 4, seed, marks=pytest.mark.slow) for seed in range(9)),
    ],
)
def test_norms_judge_acts_that_count_later_when_they_are_sent(partition, frames, every, seed):
    lag = RegionLag(frames, partition, every)
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=seed, norms=ACT_NORMS, lag=lag)
    kills = 0.0 if seed % 2 else 0.01
    schedule = Schedule.of(lag, min(frames, every - 1))
    regions = Regions(
        world, LAG_FRAMES, [partition], Random(seed), nomad_hosts, kills, not kills,
        schedule=schedule,
    )  # fmt: skip
    strings = [digest for digest, _ in regions.digests()]
    assert strings == [digest for digest, _ in digests_of_one(world, LAG_FRAMES, nomad_hosts)]
    free = replace(world, norms=ACT_NORMS[:1])
    assert strings != [digest for digest, _ in digests_of_one(free, LAG_FRAMES, nomad_hosts)]
    assert broken_in(regions) == broken_in_one(world, LAG_FRAMES)
    assert set(broken_in(regions)) == {"far", "loud", "low"}


class Herald(nomads.Settler, symbol="AHerald"):
    """Calls across the border first, then to itself; a norm permits one of both."""

    @on("eStep")
    def act(self, step, moment):
        for receiver in ("west" if self.id == "east" else "east", self.id):
            moment.emit(nomads.eCall(value=50 + moment.number, receivers=[receiver]))


def test_norms_judge_acts_that_stay_in_a_region_before_others():
    partition, norm = ByPosition((0.0,)), Norm("once", on=("eCall",), most=1, per=1)
    heralds = [*Herald("east", x=1.0).string.nodes, *Herald("west", x=-1.0).string.nodes]
    vocabulary = Vocabulary.of(nomads.eStep, nomads.eCall, Herald)
    lag = RegionLag(2, partition)
    world = World("w", Scene(tuple(heralds)), vocabulary, norms=(norm,), lag=lag)
    frames = [[nomads.eStep()]] * 5

    def hosts():
        return [Member("hosts", None, (Herald,))]

    regions = Regions(world, frames, [partition], Random(0), hosts)
    strings = [digest for digest, _ in regions.digests()]
    assert strings == [digest for digest, _ in digests_of_one(world, frames, hosts)]
    heard = {
        agent.state["heard"]
        for each in regions.processes
        for agent in agents(each.region.units.scene)
    }
    assert heard == {(((50 * 31 + 51) * 31 + 52) * 31 + 53) % 100_003}


def test_rejected_acts_that_would_count_later_are_explained():
    norm = Norm("loud", on=("eCall",), when="event.value > 40")
    calls = [nomads.eCall(value=value, receivers=["s1"]) for value in (30, 50)]
    sent = tuple(replace(call, sender="s0") for call in calls)
    lag = RegionLag(2, ByPosition((0.5,)))
    world = World("w", nomads.string(), nomads.VOCABULARY, norms=(norm,), lag=lag)
    past = SimpleNamespace(
        frame=SimpleNamespace(number=5, events=(), inputs=None), before=world.scene, people=(),
        checkpoint=Checkpoint(5, inbox={"#6": sent, "#7": sent}),
    )  # fmt: skip
    assert [*rejected_events(world, past, "s0")] == [
        "frame 5: the norm loud rejected eCall<value=50> from #s0 to #s1, sent by #s0"
    ]


@pytest.mark.parametrize("norms", [(), ACT_NORMS])
def test_acts_are_judged_once_if_a_run_continues(norms):
    partition = ByPosition((0.5,))
    lag = RegionLag(2, partition, 3)
    world = World("w", nomads.string(), nomads.VOCABULARY, seed=1, norms=norms, lag=lag)
    runner = InProcessRunner(FrameAlgorithm(world), nomad_hosts())
    runner.start()
    for events in LAG_FRAMES[:4]:
        begin(runner, events)
    algorithm = runner.algorithm
    past = replace(world, scene=algorithm.scene, past=algorithm.checkpoint)
    again = InProcessRunner(FrameAlgorithm(past), nomad_hosts())
    again.start()
    regions = [Region(past, number, partition) for number in range(2)]
    runners = [InProcessRunner(each.algorithm, nomad_hosts()) for each in regions]
    for each in runners:
        each.start()
    for events in LAG_FRAMES[4:]:
        for_all = [event for region in regions for event in region.for_all]
        for region, each in zip(regions, runners, strict=True):
            region.enter(for_all.copy)
            begin(each, events)
        begin(runner, events)
        begin(again, events)
        assert exchanged(regions) == again.algorithm.scene.digest == algorithm.scene.digest
    assert algorithm.norms.broken == again.algorithm.norms.broken
    for region in regions:
        region.end()
    broken = sum((Counter(each.algorithm.norms.broken) for each in regions), Counter())
    assert broken == algorithm.norms.broken


@pytest.mark.parametrize("count", [2, 16])
def test_all_regions_end_in_the_frame_of_the_last_arrival(count):
    string = Scene(tuple(nomads.Pilgrim(f"p{n}", left=1 + n % 4).string.nodes[0] for n in range(9)))
    world = World("w", string, nomads.VOCABULARY, until="eArrive")
    regions = Regions(world, FRAMES, PARTITIONS[count], Random(count), nomad_hosts)
    regions.digests()
    assert regions.end == ("every agent has sent eArrive", True, 4)


@pytest.mark.parametrize("count", [2, 16])
@pytest.mark.parametrize("last", [1, 4])
def test_all_regions_end_when_the_last_agents_have_given_up(count, last):
    """p0 gives up after its arrival, p1 and p2 before it, p3 for good."""
    ages = [(1, 2), (2, 1), (3, 1), (9, last)]
    string = Scene(
        tuple(
            nomads.Pilgrim(f"p{n}", left=left, strength=strength).string.nodes[0]
            for n, (left, strength) in enumerate(ages)
        )
    )
    world = World("w", string, nomads.VOCABULARY, until="eArrive", give_up="eTire")
    algorithm = FrameAlgorithm(world)
    runner = InProcessRunner(algorithm, nomad_hosts())
    runner.start()
    while runner.ended is None:
        begin(runner, FRAMES[0])
    regions = Regions(world, FRAMES, PARTITIONS[count], Random(count), nomad_hosts)
    regions.digests()
    assert regions.end == (runner.ended.reason, False, algorithm.frame)


def test_a_region_without_agents_goes_on_until_all_are_empty():
    world = World("w", Scene(), nomads.VOCABULARY)
    regions = Regions(world, FRAMES, [ById(2)], Random(0), nomad_hosts)
    regions.digests()
    assert regions.end == ("the string is empty", False, 1)


CHECKS: Any = list(HealthCheck)


@settings(max_examples=20, deadline=None, suppress_health_check=CHECKS)
@given(
    strings.flatmap(
        lambda w: st.tuples(st.just(w), st.lists(family_events(w), min_size=2, max_size=4))
    ),
    st.sampled_from(sorted(PARTITIONS)).flatmap(lambda count: st.permutations(PARTITIONS[count])),
    st.integers(0, 99),
    st.integers(0, 2),
    st.integers(1, 4),
)
def test_regions_have_the_string_of_one_coordinator_in_every_frame(
    case, partitions, seed, lag, every
):
    w, frames = case
    schedule = Schedule(every, min(lag, every - 1)) if lag else Schedule()
    if lag:  # Borders stay where they are.
        partitions = partitions[:1]
    delay = RegionLag(lag, partitions[0], every) if lag else None
    world = World("w", w, FAMILY_VOCABULARY, seed=seed, lag=delay)
    regions = Regions(
        world, frames, partitions, Random(seed), family_hosts, 0.005, schedule=schedule
    )
    digests, single = regions.digests(), digests_of_one(world, frames, family_hosts)
    strings = [digest for digest, _ in digests], [digest for digest, _ in single]
    assert strings[0] == strings[1]
    assert lag or digests == single
    assert regions.ahead <= 1 + schedule.ahead


def test_a_node_without_an_author_is_refused_in_columns():
    world = World("w", population(Mortal), FAMILY_VOCABULARY)
    region = Region(world, 0, ById(1))
    runner = InProcessRunner(region.algorithm, family_hosts())
    runner.start()
    region.enter()
    with pytest.raises(WorldStopped, match="AMortal, held in columns"):
        begin(runner, [eHit(amount=2.0, receivers=["population3"])])
