"""Placement: what hosts hold, which hosts an event concerns, and who can take over from whom."""

from dataclasses import replace

import pytest

from minerva_bus.frame import placement as module
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.placement import (
    MIN_BATCH,
    WINDOW,
    Placement,
    UnassignedLog,
    place,
)
from minerva_bus.frame.stimuli import Instructions
from minerva_bus.grammar.columns import MANY
from tests.family import FAMILY_VOCABULARY, eHit, eMark, eShow, eStep

read = FAMILY_VOCABULARY.read
BOTH = frozenset({"AWalker", "AMortal"})
OFFERS = {"east": BOTH, "west": frozenset({"AWalker"})}
FIVE = dict.fromkeys(("a", "b", "c", "d", "e"), BOTH)


def arranged(text, offers=OFFERS, limit=0):
    """A placement whose hosts have received their fragments, and its composition."""
    composition = Composition(read(text))
    placement = Placement(FAMILY_VOCABULARY, composition, limit)
    placement.arrange(offers)
    for host in offers:
        placement.lacking(host)
    return placement, composition


def population(rows):
    return " · ".join(f"AMortal#m{n}" for n in range(rows))


def divided(placement, composition):
    """The rows on each host of the only population, in order; None: on none."""
    (parts,) = composition.populations
    return [(placement.host_of(part), composition.parts[part].count) for part in parts]


def test_a_host_holds_what_it_has_received_until_its_process_is_gone():
    placement, _ = arranged("AMortal#a · AMortal#b")
    placement.arrange(OFFERS)
    assert placement.lacking("east") is None
    placement.forget("west")
    placement.arrange(OFFERS)
    assert placement.lacking("east") is None
    placement.forget("east")
    placement.arrange(OFFERS)
    assert sorted(placement.lacking("east").given) == ["a", "b"]


def test_without_a_limit_one_host_takes_any_number_of_agents():
    placement, _ = arranged("AMortal#a · AMortal#b · AMortal#c")
    assert (placement.unassigned, placement.fragments_of("east")) == ({}, ("a", "b", "c"))


def test_within_a_frame_the_limit_of_a_host_does_not_count():
    """The frame waits for the agents of the host that is gone."""
    placement, _ = arranged("AMortal#a · AMortal#b · AMortal#c", {"east": BOTH, "west": BOTH}, 2)
    placement.arrange({"east": BOTH}, mid_frame=True)
    assert (placement.unassigned, placement.fragments_of("east")) == ({}, ("a", "b", "c"))
    placement.arrange({"east": BOTH})
    assert len(placement.unassigned) == 1


def test_within_a_frame_the_parts_of_a_population_stay():
    """Undivided, on hosts that may be evolving them; only those of a lost host move."""
    placement, composition = arranged(population(192), {"east": BOTH, "west": BOTH})
    (parts,) = composition.populations
    hosts = [placement.host_of(part) for part in parts]
    assert hosts == ["east", "west"]
    for offers, expected in (
        ({"a": BOTH, "east": BOTH, "west": BOTH}, hosts),
        ({"a": BOTH, "west": BOTH}, ["a", "west"]),
        ({"i": BOTH, "west": BOTH}, ["i", "west"]),
    ):
        placement.arrange(offers, mid_frame=True)
        assert list(composition.populations) == [parts]
        assert [placement.host_of(part) for part in parts] == expected
    placement.arrange({"a": BOTH, "east": BOTH, "west": BOTH})
    assert len(composition.populations[0]) == 3


@pytest.mark.parametrize(
    ("rows", "limit", "expected"),
    [
        (39, 0, [("a", 39)]),
        (128, 0, [("a", 64), ("b", 64)]),
        (39, 10, [("a", 10), ("b", 10), ("c", 9), ("d", 10)]),
        (39, 8, [("a", 8), ("b", 8), ("c", 7), ("d", 8), ("e", 8)]),
        (39, 1, [("a", 1), ("b", 1), ("c", 1), ("d", 1), ("e", 1), (None, 34)]),
    ],
)
def test_a_population_has_as_many_hosts_as_its_size_and_their_room_require(rows, limit, expected):
    assert divided(*arranged(population(rows), FIVE, limit)) == expected


