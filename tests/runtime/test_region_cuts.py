"""Regions, their coordinator and the links between them in one process: losses, cuts and deaths."""

from dataclasses import replace
from itertools import islice
from random import Random

import msgpack
import pytest
from running import MEMBERS, here, write_world

from minerva_bus import EventType, Metres
from minerva_bus.errors import WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.in_process_parts import members_of
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.regions import journal as region_journal
from minerva_bus.launch.regions.layout import in_regions, region_elsewhere
from minerva_bus.launch.resuming import read_resumed
from minerva_bus.regions.journal import CHECKPOINT, JOURNAL, entries
from minerva_bus.regions.lag import RegionLag
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.settings.overrides import Overrides
from minerva_bus.testing.simulation.cluster import Cluster
from minerva_bus.world.norms import SOURCE

FRAMES = 25

GRID = """
[regions]
grid = { x = [0.5, 2.5] }
"""
"""Regions between which agents move, in parcels: regions by id send what all need in reports."""

WALKERS = " · ".join(f"AWalker#w{n}<x={n % 4}>" for n in range(24))


@pytest.fixture
def file(tmp_path):
    path = write_world(tmp_path, frames=FRAMES)
    return read_world_file(path, Overrides(regions=3))


def digests(cluster):
    return {frame.number: frame.digest for frame in cluster.done}


def orders_of(cluster):
    """The events of people, by frame."""
    wishes = {
        frame.number: [event for event in frame.events if event.type == "eWish"]
        for frame in cluster.done
    }
    return {number: events for number, events in wishes.items() if events}


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
        digests[frame] = algorithm.scene.digest.hex()
    return digests


@pytest.mark.parametrize("seconds", [1, 10])
def test_a_cut_link_delays_regions_and_nothing_else(tmp_path, seconds):
    path = write_world(tmp_path, MEMBERS + GRID, WALKERS, frames=FRAMES)
    file = read_world_file(path, Overrides())

    def disturb(cluster):
        if cluster.seconds == seconds:
            cluster.restore()
        elif not cluster.seconds and cluster.algorithm.frame == 5:
            cluster.links.cuts = {frozenset((0, 1)), frozenset((1, 2))}

    with in_regions(file) as regions:
        cluster = Cluster(regions, Random(1))
        cluster.run(disturb)
    assert digests(cluster) == digests_of_one(file, {})
    # In each direction three parcels at most are kept, which are repeated once a second.
    assert 4 <= cluster.links.lost <= 4 * 3 * (seconds + 1)


@pytest.mark.parametrize(
    ("seed", "frames", "kept", "lag", "every"),
    [
        (1, 200, False, 0, 1),
        (2, 3, False, 3, 9),
        (3, 200, True, 2, 5),
        (4, 3, True, 0, 1),
    ],
)
def test_orders_count_once_whatever_dies_or_is_cut(
    file, seed, frames, kept, lag, every, tmp_path, monkeypatch
):
    """Also if regions run ahead. A process that continues runs all frames again, or those since a checkpoint.

    A region has a file for its journal, or the coordinator keeps it: then the region also lacks
    what the report of its last frame had.
    """
    monkeypatch.setattr(region_journal, "MIN_CHECKPOINT_FRAMES", frames)
    chance, orders = Random(seed), []
    file = replace(file, bus=replace(file.bus, journal=str(tmp_path) if kept else ""))
    delay = RegionLag(lag, file.partition, every) if lag else None
    file = replace(file, world=replace(file.world, lag=delay))
    ahead = []

    def disturb(cluster):
        ahead.append(max(cluster.frames) - cluster.algorithm.frame)
        if cluster.algorithm.in_frame and chance.random() < 0.02:
            cluster.links.cuts.add(frozenset(chance.sample(range(3), 2)))
        elif cluster.links.cuts and chance.random() < 0.05:
            cluster.restore()
        elif chance.random() < 0.02:
            cluster.start(f"region-{chance.randrange(3)}")
        elif chance.random() < 0.02:
            cluster.succeed()
        elif cluster.algorithm.frame and chance.random() < 0.02:
            orders.append(wish(len(orders), chance.choice("abcd")))
            cluster.publish(orders[-1])

    with in_regions(file) as regions:
        cluster = Cluster(regions, Random(1))
        cluster.run(disturb)
        saved = cluster.algorithm.source.saved_for
        journals = [
            (saved(name) or {})[JOURNAL] if spec.journal is None else spec.journal.read_bytes()
            for name, spec in cluster.specs.items()
        ]
    assert max(ahead) == 1 + lag
    assert len(cluster.deaths) > 1
    assert len(cluster.successions) > 1
    checkpoints = [next(entries(journal))[0] == CHECKPOINT for journal in journals]
    assert checkpoints == [frames < FRAMES] * 3
    counted = [event for events in orders_of(cluster).values() for event in events]
    assert counted == orders[: len(counted)]
    assert len(counted) > 1
    assert digests(cluster) == digests_of_one(file, orders_of(cluster))


