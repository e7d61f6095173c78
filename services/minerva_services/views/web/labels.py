"""Labels on the page, which keep their size on the screen, and clicks on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import LabelHandle, SceneApi

Point = tuple[float, float, float]
# viser's font in pixels at scale 1, and measures of a label in that font size.
_FONT_PIXELS = 12.0
_LETTER_WIDTH, _PADDING, _LABEL_HEIGHT = 0.62, 0.4, 1.5
_PAGE_HEIGHT = 800.0
"""Assumed height of a page in pixels of the style sheet.

Browsers send the height of their drawing buffer, which depends on the screen's pixel ratio and on
the load. On a page of another height, the clickable area of a label is larger or smaller than the
label.
"""


@dataclass(frozen=True, slots=True)
class PageLabel:
    """A text whose lower edge is at a position in metres; `agent` if it names one."""

    text: str
    position: Point
    scale: float = 1.0
    agent: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """A browser's camera: its axes (3,), and the side of a pixel per metre of distance."""

    ahead: NDArray[Any]
    right: NDArray[Any]
    up: NDArray[Any]
    pixel: float

    @staticmethod
    def of(camera: Any) -> Eye:
        """The eye of viser's camera."""
        ahead = np.asarray(camera.look_at) - np.asarray(camera.position)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, np.asarray(camera.up_direction))
        right = right / np.linalg.norm(right)
        pixel = 2 * math.tan(camera.fov / 2) / _PAGE_HEIGHT
        return Eye(ahead, right, np.cross(right, ahead), pixel)


class LabelNodes:
    """The nodes of a list of labels."""

    def __init__(self, scene: SceneApi, folder: str) -> None:
        self._scene = scene
        self._folder = folder
        self._nodes: list[LabelHandle] = []
        self.shown: Sequence[PageLabel] = ()

    def show(self, labels: Sequence[PageLabel]) -> None:
        """Show exactly these; only changes are sent."""
        before, self.shown = self.shown, labels
        while len(self._nodes) > len(labels):
            self._nodes.pop().remove()
        for number, label in enumerate(labels):
            if number == len(self._nodes):
                self._nodes.append(
                    self._scene.add_label(
                        f"{self._folder}/{number}",
                        label.text,
                        position=label.position,
                        anchor="bottom-center",
                        font_screen_scale=label.scale,
                    )
                )
            elif label != before[number]:
                node = self._nodes[number]
                node.text, node.position = label.text, label.position
                node.font_screen_scale = label.scale


def clicked_label(
    origin: NDArray[Any], direction: NDArray[Any], eye: Eye, labels: Sequence[PageLabel]
) -> PageLabel | None:
    """The nearest label that a ray from the camera hits."""
    along = float(direction @ eye.ahead)
    hits: list[tuple[float, int]] = []
    for number, label in enumerate(labels):
        place = np.array(label.position)
        depth = float((place - origin) @ eye.ahead)
        if depth <= 0 or along <= 0:
            continue
        # A label faces the camera, so its plane is at one depth.
        beside = (origin + direction * (depth / along) - place) / (depth * eye.pixel)
        em = _FONT_PIXELS * label.scale
        width, height = em * (_LETTER_WIDTH * len(label.text) + _PADDING), em * _LABEL_HEIGHT
        if abs(float(beside @ eye.right)) <= width / 2 and 0 <= float(beside @ eye.up) <= height:
            hits.append((depth, number))
    return labels[min(hits)[1]] if hits else None
