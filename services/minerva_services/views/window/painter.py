"""The interface between views in windows and their geometric systems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.colors import Legend
from minerva_services.geometry.picture import Picture
from minerva_services.views.fates import OrderEntry
from minerva_services.views.names import AgentName

Floats: TypeAlias = NDArray[np.float64]
Pixels: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Laser beams from a position (m) to their end points (n, 2).

    `hits` (n,) marks beams that hit something; the others end at the laser's range.
    """

    x: float
    y: float
    ends: Floats
    hits: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Box:
    """A label's box on the screen: pixels from left and top.

    `names_agent`: the text is the name of the agent that it stands at.
    """

    text: str
    left: float
    top: float
    right: float
    bottom: float
    names_agent: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Everything that is displayed at one time.

    `caption` is the line about the world, `subtitle` further status; `notice` reports the last
    action or its failure; `help` lists keys and meanings, empty unless requested; `hint` names the
    key that requests it. `names` are labels of agents, `orders` the last orders of people.
    `follows`: keep the selected agent in the middle.
    """

    picture: Picture
    beams: Sequence[Beams] = ()
    caption: str = ""
    subtitle: str = ""
    notice: str = ""
    help: Sequence[tuple[str, str]] = ()
    selected: str = ""
    follows: bool = False
    hint: str = ""
    legend: Legend = ()
    names: Sequence[AgentName] = ()
    orders: tuple[OrderEntry, ...] = ()


class Painter(Protocol):
    """A geometric system with its own screen. Called only from the process's main thread."""

    def open(self, title: str, size: tuple[int, int]) -> None:
        """Open a window of this size in pixels. Raises MisuseError on failure."""
        ...

    def offscreen(self, size: tuple[int, int]) -> None:
        """Draw without a window at this size in pixels. Raises MisuseError on failure."""
        ...

    def resized(self, size: tuple[int, int]) -> None:
        """The window was resized."""
        ...

    def draw(self, sight: Sight) -> None:
        """Draw, and present it in the window if there is one."""
        ...

    def pixels(self) -> Pixels:
        """The last picture: RGB of shape (height, width, 3)."""
        ...

    def project(self, x: Floats, y: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        """Pixels from left and top of positions (m), and pixels per metre there.

        NaN behind the camera.
        """
        ...

    def labels(self) -> Sequence[Box]:
        """Boxes of the labels drawn last, topmost last."""
        ...

    def drag(self, dx: float, dy: float, button: int) -> bool:
        """The mouse moved by pixels with a button (1 left, 2, 3 right) held.

        True if the view now shows another place, which ends following an agent.
        """
        ...

    def zoom(self, steps: float, at: tuple[float, float]) -> None:
        """Zoom in by steps of a wheel, towards a pixel."""
        ...

    def fit(self) -> None:
        """Show the whole world again."""
        ...

    def close(self) -> None:
        """Called once at the end, even if nothing was opened."""
        ...
