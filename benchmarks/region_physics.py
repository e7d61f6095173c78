"""CPU time and bytes of regions with robots, whose physics runs in region 0 or in each region.

    python -m benchmarks.region_physics [--robots 100] [--regions 1 2 4] [--halo false true]

Robots with a laser of 90 beams and a camera drive about in a hall with one robot on four square
metres, and add up what they measure. CPU times are per robot and frame, as of
`benchmarks.region_halo`, without Zenoh.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.command import Option, Table, options
from benchmarks.region_halo import COLUMNS, measured
from minerva_bus import (
    Agent,
    Cells,
    Context,
    Degrees,
    Event,
    EventType,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)

SPACING: Final = 2.0
"""Metres between robots at the start."""

PMap = Primitive("PMap", cells=Cells, resolution=Metres, x=Metres, y=Metres, angle=Degrees)
PMarker = Primitive("PMarker", name=str)
PRobot = Primitive("PRobot", name=str, radius=Metres)
TPlace = Transformation("TPlace", x=Metres, y=Metres, angle=Degrees)
TRotate = Transformation("TRotate", angle=Degrees)
TMove = Transformation("TMove", dist=Metres)
eRepresent = EventType("eRepresent", visual=True)
eStep = EventType("eStep")
eLaser = EventType("eLaser", dist=Metres, angle=Degrees)
eCamera = EventType("eCamera", marker=str, dist=Metres, angle=Degrees)
eCollision = EventType("eCollision", shortfall=Metres)


class Rover(Agent, symbol="ARover"):
    """Drives about at random, and knows its own pose by dead reckoning."""

    x: Metres = 0.0
    y: Metres = 0.0
    angle: Degrees = 0.0
    turn: Degrees = 0.0
    dist: Metres = 0.0
    measured: float = 0.0

    @on("eLaser", together=True, population=False)
    def sense(self, laser: Event, moment: Context) -> None:
        """Add up the distances."""
        self.measured += float(np.sum(laser.dist))

    @on("eCamera")
    def see(self, camera: Event, moment: Context) -> None:
        """Add the distance of a marker."""
        self.measured += camera.dist

    @on("eCollision")
    def stop(self, collision: Event, moment: Context) -> None:
        """Go back by what it has not driven."""
        self._drive(0.0, -collision.shortfall)

    @on("eStep")
    def step(self, event: Event, moment: Context) -> None:
        """Be where the last command has led, and choose the next one."""
        self._drive(self.turn, self.dist)
        self.turn, self.dist = moment.chance.uniform(-20.0, 20.0), 0.1

    @view("eRepresent")
    def represent(self, event: Event) -> Scene:
        """The command at its pose."""
        robot = PRobot(self.id, 0.2)
        return TPlace(self.x, self.y, self.angle)(TRotate(self.turn)(TMove(self.dist)(robot)))

    def _drive(self, turn: float, dist: float) -> None:
        self.angle += turn
        heading = np.radians(self.angle)
        self.x += dist * float(np.cos(heading))
        self.y += dist * float(np.sin(heading))


vocabulary = Vocabulary.of(
    PMap, PMarker, PRobot, TPlace, TRotate, TMove, eRepresent, eStep, eLaser, eCamera, eCollision,
    Rover,
)  # fmt: skip


def _columns(robots: int) -> int:
    return max(n for n in range(1, robots + 1) if robots % n == 0 and n * n <= 2 * robots)


def scene(given: Mapping[str, Any]) -> Scene:
    """A hall with robots in rows, and a marker at each tenth one."""
    robots = given["robots"]
    columns = _columns(robots)
    rows = robots // columns
    cells = np.ones((columns + 2, rows + 2), np.int16)
    cells[1:-1, 1:-1] = 0
    string = PMap(cells, SPACING, -SPACING, -SPACING, 0.0)
    for number in range(0, robots, 10):
        x, y = SPACING * (number % columns), SPACING * (number // columns)
        string += TPlace(x + SPACING, y + SPACING, 0.0)(PMarker(f"m{number}"))
    numbers = np.arange(robots)
    x, y = SPACING * (numbers % columns + 0.5), SPACING * (numbers // columns + 0.5)
    return string + Rover.many("r", robots, x=x, y=y, angle=37.0 * numbers % 360.0)


def world(folder: Path, robots: int, regions: int, halo: str) -> Path:
    """A world file with a hall that is divided into cells of about equal size."""
    width = SPACING * _columns(robots)
    height = SPACING * robots / _columns(robots)
    columns = _columns(regions)
    borders = {"x": columns, "y": regions // columns}
    sides = {"x": width, "y": height}
    grid = ", ".join(
        f"{name} = {[sides[name] * n / count for n in range(1, count)]}"
        for name, count in borders.items()
    )
    module = "benchmarks.region_physics"
    path = folder / "rovers.toml"
    path.write_text(
        f'[world]\nvocabulary = "{module}:vocabulary"\nscene = "{module}:scene"\nseed = 7\n'
        'order = ["eCollision", "eLaser", "eCamera", "eStep", "eRepresent"]\n'
        f"[options]\nrobots = {robots}\n"
        f'[process.rovers]\nagents = "{module}:Rover"\n'
        '[process.physics]\nservice = "physics"\n'
        '[process.laser]\nservice = "laser"\n[process.camera]\nservice = "camera"\n'
        '[process.steps]\nservice = "each"\nevent = "eStep"\n'
        '[process.views]\nservice = "each"\nevent = "eRepresent"\n'
        f"[regions]\ngrid = {{ {grid} }}\nhalo = {halo}\n"
    )
    return path


def main() -> None:
    """Print a row for each number of regions, with physics in region 0 and in each region."""
    given = options(
        __doc__, robots=Option(100, "in all regions together"), regions=[1, 2, 4],
        halo=Option(["false", "true"], "true, false or both"), frames=8, turns=1,
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    for count in given.regions:
        for halo in given.halo if count > 1 else ["false"]:
            with tempfile.TemporaryDirectory() as folder:
                path = world(Path(folder), given.robots, count, halo)
                run = partial(measured, path, given.robots, count, given.frames)
                turns = [run() for _ in range(given.turns)]
            best = {name: min(turn[name] for turn in turns) for name in turns[0]}
            table.row({"regions": count, "halo": halo, "agents": given.robots, **best})


if __name__ == "__main__":
    main()
