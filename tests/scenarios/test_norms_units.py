"""Norms on agents inside others and on newborns, and what is logged of them."""

from street import FINE, eFine, eShout, street
from test_norms import happened, live, states

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import Notify
from minerva_bus.grammar.events import single
from minerva_bus.world.norms import Norm, Then, ViolationCounts

FAST = Norm("fast", when="speed > 20", then=Then.SANCTION, sanction=eFine(2, "fast"))


def fined(frames):
    """The ids of the agents fined in each frame."""
    return [
        [who for event in single(events) if event.type == "eFine" for who in event.receivers]
        for events, _ in frames
    ]


def test_an_agent_within_another_is_sanctioned_itself():
    frames, _, _ = live(
        "ARunner#a<x=-300, speed=1>(ARunner#b<x=-300, speed=30>)", (FAST,), frames=3
    )
    assert fined(frames) == [[], ["b"], ["b"]]


def test_all_agents_within_an_agent_are_judged():
    """An agent of another kind, or an unchanged one, precedes those that have changed."""
    runners = Norm("fast", ("ARunner",), when="speed > 20", then=Then.COUNT)
    w = "APasser#p(ALight#light · ARunner#a<speed=30> · ARunner#b<speed=30>)"
    assert live(w, (runners,), frames=1)[2] == {"norm_fast": 2}
    every = Norm("all", where="x > -99", then=Then.COUNT)
    assert live(w, (every,), frames=1)[2] == {"norm_all": 2}
    calm = Norm("calm", ("APasser",), when="boos < 99", then=Then.COUNT)
    assert live(w, (calm,), frames=1)[2] == {}, "the passer has not changed"


def test_for_a_newborn_its_parent_is_sanctioned():
    """A rejected newborn does not enter the string, so it cannot be sanctioned."""
    norm = Norm("young", when="births == 0", sanction=eFine(4, "young"))
    frames, _, figures = live("ARunner#a<births=1, speed=-9>", (norm,), frames=20)
    assert {tuple(states(scene)) for _, scene in frames} == {("a",)}
    assert figures["norm_young"] > 0
    assert {who for of in fined(frames) for who in of} == {"a"}


def test_only_events_of_rejected_agents_are_lost():
    """Even if some agents of many breed, compliant agents keep sending their events."""
    w = " · ".join(f"ARunner#r{n}<speed={-9 - n}>" for n in range(40))
    norm = Norm("calm", when="was.speed > -20", most=0)
    frames, algorithm, _ = live(w, (norm,), frames=3)
    calm = {f"r{n}" for n in range(40) if -9 - n > -20}
    shouting = {event.sender for event in single(frames[1][0]) if event.type == "eShout"}
    assert shouting == {f"r{n}" for n in range(40)} - calm
    assert len(states(algorithm.scene)) > 40
    assert sum(happened(frames, FINE.sanction.type)) == 0


def test_the_status_has_the_last_violation_of_each_broken_norm():
    """In the order of the world file, without those that hold."""
    norms = Norm("calm", when="x > 999"), Norm("moves", when="x > -999", then=Then.COUNT), FAST
    _, algorithm, _ = live("ARunner#a<x=-300, speed=30> · ARunner#b<x=-300>", norms, frames=3)
    moves, fast = algorithm.norms.status()
    assert (moves.name, moves.then, moves.frame, moves.by) == ("moves", "count", 2, "#b")
    assert (fast.name, fast.then, fast.frame, fast.by) == ("fast", "sanction", 2, "#a")
    assert algorithm.norms.broken == {"moves": moves.broken, "fast": fast.broken}


def test_counts_are_saved_as_long_as_they_matter():
    quiet = Norm("quiet", most=2, per=5)
    counts = ViolationCounts({})
    assert not any(counts.breaks(quiet, who, frame) for who, frame in [("a", 0), ("a", 2)])
    resumed = ViolationCounts(counts.saved((quiet,), 3))
    assert resumed.breaks(quiet, "a", 4)
    assert resumed.saved((quiet,), 6)["lately"] == {"quiet": {"a": [0, 2]}}
    assert counts.saved((quiet,), 7) == {"broken": {}, "lately": {}}
    assert [resumed.exceeds(quiet, who, 4) for who in "ab"] == [True, False]


def test_the_first_violation_is_logged_under_the_name_of_norms():
    quiet = Norm("quiet", on=("eShout",), then=Then.COUNT)
    algorithm = FrameAlgorithm(street("ARunner#a", (quiet,)))
    for _ in range(2):
        algorithm.norms.events(0, {"crier": [eShout(1.0, sender="a")]})
    algorithm.inbox.sanctions += algorithm.norms.publish(algorithm.out, {})
    (line,) = [each for each in algorithm.out.pending if isinstance(each, Notify)]
    assert line.member == "norms"
    assert line.text.endswith(": allowed; from now on this is only counted")
