"""The alphabets of the robot's world: Tables 3 and 4 of the paper, and additions.

Tables 3 and 4 define PMap, PRobot, TMove, TRotate, eLaser and the five events from eCamera to
eSpeed. Added are eClear for beams without a hit; TPlace for the position of a robot or marker;
PMarker, because a floor shows its rooms' markers; PGrid, PPath, PObjective and PGoal, which show a
robot's knowledge and plan; eCollision, by which physics notifies an agent (section 5); eReached and
eUnreachable, by which the robot reports; eRefused, by which norms notify it; and ePicture, a second
view. The transport of objects (4.1) uses PParcel, eErrand, which a user orders, and the six events
from eTake to eGivenUp between robots and parcels; see `errands`.

Rows of a grid grow along the world's x, columns along its y. Lengths are in metres, angles in
degrees, counter-clockwise. The colours of things and cells are the palette of Okabe and Ito (Color
Universal Design, 2008), which colour-blind readers can distinguish; walls and ground are grey. The
colours of cells are light and nearly opaque, so that the grids of several robots do not add up.
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
        colors=((-1, "#e6e0d0"), (0, "#fbfaf6"), (1, "#9aa1ab")),
        height=0.5,
        meanings=("unknown or inside furniture", "floor", "wall or furniture"),
    ),
    cells=Cells,
    resolution=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)
"""The floor as a map: -1 unknown, 0 free, 100 occupied."""

PRobot = Primitive(
    "PRobot",
    Disc("radius", "#e69f00", heading=True),
    name=str,
    radius=Default(Metres, 0.18),
)
"""The robot, at the origin and heading along x; `name` is the agent's id."""

PMarker = Primitive("PMarker", Label("name", "#0072b2", "marker of a room"), name=str)
"""A marker that identifies a room, positioned by a TPlace."""

PObjective = Primitive(
    "PObjective", Label("marker", "#d55e00", "objective of a robot", marks=True), marker=str
)
"""The marker that a robot is looking for, wherever it is."""

PGrid = Primitive(
    "PGrid",
    Raster(
        "cells",
        "cell",
        "x",
        "y",
        colors=(
            (0, ""),
            (1, "#94ceee"),
            (2, "#5e5e5c"),
            (10, "#5ec0a4"),
            (11, "#f4ec86"),
            (16, "#5ea5cc"),
        ),
        opacity=0.8,
        meanings=(
            "",
            "free, seen by the laser",
            "obstacle, seen by the laser",
            "free, inspected by the camera",
            "closed by a norm",
            "remembered marker",
        ),
    ),
    cells=Cells,
    cell=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
)
"""A robot's evidence grid; see `grid` for the codes."""

PPath = Primitive(
    "PPath",
    Line("xs", "ys", "#e69f00", 0.05, dashed=True, meaning="planned path"),
    xs=tuple[float, ...],
    ys=tuple[float, ...],
)
"""The path that a robot plans to follow, in metres of the world."""

PGoal = Primitive(
    "PGoal",
    Disc("radius", "#d55e00", meaning="where a robot assumes its objective"),
    radius=Default(Metres, 0.12),
)
"""Where a robot assumes its objective to be."""

PParcel = Primitive("PParcel", Disc("radius", "#f0e442", height=0.5), radius=Default(Metres, 0.11))
"""An object that robots transport; taller than a robot, so that it is visible on top of one."""

TMove = Transformation("TMove", Motion(forward="dist"), dist=Metres)
"""Move by a distance along the heading."""

TRotate = Transformation("TRotate", Motion(turn="angle"), angle=Degrees)
"""Rotate by an angle."""

TPlace = Transformation(
    "TPlace",
    Motion("x", "y", "angle"),
    x=Metres,
    y=Metres,
    angle=Default(Degrees, 0.0),
)
"""Place at a position of the world, with a heading."""

eLaser = EventType("eLaser", dist=Metres, angle=Degrees)
"""The laser detects an obstacle at this distance and angle from the robot's heading."""

eClear = EventType("eClear", dist=Metres, angle=Degrees)
"""The laser detects no obstacle up to this distance at this angle from the robot's heading.

Table 4 has no such event: its eLaser reports obstacles only. Without it, a robot in a hall larger
than its laser's range would never learn that the ground ahead is free.
"""

eCamera = EventType("eCamera", marker=str, dist=Metres, angle=Default(Degrees, 0.0))
"""The camera detects a marker.

Table 4 gives this event only the marker, whereas 4.2.3 also uses a distance and assumes the marker
straight ahead. A camera also measures the bearing `angle` from the robot's heading; with 0 the cell
is exactly that of the paper's formula.
"""

eDecide = EventType("eDecide")
"""The robot makes a decision."""

_MARKER = Annotated[str, Of("PMarker", "name")]

eObjective = EventType("eObjective", replaces=("eObjective", "eErrand"), marker=_MARKER)
"""The user sets the objective marker; a robot drops earlier objectives and its errand."""

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
"""Something stopped the last move, `shortfall` metres before its end.

`other` is the agent that was hit, "" for a wall, and `what` its primitive; (x, y) is the contact
point and (nx, ny) the normal, pointing to the robot. The robot itself needs none of them.
"""

eRefused = EventType("eRefused", norm=Default(str, ""))
"""A norm rejected the robot's last step, so it has not moved. Sent by the norms."""

eReached = EventType("eReached", completes=eObjective, marker=str)
"""A robot has reached its objective; sent by the robot."""

eUnreachable = EventType("eUnreachable", fails=eObjective, marker=str, why=str)
"""A robot has given up its objective and stops; sent by the robot."""

eErrand = EventType("eErrand", replaces="eErrand", source=_MARKER, target=_MARKER)
"""The user orders a robot to bring what stands at one marker to another.

Without receivers it addresses all robots: all depart, the first at the source gets the load, and
the others give up as soon as they learn of it.
"""

eTake = EventType("eTake", marker=str)
"""A robot at a marker asks all parcels there to come along."""

eTaken = EventType("eTaken")
"""A parcel now belongs to a robot; sent by the parcel to its robot."""

eCarry = EventType("eCarry", x=Metres, y=Metres)
"""Where the sender's load will be in the next frame; sent by a robot to its parcels."""

ePut = EventType("ePut", marker=str, x=Metres, y=Metres)
"""A robot puts down its load at a marker, whose position it gives."""

eDelivered = EventType("eDelivered", completes=eErrand, marker=str)
"""An errand is complete: the load stands at this marker; sent by the robot.

A robot on an errand sends no eReached, which is reserved for objectives.
"""

eGivenUp = EventType("eGivenUp", fails=eErrand, source=str, target=str, why=str)
"""An errand cannot be completed; sent by the robot, which resumes its previous objective."""

eInterrupt = EventType("eInterrupt")
"""The user interrupts a robot's task, an objective or an errand (4.1); the robot stops."""

eInterrupted = EventType(
    "eInterrupted", completes=eInterrupt, fails=(eObjective, eErrand), marker=str
)
"""A robot has stopped its task, on the way to this marker; sent by the robot."""

eRepresent = EventType("eRepresent", visual=True)
"""The robot's action is executed in the representation space."""

ePicture = EventType("ePicture", visual=True)
"""The robot shows its pose, knowledge and plan."""
