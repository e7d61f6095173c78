"""What a view in a window draws with, and what it is given to draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.picture import Picture

Floats: TypeAlias = NDArray[np.float64]
Pixels: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """A laser's beams: from a place (m) of the world to the points (n, 2) where they end.

    `hits` (n,) tells which have hit something; the others end at the laser's range.
    """

    x: float
    y: float
    ends: Floats
    hits: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Box:
    """Where a label is on the screen: pixels from the left and from the top."""

    text: str
    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """All that is to be seen in one moment.

    `caption` is the line about the world, `subtitle` what else is worth saying in it; `notice`
    what was just done, or why it was not; `help` are keys and what they do, empty where nobody
    has asked. `follows`: the selected agent stays in the middle.
    """

    picture: Picture
    beams: Sequence[Beams] = ()
    caption: str = ""
    subtitle: str = ""
    notice: str = ""
    help: Sequence[tuple[str, str]] = ()
    selected: str = ""
    follows: bool = False


class Painter(Protocol):
    """A geometric system with a screen of its own. Only the process's main thread calls it."""

    def open(self, title: str, size: tuple[int, int]) -> None:
        """Open a window of so many pixels. Raises MisuseError where it cannot."""
        ...

    def offscreen(self, size: tuple[int, int]) -> None:
        """Draw without a window, on so many pixels. Raises MisuseError where it cannot."""
        ...

    def resized(self, size: tuple[int, int]) -> None:
        """The window has another size now."""
        ...

    def draw(self, sight: Sight) -> None:
        """Draw, and show it where there is a window."""
        ...

    def pixels(self) -> Pixels:
        """What was drawn last: red, green and blue of shape (height, width, 3)."""
        ...

    def project(self, x: Floats, y: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        """Where places (m) are on the screen: pixels from the left, from the top, per metre.

        Not a number for what is behind the one who looks.
        """
        ...

    def labels(self) -> Sequence[Box]:
        """Where the labels are that were drawn last, the topmost last."""
        ...

    def drag(self, dx: float, dy: float, button: int) -> bool:
        """The mouse was moved by so many pixels with a button (1 left, 2, 3 right) held.

        True where another place is looked at now, so that nobody is followed any more.
        """
        ...

    def zoom(self, steps: float, at: tuple[float, float]) -> None:
        """Come nearer by so many steps of a wheel, to what is at a pixel."""
        ...

    def fit(self) -> None:
        """Show the whole world again."""
        ...

    def close(self) -> None:
        """Called once, at the end, also where nothing was opened."""
        ...
