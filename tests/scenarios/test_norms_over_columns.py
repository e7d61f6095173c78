"""Norms over agents in columns have the same effect as over the same agents one by one.

There are no births and deaths here, so rows stay rows: each frame's columns are judged as columns.
The runs with births in test_norms.py judge them as separate strings.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pond import host, service
from street import Light, Steps, eBoo, eFine, eShout, eStep

from minerva_bus import Agent, Vocabulary, on
from minerva_bus.frame.norm_rejections import FragmentOutcome
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Events, single
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.norms import Norm, Then
from tests.one_process import run_world

COUNT = 20
"""Fewer agents of a shape than the engine packs into columns by itself."""


class Walker(Agent, symbol="AWalker"):
    """Walks at random to the right of 0 and shouts its speed; it rests to the left."""

    x: float = 0.0
    speed: float = 1.0
    fined: int = 0

    @on("eStep")
    def step(self, step, moment):
        if self.x >= 0:
            self.speed += moment.chance.uniform(-1.0, 1.5)
            self.x += self.speed
            moment.emit(eShout(self.speed))

    @on("eFine")
    def pay(self, fine, moment):
        self.fined += fine.amount


class Walkers(Agent, symbol="AWalker"):
    """The same for all rows at once."""

    x: float = 0.0
    speed: float = 1.0
    fined: int = 0

    @on("eStep", population=True)
    def step(self, step, moment):
        walks = self.x >= 0
        self.speed += moment.chance.uniform(-1.0, 1.5) * walks
        self.x += self.speed * walks
        moment.emit(eShout(self.speed), walks)

    @on("eFine", population=True)
    def pay(self, fine, moment):
        self.fined += fine.amount


VOCABULARY = vocabulary = Vocabulary.of(eStep, eBoo, eShout, eFine, Walker, Light)
PLACES = np.arange(COUNT) * 2.0 - 6.0
WALKERS = Walker.many("w", COUNT, x=PLACES, speed=np.arange(COUNT) % 4 - 1.0)
RESTING = [f"w{row}" for row in np.flatnonzero(PLACES < 0)]
LIGHT = VOCABULARY.read("ALight#light")


def run(scene, norms, kind=Walker, frames=4):
    """The strings and events of each frame, and how often each norm was broken."""
    members = {"walkers": host("walkers", kind, Light), "steps": service("steps", Steps)}
    order = Priority(("eFine", "eShout", "eBoo", "eStep"))
    expected = frozenset(members)
    rest = {"norms": norms, "frames": frames, "seed": 5, "order": order}
    world = WorldSpec("street", scene, VOCABULARY, expected=expected, **rest)
    scenes, events = [], []

    def watch(done, scene):
        scenes.append(scene)
        events.append(list(single(done.events)))

    runner = run_world(world, [make() for make in members.values()], watch)
    return scenes, events, runner.ended.figures


def in_columns(norms, kind=Walker, **rest):
    result = run(WALKERS + LIGHT, norms, kind, **rest)
    assert all(isinstance(scene.pieces[0], Columns) for scene in result[0])
    return result


def one_by_one(norms, **rest):
    result = run(Scene(WALKERS.nodes) + LIGHT, norms, **rest)
    assert not any(isinstance(piece, Columns) for scene in result[0] for piece in scene.pieces)
    return result


def walkers(scene):
    return {agent.id: dict(agent.state) for agent in agents(scene) if agent.symbol == "AWalker"}


def light(scene):
    return next(agent.state["green"] for agent in agents(scene) if agent.symbol == "ALight")


both_ways = pytest.mark.parametrize("held", [in_columns, one_by_one])


@pytest.mark.parametrize("kind", [Walker, Walkers])
def test_the_previous_state_of_a_row_counts(kind):
    """No agent crosses the line; those already beyond it move on."""
    line = Norm("line", when="was.x < 10 and x >= 10")
    free, _, _ = in_columns((), kind)
    scenes, _, figures = in_columns((line,), kind)
    start, end = walkers(WALKERS), walkers(scenes[-1])
    before = {who for who, state in start.items() if state["x"] < 10}
    crossed = {who for who in before if walkers(free[-1])[who]["x"] >= 10}
    assert crossed
    assert crossed < before
    assert all(end[who]["x"] < 10 for who in before)
    assert all(end[who] != start[who] for who in start if start[who]["x"] >= 10)
    assert figures["norm_line"] >= len(crossed)


def fines(events, norm=""):
    """The ids of agents fined in a frame, by one norm or by any."""
    fines = [event for event in events if event.type == "eFine" and norm in ("", event.norm)]
    return sorted(who for event in fines for who in event.receivers)


@both_ways
@pytest.mark.parametrize("then", [Then.SANCTION, Then.REFUSE])
def test_all_agents_that_violate_a_norm_in_one_frame_are_sanctioned(held, then):
    """Each agent gets an event of every norm that it breaks, even of several at once."""
    fast = Norm("fast", when="was.speed >= 1", then=then, sanction=eFine(2, "fast"))
    far = Norm("far", when="x > 20", then=Then.SANCTION, sanction=eFine(3, "far"))
    _, events, _ = held((far, fast), frames=2)
    start = walkers(WALKERS)
    moved = [who for who in start if who not in RESTING]
    assert fines(events[1], "fast") == sorted(who for who in moved if start[who]["speed"] >= 1)
    assert len(fines(events[1], "far")) > 5


@both_ways
def test_a_sanction_follows_once(held):
    """An agent that crosses the line is fined once, in the next frame."""
    line = Norm(
        "line", when="was.x < 10 and x >= 10", then=Then.SANCTION, sanction=eFine(1, "line")
    )
    scenes, _, figures = held((line,), frames=8)
    xs = [walkers(WALKERS), *map(walkers, scenes)]
    crossed = {
        who: sum(a[who]["x"] < 10 <= b[who]["x"] for a, b in pairwise(xs[:-1])) for who in xs[0]
    }
    assert {who: state["fined"] for who, state in xs[-1].items()} == crossed
    assert sum(crossed.values()) > 2
    assert figures["norm_line"] >= sum(crossed.values())


@both_ways
def test_all_senders_that_violate_a_norm_in_one_frame_are_sanctioned(held):
    loud = Norm("loud", on=("eShout",), then=Then.SANCTION, sanction=eFine(1, "loud"))
    _, events, figures = held((loud,))
    shouts = [sorted(e.sender for e in frame if e.type == "eShout") for frame in events]
    assert [fines(frame) for frame in events] == [[], *shouts[:-1]]
    assert all(len(frame) > COUNT // 2 for frame in shouts[1:])
    assert figures["norm_loud"] == sum(map(len, shouts))


@both_ways
def test_only_the_state_of_the_sender_counts(held):
    """Only some rows send: each event is judged by its sender's row."""
    _, free, _ = held(())
    slow = Norm("slow", on=("eShout",), when="x > 12 and event.loud < 2")
    scenes, events, figures = held((slow,))
    refused = []
    for scene, all_events, left in zip(scenes, free[1:], events[1:], strict=False):
        states = walkers(scene)
        shouts = [e.sender for e in all_events if e.type == "eShout"]
        slow_ones = [who for who in shouts if states[who]["x"] > 12 and states[who]["speed"] < 2]
        assert shouts != slow_ones != []
        assert {e.sender for e in left if e.type == "eShout"} == {*shouts} - {*slow_ones}
        refused += slow_ones
    assert figures == {"norm_slow": len(refused)}