@pytest.mark.parametrize("name", ["parcel", "replies"])
@pytest.mark.parametrize("always", [False, True])
def test_nobody_waits_forever_for_what_came_with_an_earlier_frame(tmp_path, name, always):
    """It is ignored as a repetition; its sender then does not know that it is still needed."""
    members = MEMBERS + '[process.water]\nservice = "yard:Water"\n' + GRID
    file = read_world_file(write_world(tmp_path, members, WALKERS, frames=12), Overrides())
    wrong = []

    def forge(sender, target, data):
        message = msgpack.unpackb(data, ext_hook=msgpack.ExtType)
        if message[:2] == [name, 7] and (sender, target) == (0, 1) and (always or not wrong):
            message[1] = 5
            wrong.append(data)
        return msgpack.packb(message)

    with in_regions(file) as regions:
        cluster = Cluster(regions, Random(1))
        cluster.links.forge = forge
        if always:
            frame = 8 if name == "parcel" else 7
            with pytest.raises(WorldStopped, match=f"region 0 has sent no valid .* frame {frame}"):
                cluster.run()
            assert len(wrong) > 30
            return
        cluster.run()
    assert digests(cluster) == digests_of_one(file, {})
    assert len(wrong) == 1


def test_nobody_waits_forever_if_two_regions_wait_for_each_other(tmp_path):
    """Both have finished the same frame, so no parcel shows by itself that its receiver lacks one."""
    forged = set()

    def forge(sender, target, data):
        message = msgpack.unpackb(data, ext_hook=msgpack.ExtType)
        if message[:2] == ["parcel", 7] and {sender, target} == {1, 2}:
            message[1] = 5
            forged.add((sender, target))
        return msgpack.packb(message)

    path = write_world(tmp_path, MEMBERS + GRID, WALKERS, frames=12)
    with in_regions(read_world_file(path, Overrides())) as regions:
        cluster = Cluster(regions, Random(1))
        cluster.links.forge = forge
        with pytest.raises(WorldStopped, match=r"region . has sent no valid parcel for frame 8"):
            cluster.run()
    assert forged == {(1, 2), (2, 1)}


NORMS = """
[norm.loud]
on = "eCall"
when = "event.x > 1"
most = 1
per = 4
event = "eWish"
data = { x = 0.5, name = "quiet" }

[norm.still]
when = "x > was.x and x > 2"
most = 2
per = 40
"""
SERVICES = """
[process.water]
service = "yard:Water"

[process.eye]
service = "yard:Eye"
"""


