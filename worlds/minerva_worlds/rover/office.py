"""The robot's office in space: its string, and a ramp and furniture beside it.

With the option `camera` "rendered", markers hang on its walls, and robots recognise them in the
pictures of their cameras, by the detector of real ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from minerva_agents.robot import world as plane
from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.pose import Move, move_of
from minerva_agents.robot.robot import ALocalisingRobot, ARobot
from minerva_agents.robot.vocabulary import PRobot, TPlace
from minerva_bodies import Box, Camera, Matter, Poster, euler
from minerva_bodies.cameras import Cameras, focal_length
from minerva_bus import (
    Cells,
    Context,
    Default,
    Degrees,
    Event,
    EventBatch,
    EventType,
    Metres,
    Primitive,
    Range,
    Scene,
    Tick,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)
from minerva_bus.errors import WorldFileError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import agents
from minerva_bus.world.services import WorldInfo
from minerva_services.sensors import camera
from minerva_services.sensors.vision.detection import marker_cells
from minerva_services.sensors.vision.markers import Markers

SIZES: dict[str, Any] = dict.fromkeys("xyz", Metres)
WOOD = Matter(friction=1.0, fixed=True)

PBoard = Primitive("PBoard", Box("x", "y", "z", "#c8b078", matter=WOOD, meaning="ramp"), **SIZES)
PCase = Primitive("PCase", Box("x", "y", "z", "#7a5c8e", matter=WOOD, meaning="furniture"), **SIZES)
TLay = Transformation(
    "TLay", euler("x", "y", "z", pitch="pitch"), **SIZES, pitch=Default(Degrees, 0.0)
)

WIDTH, HEIGHT, FOV = 640, 360, 60.0
PCamera = Primitive("PCamera", Camera(WIDTH, HEIGHT, fov=FOV))
PPoster = Primitive(
    "PPoster",
    Poster("cells", "cell", meanings=("marker on a wall", "")),
    cells=Cells,
    cell=Metres,
)
THang = Transformation("THang", euler("x", "y", "z", turn="turn"), **SIZES, turn=Degrees)
eSight = EventType("eSight", visual=True)
eDrive = EventType(
    "eDrive", turn=Annotated[Degrees, Range(-15, 15)], ahead=Annotated[Metres, Range(0, 0.1)]
)
"""A policy drives a robot: the turn and then the way of its next frames."""


class _WithCamera:
    """A robot whose camera is above its centre, at the height of the markers."""

    @view("eSight")
    def see(self: Any, event: Event) -> Scene:
        """θ: the camera, and its robot, which those of others see."""
        carried = PRobot(self.id, self.radius) + TLay(0.0, 0.0, MIDDLE)(PCamera())
        return TPlace(*self.metres(self.position), self.angle)(carried)


class ARover(_WithCamera, ARobot, symbol="ARobot"):
    """A robot with a camera."""


class ALocalisingRover(_WithCamera, ALocalisingRobot, symbol="ALocalisingRobot"):
    """A robot with a camera that corrects its odometry."""


SECTORS = -90.0, -40.0, 0.0, 40.0, 90.0
"""Directions in degrees from the heading, of 40 degrees each."""
FAR = 4.0
"""Metres in a direction without an obstacle nearer than this."""


class ADrivenRobot(_WithCamera, ARobot, symbol="ADrivenRobot"):
    """A robot that draws its map and plans nothing: `eDrive` says how it moves.

    `near` are the metres to the nearest obstacle in each of the `SECTORS`.
    """

    turn: Degrees = 0.0
    ahead: Metres = 0.0
    near: tuple[Metres, ...] = (FAR,) * len(SECTORS)

    @on("eDrive")
    def drive(self, drive: Event, moment: Context) -> None:
        """The next moves."""
        self.turn, self.ahead = drive.turn, drive.ahead

    @on("eLaser", together=True, population=False)
    def sense_obstacle(self, laser: EventBatch | Event, moment: Context) -> None:
        """The map, and the nearest obstacles."""
        super().sense_obstacle(laser, moment)
        dist, angle = np.atleast_1d(laser.dist), np.atleast_1d(laser.angle)
        away = [abs((angle - middle + 180.0) % 360.0 - 180.0) for middle in SECTORS]
        self.near = tuple([float(dist[off <= 20.0].min(initial=FAR)) for off in away])

    def decide(self, event: Event, moment: Context) -> None:
        """The pose after the last move, and the next one."""
        if self.action.nodes:
            self._stand(self.pose.after(move_of(self.action), self.cell))
        self._act(Move(self.turn, self.ahead))


vocabulary = Vocabulary.of(
    *plane.vocabulary.primitives.values(),
    *plane.vocabulary.transformations.values(),
    *plane.vocabulary.events.values(),
    *(ARover, ALocalisingRover, ADrivenRobot, AParcel, PBoard, PCase, TLay, PCamera, PPoster),
    *(THang, eSight, eDrive),
)

THICK = 0.02  # half of a board, metres
CORRIDOR = 5.85, 0.8  # its middle and half of its width, y in metres
CASES = ((3.4, 3.6, 0.3), (6.1, 1.2, 0.25), (7.8, 11.0, 0.3), (13.0, 8.6, 0.25))
"""x, y and half of the side, metres."""

DICTIONARY, SIZE = "4X4_50", 0.3
"""Of the markers on the walls; metres, the side of the black square."""
MIDDLE = 0.25
"""Their height above the floor, metres."""
POSTERS = {
    "reception": (0.2, 1.3, 0.0),
    "office": (4.75, 4.15, 0.0),
    "workshop": (13.8, 4.0, 180.0),
    "lab": (14.55, 6.6, 270.0),
    "kitchen": (15.35, 11.2, 270.0),
    "meeting": (9.85, 6.75, 90.0),
    "store": (5.2, 8.6, 270.0),
    "library": (0.55, 10.15, 0.0),
}
"""Where on its wall the middle of a marker is, and to where it faces: x, y (m) and degrees."""
_AIR = 0.005
"""Metres between a wall and its marker."""


def posters() -> Scene:
    """The markers on the walls; their numbers count from 0. Raises MisuseError without OpenCV."""
    hung = Scene(())
    for number, (x, y, turn) in enumerate(POSTERS.values()):
        cells = marker_cells(DICTIONARY, number)
        cos, sin = portable.cos_sin(math.radians(turn))
        at = THang(round(x + _AIR * cos, 6), round(y + _AIR * sin, 6), MIDDLE, turn)
        hung += at(PPoster(cells, SIZE / (len(cells) - 2)))
    return hung


class Eyes(Cameras):
    """The cameras, the detector of markers and the service `camera` in one process.

    `eCamera` comes from pixels: of the topics `image` and `seen`, which a record may have.
    """

    def __init__(self, ros2: Mapping[str, Any] | None = None) -> None:
        """`ros2` is that of `Cameras`."""
        super().__init__("eSight", depths="", poses="poses", ros2=ros2)
        self._markers = Markers(
            topic="seen",
            dictionary=DICTIONARY,
            size=SIZE,
            names={str(number): name for number, name in enumerate(POSTERS)},
            fx=focal_length(WIDTH, FOV),
            # Of the middle pixels' centres, from 0.
            cx=(WIDTH - 1) / 2,
            cy=(HEIGHT - 1) / 2,
        )
        self._camera = camera.Camera("seen")
        self.publishes = (*self.publishes, *self._markers.publishes)

    def generates(self) -> tuple[str, ...]:
        return self._camera.generates()

    def check(self, world: WorldInfo) -> None:
        super().check(world)
        self._camera.check(world)

    def joined(self, world: WorldInfo) -> None:
        super().joined(world)
        self._markers.joined(world)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        """What the cameras recognise in this frame."""
        super().generate(tick)
        for service in (self._markers, self._camera):
            taken = [reading for topic, reading in tick.published if topic in service.topics]
            yield from service.generate(replace(tick, readings=tuple(taken)))


def defaults(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Those of the plane, and the services of the option `camera`. Raises MinervaError."""
    if options.get("driver") == "policy" and options.get("localise") == "matching":
        raise WorldFileError('option driver: "policy" needs localise = "odometry"')
    rendered = options.get("camera") == "rendered"
    return {
        **plane.defaults(options),
        "eyes": f"{__name__}:Eyes" if rendered else "camera",
        "poses": "poses" if rendered else "",
    }