def test_a_small_population_has_as_many_hosts_as_its_measured_time_pays_for():
    """Within a frame its parts stay. A slow first frame, which imports code, does not count."""
    placement, composition = arranged(population(MANY), FIVE)
    placement.note_elapsed("a", 9.0)
    assert not placement.imbalanced
    hosts = 1
    for seconds, expected in (
        *((0.0038, 1), (0.004, 2), (0.3, 5), (0.0075, 5), (0.001, 2), (0.0019, 2), (0.0014, 1)),
    ):
        for _ in range(WINDOW):
            for host in placement.occupied:
                placement.note_elapsed(host, seconds)
        before = divided(placement, composition)
        assert placement.imbalanced == (hosts != expected)
        placement.arrange(FIVE, mid_frame=True)
        assert divided(placement, composition) == before
        placement.arrange(FIVE)
        hosts = len(divided(placement, composition))
        assert (hosts, placement.occupied) == (expected, sorted(FIVE)[:expected])


def test_a_population_is_divided_by_the_measured_speed_of_its_hosts(monkeypatch):
    monkeypatch.setattr(module, "_MIN_ROWS", 1)
    placement, composition = arranged(population(128), {"a": BOTH, "b": BOTH})
    for _ in range(WINDOW):
        placement.note_elapsed("a", 1.0)
        placement.note_elapsed("b", 3.0)
    assert placement.imbalanced
    placement.arrange({"a": BOTH, "b": BOTH})
    assert divided(placement, composition) == [("a", 96), ("b", 32)]
    for _ in range(WINDOW):
        placement.note_elapsed("a", 1.5)
        placement.note_elapsed("b", 1.5)
    assert not placement.imbalanced


def test_nothing_is_unwanted_before_hosts_are_known():
    placement = Placement(FAMILY_VOCABULARY, Composition(read("AMortal#a · AMortal#b")))
    placement.arrange({"east": BOTH})
    assert (placement.lacking("east").dropped, placement.unassigned) == ((), {})


def test_a_rejected_result_is_sent_again():
    placement, _ = arranged("AMortal#a · AMortal#b")
    placement.resend("a")
    assert list(placement.lacking("east").given) == ["a"]
    placement.resend("unknown")
    assert placement.lacking("east") is None
    placement.forget("east")
    placement.resend("b")
    placement.arrange({"east": frozenset(), "west": BOTH})
    assert placement.lacking("east").dropped == ("b",)


def test_an_agent_that_is_gone_is_not_sent_again():
    placement, composition = arranged("AMortal#a · AMortal#b")
    composition.become(read("AMortal#b"))
    placement.resend("a")
    assert placement.lacking("east") is None


def test_a_host_keeps_its_own_result_unless_it_was_to_drop_the_agent():
    placement, composition = arranged("AMortal#a", {"east": BOTH})
    result = read("AMortal#a<energy=2>")
    composition.replace({"a": result})
    placement.changed("east", "a", result)
    placement.arrange({"east": BOTH})
    assert placement.lacking("east") is None
    placement.arrange({"east": frozenset(), "west": BOTH})
    assert placement.lacking("east").dropped == ("a",)
    placement.changed("east", "a", result)
    placement.arrange({"east": BOTH})
    assert list(placement.lacking("east").given) == ["a"]


def test_a_former_host_of_a_rejected_result_gets_the_agent_again():
    """It may have evolved the agent in this frame, before another host returned and was lost."""
    placement, _ = arranged("AMortal#a", {"east": BOTH})
    placement.arrange({"west": BOTH}, mid_frame=True)
    placement.resend("a")
    assert list(placement.lacking("west").given) == ["a"]
    placement.arrange({"east": BOTH}, mid_frame=True)
    assert list(placement.lacking("east").given) == ["a"]