def test_a_region_that_a_person_ends_says_which_views_its_services_have_not_seen(
    tmp_path, monkeypatch
):
    """They are behind a link that is cut, perhaps the reason for the end."""
    path = write_world(tmp_path, MEMBERS + SERVICES + GRID, WALKERS, frames=0)
    lines = []

    def disturb(cluster):
        parcels = cluster.links.parcels
        views = [each for each in parcels if each[:2] == (1, 0)]
        if cluster.algorithm.frame >= 5 and views and not cluster.links.cuts:
            cluster.links.cuts = {frozenset((0, 1))}
            cluster.links.parcels = [each for each in parcels if each not in views]
            for member in cluster.members.values():
                monkeypatch.setattr(member, "_log", lambda about, text, details: lines.append(text))
        elif cluster.seconds == 2 and not cluster.runner.algorithm.shutdown.reason:
            cluster.runner.handle(s.End("stopped by a person"))

    with in_regions(read_world_file(path, Overrides())) as regions:
        cluster = Cluster(regions, Random(1))
        cluster.run(disturb)
    assert cluster.seconds < 10
    assert cluster.runner.ended.reason == "stopped by a person"
    assert lines == [
        "region-0: its services have not seen the last views: nothing has arrived from region-1"
        " for 5 s"
    ]


VAIN = """
[norm.vain]
on = "eWish"
applies = "people:anna"
when = "event.x > 2"
most = 1
per = 4
"""


def test_norms_judge_orders_as_with_one_coordinator(tmp_path):
    """In the frames that are recorded, and in what the people who gave them learn."""
    file = read_world_file(write_world(tmp_path, MEMBERS + VAIN, frames=13), Overrides(regions=3))
    given = [[wish(number % 4, "a"), wish(number % 5, "b")] for number in range(12)]
    verdicts, wanted, events, frames = [], [], {}, iter(enumerate(given))

    def verdict(notice):
        return notice.frame, str(notice.event), notice.person, notice.norm

    def observe(notice):
        if isinstance(notice, s.OrderJudged):
            wanted.append(verdict(notice))

    algorithm = FrameAlgorithm(file.world)
    runner = InProcessRunner(algorithm, members_of(file), observe)
    runner.start()
    for number, orders in enumerate(given):
        for order in orders:
            runner.handle(s.Publish(order, "anna"))
        runner.handle(s.Begin())
        events[number] = [*map(str, algorithm.in_flight.events.ordered)]

    class Informed(Cluster):
        def order_judged(self, notice):
            verdicts.append(verdict(notice))

    upcoming = [next(frames)]

    def give(cluster):
        if upcoming and upcoming[0][0] == cluster.algorithm.frame:
            for order in upcoming.pop()[1]:
                cluster.publish(order)
            upcoming.extend(islice(frames, 1))
            if cluster.algorithm.frame == 7:
                cluster.succeed()

    with in_regions(file) as regions:
        cluster = Informed(regions, Random(1))
        cluster.run(give)
    assert {done.number: [*map(str, done.events)] for done in cluster.done[:-1]} == events
    assert [*dict.fromkeys(verdicts)] == wanted
    assert {norm for *_, norm in wanted} == {"", "vain"}


def run_of_one(file):
    runner = InProcessRunner(FrameAlgorithm(file.world), members_of(file))
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    return runner


def figures_of_norms(ended):
    return {name: count for name, count in ended.figures.items() if name.startswith("norm_")}


