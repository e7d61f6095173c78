"""Laws of regions for whole worlds: devices, physics and searches for all regions, and norms."""

from functools import cache
from random import Random

import pytest
from region_simulation import Regions, digests_of_one

from minerva_bus.launch.in_process import members_of
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.reading import read_world_file
from minerva_bus.regions.partition import ById, ByPosition
from minerva_bus.settings.overrides import Overrides

OPTIONS = {
    "meadow": {},
    "flock": {"birds": "70"},
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


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 4, 16])
@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_any_number_of_regions_has_the_digests_of_one_coordinator(name, count):
    of = world_file(name)
    grid = GRIDS.get(count, [ById(1)])
    regions = Regions(of.file.world, FRAMES, grid, Random(count), of.members, kills=0.005)
    assert regions.digests() == of.single
