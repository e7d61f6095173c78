"""The parcel, AParcel: what a robot transports from one place to another, section 4.1.

It moves by events alone, and what it knows of robots is what they send.
"""

from __future__ import annotations

import math
from typing import Final

from minerva_agents.robot.vocabulary import PParcel, TPlace, eTaken
from minerva_bus import Agent, Context, Degrees, Event, Metres, Scene, on, portable, view

_FROM_MARKER: Final = 0.25
_FROM_CARRIER: Final = 0.07
"""Metres from the middle of what it stands at or lies on."""


class AParcel(Agent, symbol="AParcel"):
    """A thing to be transported.

    Attributes:
        x, y: where it is in the world.
        marker: at which marker it stands, or empty.
        carrier: which robot has it, or empty.
        side: on which side of a marker, and of a robot, it is; where each has its own, all that
            are at one place can be told apart. Counter-clockwise from x.

    A parcel whose robot is gone stays where it was, and that robot's, for nobody tells it. A
    person can put it elsewhere: `minerva pub ePut marker=office x=7.0 y=2.9 --to p2`.

    """

    x: Metres
    y: Metres
    marker: str = ""
    carrier: str = ""
    side: Degrees = 0.0

    @on("eTake")
    def take(self, take: Event, moment: Context) -> None:
        """Go with the first who asks, and tell it so."""
        if self.marker and self.marker == take.marker and take.sender:
            self.marker, self.carrier = "", take.sender
            moment.emit(eTaken(receivers=(take.sender,)))

    @on("eCarry")
    def follow(self, carry: Event, moment: Context) -> None:
        """x', y': where its robot is."""
        if self.carrier and self.carrier == carry.sender:
            self._place(carry.x, carry.y, _FROM_CARRIER)

    @on("ePut")
    def put(self, put: Event, moment: Context) -> None:
        """Stand at a marker from now on; robots may put their own parcels only, people any."""
        if put.sender in ("", self.carrier):
            self.stand(put.marker, put.x, put.y)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        """θ: the parcel, where it is."""
        return TPlace(self.x, self.y)(PParcel())

    def stand(self, marker: str, x: float, y: float) -> None:
        """Stand beside a marker, which is at this place in metres of the world."""
        self.marker, self.carrier = marker, ""
        self._place(x, y, _FROM_MARKER)

    def _place(self, x: float, y: float, dist: float) -> None:
        side = math.radians(self.side)
        self.x, self.y = x + dist * portable.cos(side), y + dist * portable.sin(side)
