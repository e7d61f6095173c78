"""Marker recognition in images published by other members, in lockstep with the world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.readings import Image, Sightings
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.options import takes_options
from minerva_services.sensors.vision.images import NoImage, grey_of
from minerva_services.sensors.vision.locator import MarkerLocator, VisionOptions, WrongSize


class Markers(Generator):
    """Recognises markers (ArUco, AprilTag) in the images of a topic and publishes `Sightings`.

    In lockstep: a frame waits until its images are processed. Robot and mount are those of the
    image.

    Args (further ones are those of `VisionOptions`):
        images: the topic of the images.
        topic: the topic of the sightings.
        takes: of images that arrive faster than frames, use the "newest" or "all".
        nth: of images that arrive asynchronously, use only every n-th.

    """

    @takes_options(VisionOptions)
    def __init__(
        self,
        images: str = "image",
        topic: str = "sightings",
        takes: str = "newest",
        nth: int = 1,
        **vision: Any,
    ) -> None:
        self._options = VisionOptions(**vision)
        self.takes, self.nth = takes, nth
        # Topics differ between worlds, so the instance attributes hide the class's.
        self.topics = (images,)
        self.publishes = (topic,)
        self._counts: Counter[str] = Counter()

    def joined(self, world: WorldInfo) -> None:
        self._locator = MarkerLocator(self._options, self._count)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        for image in tick.readings:
            if not isinstance(image, Image):
                raise MisuseError(
                    f"markers: expected images on {self.topics[0]!r}, found {type(image).__name__}"
                )
            self._count("images")
            try:
                seen = self._locator.locate(grey_of(image), image.mount)
            except (NoImage, WrongSize) as problem:
                self._count("wrong size" if isinstance(problem, WrongSize) else "garbage")
                continue
            tick.publish(self.publishes[0], Sightings(image.robot, seen, image.time))
        return ()

    def save(self) -> None:
        """Nothing: the counts are metrics."""

    def report(self) -> Mapping[str, bool | int | float | str]:
        return dict(self._counts)

    def _count(self, what: str) -> None:
        self._counts[what] += 1
