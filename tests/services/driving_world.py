"""A small robotic vocabulary, an agent that drives blindly, and a world with failures."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from minerva_bus import (
    Agent,
    Cells,
    Default,
    Degrees,
    Event,
    EventType,
    Frame,
    Metres,
    Primitive,
    Scene,
    Tick,
    Transformation,
    Vocabulary,
    WorldInfo,
    on,
    view,
)
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import agents
from minerva_bus.runtime.runner import InProcessRunner, deliver
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Service
from minerva_services.input.each import Each
from minerva_services.physics.kept import kept_bodies
from minerva_services.physics.service import Physics
from minerva_services.sensors.camera import Camera
from minerva_services.sensors.laser import Laser

PMap = Primitive(
    "PMap",
    cells=Cells,
    resolution=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)
PMarker = Primitive("PMarker", name=str)
PRobot = Primitive("PRobot", name=str, radius=Metres)
PTree = Primitive("PTree")
TPlace = Transformation("TPlace", x=Metres, y=Metres, angle=Degrees)
TRotate = Transformation("TRotate", angle=Degrees)
TMove = Transformation("TMove", dist=Metres)
TPaint = Transformation("TPaint")

RADIUS = 0.2


class ADriver(Agent, symbol="ADriver"):
    """Turns and drives the same amount in every frame; its pose is from dead reckoning."""

    x: Metres = 2.0
    y: Metres = 2.0
    angle: Degrees = 0.0
    turn: Degrees = 0.0
    speed: Metres = 0.0
    frames: int = 0
    heard: float = 0.0
    seen: tuple[str, ...] = ()
    short: Metres = 0.0

    @on("eLaser")
    def hear(self, laser: Event, moment: object) -> None:
        self.heard = self.heard * 0.5 + laser.dist * (1 + abs(laser.angle))

    @on("eCamera")
    def see(self, camera: Event, moment: object) -> None:
        self.seen = tuple(sorted({*self.seen, camera.marker}))
        self.heard += camera.dist + camera.angle

    @on("eCollision")
    def stop(self, collision: Event, moment: object) -> None:
        self.short += collision.shortfall

    @on("eDecide")
    def decide(self, decide: Event, moment: object) -> None:
        self.angle = self.angle + self.turn
        self.x += self.speed * math.cos(math.radians(self.angle))
        self.y += self.speed * math.sin(math.radians(self.angle))
        self.frames += 1

    @view("eRepresent")
    def represent(self, event: Event) -> Scene:
        action = TRotate(self.turn)(TMove(self.speed)(PRobot(self.id, RADIUS)))
        return TPlace(self.x, self.y, self.angle)(action)


EVENTS = (
    EventType("eLaser", dist=Metres, angle=Degrees),
    EventType("eClear", dist=Metres, angle=Degrees),
    EventType("eCamera", marker=str, dist=Metres, angle=Degrees),
    EventType("eCollision", shortfall=Metres),
    EventType("eObjective", marker=str),
    EventType("eDecide"),
    EventType("eRepresent", visual=True),
)
VOCABULARY = Vocabulary.of(
    PMap, PMarker, PRobot, PTree, TPlace, TRotate, TMove, TPaint, ADriver, *EVENTS
)
INFO = WorldInfo("yard", VOCABULARY, 7, 0.1)
ORDER = Priority(("eLaser", "eCamera", "eCollision", "eObjective", "eDecide", "eRepresent"))


def world_with(*events: EventType) -> WorldInfo:
    """A world with these event types, and no others."""
    return WorldInfo("yard", Vocabulary.of(*events), 7, 0.1)


def room(width_m: float, height_m: float, resolution: float = 0.1) -> Scene:
    """A floor that is free from (0, 0) to (width, height), and solid around."""
    shape = round(width_m / resolution), round(height_m / resolution)
    return PMap(np.zeros(shape, np.int16), resolution)


def tick(number: int = 1, *readings: Reading, orders: Iterable[Event] = (), seed: int = 7) -> Tick:
    return Tick(Frame(number, 0.1, seed), "tested", readings=readings, orders=tuple(orders))


def joined(service: Any, world: WorldInfo = INFO) -> Any:
    service.joined(world)
    return service


class Mortal:
    """A participant that dies at a message and may lose some of its replies to that message.

    `answers` is the number of replies that are still sent: with none, the message has no effect;
    with all, the participant dies immediately afterwards.
    """

    def __init__(self, name: str, born: Callable[[], Service]) -> None:
        self.name = name
        self._born = born
        self.heard = 0
        self.dies_at = -1
        self.answers = 0
        self.dead = False
        self.reborn()

    def reborn(self) -> None:
        """Replace the process by a new one without state."""
        self.dead = False
        self._participant = Member(self.name, self._born())

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["_participant"], name)

    def receive(self, message: Any) -> list[Any]:
        if self.dead:
            return []
        self.heard += 1
        answers = self._participant.receive(message)
        if self.heard - 1 != self.dies_at:
            return answers
        self.dead = True
        return answers[: self.answers]


class Yard(InProcessRunner):
    """A world of drivers in one process, which restarts its physics when that dies."""

    def __init__(
        self,
        scene: Scene,
        seed: int = 7,
        physics: Callable[[], Physics] = Physics,
        notices_at_once: bool = True,
        represents_every: int = 1,
    ) -> None:
        self.mortal = Mortal("physics", physics)
        self.frames: list[m.FrameRecord] = []
        self.scenes: list[Scene] = []
        self.deaths = 0
        self._notices_at_once = notices_at_once
        others = [
            Member("camera", Camera()),
            Member("decide", Each("eDecide")),
            Member("drivers", agents=[ADriver]),
            Member("laser", Laser()),
            Member("represent", Each("eRepresent", represents_every)),
        ]
        names = frozenset({"physics", *(other.name for other in others)})
        world = WorldSpec("yard", scene, VOCABULARY, seed, 0.1, ORDER, expected=names)
        members = [self.mortal, *others]
        super().__init__(FrameAlgorithm(world), members, self._saw, deliver=self._delivered)  # type: ignore[arg-type]
        self.start()

    def _saw(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            self.frames.append(instruction.record)

    def _delivered(self, member: Member, message: m.ToMember | m.Readings) -> list[Any]:
        answers = list(deliver(member, message))
        if self.mortal.dead and self._notices_at_once:
            self.deaths += 1
            self.mortal.reborn()
            answers += [s.Vanished("physics"), s.Appeared("physics")]
        return answers

    def run(self, frames: int) -> "Yard":
        for _ in range(frames):
            self.scenes.append(self.algorithm.scene)
            done = len(self.frames)
            self.handle(s.Begin())
            while len(self.frames) == done:
                self._raise_the_dead()
            if self.mortal.dead:  # the death has not been noticed yet
                self._raise_the_dead()
        return self

    def _raise_the_dead(self) -> None:
        assert self.mortal.dead, f"waits for {self.algorithm.waiting_for()}"
        self.deaths += 1
        self.mortal.reborn()
        self.handle(s.Vanished("physics"))
        self.handle(s.Appeared("physics"))

    @property
    def digests(self) -> list[bytes]:
        return [frame.digest for frame in self.frames]

    def events(self, frame: int, event_type: str) -> list[Event]:
        return [event for event in single(self.frames[frame].events) if event.type == event_type]

    def pose(self, name: str) -> tuple[float, ...]:
        """The pose of a body in the physics world: x, y in metres, angle in degrees."""
        at = kept_bodies(self.mortal.service.save())[name].body.pose
        return at.x, at.y, at.angle

    def belief(self, frame: int, name: str) -> Any:
        """The state of an agent in the string at the beginning of a frame."""
        (node,) = [agent for agent in agents(self.scenes[frame]) if agent.id == name]
        return Belief(**node.state)


@dataclass
class Belief:
    """The attributes of a driver."""

    x: float
    y: float
    angle: float
    turn: float
    speed: float
    frames: int
    heard: float
    short: float
    seen: tuple[str, ...] = field(default=())

    @property
    def pose(self) -> tuple[float, float, float]:
        return self.x, self.y, self.angle


def driver(name: str, **state: Any) -> Scene:
    return ADriver(name, **state).string
