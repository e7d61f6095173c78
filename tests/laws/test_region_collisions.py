"""Laws of collisions in each region: contacts, and what is known of them, are those of the whole."""

from random import Random

import pytest
from region_simulation import Regions, begin, digests_of_one

from minerva_bus import (
    Agent,
    Disc,
    EventType,
    Line,
    Metres,
    Motion,
    Primitive,
    Transformation,
    on,
    view,
)
from minerva_bus.errors import MinervaError, WorldStopped
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.regions.kept import joined_parts
from minerva_bus.regions.partition import ByPosition
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.runtime.direct import InProcessRunner
from minerva_services.physics.collisions import Collisions

RADIUS = 0.3
PBall = Primitive("PBall", Disc("radius"), radius=Metres, who=str)
PWall = Primitive("PWall", Line("x", "y", 0.1), x=tuple[float, ...], y=tuple[float, ...])
TAt = Transformation("TAt", Motion("x", "y"), x=Metres, y=Metres)
eBody = EventType("eBody", visual=True)
eStep = EventType("eStep")
eCollision = EventType("eCollision", other=str, depth=Metres, nx=float, begins=bool)


class Ball(Agent, symbol="ABall"):
    x: Metres
    y: Metres
    begun: int = 0
    depth: float = 0.0
    partner: str = ""

    @on("eStep")
    def roll(self, step, moment):
        leap = 3.0 if moment.chance.chance(0.1) else 0.2
        self.x = min(4.0, max(-4.0, self.x + moment.chance.uniform(-leap, leap)))
        self.y = min(4.0, max(-4.0, self.y + moment.chance.uniform(-leap, leap)))
        return Scene() if moment.chance.chance(0.03) else None

    @on("eCollision")
    def hit(self, hit, moment):
        self.begun += hit.begins
        self.depth += hit.depth * hit.nx
        self.partner = hit.other

    @view("eBody")
    def body(self, event):
        return TAt(self.x, self.y)(PBall(RADIUS, self.id))


class Loner(Ball, symbol="ALoner"):
    """A few, so they are not held in columns."""


class Nameless(Ball, symbol="ANameless"):
    @view("eBody")
    def body(self, event):
        return TAt(self.x, self.y)(PBall(RADIUS, ""))


class Wide(Ball, symbol="AWide"):
    @view("eBody")
    def body(self, event):
        return TAt(self.x, self.y)(PBall(2 * RADIUS, self.id))


KINDS = Ball, Loner, Nameless, Wide
VOCABULARY = Vocabulary.of(PBall, PWall, TAt, eBody, eStep, eCollision, *KINDS)
WALLS = PWall((-4.0, 4.0), (1.0, 1.0)), PWall((1.0, 1.0), (-4.0, 4.0))
FRAMES = [[eStep()]] * 7
GRID = ByPosition((0.0,), (0.0,), halo=True)
HALVES = ByPosition((0.5,), halo=True)
MOVED = ByPosition((-1.5,), (1.0,), halo=True)
TREE = ByTree(Split("x", 0.5, Split("y", -1.0)), halo=True)


def world(seed, *nodes):
    chance = Random(seed)
    at = [{"x": chance.uniform(-3, 3), "y": chance.uniform(-3, 3)} for _ in range(90)]
    balls = [Ball(f"b{n}", **each).string.nodes[0] for n, each in enumerate(at[:80])]
    loners = [Loner(f"l{n}", **each).string.nodes[0] for n, each in enumerate(at[80:])]
    walls = [wall.nodes[0] for wall in WALLS]
    string = packed(Scene((*walls, *balls, *loners, *nodes)))
    return World("w", string, VOCABULARY, seed=seed)


def members(every, persist):
    service = Collisions(every=every, persist=persist, reach=RADIUS)
    return [Member("hosts", None, KINDS), Member("collisions", service)]


@pytest.mark.parametrize(
    ("seed", "partitions", "every", "persist", "checkpoints"),
    [
        (1, [HALVES], 1, False, True),
        (2, [TREE], 2, True, False),
        (3, [GRID, MOVED], 1, False, False),
        *(
            pytest.param(seed, [GRID, MOVED], 1 + seed % 3, bool(seed % 2), bool(seed % 4 < 2),
                         marks=pytest.mark.slow)
            for seed in range(4, 40)
        ),
    ],
)  # fmt: skip
def test_collisions_in_each_region_are_those_of_one(seed, partitions, every, persist, checkpoints):
    whole, kills = world(seed), 0.0 if checkpoints else 0.01
    algorithm = FrameAlgorithm(whole)
    runner = InProcessRunner(algorithm, members(every, persist))
    runner.start()
    for events in FRAMES:
        begin(runner, events)
    regions = Regions(
        whole, FRAMES, partitions, Random(seed), lambda: members(every, persist), kills, checkpoints
    )
    assert regions.digests() == digests_of_one(whole, FRAMES, lambda: members(every, persist))
    saved = [each.region.algorithm.members.saved["collisions"] for each in regions.processes]
    assert joined_parts(saved) == algorithm.members.saved["collisions"]
    assert algorithm.members.saved["collisions"]["count"] > 10


def test_an_agent_whose_figure_has_no_id_stops_the_world():
    """It would be taken for scenery, which such a figure outside of all agents is."""
    nodes = TAt(0.0, 0.0)(PBall(0.1, "")).nodes[0], Nameless("n", x=0.0, y=0.0).string.nodes[0]
    regions = Regions(world(1, *nodes), FRAMES, [GRID], Random(1), lambda: members(1, False))
    with pytest.raises(
        WorldStopped, match=": an agent shows TAt for eBody without x, y and its id as who"
    ):
        regions.digests()


@pytest.mark.parametrize("x", [0.0, 2.0])
def test_a_figure_beyond_the_reach_is_an_error(x):
    wide = Wide("w", x=x, y=0.0).string.nodes[0]
    regions = Regions(world(1, wide), FRAMES, [GRID], Random(1), lambda: members(1, False))
    with pytest.raises((MinervaError, WorldStopped), match=r"#w extends 0\.6 m .* reach is 0\.3"):
        regions.digests()