@both_ways
def test_unchanged_agents_are_not_judged(held):
    """Agents to the left of 0 do not move, whatever other rows of the same columns do."""
    left = Norm("left", when="was.x < 0", then=Then.COUNT)
    right = Norm("right", when="was.x >= 0", then=Then.COUNT)
    assert held((left, right), frames=1)[2] == {"norm_right": COUNT - len(RESTING)}
    assert RESTING


@both_ways
def test_the_first_norm_that_refuses_a_row_leaves_the_other_rows_to_the_others(held):
    norms = (Norm("fast", when="was.speed >= 1"), Norm("all", when="was.speed >= 0"))
    speeds = [s["speed"] for w, s in walkers(WALKERS).items() if w not in RESTING]
    fast, slow = sum(s >= 1 for s in speeds), sum(0 <= s < 1 for s in speeds)
    assert held(norms, frames=1)[2] == {"norm_fast": fast, "norm_all": slow}
    assert fast
    assert slow


@both_ways
def test_a_norm_applies_to_its_kinds_alone(held):
    dark = Norm("dark", ("ALight",), where="green == false", then=Then.COUNT)
    any_light = Norm("light", ("ALight",), then=Then.COUNT)
    assert held((dark, any_light), frames=4)[2] == {"norm_dark": 1, "norm_light": 1}


