"""Laws of physics in each region: bodies, contacts and readings are those of the whole."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from region_simulation import Regions, begin, digests_of_one, exchanged

from minerva_bus import (
    Agent,
    Cells,
    Degrees,
    EventType,
    Metres,
    Primitive,
    Transformation,
    on,
    view,
)
from minerva_bus.errors import WorldStopped
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.regions.kept import joined_parts
from minerva_bus.regions.partition import ByPosition
from minerva_bus.regions.region import Region
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.world.norms import Norm
from minerva_services.physics.kept import kept_bodies
from minerva_services.physics.service import Physics
from minerva_services.sensors.camera import Camera
from minerva_services.sensors.laser import Laser

SIDE = 8.0
PMap = Primitive("PMap", cells=Cells, resolution=Metres, x=Metres, y=Metres, angle=Degrees)
PMarker = Primitive("PMarker", name=str)
PRobot = Primitive("PRobot", name=str, radius=Metres)
TPlace = Transformation("TPlace", x=Metres, y=Metres, angle=Degrees)
TRotate = Transformation("TRotate", angle=Degrees)
TMove = Transformation("TMove", dist=Metres)
eRepresent = EventType("eRepresent", visual=True)
eStep = EventType("eStep")
eLaser = EventType("eLaser", dist=Metres, angle=Degrees)
eClear = EventType("eClear", dist=Metres, angle=Degrees)
eCamera = EventType("eCamera", marker=str, dist=Metres, angle=Degrees)
eCollision = EventType("eCollision", shortfall=Metres, other=str, x=Metres, begins=bool)


class Rover(Agent, symbol="ARover"):
    """Drives at random, and keeps all that its sensors say in its state."""

    x: Metres
    y: Metres
    angle: Degrees = 0.0
    turn: Degrees = 0.0
    dist: Metres = 0.0
    ready: bool = False
    heard: float = 0.0
    hits: int = 0
    last: str = ""

    @on("eLaser")
    def echo(self, beam, moment):
        self.heard = 0.5 * self.heard + beam.dist * beam.angle

    @on("eClear")
    def open(self, beam, moment):
        self.heard = 0.7 * self.heard + beam.angle

    @on("eCamera")
    def look(self, image, moment):
        self.heard += image.dist
        self.last = image.marker

    @on("eCollision")
    def hit(self, hit, moment):
        self.hits += 1 + hit.begins
        self.last = hit.other
        self.heard += hit.shortfall + hit.x

    @on("eStep")
    def drive(self, step, moment):
        # Its own pose is what it believes: it does not know that something has stopped it.
        if self.ready:
            self.angle += self.turn
            self.x = min(SIDE, max(-SIDE, self.x + self.dist * (1 if self.angle % 2 < 1 else -1)))
            self.y = min(SIDE, max(-SIDE, self.y + moment.chance.uniform(-1.0, 1.0)))
        self.ready = True
        self.turn = float(round(moment.chance.uniform(-60.0, 60.0)))
        self.dist = moment.chance.uniform(-0.3, 1.2)
        return EMPTY if moment.chance.chance(0.02) else None

    @view("eRepresent")
    def represent(self, event):
        action = TRotate(self.turn)(TMove(self.dist)(PRobot(self.id, 0.2)))
        return TPlace(self.x, self.y, self.angle)(action if self.ready else EMPTY)


class Loner(Rover, symbol="ALoner"):
    """A few, so they are not held in columns."""


class Alias(Rover, symbol="AAlias"):
    @view("eRepresent")
    def represent(self, event):
        return TPlace(self.x, self.y, self.angle)(PRobot(f"robot-{self.id}", 0.2))


KINDS = Rover, Loner, Alias
VOCABULARY = Vocabulary.of(
    PMap, PMarker, PRobot, TPlace, TRotate, TMove, eRepresent, eStep, eLaser, eClear, eCamera,
    eCollision, *KINDS,
)  # fmt: skip
FRAMES = [[eStep(), eRepresent()]] * 9
GRID = ByPosition((0.0,), (0.0,), halo=True)
MOVED = ByPosition((-2.5,), (1.0,), halo=True)
HALVES = ByPosition((0.5,), halo=True)
TREE = ByTree(Split("x", 0.5, Split("y", -1.0)), halo=True)
NINE = ByPosition((-3.0, 3.0), (-3.0, 3.0), halo=True)
SIXTEEN = ByPosition((-4.0, 0.0, 4.0), (-4.0, 0.0, 4.0), halo=True)


def world(seed, rovers=40):
    chance = Random(seed)
    places = [(x - 5.0, y - 5.0) for x in range(11) for y in range(11)]
    chance.shuffle(places)
    cells = np.ones((42, 42), np.int16)
    cells[1:-1, 1:-1] = 0
    scenery = PMap(cells, 0.4, -8.4, -8.4, 0.0)
    for number in range(0, 40, 5):  # Markers with the names of robots.
        scenery += TPlace(number / 5 - 3.5, 2.5, 0.0)(PMarker(f"r{number}"))
    kinds = [Loner] * 6 + [Rover] * rovers
    for number, (kind, (x, y)) in enumerate(zip(kinds, places, strict=False)):
        angle = chance.uniform(-180.0, 180.0)
        scenery += kind(f"r{number}", x=x, y=y, angle=angle).string
    return World("w", packed(Scene(scenery.nodes)), VOCABULARY, seed=seed)


NOISE = {"laser_noise": 0.01, "drive_noise": 0.1, "turn_noise": 2.0, "camera_noise": 0.05}
MODELS = {"alpha2": 0.01, "laser_short": 0.1, "laser_dropout": 0.1, "camera_miss": 0.2}


def members(**options):
    # A name before and after that of the publisher: the order of names must not matter.
    physics = Physics(beams=8, range_max=3.0, camera_range=6.0, camera_fov=180.0, **options)
    return [
        Member("hosts", None, KINDS),
        Member("alaser", Laser(clear="eClear")),
        Member("physics", physics),
        Member("zcamera", Camera()),
    ]


@pytest.mark.parametrize(
    ("seed", "partitions", "options", "checkpoints"),
    [
        (1, [HALVES], {}, True),
        (2, [TREE], NOISE, False),
        (3, [GRID, MOVED], MODELS, False),
        (4, [NINE], NOISE | MODELS, True),
        *(
            pytest.param(seed, [[GRID, MOVED], [SIXTEEN], [HALVES]][seed % 3],
                         [{}, NOISE, MODELS][seed // 3 % 3], bool(seed % 2),
                         marks=pytest.mark.slow)
            for seed in range(5, 35)
        ),
    ],
)  # fmt: skip
def test_physics_in_each_region_is_that_of_one(seed, partitions, options, checkpoints):
    whole, kills = world(seed), 0.0 if checkpoints else 0.01
    algorithm = FrameAlgorithm(whole)
    runner = InProcessRunner(algorithm, members(**options))
    runner.start()
    for events in FRAMES:
        begin(runner, events)
    regions = Regions(
        whole, FRAMES, partitions, Random(seed), lambda: members(**options), kills, checkpoints
    )
    assert regions.digests() == digests_of_one(whole, FRAMES, lambda: members(**options))
    saved = [each.region.algorithm.members.saved["physics"] for each in regions.processes]
    one = algorithm.members.saved["physics"]
    assert joined_parts(saved) == one
    bodies = kept_bodies(one).values()
    assert sum(each.body.odometer.collisions for each in bodies) > 5
    nearby = [process.region.services.nearby for process in regions.processes]
    assert all(each.names == {"alaser", "physics", "zcamera"} for each in nearby)


@pytest.mark.parametrize("checkpoints", [False, True])
def test_a_command_that_a_norm_rejects_is_executed_in_no_region(checkpoints):
    norm = Norm("far", when="x > 2 and was.x < 2")
    whole = replace(world(6), norms=(norm,))
    regions = Regions(whole, FRAMES, [GRID], Random(6), members, checkpoints=checkpoints)
    digests = digests_of_one(whole, FRAMES, members)
    assert regions.digests() == digests
    assert digests != digests_of_one(replace(whole, norms=()), FRAMES, members)


@pytest.mark.parametrize("checkpoints", [False, True])
def test_regions_continue_from_the_checkpoint_of_one_coordinator(checkpoints):
    """The last view is shown again, with all that the physics world of the whole had saved."""
    algorithm = FrameAlgorithm(world(7))
    runner = InProcessRunner(algorithm, members())
    runner.start()
    for events in FRAMES[:4]:
        begin(runner, events)
    shown = tuple(algorithm.views.keyframes())
    past = replace(world(7), scene=algorithm.scene, past=algorithm.checkpoint, shown=shown)
    first = [members() for _ in range(4)]
    regions = [Region(past, number, GRID, first[number]) for number in range(4)]
    if checkpoints:  # As regions on other machines begin.
        first = [members() for _ in range(4)]
        regions = [
            RegionCheckpoint.first(each).region(past, each.number, GRID, first[each.number])
            for each in regions
        ]
    runners = [
        InProcessRunner(each.algorithm, own, deliver=each.services.deliver)
        for each, own in zip(regions, first, strict=True)
    ]

    def send(replies):
        for each in replies:
            regions[each.target].receive(each)

    for region, each in zip(regions, runners, strict=True):
        region.services.send = send
        each.start()
    for events in FRAMES[4:]:
        for region in regions:
            region.enter()
        for each in runners:
            begin(each, events)
        begin(runner, events)
        assert exchanged(regions) == algorithm.scene.digest


def test_a_body_that_does_not_have_the_id_of_its_agent_stops_the_world():
    """What physics knows of it would not move with the agent."""
    alias = Alias("z", x=7.0, y=7.0).string
    whole = replace(world(8), scene=Scene((*world(8).scene.pieces, *alias.pieces)))
    regions = Regions(whole, FRAMES, [GRID], Random(8), members)
    with pytest.raises(
        WorldStopped, match=r": an agent shows PRobot of 'robot-z' .* no agent of its region"
    ):
        regions.digests()
