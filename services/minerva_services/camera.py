"""gCamera of Table 4: an event for each marker that a camera recognises."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Degrees, Metres
from minerva_bus.world.readings import Sightings
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.making import Maker


class Camera(Generator, events=("eCamera",)):
    """Turns sightings into `eCamera(marker, dist, angle)`, to the robot that carries the camera.

    `dist` is in metres, `angle` in degrees counter-clockwise from the robot's heading.

    Args:
        topic: the sensor topic of the sightings.
        event: the event type; several cameras may make the same, or each its own.
        takes: of images that come faster than frames, "newest" counts, or "all" of them.
        nth: of images that come freely, only every n-th counts.

    """

    topics = ("sightings",)

    def __init__(
        self,
        topic: str = "sightings",
        event: str = "eCamera",
        takes: str = "newest",
        nth: int = 1,
    ) -> None:
        self.takes, self.nth = takes, nth
        self.topics = (topic,)
        self._event = event

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def joined(self, world: WorldInfo) -> None:
        data = {"marker": str, "dist": Metres, "angle": Degrees}
        self._marker = Maker("camera", world, self._event, **data)

    def generate(self, tick: Tick) -> Iterable[Event]:
        for image in tick.readings:
            if not isinstance(image, Sightings):
                raise MisuseError(
                    f"camera: expected sightings on {self.topics[0]!r},"
                    f" found {type(image).__name__}"
                )
            to = (image.robot,)
            for one in image.seen:
                yield self._marker(one.marker, one.distance, one.angle, receivers=to)
