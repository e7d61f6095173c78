"""Norms over events in columns have the same effect as over the same events one by one.

A generator that speaks for agents sends their events in any order: of agents in several columns,
of separate agents, and without a sender.
"""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pond import host, service
from street import Light, eFine, eStep
from test_norms_over_columns import LIGHT, conditions

from minerva_bus import Agent, EventType, Generator, Vocabulary, on
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Events, single
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.norms import Norm, Then
from tests.one_process import run_world

eShout = EventType("eShout", loud=float)
eHorn = EventType("eHorn", loud=float)


class State(Agent):
    x: float = 0.0
    heard: int = 0
    fined: int = 0

    @on("eShout", population=True)
    def hear(self, shout, moment):
        self.heard += 1

    @on("eFine", population=True)
    def pay(self, fine, moment):
        self.fined += fine.amount


class Walker(State, symbol="AWalker"):
    pass


class Rider(State, symbol="ARider"):
    pass


class Crier(Generator, events=("eShout", "eHorn")):
    """Sends the given events in each frame."""

    def __init__(self, events):
        self.cries = events

    def generate(self, tick):
        return self.cries


VOCABULARY = Vocabulary.of(eStep, eShout, eHorn, eFine, Walker, Rider, Light)
SCENE = (
    Walker.many("w", 6, x=np.arange(6) * 1.0)
    + Rider.many("r", 5, x=np.arange(5) * 1.0 + 0.5)
    + Walker("lone", x=3.5).string
    + LIGHT
)
SENDERS = [*[f"w{n}" for n in range(6)], *[f"r{n}" for n in range(5)], "lone", "light"]


def cries(kind, senders, of_somebody):
    """Events of the senders in columns; the louder, the later."""
    first = Events.repeated(kind(0.0), len(senders))
    loud = tuple(Events.of([kind(n / 2) for n in range(len(senders))]).columns)
    ids = Ids.of(senders) if of_somebody else None
    return Events(first.type, first.names, loud, len(senders), senders=ids)


def run(norms, events, **world):
    """Each frame's events, the digests, and how often each norm was broken."""
    members = {
        "agents": host("agents", Walker, Rider, Light),
        "crier": service("crier", lambda: Crier(events)),
    }
    street = WorldSpec(
        "street", SCENE, VOCABULARY, expected=frozenset(members), norms=norms, frames=3,
        speaks_for={"crier": ("AWalker", "ARider", "ALight")}, **world,
    )  # fmt: skip
    frames = []

    def watch(done, scene):
        frames.append((list(single(done.events)), scene.digest))

    runner = run_world(street, [make() for make in members.values()], watch)
    return frames, runner.ended.figures


SIGNS = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])
NAMES = st.sampled_from(["x", "fined", "heard", "event.loud", "#w0.x", "#lone.fined"])
ATOMS = st.builds(
    "{} {} {}".format, NAMES, SIGNS, st.integers(-1, 12).map(lambda n: f"{n / 2}")
) | st.just("#light.green == true")
APPLIES = st.lists(
    st.sampled_from(["AWalker", "ARider", "ALight", "crier", "agents"]), max_size=2, unique=True
)
norms = st.builds(
    Norm,
    name=st.sampled_from(["first", "second"]),
    applies=APPLIES.map(tuple),
    on=st.sampled_from([("eShout",), ("eHorn",), ("eShout", "eHorn")]),
    when=conditions(ATOMS),
    where=conditions(ATOMS),
    most=st.sampled_from([0, 0, 2]),
    per=st.integers(1, 3),
    then=st.sampled_from(Then),
    sanction=st.none() | st.just(eFine(1, "first")),
)


@given(
    norms=st.lists(norms, min_size=1, max_size=2, unique_by=lambda norm: norm.name).map(tuple),
    senders=st.lists(st.sampled_from(SENDERS), min_size=1, max_size=16),
    of_somebody=st.booleans(),
)
@example(norms=(Norm("first", ("AWalker",), ("eShout",)),), senders=SENDERS, of_somebody=True)
@example(norms=(Norm("first", ("ARider",), ("eShout",)),), senders=SENDERS[::-1], of_somebody=True)
@example(norms=(Norm("first", ("crier",), ("eShout",)),), senders=SENDERS, of_somebody=True)
@example(norms=(Norm("first", ("crier",), ("eHorn",)),), senders=SENDERS, of_somebody=False)
@example(
    norms=(Norm("first", (), ("eShout",), "x < 3 and event.loud > 1"),),
    senders=SENDERS,
    of_somebody=True,
)
@settings(max_examples=60)
def test_events_in_columns_are_judged_as_one_by_one(norms, senders, of_somebody):
    batches = [cries(kind, senders, of_somebody) for kind in (eShout, eHorn)]
    assert isinstance(SCENE.pieces[0], Columns)
    columns = run(norms, batches)
    assert columns == run(norms, [event for batch in batches for event in batch])


def test_each_sender_is_judged_by_what_it_is():
    """This includes the first row of each column, separate agents, and a norm for one kind."""
    norm = Norm("low", ("AWalker", "ALight"), ("eShout",), "event.loud < 20")
    ((events, _), *_), figures = run((norm,), [cries(eShout, SENDERS, of_somebody=True)])
    assert [event.sender for event in events] == [f"r{n}" for n in range(5)]
    assert figures == {"norm_low": 3 * 8}


def test_a_norm_for_a_generator_holds_for_all_that_it_sends():
    norm = Norm("quiet", ("crier",), ("eShout",), "event.loud >= 2")
    for of_somebody in (True, False):
        batch = cries(eShout, SENDERS, of_somebody)
        ((events, _), *_), figures = run((norm,), [batch])
        assert [event.data["loud"] for event in events] == [0.0, 0.5, 1.0, 1.5]
        assert figures == {"norm_quiet": 3 * (len(SENDERS) - 4)}
