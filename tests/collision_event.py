"""`eCollision` with every attribute that a service can provide, for test worlds."""

from minerva_bus import EventType, Metres

eCollision = EventType(
    "eCollision",
    shortfall=Metres,
    other=str,
    what=str,
    x=Metres,
    y=Metres,
    nx=float,
    ny=float,
    depth=Metres,
    begins=bool,
)
