"""Placement: what hosts hold, which hosts an event concerns, and who can take over from whom."""

from dataclasses import replace

import pytest

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.placement import MIN_AGENTS, Placement
from minerva_bus.testing.family import FAMILY_VOCABULARY, eHit

read = FAMILY_VOCABULARY.read
BOTH = frozenset({"AWalker", "AMortal"})
OFFERS = {"east": BOTH, "west": frozenset({"AWalker"})}


def arranged(text, offers=OFFERS, limit=0):
    """A placement whose hosts have received their fragments, and its composition."""
    composition = Composition(read(text))
    placement = Placement(FAMILY_VOCABULARY, composition, limit)
    placement.arrange(offers)
    for host in offers:
        placement.lacking(host)
    return placement, composition


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
    text = " · ".join(f"AMortal#m{n}" for n in range(3 * MIN_AGENTS))
    placement, composition = arranged(text, {"east": BOTH, "west": BOTH})
    (parts,) = composition.populations
    hosts = [placement.host_of(part) for part in parts]
    assert hosts == ["east", "west"]
    for offers, expected in (
        ({"a": BOTH, "east": BOTH, "west": BOTH}, hosts),
        ({"a": BOTH, "west": BOTH}, ["a", "west"]),
    ):
        placement.arrange(offers, mid_frame=True)
        assert list(composition.populations) == [parts]
        assert [placement.host_of(part) for part in parts] == expected
    placement.arrange({"a": BOTH, "east": BOTH, "west": BOTH})
    assert len(composition.populations[0]) == 3


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
    assert list(placement.lacking("east").given) == ["b"]


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


def test_an_event_concerns_the_hosts_of_its_receivers():
    placement, _ = arranged("AMortal#a · AMortal#b", {"east": BOTH})
    assert placement.concerned([replace(eHit(1.0), receivers=("a",))], []) == ["east"]
    assert placement.concerned([replace(eHit(1.0), receivers=("nobody",))], []) == []


@pytest.mark.parametrize(
    ("offers", "limit", "able"),
    [
        ({"west": BOTH}, 0, True),
        ({"west": frozenset({"AWalker"})}, 0, False),
        ({}, 0, False),
        ({"west": BOTH}, 2, False),
        ({"west": BOTH, "new": BOTH}, 2, True),
    ],
    ids=["any", "other kinds", "no host", "a full host", "room on another"],
)
def test_whether_others_can_take_over_from_a_host(offers, limit, able):
    placement, _ = arranged("AMortal#a · AMortal#b · AWalker#c", limit=limit)
    # With two agents per host, the walker is on west.
    assert sorted(placement.fragments_of("east"))[:2] == ["a", "b"]
    assert placement.may_take_over("east", offers) is able
