"""Parameters of the models of the public comparison, in two sizes, and of crowds.

Source: JuliaDynamics/ABMFrameworksComparison, the file DECLARATION.md of each model. The forest
fire is no longer part of the published tables; its parameters are those of earlier ones. The size
`crowd` and the model `wealth` are not part of that comparison: their numbers of agents are those of
`benchmarks.populations`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class WolfSheep:
    """Numbers of animals, side of the lattice, steps of regrowth, probabilities of births."""

    sheep: int
    wolves: int
    side: int
    regrowth: int
    sheep_breed: float
    wolf_breed: float
    steps: int = 100
    sheep_gain: float = 5.0
    wolf_gain: float = 13.0


@dataclass(frozen=True, slots=True)
class Flocking:
    """Number of birds, side of the periodic square, and how far a bird sees."""

    birds: int
    side: float
    sight: float
    steps: int = 100
    speed: float = 1.0
    separation: float = 1.0
    cohere: float = 0.03
    separate: float = 0.015
    match: float = 0.05


@dataclass(frozen=True, slots=True)
class Schelling:
    """Number of agents, side of the lattice, Chebyshev radius, and similar neighbours wanted."""

    agents: int
    side: int
    radius: int
    wanted: int
    steps: int = 20


@dataclass(frozen=True, slots=True)
class ForestFire:
    """Side of the lattice, and share of cells with a tree."""

    side: int
    density: float
    steps: int = 100


@dataclass(frozen=True, slots=True)
class Wealth:
    """Number of people, who have one coin each; a rich one gives a coin to a random one."""

    people: int
    steps: int = 100


Parameters = WolfSheep | Flocking | Schelling | ForestFire | Wealth

PARAMETERS: Final[dict[tuple[str, str], Parameters]] = {
    ("wolf_sheep", "small"): WolfSheep(60, 40, 25, 20, 0.2, 0.1),
    ("wolf_sheep", "large"): WolfSheep(1000, 500, 100, 10, 0.4, 0.2),
    ("flocking", "small"): Flocking(200, 100.0, 5.0),
    ("flocking", "large"): Flocking(400, 150.0, 15.0),
    ("schelling", "small"): Schelling(1000, 40, 1, 3),
    ("schelling", "large"): Schelling(8000, 100, 2, 8),
    ("forest_fire", "small"): ForestFire(100, 0.7),
    ("forest_fire", "large"): ForestFire(500, 0.9),
    ("wealth", "small"): Wealth(1000),
    ("wolf_sheep", "crowd"): WolfSheep(10_000, 5_000, 200, 30, 0.04, 0.05, 20, 4.0, 20.0),
    ("flocking_at_once", "small"): Flocking(200, 100.0, 5.0),
    ("flocking_at_once", "crowd"): Flocking(100_000, 3162.0, 10.0, steps=20, separation=2.0),
    ("wealth", "crowd"): Wealth(1_000_000, steps=20),
}
MODELS: Final = tuple(dict.fromkeys(model for model, _ in PARAMETERS))
SIZES: Final = ("small", "large", "crowd")
PUBLIC: Final = ("wolf_sheep", "flocking", "schelling", "forest_fire")
"""The models of the public comparison."""