@both_ways
def test_another_agents_state_counts_as_each_frame_began(held):
    """No agent moves if the light was red at the beginning of the frame."""
    red = Norm("red", ("AWalker",), when="#light.green == false")
    scenes, _, _ = held((red,), frames=9)
    lights = [True, *(light(scene) for scene in scenes[:-1])]
    strings = [walkers(WALKERS), *map(walkers, scenes)]
    assert [a != b for a, b in pairwise(strings)] == lights
    assert lights.count(False) > 2


# --- a law over random norms ---

NUMBERS = st.integers(-6, 24).map(lambda n: f"{n / 2}")
SIGNS = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])
OWN = st.sampled_from(
    ["x", "speed", "fined", "was.x", "was.speed", "was.fined", "#w9.x", "#w0.speed"]
)
AGENTS = st.builds("{} {} {}".format, OWN, SIGNS, NUMBERS) | st.just("#light.green == true")
SHOUTS = st.builds(
    "{} {} {}".format, st.sampled_from(["x", "speed", "event.loud"]), SIGNS, NUMBERS
) | st.just("#light.green == false")


def conditions(atoms):
    joined = st.builds(
        "({}) {} ({})".format, atoms, st.sampled_from(["and", "or", "and not"]), atoms
    )
    return atoms | joined | st.just("")


@st.composite
def norm(draw, name):
    on_events = draw(st.booleans())
    texts = conditions(SHOUTS if on_events else AGENTS)
    most = draw(st.sampled_from([0, 0, 1, 2]))
    return Norm(
        name,
        applies=draw(st.sampled_from([(), ("AWalker",), ("ALight",)])),
        on=("eShout",) if on_events else (),
        when=draw(texts),
        where=draw(texts),
        most=most,
        per=draw(st.integers(1, 4)),
        then=draw(st.sampled_from(Then)),
        sanction=draw(st.none() | st.just(eFine(1, name))),
    )


@given(norms=st.tuples(norm("first"), norm("second"), norm("third")))
@settings(max_examples=60)
def test_rows_are_judged_as_agents_one_by_one_are(norms):
    scenes, events, figures = in_columns(norms)
    other_scenes, other_events, other_figures = one_by_one(norms)
    assert [walkers(scene) for scene in scenes] == [walkers(scene) for scene in other_scenes]
    assert [scene.digest for scene in scenes] == [scene.digest for scene in other_scenes]
    assert events == other_events
    assert figures == other_figures


def test_a_rejected_row_loses_its_events_of_every_type_and_no_others():
    """The batches of an outcome, and those of its replacement, are each reduced and kept."""
    w = WALKERS.pieces[0]
    outcome, again = FragmentOutcome(w, WALKERS), FragmentOutcome(w, WALKERS)
    ids = [f"w{row}" for row in range(COUNT)]
    shouts, boos = (
        (Events.of([replace(event, sender=who) for who in ids]),) for event in (eShout(1.0), eBoo())
    )
    outcome.undo("w3")
    outcome.replace("w3", again)
    outcome.undo("w5")
    left = list(single(outcome.left((*shouts, *boos), [(again, boos)])))
    both = [who for who in ids if who not in ("w3", "w5")]
    assert sorted(e.sender for e in left if e.type == "eShout") == sorted(both)
    assert sorted(e.sender for e in left if e.type == "eBoo") == sorted([*both, "w3"])


def test_a_replaced_row_stays_in_a_population_with_deaths():
    w, survivors = WALKERS.pieces[0], Scene(WALKERS.nodes[:-1])
    outcome = FragmentOutcome(w, survivors)
    outcome.undo("w3")
    outcome.replace("w3", FragmentOutcome(w, survivors))
    assert walkers(outcome.scene) == walkers(survivors)
