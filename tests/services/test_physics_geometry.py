"""Walls, markers and bodies from a string: α, β and δ of the physical system."""

import numpy as np
import pytest
from driving_world import PMap, PMarker, PRobot, PTree, TMove, TPaint, TPlace, TRotate

from minerva_bus import Scene, interpret
from minerva_bus.semantics.poses import Pose
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.geometry import FloorPlan, PhysicalGeometry, Robot


def seen(scene: Scene) -> PhysicalGeometry:
    geometry = PhysicalGeometry()
    interpret(scene, geometry)
    return geometry


def test_a_place_holds_a_robot_and_its_command() -> None:
    scene = TPlace(1.5, 2.5, 30.0)(TRotate(10.0)(TMove(0.3)(PRobot("r", 0.2))))
    assert seen(scene).robots == {"r": Robot(Pose(1.5, 2.5, 30.0), 0.2, DriveCommand(10.0, 0.3))}


def test_a_robot_without_a_place_is_at_the_origin_and_one_without_a_command_stays() -> None:
    robots = seen(TMove(0.3)(PRobot("a", 0.2)) + PRobot("b", 0.1)).robots
    assert robots["a"] == Robot(Pose(0, 0, 0), 0.2, DriveCommand(0, 0.3))
    assert robots["b"] == Robot(Pose(0, 0, 0), 0.1, DriveCommand(0, 0))


def test_several_turns_and_moves_add_up() -> None:
    scene = TRotate(10.0)(TRotate(5.0)(TMove(0.3)(TMove(-0.1)(PRobot("r", 0.2)))))
    assert seen(scene).robots["r"].command == DriveCommand(15.0, 0.3 - 0.1)


def test_a_turn_after_a_move_is_refused_for_a_body_turns_first() -> None:
    with pytest.raises(PhysicsError, match=r"TRotate<angle=5> within TMove<dist=0.3>"):
        seen(TMove(0.3)(TRotate(5.0)(PRobot("r", 0.2))))
    assert seen(TMove(0.0)(TRotate(5.0)(PRobot("r", 0.2)))).robots["r"].command.turn_deg == 5


def test_transformations_around_a_place_move_it_without_commands() -> None:
    inner = TPlace(1.0, 0.0, 5.0)(TMove(0.1)(PRobot("r", 0.2)) + PMarker("m"))
    view = seen(TPlace(2.0, 3.0, 90.0)(TRotate(90.0)(TMove(0.5)(inner))))
    robot = view.robots["r"]
    assert (robot.believed.x, robot.believed.y) == pytest.approx((0.5, 3.0))
    assert (robot.believed.angle, robot.command) == (185.0, DriveCommand(0.0, 0.1))
    assert view.markers["m"] == pytest.approx((0.5, 3.0))


def test_a_scope_that_has_closed_leaves_nothing_behind() -> None:
    scene = TPlace(1.0, 2.0, 3.0)(TRotate(4.0)(TMove(5.0)(PTree()))) + PMarker("m")
    view = seen(scene + PRobot("r", 0.2))
    assert view.markers == {"m": (0.0, 0.0)}
    assert view.robots["r"] == Robot(Pose(0, 0, 0), 0.2, DriveCommand(0, 0))
    behind = seen(TMove(0.5)(TPlace(1.0, 2.0, 3.0)(TMove(5.0)(PTree())) + PRobot("r", 0.2)))
    assert behind.robots["r"] == Robot(Pose(0, 0, 0), 0.2, DriveCommand(0, 0.5))


def test_a_map_lies_where_its_own_parameters_and_its_place_put_it() -> None:
    cells = np.zeros((2, 3), np.int16)
    (floor,) = seen(PMap(cells, 0.1, x=1.25, y=-0.7, angle=12.5)).floors
    assert floor.corner == Pose(1.25, -0.7, 12.5)
    assert floor.resolution == 0.1
    (moved,) = seen(TPlace(1.0, 1.0, 90.0)(PMap(cells, 0.1, x=1.0))).floors
    assert (moved.corner.x, moved.corner.y) == pytest.approx((1.0, 2.0))


def test_symbols_that_mean_nothing_to_a_body_are_passed_over() -> None:
    view = seen(PTree() + TPaint()(PRobot("r", 0.2)))
    assert list(view.robots) == ["r"]


@pytest.mark.parametrize("twice", [PRobot("r", 0.2), PMarker("r")])
def test_a_name_that_stands_twice_is_refused(twice: Scene) -> None:
    with pytest.raises(PhysicsError, match="'r' appears twice in the view"):
        seen(twice + twice)


def test_floors_are_the_same_when_their_walls_are() -> None:
    cells, corner = np.zeros((2, 3), np.int16), Pose(0, 0, 0)
    floor = FloorPlan(cells, 0.1, corner)
    assert floor.same_as(FloorPlan(cells.copy(), 0.1, corner))
    assert not floor.same_as(FloorPlan(cells, 0.2, corner))
    assert not floor.same_as(FloorPlan(cells, 0.1, Pose(0, 0, 1)))
    assert not floor.same_as(FloorPlan(np.ones((2, 3), np.int16), 0.1, corner))
    assert not floor.same_as(FloorPlan(np.zeros((3, 2), np.int16), 0.1, corner))
