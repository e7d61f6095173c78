"""Halo: how far a device looks around the figures in its views."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Halo:
    """What a device sends an agent depends on figures within a radius of that agent's figure only.

    Its events have one receiver each, an agent with a figure in the view. So a world in regions may
    show each instance of the device a part of the view: the agents of its region, and others that
    are near them.

    Args:
        radius: of the circle, or half of a side of the square, in the units of the coordinates.
        x: name of the x coordinate in the view.
        y: name of the y coordinate in the view.
        who: name of the agent's id in the view; figures without it do not count.
        size: width and height of a plane whose opposite edges are connected, or None.

    """

    radius: float
    x: str = "x"
    y: str = "y"
    who: str = "who"
    size: tuple[float, float] | None = None
