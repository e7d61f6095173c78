"""The service `bodies`: views in, events out; successors continue to the last bit."""

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")

from minerva_bodies import Ball, Box, Command, Joint, Matter, Terrain, euler
from minerva_bodies.errors import BodiesError
from minerva_bodies.service import RigidBodies
from minerva_bus import (
    Cells,
    Default,
    EventType,
    Metres,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
)
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.context import Frame
from minerva_bus.world.services import WorldInfo

PBox = Primitive("PBox", Box("size", "size", "size"), size=Default(Metres, 0.1))
PBall = Primitive("PBall", Ball(0.1, matter=Matter(restitution=1.0)), who=Default(str, ""))
PFloor = Primitive("PFloor", Box(20, 20, 0.5, matter=Matter(fixed=True)))
PBlade = Primitive("PBlade", Box(0.1, 0.1, 0.1, matter=Matter(kinematic=True)))
PHill = Primitive("PHill", Terrain("heights", 1.0), heights=Cells)
PHinge = Primitive(
    "PHinge",
    Joint("revolute", "first", "second", axis=(0, 1, 0), low="low", speed="speed", damping=10),
    first=str,
    second=str,
    low=Default(float, 0.0),
    speed=Default(float, 0.0),
)
TAt = Transformation(
    "TAt", euler("x", "y", "z"), **dict.fromkeys("xyz", Default(Metres, 0.0)), who=Default(str, "")
)
TPush, TForce = (
    Transformation(name, Command(kind, "x", "y", "z"), **dict.fromkeys("xyz", Default(float, 0.0)))
    for name, kind in (("TPush", "impulse"), ("TForce", "force"))
)
NAMES = ["x", "y", "z", "w", "i", "j", "k", "vx", "vy", "vz", "wx", "wy", "wz"]
ePose = EventType("ePose", **dict.fromkeys(NAMES, float))
eContact = EventType(
    "eContact", other=str, impulse=float, begins=bool, ends=bool, first=int, last=int
)
eJoint = EventType("eJoint", joint=str, first=str, second=str, position=float, velocity=float)
eLost = EventType("eLost")
eBodies = EventType("eBodies", visual=True)
VOCABULARY = Vocabulary.of(
    *(PBox, PBall, PFloor, PBlade, PHill, PHinge, TAt, TPush, TForce),
    *(ePose, eContact, eJoint, eLost, eBodies),
)
INFO = WorldInfo("yard", VOCABULARY, 7, 0.02)
FLOOR = TAt(z=-0.5)(PFloor())


def joined(**options):
    service = RigidBodies(**options)
    service.joined(INFO)
    return service


def view(frame, **parts):
    slots = [AgentNode("ABody", name, (), (), Scene(())) for name in parts]
    return View(frame, "eBodies", Scene((*FLOOR.pieces, *slots)), parts)


def tick(number):
    return Tick(Frame(number, 0.02, 7), "bodies")


def step(service, number, **parts):
    service.show(view(number - 1, **parts))
    return list(service.generate(tick(number)))


def poses(events):
    """The numbers of all poses, by agent."""
    all_events = [event for event in single(events) if event.type == "ePose"]
    return {event.receivers[0]: tuple(event.data.values()) for event in all_events}


def story(number):
    """A view with births, a death, commands, a growth, a loss, a joint and a blade."""
    grown = PBox(0.1 if number < 12 else 0.2)
    parts = {"a": TAt(z=0.5)(TPush(x=3.0 if number == 5 else 0.0)(grown))}
    if number > 25:
        parts["e"] = TAt(z=3)(NOTHING_LEFT + PHinge("e", "a"))
    if number < 30:
        parts["b"] = TAt(0.3, 0, 0.4)(PBall() + TAt(z=0.15)(PBall()))
    if number > 8:
        hinge = TAt(x=-0.2)(PHinge("c", "", speed=90.0 if number > 20 else 0.0))
        parts["c"] = TAt(-2, 0, 1)(TForce(z=4.0)(PBox(0.2)) + hinge)
    parts["d"] = TAt(0.05 * number - 1, 0, 0.1)(PBlade())
    return parts


NOTHING_LEFT = TPush(x=1e17)(PBox(1e-9))
"""A body whose speed is no number after its first step."""


def told(service, number):
    events = single(step(service, number, **story(number)))
    return [(event.receivers, dict(event.data)) for event in events]


