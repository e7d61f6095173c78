"""Laws of regions for whole worlds: devices, physics and searches for all regions, and norms."""

from functools import cache
from random import Random

import pytest
from region_simulation import Regions, digests_of_one

from minerva_bus.launch.in_process_parts import members_of
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.reading import read_world_file, read_world_text
from minerva_bus.regions.partition import ById, ByPosition
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.settings.overrides import Overrides

OPTIONS = {
    "meadow": {},
    "flock": {"birds": "150"},
    "crowd": {"people": "40"},
    "warehouse": {},
    "robots": {},
    "traffic": {"cars": "40"},
}
FRAMES = [[]] * 6
GRIDS = {
    2: [ById(2), ByPosition((12.0,))],
    4: [ById(4), ByPosition((12.0,), (8.0,))],
    9: [ById(9), ByPosition((5.0, 20.0), (5.0, 12.0))],
    16: [ById(16), ByPosition((5.0, 10.0, 20.0), (4.0, 8.0, 12.0))],
}


class File:
    """A world file with the members of each run, and the digests of one coordinator."""

    def __init__(self, name):
        self.file = read_world_file(find_world(name), Overrides(options=OPTIONS[name]))
        self.single = digests_of_one(self.file.world, FRAMES, self.members)

    def members(self):
        return members_of(self.file)


world_file = cache(File)


@pytest.mark.parametrize(("count", "checkpoints"), [(2, True), (9, False)])
@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_regions_have_the_digests_of_one_coordinator(name, count, checkpoints):
    of, kills = world_file(name), 0.0 if checkpoints else 0.01
    grid, chance = GRIDS[count], Random(count)
    regions = Regions(of.file.world, FRAMES, grid, chance, of.members, kills, checkpoints)
    assert regions.digests() == of.single


def test_services_know_the_kinds_of_agents_in_columns_of_other_regions():
    path = find_world("crowd")
    text = path.read_text(encoding="utf-8").replace("persist = true", 'ignore = [["APerson", "*"]]')
    file = read_world_text(text, path, Overrides(options={"people": "300"}))
    regions = Regions(file.world, FRAMES, GRIDS[2], Random(0), lambda: members_of(file))
    regions.digests()
    collisions = regions.processes[0].runner.direct.members["collisions"].service
    assert collisions is not None
    assert collisions.report() == {"collisions": 0}


HALOS = [
    ("crowd", [ByPosition((12.0,), (8.0,), halo=True)], True),
    ("flock", [ByTree(Split("x", 20.0, Split("y", 11.0)), halo=True)], False),
    (
        "flock",  # The borders move in each frame, so half of the birds do.
        [ByPosition((12.0, 30.0), (8.0,), halo=True), ByPosition((28.0, 49.0), (25.0,), halo=True)],
        True,
    ),
]


@pytest.mark.parametrize(("name", "partitions", "checkpoints"), HALOS)
def test_services_with_a_halo_have_the_digests_of_one_coordinator(name, partitions, checkpoints):
    of, kills = world_file(name), 0.0 if checkpoints else 0.02
    frames = of.file.world, FRAMES, partitions, Random(5), of.members
    regions = Regions(*frames, kills=kills, checkpoints=checkpoints)
    assert regions.digests() == of.single
    nearby = [process.region.services.nearby for process in regions.processes]
    names = {"neighbours", "collisions"} if name == "crowd" else {"neighbours"}
    assert all(each.names == names for each in nearby)
    # Together they answer once for each agent: those of other regions are only shown.
    events = [each.event for of in nearby for each in of.answered["neighbours"]]
    answered = [name for event in events for name in event.receivers]
    assert len(answered) == len(set(answered)) > 0


@cache
def large_crowd():
    file = read_world_file(find_world("crowd"), Overrides(options={"people": "70"}))
    frames = [[]] * 24
    return file, frames, digests_of_one(file.world, frames, lambda: members_of(file))


@pytest.mark.parametrize(
    "seed", [5, 6, 7, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(8, 40))]
)
def test_regions_that_continue_from_a_checkpoint_are_seen_as_before(seed):
    """People in columns have other fragments then, and walls are not shown again."""
    file, frames, single = large_crowd()
    grid = [ByPosition((12.0,), halo=bool(seed % 2))]
    of = file.world, frames, grid, Random(seed), lambda: members_of(file)
    regions = Regions(*of, kills=0.08, checkpoints=0.12)
    assert regions.digests() == single
    assert regions.killed > 10


def rows(*borders):
    return ByPosition(borders, (13.0,), names=("row", "column"), halo=True)


@pytest.mark.parametrize(
    ("name", "partitions", "checkpoints"),
    [
        # The borders move in each frame, so robots change their regions.
        ("robots", [rows(12.0), rows(17.0)], True),
        ("robots", [rows(11.0, 15.0, 18.0, 30.0)], False),
        ("robot", [rows(90.0), rows(5.0)], False),
    ],
)
def test_physics_and_its_sensors_run_in_each_region(name, partitions, checkpoints):
    path = find_world(name)
    file = read_world_file(path, Overrides())
    frames, kills = [[]] * 12, 0.0 if checkpoints else 0.02
    of = file.world, frames, partitions, Random(6), lambda: members_of(file)
    regions = Regions(*of, kills=kills, checkpoints=checkpoints)
    assert regions.digests() == digests_of_one(file.world, frames, of[-1])
    for process in regions.processes:
        assert process.region.services.nearby.names == {"physics", "gLaser", "gCamera"}
        assert not process.region.services.drawn, "no view goes to region 0"


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 4, 16])
@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_any_number_of_regions_has_the_digests_of_one_coordinator(name, count):
    of = world_file(name)
    grid = GRIDS.get(count, [ById(1)])
    regions = Regions(of.file.world, FRAMES, grid, Random(count), of.members, kills=0.005)
    assert regions.digests() == of.single