def test_a_result_of_a_former_host_makes_that_of_the_present_one_outdated():
    placement, _ = arranged("AMortal#a")
    placement.changed("east", "a", read("AMortal#a<energy=2>"))
    assert placement.lacking("east") is None
    placement.changed("west", "a", read("AMortal#a<energy=3>"))
    assert list(placement.lacking("east").given) == ["a"]
    placement.arrange({"west": OFFERS["west"]})
    placement.changed("west", "a", read("AMortal#a<energy=4>"))
    assert list(placement.unassigned) == ["a"]


def test_an_event_concerns_the_hosts_of_its_receivers():
    placement, _ = arranged("AMortal#a · AMortal#b", {"east": BOTH})
    assert placement.concerned([replace(eHit(1.0), receivers=("a",))], []) == ["east"]
    assert placement.concerned([replace(eHit(1.0), receivers=("nobody",))], []) == []
    many = ("a", *(f"n{n}" for n in range(MIN_BATCH)))
    assert placement.concerned([replace(eHit(1.0), receivers=many)], []) == ["east"]


def test_an_event_concerns_the_hosts_of_the_kinds_that_subscribe_to_it():
    placement, _ = arranged("AWalker#w · AMortal#a", {"east": BOTH})
    assert placement.concerned([eStep(1.0)], []) == ["east"]
    placement, _ = arranged("AMortal#a", {"east": BOTH, "west": BOTH, "new": frozenset()})
    (home,) = placement.occupied
    assert placement.concerned([eStep(1.0)], []) == []
    assert placement.concerned([], [eMark(1.0)]) == []
    assert placement.concerned([], [eShow(), eMark(1.0)]) == [home]
    assert placement.fragments_of("nobody") == ()


@pytest.mark.parametrize(
    ("offers", "limit", "able"),
    [
        ({"west": BOTH}, 0, True),
        ({"west": frozenset({"AWalker"})}, 0, False),
        ({}, 0, False),
        ({"west": BOTH}, 2, False),
        ({"west": BOTH, "new": BOTH}, 2, True),
        ({"new": BOTH}, 2, True),
    ],
    ids=["any", "other kinds", "no host", "a full host", "room on another", "another alone"],
)
def test_whether_others_can_take_over_from_a_host(offers, limit, able):
    placement, _ = arranged("AMortal#a · AMortal#b · AWalker#c", limit=limit)
    # With two agents per host, the walker is on west.
    assert sorted(placement.fragments_of("east"))[:2] == ["a", "b"]
    assert placement.may_take_over("east", offers) is able


@pytest.mark.parametrize(
    ("limit", "reason"), [(0, "see [placement]"), (3, "a host takes 3 (agents_per_host)")]
)
def test_changes_of_agents_without_a_host_are_logged_once(limit, reason):
    out, log = Instructions(lambda _: False), UnassignedLog(limit)
    for agents in (0, 2, 2, 0, 0):
        log.count(agents, rules=True, out=out)
    for missing in ({"C"}, {"A", "B"}, {"C"}, {"A"}):
        log.kinds([frozenset("A")], [frozenset(missing)], out)
    still = "these agents do not evolve; add their class to agents, or attach a host"
    assert [(line.member, line.text) for line in out.pending] == [
        ("placement", f"2 agents have no host and do not evolve: {reason}; attach another host"),
        ("placement", "every agent has a host again"),
        ("placement", f"no host offers C: {still}"),
        ("placement", f"no host offers all of A, B: {still}"),
    ]


def test_an_agent_is_on_the_host_that_the_protocol_defines():
    hosts = [place(f"a{n}", ("east", "north", "west")) for n in range(9)]
    assert hosts == ["east", "north", "east", "west", "west", "west", "north", "west", "east"]
