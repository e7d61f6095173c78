"""Options shared by views in windows: a window, PNG pictures, or a video."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, check_file, check_output
from minerva_bus.wording import install

_PIXELS = range(100, 7681)
RATE = 30.0
"""Maximum views per second of a window."""


class Medium(Enum):
    """Where a view is displayed."""

    WINDOW = "window"
    PICTURES = "pictures"
    VIDEO = "video"


@dataclass(frozen=True, slots=True)
class WindowOptions:
    """Options of views in windows, validated on creation; raises MisuseError.

    `service` is the name of the view and of its extra, `needs` the modules that it imports.

    Args:
        width: width of the window or picture in pixels.
        height: height in pixels.
        path: a PNG file instead of a window; each picture replaces the previous one atomically.
        every: frames between views. 0: thirty views per second in a window, every 10th frame as a
          picture, every frame in a video.
        frames: keep all pictures, numbered by frame, as in `world-000010.png`.
        video: an .mp4 or .gif file instead of a window; needs `pip install 'minerva-bus[video]'`.
        fps: frame rate of the video; 0: as many pictures as there are views, up to 60 (GIF: 25).
        speed: speed of the video relative to simulated time; at 1, worlds with frames longer than a
          tenth of a second are shown at ten frames per second.
        click: the event type sent by a click on a label, if the world accepts several.
        slide: the event type sent by the arrow keys, if the world accepts several.
        follow: an agent to keep in the middle.
        person: the name under which the window gives orders; empty: that of its process.

    """

    service: str
    needs: tuple[str, ...] = ("pygame",)
    width: int = 1200
    height: int = 800
    path: str = ""
    every: int = 0
    frames: bool = False
    video: str = ""
    fps: float = 0.0
    speed: float = 1.0
    click: str = ""
    slide: str = ""
    follow: str = ""
    person: str = ""
    environment: Mapping[str, str] = field(default_factory=lambda: os.environ, repr=False)

    def __post_init__(self) -> None:
        for name, side in (("width", self.width), ("height", self.height)):
            if side not in _PIXELS:
                raise self._wrong(f"{name} is {side}; expected 100 to 7680 pixels")
        if self.path and self.video:
            raise self._wrong("path and video are both set; use one, or add a second view")
        if self.path:
            check_ending(Path(self.path), (".png",), self.service)
        if self.video:
            check_ending(Path(self.video), (".mp4", ".gif"), self.service)
        if self.every < 0:
            raise self._wrong(f"every is {self.every}; expected a number of frames from 0")
        if not (0 <= self.fps <= 120 and 0 < self.speed <= 1e6):
            raise self._wrong("fps must be 0 to 120 and speed above 0")
        self._check_installed()
        self._check_display()
        self._check_output()

    @property
    def medium(self) -> Medium:
        """The medium, from the options that are set."""
        if self.video:
            return Medium.VIDEO
        return Medium.PICTURES if self.path else Medium.WINDOW

    @property
    def size(self) -> tuple[int, int]:
        """Size in pixels; even for a video, as its encoder requires."""
        if self.medium is Medium.VIDEO:
            return self.width // 2 * 2, self.height // 2 * 2
        return self.width, self.height

    @property
    def asks_every(self) -> int:
        """Frames between views; 0 for a window, which is timed by the clock."""
        return self.every or {Medium.WINDOW: 0, Medium.PICTURES: 10, Medium.VIDEO: 1}[self.medium]

    @property
    def when(self) -> str:
        """When views are made: by the clock for a window, otherwise by frames."""
        return f"each {self.asks_every} frames" if self.asks_every else f"at {RATE:g} Hz"

    def _check_installed(self) -> None:
        extras = dict.fromkeys(self.needs, self.service)
        if self.video:
            extras["av"] = "video"
        missing = [module for module in extras if importlib.util.find_spec(module) is None]
        if missing:
            wanted = ",".join(dict.fromkeys(extras[module] for module in missing))
            raise self._wrong(f"it needs {', '.join(missing)}: {install(wanted)}")

    def _check_display(self) -> None:
        if self.medium is Medium.WINDOW and not has_display(self.environment):
            raise self._wrong(
                "there is no display to open a window on (DISPLAY and WAYLAND_DISPLAY are not"
                " set); write pictures with path=FILE.png, or a video with video=FILE.mp4"
            )

    def _check_output(self) -> None:
        """Reject an output file that must not be overwritten before the world runs."""
        if self.video:
            check_file(Path(self.video), self.service)
        elif self.path and not self.frames:
            check_output(Path(self.path), self.service)

    def _wrong(self, problem: str) -> MisuseError:
        return MisuseError(f"{self.service}: {problem}")


def has_display(environment: Mapping[str, str], platform: str = sys.platform) -> bool:
    """True if windows can be opened here, according to the environment.

    SDL_VIDEODRIVER overrides the check.
    """
    if platform in ("win32", "darwin"):
        return True
    return any(environment.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"))
