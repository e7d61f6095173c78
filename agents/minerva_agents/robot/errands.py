"""Errands: a robot fetches what stands at one marker and brings it to another (section 4.1).

| frame | robot                                 | parcels                                    |
  |-------|---------------------------------------|--------------------------------------------|
  | t     | is at the source and emits eTake      |                                            |
  | t + 1 | waits                                 | those at the marker answer with eTaken     |
  | t + 2 | has the answers and departs           |                                            |
  | ...   | emits eCarry whenever it moves        | carried parcels follow                     |
  | u     | is at the target and emits ePut       |                                            |
  | u + 1 | is done and emits eDelivered          | the carried parcels stand at the target    |

If several robots ask, the first in the order of events gets all parcels. A robot that gets none, or
learns on its way that another robot has come first, emits eGivenUp.

An errand interrupts the objective; the robot resumes it afterwards, whether the errand succeeded or
not. eReached therefore keeps its meaning, and an errand cannot end a world that stops on eReached.
The latest order wins: a new errand replaces the current errand or objective. The robot keeps its
load and puts it down where the new order ends. eInterrupt ends both the errand and the objective
that it has interrupted.
"""

from __future__ import annotations

import math
from typing import Final

from minerva_agents.robot.pose import Cell, Position, centre_of
from minerva_agents.robot.state import RobotState
from minerva_agents.robot.vocabulary import (
    PParcel,
    TPlace,
    eCarry,
    eDelivered,
    eGivenUp,
    ePut,
    eTake,
    eTaken,
)
from minerva_bus import Agent, Context, Degrees, Event, Metres, Scene, on, portable, view

_REPLY_FRAMES: Final = 2
"""Frames from a request to its answers: events emitted by agents belong to the next frame."""


def begin(robot: RobotState, source: str, target: str, moment: Context) -> None:
    """Start an errand; an invalid one is refused with eGivenUp."""
    unknown = [marker for marker in (source, target) if marker not in robot.markers]
    if unknown:
        why = f"there is no marker {unknown[0]!r}"
    elif source == target:
        why = "source and target are the same"
    else:
        # A previous errand has stored the objective that it interrupted.
        robot.later = robot.later if robot.target else robot.objective
        robot.seek(source, target)
        return
    moment.emit(eGivenUp(source, target, why))


def is_fetching(robot: RobotState) -> bool:
    """True if the robot is driving to the source or asking there."""
    return bool(robot.target) and robot.objective != robot.target


def attend(robot: RobotState, place: Cell, moment: Context) -> bool:
    """Perform the errand's step at the objective's marker; False if there is no errand."""
    if is_fetching(robot):
        _fetch(robot, moment)
    elif robot.load:
        x, y = robot.metres(centre_of(place))
        moment.emit(ePut(robot.objective, x, y, receivers=robot.load))
        # Delivered only in the next call: the parcels process ePut in the next frame.
        robot.load = ()
    elif robot.target:
        moment.emit(eDelivered(robot.target))
        _end(robot)
    else:
        return False
    return True


def notice_rival(robot: RobotState, marker: str, moment: Context) -> None:
    """Abort the approach to a source that another robot has just emptied."""
    # A robot that has asked, too, waits for its answers: the parcels join whoever asked first.
    if is_fetching(robot) and robot.objective == marker and not robot.waits:
        _go_on(robot, "another robot has come first", moment)


def give_up(robot: RobotState, why: str, moment: Context) -> None:
    """Abort an errand and report why; the robot keeps its load."""
    moment.emit(eGivenUp(robot.objective, robot.target, why))
    _end(robot)


def carry(robot: RobotState, position: Position, moment: Context) -> None:
    """Send the parcels on board their next position."""
    if robot.load:
        moment.emit(eCarry(*robot.metres(position), receivers=robot.load))


def _fetch(robot: RobotState, moment: Context) -> None:
    """Ask the parcels at this marker to come along; continue once all have answered."""
    if not robot.waits:
        moment.emit(eTake(robot.objective))
        robot.waits = _REPLY_FRAMES
        return
    robot.waits -= 1
    if not robot.waits:
        _go_on(robot, "nothing stands there", moment)


def _go_on(robot: RobotState, why: str, moment: Context) -> None:
    """Bring the load to the target; give up if there is none."""
    if robot.load:
        robot.seek(robot.target, robot.target)
    else:
        give_up(robot, why, moment)


def _end(robot: RobotState) -> None:
    robot.seek(robot.later)
    robot.later = ""


# --- parcels --------------------------------------------------------------------------------------


_FROM_MARKER: Final = 0.25
_FROM_CARRIER: Final = 0.07
"""Distance in metres from the marker or the robot's centre."""


class AParcel(Agent, symbol="AParcel"):
    """An object to be transported.

    Attributes:
        x, y: position in the world.
        marker: the marker it stands at, or empty.
        carrier: the robot that carries it, or empty.
        side: direction from the marker or the robot, counter-clockwise from x; distinct sides
          keep several parcels at one place distinguishable.

    A parcel whose carrier disappears stays where it is and remains assigned to it, because no event
    announces the loss. A user can put it elsewhere: `minerva pub ePut marker=office x=7.0 y=2.9
    --to p2`.

    """

    x: Metres
    y: Metres
    marker: str = ""
    carrier: str = ""
    side: Degrees = 0.0

    @on("eTake")
    def take(self, take: Event, moment: Context) -> None:
        """Join the first robot that asks, and notify it."""
        # On board, a parcel has no marker, so a second robot does not get it.
        if self.marker and self.marker == take.marker and take.sender:
            self.marker, self.carrier = "", take.sender
            moment.emit(eTaken(receivers=(take.sender,)))

    @on("eCarry")
    def follow(self, carry: Event, moment: Context) -> None:
        """x', y': next to its carrier."""
        if self.carrier and self.carrier == carry.sender:
            self._place(carry.x, carry.y, _FROM_CARRIER)

    @on("ePut")
    def put(self, put: Event, moment: Context) -> None:
        """Stand at a marker; robots may put down their own parcels only, users any."""
        if put.sender in ("", self.carrier):
            self.stand(put.marker, put.x, put.y)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        """θ: the parcel at its position."""
        return TPlace(self.x, self.y)(PParcel())

    def stand(self, marker: str, x: float, y: float) -> None:
        """Stand next to a marker at (x, y), in metres of the world."""
        self.marker, self.carrier = marker, ""
        self._place(x, y, _FROM_MARKER)

    def _place(self, x: float, y: float, dist: float) -> None:
        cos, sin = portable.cos_sin(math.radians(self.side))
        self.x, self.y = x + dist * cos, y + dist * sin
