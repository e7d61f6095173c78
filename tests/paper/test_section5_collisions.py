"""Collision events from the scene geometry, as in section 5 of the paper.

"[...] if an agent has to react to collisions, the event generator of this type would calculate the
collisions between elements by extracting the scene geometry from the graphics engine (it would use
the implementation of the functions α, β and δ to calculate the bounding box of the elements). Then,
it would generate the events needed to react to such collisions."
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from minerva_bus import (
    Agent,
    BatchContext,
    Cells,
    Context,
    Default,
    Degrees,
    Disc,
    Event,
    EventType,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import agents
from minerva_bus.world.event_collection import Priority
from minerva_services.geometry.volumes import volumes
from minerva_services.input.each import Each
from minerva_services.physics.collisions import Collisions
from minerva_services.physics.service import Physics
from tests.collision_event import eCollision
from tests.one_process import run_world

SIZE, RADIUS = 8.0, 0.3
CELLS = np.ones((20, 20), np.int16)
CELLS[2:-2, 2:-2] = 0
CELLS[9:11, 9:11] = 1

PMap = Primitive(
    "PMap",
    Raster("cells", "resolution", "x", "y", "angle", height=1.0),
    cells=Cells,
    resolution=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)
PBall = Primitive("PBall", Disc("radius"), radius=Metres, who=str)
PRobot = Primitive("PRobot", Disc("radius"), name=str, radius=Metres)
TPlace = Transformation(
    "TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0.0)
)
TMove = Transformation("TMove", Motion(forward="dist"), dist=Metres)
eStep = EventType("eStep")
eBody = EventType("eBody", visual=True)
eRepresent = EventType("eRepresent", visual=True)


class Ball(Agent, symbol="ABall"):
    """Moves in a straight line and bounces off the obstacles of its collision events."""

    x: Metres
    y: Metres
    vx: float
    vy: float
    hits: int = 0

    @on("eCollision", population=True)
    def bounce(self, hit: Event, moment: BatchContext) -> None:
        into = np.minimum(self.vx * hit.nx + self.vy * hit.ny, 0.0)
        self.vx = self.vx - 2 * into * hit.nx
        self.vy = self.vy - 2 * into * hit.ny
        self.hits = self.hits + 1

    @on("eStep", population=True)
    def roll(self, step: Event, moment: BatchContext) -> None:
        self.x = self.x + self.vx * moment.dt
        self.y = self.y + self.vy * moment.dt

    @view("eBody", population=True)
    def body(self, event: Event) -> Scene:
        return TPlace(self.x, self.y)(PBall(RADIUS, self.id))


class PlainBall(Agent, symbol="ABall"):
    """The same as Ball, with activities for a single agent."""

    x: Metres
    y: Metres
    vx: float
    vy: float
    hits: int = 0

    @on("eCollision")
    def bounce(self, hit: Event, moment: Context) -> None:
        into = min(self.vx * hit.nx + self.vy * hit.ny, 0.0)
        self.vx, self.vy = self.vx - 2 * into * hit.nx, self.vy - 2 * into * hit.ny
        self.hits += 1

    @on("eStep")
    def roll(self, step: Event, moment: Context) -> None:
        self.x, self.y = self.x + self.vx * moment.dt, self.y + self.vy * moment.dt

    @view("eBody")
    def body(self, event: Event) -> Scene:
        return TPlace(self.x, self.y)(PBall(RADIUS, self.id))


class Robot(Agent, symbol="ARobot"):
    """Drives straight on, in a physics world and in a world with collision detection only."""

    x: Metres = 1.5
    collisions: tuple[str, ...] = ()

    @on("eCollision")
    def hear(self, hit: Event, moment: Context) -> None:
        place = f"{hit.what} {hit.x:.3f} {hit.y:.3f} {hit.nx:g} {hit.ny:g} {hit.begins}"
        self.collisions = (*self.collisions, place)

    @on("eStep")
    def drive(self, step: Event, moment: Context) -> None:
        self.x = min(self.x + 0.5, 3.0 - RADIUS)

    @view("eRepresent")
    def represent(self, event: Event) -> Scene:
        return TPlace(self.x, 2.0)(TMove(min(0.5, 2.7 - self.x + 0.01))(PRobot(self.id, RADIUS)))

    @view("eBody")
    def body(self, event: Event) -> Scene:
        return TPlace(self.x, 2.0)(PRobot(self.id, RADIUS))


VOCABULARY = Vocabulary.of(
    *(PMap, PBall, PRobot, TPlace, TMove, eStep, eBody, eRepresent, eCollision, Ball, Robot)
)


class Story:
    """An in-process run: digests, strings and collisions of its frames."""

    def __init__(self, scene: Scene, members: list[Member], frames: int) -> None:
        names = frozenset(member.name for member in members)
        world = WorldSpec(
            "test",
            scene,
            VOCABULARY,
            seed=5,
            dt=0.05,
            frames=frames,
            order=Priority(("eCollision", "eStep")),
            expected=names,
        )
        self.digests: list[str] = []
        self.scenes: list[Scene] = []
        self.collisions: list[list[Event]] = []

        def watch(done: FrameDone, scene: Scene) -> None:
            events = single(done.record.events)
            self.digests.append(scene.digest.hex())
            self.scenes.append(scene)
            self.collisions.append([event for event in events if event.type == "eCollision"])

        run_world(world, members, watch)


def billiards(count: int = 32) -> Scene:
    rng = np.random.default_rng(3)
    columns = (np.arange(count) % 8, np.arange(count) // 8)
    turn = rng.uniform(0, 2 * np.pi, count)
    balls = Ball.many(
        "b",
        count,
        x=1.2 + 0.8 * columns[0],
        y=1.2 + 1.3 * columns[1],
        vx=2 * np.cos(turn),
        vy=2 * np.sin(turn),
    )
    return PMap(CELLS, SIZE / 20) + balls


def play(hosts: int = 1, kind: type[Agent] = Ball, frames: int = 80) -> Story:
    members = [
        Member("collisions", Collisions(persist=True)),
        Member("steps", Each("eStep")),
        *(Member(f"host-{number}", agents=[kind]) for number in range(hosts)),
    ]
    return Story(billiards(), members, frames)


def test_the_geometry_is_that_of_alpha_beta_and_delta() -> None:
    scene = TPlace(2.0, 1.0, 90.0)(TMove(3.0)(PBall(0.5, "a")) + PMap(CELLS, 0.1))
    lower, upper = volumes(scene, VOCABULARY).boxes()
    assert (*lower[0], *upper[0]) == pytest.approx((1.5, 3.5, 2.5, 4.5))
    assert (*lower.min(axis=0), *upper.max(axis=0)) == pytest.approx((0.0, 1.0, 2.5, 4.5))


def test_agents_bounce_and_know_each_other_by_events_only() -> None:
    story = play()
    hits = sum(agent.state["hits"] for agent in agents(story.scenes[-1]))  # pyright: ignore
    collisions = [event for frame in story.collisions for event in frame]
    assert hits == len(collisions) > 40
    assert {"", "b0"} < {event.other for event in collisions}
    for agent in agents(story.scenes[-1]):
        state: Any = agent.state
        assert math.hypot(state["vx"], state["vy"]) == pytest.approx(2.0)
        assert all(0.5 < state[axis] < SIZE - 0.5 for axis in "xy")


def test_an_event_reports_what_the_previous_frame_showed() -> None:
    story = play()
    for shown, frame in pairwise(range(80)):
        view_of = story.scenes[shown - 1] if shown else billiards()
        place: dict[str, Any] = {agent.id: agent.state for agent in agents(view_of)}
        close = {
            (first, other)
            for first in place
            for other in place
            if first != other
            and math.dist(
                (place[first]["x"], place[first]["y"]), (place[other]["x"], place[other]["y"])
            )
            <= 2 * RADIUS
        }
        reported = {
            (event.receivers[0], event.other) for event in story.collisions[frame] if event.other
        }
        assert reported == close


def test_the_string_is_the_same_on_any_number_of_processes_and_for_one_or_for_all() -> None:
    digests = play().digests
    assert len(set(digests)) == len(digests)
    assert play(3).digests == digests
    assert play(2, PlainBall).digests == digests


def test_physics_and_scene_geometry_report_the_same_collisions() -> None:
    walls = np.zeros((10, 10), np.int16)
    walls[6:, :] = 1  # a wall from x = 3 on
    scene = PMap(walls, 0.5) + VOCABULARY.read("ARobot#r")
    stories: list[Any] = []
    for service in (Physics(), Collisions(who="name", persist=True)):
        members = [
            Member("service", service),
            Member("steps", Each("eStep")),
            Member("host", agents=[Robot]),
        ]
        if isinstance(service, Physics):
            members.append(Member("shows", Each("eRepresent")))
        story = Story(scene, members, 8)
        (robot,) = agents(story.scenes[-1])
        stories.append(robot.state["collisions"])
        names = {event.names for frame in story.collisions for event in frame}
        assert names == {eCollision.fields.names}
    assert stories[0][0] == stories[1][0] == "PMap 3.000 2.000 -1 0 True"
    assert stories[0][1] == stories[1][1] == "PMap 3.000 2.000 -1 0 False"
