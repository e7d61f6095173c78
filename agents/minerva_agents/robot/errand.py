"""Errands: a robot fetches what stands at one marker and brings it to another, section 4.1.

| frame | the robot                             | the parcels                                |
|-------|---------------------------------------|--------------------------------------------|
| t     | is at the source and emits eTake      |                                            |
| t + 1 | waits                                 | those that stand there are its now: eTaken |
| t + 2 | has what has answered, and sets out   |                                            |
| ...   | emits eCarry wherever it moves        | those that it carries follow               |
| u     | is at the target and emits ePut       |                                            |
| u + 1 | has carried it out: emits eDelivered  | those that it carried stand there          |

Of several robots that ask, the first in the order of events gets all that stands there. One that
gets nothing emits eGivenUp, and so does one that hears on its way that another has come first.

An errand interrupts the objective: afterwards, done or given up, the robot goes on to it. So
eReached is what it always is, and no errand ends a world that ends with it. Of orders the last
one counts: a new errand takes an errand's place, and an objective too. What the robot carries it
takes along then, and puts it down where the new order ends.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from minerva_agents.robot.ground import Position, centre_of
from minerva_agents.robot.knowledge import Cell
from minerva_agents.robot.vocabulary import eCarry, eDelivered, eGivenUp, ePut, eTake
from minerva_bus import Context

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

_ANSWERED: Final = 2
"""Frames from a question to its answers: events that agents emit belong to the next frame."""


def begin(robot: ARobot, source: str, target: str, moment: Context) -> None:
    """Set out to the source; an errand that makes no sense changes nothing."""
    unknown = [marker for marker in (source, target) if marker not in robot.markers]
    if unknown:
        why = f"there is no marker {unknown[0]!r}"
    elif source == target:
        why = "source and target are the same"
    else:
        robot.later = robot.later if robot.target else robot.objective
        robot.seek(source, target)
        return
    moment.emit(eGivenUp(source, target, why))


def is_fetching(robot: ARobot) -> bool:
    """Whether the robot is on its way to the source, or asks there."""
    return bool(robot.target) and robot.objective != robot.target


def attend(robot: ARobot, place: Cell, moment: Context) -> bool:
    """Do what there is to do at the objective's marker; False where it is a mere objective."""
    if is_fetching(robot):
        _fetch(robot, moment)
    elif robot.load:
        x, y = robot.metres(centre_of(place))
        moment.emit(ePut(robot.objective, x, y, receivers=robot.load))
        robot.load = ()
    elif robot.target:
        moment.emit(eDelivered(robot.target))
        _end(robot)
    else:
        return False
    return True


def hear_of_another(robot: ARobot, marker: str, moment: Context) -> None:
    """Another robot takes what stands at a marker: this one need not go there for it."""
    if is_fetching(robot) and robot.objective == marker and not robot.waits:
        _go_on(robot, "another robot has come first", moment)


def give_up(robot: ARobot, why: str, moment: Context) -> None:
    """End an errand that cannot be done, and say why; what the robot carries it takes along."""
    moment.emit(eGivenUp(robot.objective, robot.target, why))
    _end(robot)


def carry(robot: ARobot, position: Position, moment: Context) -> None:
    """Tell what the robot carries where it will be."""
    if robot.load:
        moment.emit(eCarry(*robot.metres(position), receivers=robot.load))


def _fetch(robot: ARobot, moment: Context) -> None:
    """Ask what stands here to come along; once all answers are there, see what they are."""
    if not robot.waits:
        moment.emit(eTake(robot.objective))
        robot.waits = _ANSWERED
        return
    robot.waits -= 1
    if not robot.waits:
        _go_on(robot, "nothing stands there", moment)


def _go_on(robot: ARobot, why: str, moment: Context) -> None:
    """Bring the load to the target; without any give up, and say why."""
    if robot.load:
        robot.seek(robot.target, robot.target)
    else:
        give_up(robot, why, moment)


def _end(robot: ARobot) -> None:
    robot.seek(robot.later)
    robot.later = ""