def ramp(begin: float, slope: float, top: float, height: float) -> Scene:
    """A board up, a level one and a board down along the corridor; lengths in metres."""
    y, half = CORRIDOR
    angle, length = math.degrees(portable.atan2(height, slope)), portable.hypot(slope, height)
    level = height - THICK
    boards = Scene(())
    for x, side in ((begin + slope / 2, -1.0), (begin + 1.5 * slope + top, 1.0)):
        # The upper face goes from the floor to the height.
        across = THICK * height / length
        z = height / 2 - THICK * slope / length
        at = TLay(round(x - side * across, 6), y, round(z, 6), round(side * angle, 6))
        boards += at(PBoard(round(length / 2, 6), half, THICK))
    return boards + TLay(begin + slope + top / 2, y, level)(PBoard(top / 2, half, THICK))


def scene(options: Mapping[str, Any]) -> Scene:
    """The string of the robot's world, a ramp in the corridor, boxes in rooms, and the markers."""
    furniture = Scene(())
    for x, y, half in CASES:
        furniture += TLay(x, y, 0.3)(PCase(half, half, 0.3))
    string = plane.scene(options)
    if options.get("driver") == "policy":
        robots = {node.id: node for node in agents(string) if node.symbol == "ARobot"}
        others = [node for node in string.nodes if node not in robots.values()]
        driven = [ADrivenRobot(name, **node.state).string for name, node in robots.items()]
        string = sum(driven, Scene(tuple(others)))
    string += ramp(5.8, 0.7, 0.3, 0.07) + furniture
    return string + posters() if options.get("camera") == "rendered" else string
