"""The position of a stopped body, and the contact that stopped it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from minerva_bus import (
    Degrees,
    EventType,
    Frame,
    MinervaError,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.types import Cells, Metres
from minerva_services.physics.arena import Arena
from minerva_services.physics.encounters import Contact
from minerva_services.physics.service import Physics
from tests.collision_event import eCollision


def stopped(arena: Arena, *commands: tuple[str, float, float]) -> dict[str, Contact | None]:
    for name, turn, forward in commands:
        arena.drive(name, turn, forward)
    return {body.name: body.contact for body in arena.step(0.1)}


def close(contact: Contact | None, other: str, x: float, y: float, nx: float, ny: float) -> bool:
    assert contact is not None
    place = contact.x, contact.y, contact.nx, contact.ny
    return contact.other == other and place == pytest.approx((x, y, nx, ny), abs=1e-9)


def test_a_wall_is_touched_where_the_body_stands_before_it() -> None:
    arena = Arena()
    arena.add_walls(np.array([[3.0, -1.0, 3.0, 4.0]]))
    arena.add_body("a", 1, 1, 30, 0.5)
    contact = stopped(arena, ("a", 0, 5))["a"]
    x = 2.5
    assert close(contact, "", 3.0, 1 + (x - 1) * math.tan(math.radians(30)), -1, 0)


def test_of_two_walls_that_more_ahead_counts() -> None:
    arena = Arena()
    arena.add_walls(np.array([[0.0, 0.0, 9.0, 0.0], [3.0, 0.0, 3.0, 4.0]]))
    arena.add_body("a", 1, 0.5, 0, 0.5)
    assert close(stopped(arena, ("a", 0, 5))["a"], "", 3.0, 0.5, -1, 0)
    assert close(stopped(arena, ("a", -90, 5))["a"], "", 2.5, 0.0, 0, 1)


def test_a_body_is_touched_where_it_was_in_that_moment() -> None:
    arena = Arena()
    arena.add_body("a", 0, 0, 0, 0.5)
    arena.add_body("b", 2, -2, 90, 0.5)  # crosses the path of a and moves on
    contacts = stopped(arena, ("a", 0, 2), ("b", 0, 4))
    contact = contacts["a"]
    assert contact is not None
    assert contacts["b"] is None
    assert contact.other == "b"
    assert math.hypot(contact.nx, contact.ny) == pytest.approx(1)
    here = arena.pose("a")
    assert (here.x - contact.x, here.y - contact.y) == pytest.approx(
        (0.5 * contact.nx, 0.5 * contact.ny)
    )
    time = here.x / 2
    assert math.dist((contact.x, contact.y), (2, 4 * time - 2)) == pytest.approx(0.5)


def test_a_body_that_is_not_stopped_has_no_contacts() -> None:
    arena = Arena()
    arena.add_body("a", 0, 0, 0, 0.5)
    assert stopped(arena, ("a", 10, 2)) == {"a": None}


# --- contact events -------------------------------------------------------------------------------

PMap = Primitive(
    "PMap", cells=Cells, resolution=Metres, x=Default(Metres, 0.0), y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)  # fmt: skip
PRobot = Primitive("PRobot", name=str, radius=Metres)
TPlace = Transformation("TPlace", x=Metres, y=Metres, angle=Degrees)
TMove = Transformation("TMove", dist=Metres)
eRepresent = EventType("eRepresent", visual=True)
WORDS = PMap, PRobot, TPlace, TMove, eRepresent


def joined(collision: EventType = eCollision) -> Physics:
    service = Physics()
    service.joined(WorldInfo("yard", Vocabulary.of(*WORDS, collision), 7, 0.1))
    return service


def body(name: str, x: float, dist: float) -> Scene:
    return TPlace(x, 1.0, 0.0)(TMove(dist)(PRobot(name, 0.2)))


def told(service: Physics, frame: int, *bodies: Scene) -> list[Any]:
    room = PMap(np.zeros((40, 20), np.int16), 0.1)
    service.show(View(frame, "eRepresent", sum(bodies, start=room)))
    return list(service.generate(Tick(Frame(frame + 1, 0.1, 7), "physics")))


def test_an_event_has_the_other_body_the_place_and_whether_it_begins() -> None:
    service = joined()
    first = told(service, 0, body("a", 1.0, 0.5), body("b", 3.0, 1.0))
    assert [(e.receivers, e.other, e.what, e.begins) for e in first] == [(("b",), "", "PMap", True)]
    assert (first[0].x, first[0].y, first[0].nx) == pytest.approx((4.0, 1.0, -1.0))
    again = told(service, 1, body("a", 1.0, 5.0), body("b", 3.0, 1.0))
    assert [(e.receivers, e.other, e.what, e.begins) for e in again] == [
        (("a",), "b", "PRobot", True),
        (("b",), "", "PMap", False),
    ]
    assert again[0].shortfall == pytest.approx(5.0 - 1.9)
    assert again[0].depth == 0
    heir = joined()
    heir.restore(service.save())
    assert [e.begins for e in told(heir, 2, body("a", 1.0, 1.0), body("b", 3.0, 0.0))] == [False]


def test_a_world_may_want_the_shortfall_only() -> None:
    service = joined(EventType("eCollision", shortfall=Metres))
    (event,) = told(service, 0, body("a", 1.0, 5.0))
    assert event.names == ("shortfall",)


def test_unknown_data_are_rejected() -> None:
    with pytest.raises(MinervaError, match="physics: eCollision declares nx as"):
        joined(EventType("eCollision", shortfall=Metres, nx=str))
    with pytest.raises(MinervaError, match="physics: eCollision needs force"):
        joined(EventType("eCollision", shortfall=Metres, force=float))
