"""gCamera of Table 4: an event for each marker that a camera recognises."""

from __future__ import annotations

import math
from collections.abc import Iterable

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Degrees, Metres
from minerva_bus.world.readings import Sightings
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.event_factory import EventFactory


class Camera(Generator, events=("eCamera",)):
    """Turns sightings into `eCamera(marker, dist, angle)`, for the robot that carries the camera.

    `dist` is in metres, `angle` in degrees counter-clockwise from the robot's heading.

    Args:
        topic: the sensor topic of the sightings.
        event: the event type; several cameras may share one, or use one each.
        takes: of images that arrive faster than frames, use the "newest" or "all".
        nth: of images that arrive asynchronously, use only every n-th.
        resolution: metres and degrees to whose multiples values are rounded, so that cameras with
          smaller differences agree; 0: no rounding.

    """

    topics = ("sightings",)
    by_agent = True

    def __init__(
        self,
        topic: str = "sightings",
        event: str = "eCamera",
        takes: str = "newest",
        nth: int = 1,
        resolution: float = 0.0,
    ) -> None:
        if not 0 <= resolution < math.inf:
            raise MisuseError(f"camera: resolution is {resolution}; expected a number from 0")
        self._resolution = resolution
        self.takes, self.nth = takes, nth
        self.topics = (topic,)
        self._event = event

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def check(self, world: WorldInfo) -> None:
        data = {"marker": str, "dist": Metres, "angle": Degrees}
        self._marker = EventFactory("camera", world, self._event, **data)

    def generate(self, tick: Tick) -> Iterable[Event]:
        for image in tick.readings:
            if not isinstance(image, Sightings):
                raise MisuseError(
                    f"camera: expected sightings on {self.topics[0]!r},"
                    f" found {type(image).__name__}"
                )
            to = (image.robot,)
            for sighting in image.seen:
                dist, angle = self._seen(sighting.distance), self._seen(sighting.angle)
                yield self._marker(sighting.marker, dist, angle, receivers=to)

    def _seen(self, value: float) -> float:
        step = self._resolution
        return round(value / step) * step if step else value
