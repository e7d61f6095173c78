"""The service `rovers`: a robot's string as a vehicle in space, its commands, sensors and errors."""

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")

from minerva_agents.robot.vocabulary import PMap, PMarker, PRobot, TMove, TPlace, TRotate
from minerva_agents.robot.world import vocabulary
from minerva_bodies.errors import BodiesError
from minerva_bodies.robots import Rovers, blocks, robot_boxes
from minerva_bus import Tick, View
from minerva_bus.grammar.events import single
from minerva_bus.world.context import Frame
from minerva_bus.world.services import WorldInfo

INFO = WorldInfo("hall", vocabulary, 7, 0.1)
HALL = np.zeros((60, 40), np.int16)  # 6 m x 4 m
HALL[30:32, :12] = 100
SCENERY = PMap(HALL, 0.1) + TPlace(5.0, 2.0)(PMarker("bay"))
ROBOT = PRobot("r1", 0.18)


class Hall:
    """A robot at (1, 2), which faces along x, and what its world has published."""

    def __init__(self, **options):
        self.service, self.frame = Rovers(beams=4, **options), 0
        self.service.joined(INFO)

    def drive(self, turn=0.0, forward=0.0):
        """A frame with a command; its events."""
        robot = TPlace(1.0, 2.0)(TRotate(turn)(TMove(forward)(ROBOT)))
        self.service.show(View(self.frame, "eRepresent", SCENERY + robot, {}))
        self.frame += 1
        self.tick = Tick(Frame(self.frame, 0.1, 7), "physics")
        return list(single(self.service.generate(self.tick)))

    def published(self, topic):
        return dict(self.tick.published)[topic]

    @property
    def ranges(self):
        """Behind, right, ahead, left."""
        return self.published("scan").ranges


def test_robots_and_walls_have_bounding_boxes():
    placed = TPlace(1.0, 2.0)(TRotate(90.0)(TMove(3.0)(ROBOT)))
    boxes = robot_boxes(View(0, "eRepresent", SCENERY + placed, {}), vocabulary)
    hull = [box for box in boxes if box.owner == "r1"]
    # Around the place of the robot, whatever its command is, and above one another.
    assert [box.symbol for box in hull] == ["PRobot"] * 2
    for box in hull:
        assert (box.lower[:2], box.upper[:2]) == (
            pytest.approx((0.82, 1.82)),
            pytest.approx((1.18, 2.18)),
        )
    assert hull[0].upper[2] == pytest.approx(hull[1].lower[2])
    floor, *_, wall = [box for box in boxes if box.symbol == "PMap"]
    assert floor.upper == pytest.approx((6.0, 4.0, 0.0))
    assert (wall.lower, wall.upper[:2]) == (
        pytest.approx((3.0, 0.0, 0.0)),
        pytest.approx((3.2, 1.2)),
    )


def test_a_vehicle_follows_commands_and_measures_where_it_is():
    hall = Hall()
    for _ in range(25):
        assert not hall.drive(forward=0.04)
    for _ in range(10):
        hall.drive()
    assert hall.ranges == pytest.approx([2.0, 2.0, 4.0, 2.0], abs=0.02)
    (seen,) = hall.published("sightings").seen
    assert (seen.marker, seen.distance, seen.angle) == (
        "bay",
        *[pytest.approx(x, abs=0.05) for x in (3.0, 0.0)],
    )
    for _ in range(10):
        hall.drive(turn=9.0)
    for _ in range(10):
        hall.drive()
    assert hall.ranges == pytest.approx([2.0, 4.0, 2.0, 2.0], abs=0.02)


def test_a_wall_stops_a_vehicle_and_its_agent_learns_how_far_it_came():
    hall = Hall()
    for _ in range(6):
        hall.drive(turn=-10.0)
    way = [0.0, 0.0]
    for _ in range(60):
        events = hall.drive(forward=0.06)
        way[0] += 0.06
        way[1] += sum(event.shortfall for event in events)
    assert {event.type for event in events} == {"eCollision"}
    (event,) = events
    assert event.other == ""
    assert event.ny == pytest.approx(1.0, abs=0.05)
    # To the wall at y = 0, obliquely.
    assert way[0] - way[1] == pytest.approx((2.0 - 0.18) / np.sin(np.radians(60)), abs=0.1)
    assert hall.service.report()["collisions"] > 0


@pytest.mark.parametrize(
    ("robot", "text"),
    [
        (PRobot("r1", 0.0), "radius"),
        (ROBOT + ROBOT, "twice"),
        (TMove(0.1)(TRotate(5.0)(ROBOT)), "put TMove within TRotate"),
        (PMap(HALL, 0.0), "cells"),
        (TPlace(0.0, 0.0)(PMarker("bay")), "twice"),
    ],
)
def test_what_cannot_stand_is_an_error_that_says_so(robot, text):
    hall = Hall()
    with pytest.raises(BodiesError, match=text):
        hall.service.show(View(0, "eRepresent", SCENERY + robot, {}))


def test_blocks_fill_solid_cells_without_overlap():
    cells = (np.random.default_rng(5).random((30, 20)) < 0.4).astype(np.int16)
    filled = np.zeros_like(cells)
    for row, rows, column, columns in blocks(cells):
        filled[row:rows, column:columns] += 1
    assert (filled == cells).all()