def test_the_checkpoints_of_regions_are_those_of_one_coordinator(tmp_path):
    """One judges events in the next frame, and regions before they send them."""
    path = write_world(tmp_path, MEMBERS + NORMS, frames=FRAMES)
    file = read_world_file(path, Overrides(regions=3))
    single = FrameAlgorithm(file.world)
    logs = {"one": [], "regions": []}

    def log(name, notice):
        logs[name] += [notice.text] if notice.member == "norms" else []

    class Logging(Cluster):
        def notify(self, notice):
            log("regions", notice)

    def observe(notice):
        if isinstance(notice, s.Notify):
            log("one", notice)

    runner = InProcessRunner(single, members_of(file), observe)
    runner.start()
    checkpoints = []

    def compare(cluster):
        if cluster.algorithm.frame == len(checkpoints) < 9 and not cluster.algorithm.in_frame:
            checkpoints.append(single.checkpoint)
            present = cluster.algorithm.checkpoint
            assert [*map(str, present.emitted)] == [*map(str, single.checkpoint.emitted)]
            assert present.saved.get(SOURCE) == single.checkpoint.saved.get(SOURCE)
            assert {*present.inbox.get(SOURCE, ())} == {*single.checkpoint.inbox.get(SOURCE, ())}
            if checkpoints[1:]:
                events = [*map(str, single.in_flight.events.ordered)]
                assert [*map(str, cluster.done[-1].events)] == events
            runner.handle(s.Begin())
            if cluster.algorithm.frame == 7:
                cluster.succeed()

    with in_regions(file) as regions:
        cluster = Logging(regions, Random(1))
        cluster.run(compare)
    while runner.ended is None:
        runner.handle(s.Begin())
    assert digests(cluster)[FRAMES - 1] == single.scene.digest.hex()
    assert len(checkpoints) == 9
    assert figures_of_norms(cluster.runner.ended) == figures_of_norms(runner.ended)
    assert set(figures_of_norms(runner.ended)) == {"norm_loud", "norm_still"}
    # Each region logs the first violation of a norm there.
    assert set(logs["one"]) <= set(logs["regions"])
    assert len(logs["one"]) == 2


@pytest.mark.parametrize(("frames", "elsewhere"), [(9, False), (4, True)])
def test_a_record_continues_in_regions(tmp_path, frames, elsewhere):
    """Processes on other machines have the initial string, and get theirs from the coordinator.

    In frame 4 agents have sent nothing, and a norm has been broken before.
    """
    path = write_world(tmp_path, MEMBERS + NORMS + SERVICES, frames=FRAMES)
    file = read_world_file(path, Overrides(regions=3))
    wanted = digests_of_one(file, {})
    words = "--in-process", "--rate", 0, "--frames", frames, "--record", "one.mcap", "--quiet"
    assert here(tmp_path, "run", file.path, *words).returncode == 0
    resumed = read_resumed(
        tmp_path / "one.mcap", str(file.path), Overrides(regions=3, frames=FRAMES)
    )
    if elsewhere:
        away = tuple(replace(each, elsewhere=True) for each in resumed.processes)
        resumed = replace(resumed, processes=away)
    with in_regions(resumed) as regions:
        if elsewhere:
            named = [region_elsewhere(file, each.name, "") for each in regions.processes]
            specs = [replace(spec, elsewhere=True) for spec in named if spec is not None]
            regions = replace(regions, processes=tuple(specs))
        cluster = Cluster(regions, Random(1))
        cluster.run()
    assert digests(cluster) == {number: wanted[number] for number in range(frames, FRAMES)}
    single = run_of_one(file)
    assert figures_of_norms(cluster.runner.ended) == figures_of_norms(single.ended)
    assert cluster.algorithm.checkpoint.saved[SOURCE] == single.algorithm.checkpoint.saved[SOURCE]


def wish(number, receiver):
    return EventType("eWish", x=Metres, name=str)(x=number, name="hill", receivers=[receiver])


def test_requests_may_overtake_each_other(file):
    """Those to all regions and those to one that has just joined come on different ways."""
    lag = RegionLag(3, file.partition, 9)
    file = replace(file, world=replace(file.world, lag=lag))
    swapped = []

    def disturb(cluster):
        for name, queue in sorted(cluster.links.down.items()):
            requests = [each for each in queue if isinstance(each, m.RegionRequest)]
            if len(queue) == len(requests) > 1 and requests == sorted(requests, key=frame_of):
                queue.reverse()
                swapped.append(name)

    with in_regions(file) as regions:
        cluster = Cluster(regions, Random(1))
        cluster.run(disturb)
    assert digests(cluster) == digests_of_one(file, {})
    assert len(swapped) > 3


def frame_of(request):
    return request.frame