@pytest.mark.parametrize("renew", [1, 7, 300])
def test_a_successor_in_any_frame_makes_the_same_events(renew):
    options = {
        "contact": "eContact",
        "joint": "eJoint",
        "lost": "eLost",
        "renew": renew,
        "substeps": 2,
    }
    first = joined(**options)
    other = joined(**options, threads=2)
    for number in range(1, 45):
        assert told(first, number) == told(other, number)
        saved = other.save()
        other = joined(**options)
        other.restore(saved)
        # As its member does: the last view comes again.
        other.show(view(number - 1, **story(number)))


def test_bodies_begin_where_the_string_says_and_then_physics_moves_them():
    service = joined(gravity=0.0)
    events = step(service, 1, a=TAt(1, 2, 3)(TPush(x=8.0)(PBox())))
    assert poses(events)["a"][:3] == pytest.approx((1.02, 2, 3), abs=1e-5)
    events = step(service, 2, a=TAt(9, 9, 9)(PBox()))
    assert poses(events)["a"][:3] == pytest.approx((1.04, 2, 3), abs=1e-5)
    assert service.report()["bodies"] == 1
    assert not poses(step(service, 3))
    assert service.report()["bodies"] == 0


def test_halted_agents_command_nothing_and_forces_last_a_frame():
    service = joined(gravity=0.0)
    pushed = {"a": TAt(z=5)(TForce(x=400.0)(PBox()))}
    service.show(View(0, "eBodies", view(0, **pushed).skeleton, pushed, frozenset("a")))
    assert poses(service.generate(tick(1)))["a"][7] == 0.0
    assert poses(step(service, 2, **pushed))["a"][7] == pytest.approx(1.0)
    assert poses(step(service, 3, a=TAt(z=5)(PBox())))["a"][7] == pytest.approx(1.0)


def test_agents_are_told_what_they_touch_and_when_it_begins_and_ends():
    service = joined(contact="eContact")
    touches = []
    for number in range(1, 120):
        events = step(service, number, a=TAt(z=2)(PBall()))
        touches += [event for event in events if event.type == "eContact"]
    assert touches[0].receivers == ("a",)
    assert (touches[0].other, touches[0].begins, touches[0].ends) == ("", True, False)
    assert touches[0].impulse > 0
    ended = [event.ends for event in touches].index(True)
    assert touches[ended].impulse == 0
    begun, lasts = touches[0].first, [event.last for event in touches[: ended + 1]]
    assert [event.first for event in touches[: ended + 1]] == [begun] * (ended + 1)
    assert lasts == [*range(begun, begun + ended), begun + ended - 1]


def test_owners_of_joints_get_their_positions_in_a_batch():
    service = joined(gravity=0.0, joint="eJoint")
    wheels = [PHinge("a", who, speed=turn) for who, turn in (("b", 90.0), ("c", -45.0))]
    parts = {"a": TAt(z=5)(PBox(1.0) + wheels[0] + wheels[1])}
    parts |= {"b": TAt(z=5.2)(PBox()), "c": TAt(z=4.8)(PBox())}
    for number in range(1, 22):
        *_, batch = step(service, number, **parts)
    events = list(single([batch]))
    names = [(event.receivers, event.joint, event.first, event.second) for event in events]
    assert names == [(("a",), "PHinge", "a", "b"), (("a",), "PHinge", "a", "c")]
    forwards, backwards = events
    assert forwards.position > 20
    assert backwards.position < -10
    assert [event.velocity for event in events] == pytest.approx([90, -45], rel=0.1)


def test_a_body_without_a_finite_position_is_removed_until_its_agent_shows_none():
    with pytest.raises(BodiesError, match="the body of 'a' has no finite position"):
        step(joined(), 1, a=NOTHING_LEFT)
    service = joined(lost="eLost")
    parts = {"a": TAt(z=9)(NOTHING_LEFT + PHinge("a", "b")), "b": TAt(z=8)(PBox())}
    events = step(service, 1, **parts)
    assert [event.receivers for event in events if event.type == "eLost"] == [("a",)]
    for number in (2, 3):
        events = step(service, number, **parts)
        assert [event.type for event in events] == ["ePose"]
        assert poses(events).keys() == {"b"}
    step(service, 4)
    assert poses(step(service, 5, a=TAt(z=9)(PBox()))).keys() == {"a"}


