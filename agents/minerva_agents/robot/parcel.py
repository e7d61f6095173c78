"""The parcel, AParcel: what robots transport between markers (section 4.1).

It is driven by events alone, and knows of robots only what they send.
"""

from __future__ import annotations

import math
from typing import Final

from minerva_agents.robot.vocabulary import PParcel, TPlace, eTaken
from minerva_bus import Agent, Context, Degrees, Event, Metres, Scene, on, portable, view

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
