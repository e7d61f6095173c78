"""The robot's office in space: its string, and a ramp and furniture beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from minerva_agents.robot import world as plane
from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.robot import ALocalisingRobot, ARobot
from minerva_bodies import Box, Matter, euler
from minerva_bus import (
    Default,
    Degrees,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    portable,
)

SIZES: dict[str, Any] = dict.fromkeys("xyz", Metres)
WOOD = Matter(friction=1.0, fixed=True)

PBoard = Primitive("PBoard", Box("x", "y", "z", "#c8b078", matter=WOOD, meaning="ramp"), **SIZES)
PCase = Primitive("PCase", Box("x", "y", "z", "#7a5c8e", matter=WOOD, meaning="furniture"), **SIZES)
TLay = Transformation(
    "TLay", euler("x", "y", "z", pitch="pitch"), **SIZES, pitch=Default(Degrees, 0.0)
)

vocabulary = Vocabulary.of(
    *plane.vocabulary.primitives.values(),
    *plane.vocabulary.transformations.values(),
    *plane.vocabulary.events.values(),
    *(ARobot, ALocalisingRobot, AParcel, PBoard, PCase, TLay),
)

THICK = 0.02  # half of a board, metres
CORRIDOR = 5.85, 0.8  # its middle and half of its width, y in metres
CASES = ((3.4, 3.6, 0.3), (6.1, 1.2, 0.25), (7.8, 11.0, 0.3), (13.0, 8.6, 0.25))
"""x, y and half of the side, metres."""


def ramp(begin: float, slope: float, top: float, height: float) -> Scene:
    """A board up, a level one and a board down along the corridor; lengths in metres."""
    y, half = CORRIDOR
    angle, length = math.degrees(portable.atan2(height, slope)), portable.hypot(slope, height)
    level = height - THICK
    boards = Scene(())
    for x, side in ((begin + slope / 2, -1.0), (begin + 1.5 * slope + top, 1.0)):
        # The upper face goes from the floor to the height.
        across = THICK * height / length
        z = height / 2 - THICK * slope / length
        at = TLay(round(x - side * across, 6), y, round(z, 6), round(side * angle, 6))
        boards += at(PBoard(round(length / 2, 6), half, THICK))
    return boards + TLay(begin + slope + top / 2, y, level)(PBoard(top / 2, half, THICK))


def scene(options: Mapping[str, Any]) -> Scene:
    """The string of the robot's world, a ramp in the corridor and boxes in rooms."""
    furniture = Scene(())
    for x, y, half in CASES:
        furniture += TLay(x, y, 0.3)(PCase(half, half, 0.3))
    return plane.scene(options) + ramp(5.8, 0.7, 0.3, 0.07) + furniture
