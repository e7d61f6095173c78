"""Colour-blind readers can distinguish the colours of the robot's world.

The simulation is that of Machado, Oliveira and Fernandes (2009), severity 1.0; distances are ΔE*ab
(CIE 1976) of colours as they appear on the floor.
"""

from itertools import combinations

import numpy as np
import pytest

from minerva_agents.robot.world import vocabulary
from minerva_services.geometry.colors import legend, rgb

SIGHTS = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
WHITE = np.array([0.95047, 1.0, 1.08883])
FLOOR = "#fbfaf6"
DISTINCT = 10.0


def linear(color):
    return np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)


def lab(light):
    share = XYZ @ np.clip(light, 0, 1) / WHITE
    f = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


class Every(frozenset[str]):
    """All colours."""

    def __contains__(self, _: object) -> bool:
        return True


def shown_colors():
    """Colours on the floor with their legend's texts; a colour of several things counts once."""
    colors: dict[tuple[float, ...], str] = {}
    for entry in legend(vocabulary, dict.fromkeys(vocabulary.primitives, Every())):
        for color in entry.colors:
            over = entry.opacity * np.array(rgb(color)) + (1 - entry.opacity) * np.array(rgb(FLOOR))
            colors.setdefault(tuple(over / 255), entry.text)
    return colors


@pytest.mark.parametrize("sight", SIGHTS)
def test_every_two_colours_are_distinct(sight):
    places = {
        text: lab(SIGHTS[sight] @ linear(np.array(color))) for color, text in shown_colors().items()
    }
    assert len(places) >= 10
    near = {
        (first, second): round(float(np.linalg.norm(places[first] - places[second])), 1)
        for first, second in combinations(places, 2)
    }
    assert min(near.values()) >= DISTINCT, min(near, key=near.get)


def test_black_and_white_are_as_distant_as_cie_1976_says():
    assert np.linalg.norm(lab(np.ones(3)) - lab(np.zeros(3))) == pytest.approx(100.0, abs=0.01)