@pytest.mark.parametrize("population", [False, True])
def test_a_solid_of_another_size_is_another_solid_where_the_body_is(population):
    service, last = joined(), {}
    for number in range(1, 80):
        sizes = np.array([0.2 if number > 20 else 0.1, 0.1])
        places = {"x": np.array([0.0, 5.0]), "z": np.array([0.1, 0.1])}
        parts = {
            who: TAt(places["x"][row], 0, 0.1)(PBox(sizes[row])) for row, who in enumerate("ab")
        }
        if population:
            parts = {"~p": TAt(**places, who=np.array(["a", "b"]))(PBox(sizes))}
        last |= poses(step(service, number, **parts))
    assert [last[who][2] for who in "ab"] == pytest.approx([0.2, 0.1], abs=0.01)
    assert service.report()["bodies"] == 2


def test_a_population_has_the_commands_of_its_rows_and_of_what_is_around_it():
    alone, together = joined(gravity=0.0), joined(gravity=0.0)
    forces, places = np.array([0.0, 2.0]), np.array([0.0, 5.0])
    for number in range(1, 5):
        outer = TPush(y=0.1 if number == 3 else 0.0)
        parts = {
            who: outer(TAt(places[row], 0, 1)(TForce(forces[row])(PBall())))
            for row, who in enumerate("ab")
        }
        last = poses(step(alone, number, **parts))
        rows = TAt(places, 0.0, 1.0, who=np.array(["a", "b"]))(TForce(forces)(PBall()))
        assert poses(step(together, number, **{"~p": outer(rows)})) == last
    assert last["b"][7] > last["a"][7] == 0.0
    assert last["a"][8] > 0.0
    with pytest.raises(BodiesError, match="TForce: x is"):
        step(
            together,
            5,
            **{"~p": TAt(places, who=np.array(["a", "b"]))(TForce(places * 1e18)(PBall()))},
        )


def test_solids_come_and_go_with_the_string():
    service = joined(gravity=0.0)
    step(service, 1, a=TAt(z=2)(PBox() + TAt(x=1)(PBall())))
    engine = service._engine
    body = engine._world.rigid_bodies[engine.bodies["a"]]
    assert len(body.colliders) == 2
    step(service, 2, a=TAt(z=2)(PBox() + TAt(x=2)(PBall()) + TAt(x=1)(PBall())))
    assert len(body.colliders) == 3
    step(service, 3, a=TAt(z=2)(TPush(x=8.0)(PBox())))
    assert engine._world.rigid_bodies[engine.bodies["a"]].linvel.x == pytest.approx(1.0)
    service.show(View(3, "eBodies", Scene(()), {}))
    assert list(service.generate(tick(4))) == []
    assert not engine._world.rigid_bodies[engine.bodies[""]].colliders


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"a": PBox() + PHinge("a", "", low=9.0)}, "agent a, PHinge: limits 9 to 0"),
        ({"a": PBox(-0.1)}, "agent a, PBox: a size is -0.1"),
        ({"a": TPush(x=1e30)(PBox())}, "agent a, TPush: x is 1e"),
        ({"a": TAt(x=1e19)(PBox())}, "agent a, TAt: x is 1e"),
        ({"a": PBox() + PBlade()}, "'a' are moved in different ways"),
        ({"a": PHill(np.zeros((2, 2), np.int16))}, "a terrain cannot move"),
        ({"~b": PBox()}, "PBox in the view of a population has no owner"),
        ({"a": PBox() + PHinge("a", "ghost")}, "no body of 'ghost'"),
        ({"a": PBox() + PHinge("a", "a")}, "joins 'a' to itself"),
        ({"a": PBox() + PHinge("a", "") + PHinge("a", "")}, "this joint appears twice"),
    ],
)
def test_what_cannot_stand_is_an_error_with_its_place(parts, says):
    service = joined()
    with pytest.raises(BodiesError, match=says) as caught:
        step(service, 1, **parts)
    assert len(str(caught.value).splitlines()) <= 10


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"substeps": 0}, "substeps is 0; expected 1"),
        ({"gravity": float("nan")}, "gravity is nan"),
        ({"pose": "eNone"}, "no event type eNone"),
        ({"pose": "eContact"}, "eContact declares other; it may have x, y"),
    ],
)
def test_options_that_do_not_fit_are_errors(options, says):
    with pytest.raises((BodiesError, MisuseError), match=says):
        joined(**options)


def test_other_data_are_no_saved_state():
    with pytest.raises(BodiesError, match="not the saved state"):
        joined().restore({"log": "x"})


@pytest.mark.parametrize("name", ["density", "friction", "restitution"])
def test_matter_is_made_of_finite_numbers(name):
    with pytest.raises(BodiesError, match="expected density"):
        Matter(**{name: float("nan")})
