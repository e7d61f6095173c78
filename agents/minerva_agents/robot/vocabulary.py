"""The alphabets of the robot's world: Tables 3 and 4 of the paper, and what an implementation adds.

Tables 3 and 4 have PMap, PRobot, TMove, TRotate, eLaser and the five events eCamera to eSpeed.
Added are eClear, for beams that meet nothing; TPlace, which says where a robot or a marker stands;
PMarker, for a floor shows the rooms' markers; PGrid, PPath and PGoal, which show what a robot knows
and means to do; eCollision, by which physics reaches an agent (section 5); eReached and
eUnreachable, by which the robot reports; eRefused, by which it hears of norms; ePicture, a second
view.
For the transport of objects (4.1) there are PParcel, eErrand, which a person orders, and the six
events from eTake to eGivenUp, by which robots and parcels carry it out; see `errand`.

Rows of a grid grow along the world's x, columns along its y. Lengths are metres, angles degrees,
counter-clockwise.
"""

from typing import Annotated

from minerva_bus import (
    Cells,
    Default,
    Degrees,
    Disc,
    EventType,
    Label,
    Line,
    Metres,
    MetresPerSecond,
    Motion,
    Of,
    Primitive,
    Range,
    Raster,
    Transformation,
)

PMap = Primitive(
    "PMap",
    Raster(
        "cells",
        "resolution",
        "x",
        "y",
        "angle",
        colors=((-1, "#d9d4c7"), (0, "#fbfaf6"), (1, "#2f3640")),
        height=1.0,
    ),
    cells=Cells,
    resolution=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)
"""The floor as a map has it: -1 unknown, 0 free, 100 occupied."""

PRobot = Primitive(
    "PRobot", Disc("radius", "#e07a2f", heading=True), name=str, radius=Default(Metres, 0.18)
)
"""The robot, about the origin and with its heading along x; `name` is the agent's id."""

PMarker = Primitive("PMarker", Label("name", "#2f6f8f"), name=str)
"""A marker that identifies a room; it stands where a TPlace puts it."""

PGrid = Primitive(
    "PGrid",
    Raster(
        "cells",
        "cell",
        "x",
        "y",
        colors=(
            (0, ""),
            (1, "#b9d9e8"),
            (2, "#c0392b"),
            (10, "#8fc7a0"),
            (11, "#b07d2b"),
            (16, "#8e44ad"),
        ),
        opacity=0.45,
    ),
    cells=Cells,
    cell=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
)
"""What a robot knows of the floor; for the codes see `knowledge`."""

PPath = Primitive(
    "PPath",
    Line("xs", "ys", "#e07a2f", 0.05, dashed=True),
    xs=tuple[float, ...],
    ys=tuple[float, ...],
)
"""The way that a robot means to go, in metres of the world."""

PGoal = Primitive("PGoal", Disc("radius", "#c2185b"), radius=Default(Metres, 0.12))
"""Where a robot believes its objective to be."""

PParcel = Primitive("PParcel", Disc("radius", "#7a4a21", height=0.5), radius=Default(Metres, 0.11))
"""A thing that robots transport; higher than a robot, so that it is seen on top of one."""

TMove = Transformation("TMove", Motion(forward="dist"), dist=Metres)
"""Move a distance, along the heading."""

TRotate = Transformation("TRotate", Motion(turn="angle"), angle=Degrees)
"""Rotate an angle."""

TPlace = Transformation(
    "TPlace",
    Motion("x", "y", "angle"),
    x=Metres,
    y=Metres,
    angle=Default(Degrees, 0.0),
)
"""Put at a place of the world, with a heading."""

eLaser = EventType("eLaser", dist=Metres, angle=Degrees)
"""The laser detects an obstacle at this distance and angle from the robot's heading."""

eClear = EventType("eClear", dist=Metres, angle=Degrees)
"""The laser detects no obstacle up to this distance at this angle from the robot's heading.

Table 4 has no such event: its eLaser is for obstacles only. Without it a robot in a hall that is
wider than its laser reaches would never know that the ground before it is free.
"""

eCamera = EventType("eCamera", marker=str, dist=Metres, angle=Default(Degrees, 0.0))
"""The camera detects a marker.

Table 4 gives this event the marker only, while 4.2.3 uses a distance as well and takes the marker
to lie straight ahead. A camera knows the marker's bearing too: `angle`, from the robot's heading;
with 0 the cell is that of the paper's formula to the letter.
"""

eDecide = EventType("eDecide")
"""The robot makes a decision."""

_MARKER = Annotated[str, Of("PMarker", "name")]

eObjective = EventType("eObjective", marker=_MARKER)
"""The user sets the objective marker."""

eSpeed = EventType("eSpeed", speed=Annotated[MetresPerSecond, Range(least=0.0)])
"""The user sets a new speed."""

eCollision = EventType(
    "eCollision",
    shortfall=Metres,
    other=Default(str, ""),
    what=Default(str, ""),
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
    nx=Default(float, 0.0),
    ny=Default(float, 0.0),
)
"""Something stopped the last move: so many metres of it were not driven.

`other` is the agent that did, "" for a wall, and `what` its primitive; (x, y) is the place of the
contact and (nx, ny) the normal, which points to the robot. The robot itself needs none of them.
"""

eRefused = EventType("eRefused", norm=Default(str, ""))
"""A norm has refused the robot's last step: it stands where it stood. Sent by the norms."""

eReached = EventType("eReached", marker=str)
"""A robot has reached its objective; sent by the robot itself."""

eUnreachable = EventType("eUnreachable", marker=str, why=str)
"""A robot has given its objective up, and stops; sent by the robot itself."""

eErrand = EventType("eErrand", source=_MARKER, target=_MARKER)
"""The user orders a robot to bring what stands at one marker to another.

Without receivers it is for all robots: all set out, the first at the source gets what stands there,
and the others give up as soon as they hear of it.
"""

eTake = EventType("eTake", marker=str)
"""A robot at a marker asks all that stands there to come along."""

eTaken = EventType("eTaken")
"""A parcel is a robot's now; sent by the parcel to its robot."""

eCarry = EventType("eCarry", x=Metres, y=Metres)
"""A robot tells what it carries where it will be in the next frame."""

ePut = EventType("ePut", marker=str, x=Metres, y=Metres)
"""A robot puts down what it carries, at a marker that it takes to be at this place."""

eDelivered = EventType("eDelivered", marker=str)
"""An errand is done: what was to be brought stands at this marker; sent by the robot.

A robot on an errand sends no eReached: that is for objectives.
"""

eGivenUp = EventType("eGivenUp", source=str, target=str, why=str)
"""An errand cannot be done; sent by the robot, which goes on with what it did before."""

eRepresent = EventType("eRepresent", visual=True)
"""The robot's action is carried out in the representation space."""

ePicture = EventType("ePicture", visual=True)
"""The robot shows where it is, what it knows and what it means to do."""
