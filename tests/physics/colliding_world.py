"""Random scenes of discs, walls and boxes, and the vocabulary for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st

from minerva_bus import (
    EMPTY,
    Cells,
    Degrees,
    Disc,
    Event,
    EventType,
    Frame,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.grammar.events import single
from minerva_bus.grammar.fields import Default, Fields
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_services.physics.collisions import Collisions
from tests.collision_event import eCollision

PBody = Primitive("PBody", Disc("radius"), radius=Metres, who=Default(str, ""))
PBar = Primitive(
    "PBar",
    Line("xs", "ys", width=0.25),
    xs=tuple[float, ...],
    ys=tuple[float, ...],
    who=Default(str, ""),
)
PBlock = Primitive(
    "PBlock", Raster("cells", "cell", height=1.0), cells=Cells, cell=Metres, who=Default(str, "")
)
TPlace = Transformation("TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Degrees)
eBody = EventType("eBody", visual=True)
WORDS = PBody, PBar, PBlock, TPlace, eBody, AgentKind("ABall", Fields())
VOCABULARY = Vocabulary.of(*WORDS, eCollision)


def joined(*, collision: EventType = eCollision, **options: Any) -> Collisions:
    service = Collisions(**options)
    service.joined(WorldInfo("test", Vocabulary.of(*WORDS, collision), seed=0, dt=0.1))
    return service


def slots(*names: str, kind: str = "ABall") -> Scene:
    return Scene(tuple(AgentNode(kind, name) for name in names))


def told(
    service: Collisions, scene: Scene, frame: int = 0, parts: dict[str, Scene] | None = None
) -> list[Event]:
    """The events in the frame after a view."""
    service.show(View(frame, "eBody", scene, parts or {}))
    made = [
        VOCABULARY.check_any(event)
        for event in service.generate(Tick(Frame(number=frame + 1), "collisions"))
    ]
    return list(single(made))


def ball(who: str, x: float, y: float, radius: float = 0.5) -> Scene:
    return TPlace(x, y, 0.0)(PBody(radius, who))


Shape = tuple[str, float, float, float, float, float]

# Multiples of 1/8 often give exact contacts and coincident corners.
eighths = st.integers(0, 40).map(lambda number: number / 8)
sizes = st.integers(1, 8).map(lambda number: number / 8)
angles = st.sampled_from((0.0, 0.0, 30.0, 45.0, 90.0, 111.1, -77.0))
kinds = st.sampled_from(("disc", "bar", "block"))
shapes = st.tuples(kinds, eighths, eighths, angles, sizes, sizes)


def figure(shape: Shape, who: str) -> Scene:
    kind, x, y, angle, size, other = shape
    if kind == "disc":
        body = PBody(size, who)
    elif kind == "bar":
        body = PBar((0.0, size), (0.0, other), who)
    else:
        cells = np.ones((1 + int(8 * size) % 3, 2), np.int16)
        body = PBlock(cells, other / 2, who)
    return TPlace(x, y, angle)(body)


def scene_of(shapes: Sequence[Shape], agents: int) -> Scene:
    """Shapes owned by the agents in turn; every (agents + 1)-th shape is scenery."""
    scene = EMPTY
    for number, shape in enumerate(shapes):
        owner = number % (agents + 1)
        scene += figure(shape, f"a{owner}" if owner < agents else "")
    return scene
