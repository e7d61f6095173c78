"""Equation 3: η applies λ to a whole string, under both readings of its third line."""

import pytest

from minerva_bus import Agent, EventType, Policy, Primitive, Transformation, Vocabulary, evolve, on

PDot = Primitive("PDot")
TMove = Transformation("TMove")
eAdd = EventType("eAdd", n=int)
eTimes = EventType("eTimes", n=int)
eGrow = EventType("eGrow")
eDie = EventType("eDie")
eCount = EventType("eCount")


class Number(Agent, symbol="ANumber"):
    n: int = 0
    births: int = 0

    @on("eAdd")
    def add(self, event, moment):
        self.n += event.n

    @on("eTimes")
    def times(self, event, moment):
        self.n *= event.n

    @on("eGrow")
    def grow(self, event, moment):
        return self.string + self.child(n=self.n)

    @on("eDie")
    def die(self, event, moment):
        return PDot()

    @on("eCount")
    def count(self, event, moment):
        self.n = len(self.scope)


VOCABULARY = Vocabulary.of(PDot, TMove, eAdd, eTimes, eGrow, eDie, eCount, Number)


def eta(text, *events, policy=Policy.SEQUENTIAL):
    scene = evolve(VOCABULARY.read(text), events, [Number], policy=policy).scene
    assert VOCABULARY.check(scene) is scene
    return str(scene).replace(", births=0", "")


BOTH = pytest.mark.parametrize("policy", Policy)


@BOTH
def test_primitives_stay(policy):
    assert eta("PDot · PDot", eAdd(1), policy=policy) == "PDot · PDot"


@BOTH
def test_the_empty_string_stays(policy):
    assert eta("", eAdd(1), policy=policy) == ""
    assert eta("TMove()", eAdd(1), policy=policy) == "TMove()"


@BOTH
def test_a_transformation_stays_around_what_evolves_in_it(policy):
    assert eta("TMove(ANumber#a · PDot)", eAdd(1), policy=policy) == (
        "TMove(ANumber#a<n=1>() · PDot)"
    )


@BOTH
def test_a_concatenation_evolves_part_by_part(policy):
    assert eta("ANumber#a · ANumber#b<n=5>", eAdd(1), policy=policy) == (
        "ANumber#a<n=1>() · ANumber#b<n=6>()"
    )


def test_the_scope_of_an_agent_evolves_before_the_agent():
    """λ is applied to a(η(y, e^v)): #in already has its child when #out counts its scope."""
    assert eta("ANumber#out(ANumber#in)", eCount(receivers=["out"]), eGrow(receivers=["in"])) == (
        "ANumber#out<n=2>(ANumber#in<n=0, births=1>() · ANumber#in:1<n=0>())"
    )


@BOTH
def test_a_death(policy):
    assert eta("ANumber#a · ANumber#b", eDie(receivers=["a"]), policy=policy) == (
        "PDot · ANumber#b<n=0>()"
    )


@BOTH
def test_a_birth(policy):
    assert eta("ANumber#a<n=3>", eGrow(), policy=policy) == (
        "ANumber#a<n=3, births=1>() · ANumber#a:1<n=3>()"
    )


def test_several_events_add_up_in_their_order():
    assert eta("ANumber#a<n=1>", eAdd(1), eTimes(10)) == "ANumber#a<n=20>()"
    assert eta("ANumber#a<n=1>", eTimes(10), eAdd(1)) == "ANumber#a<n=11>()"


def test_without_events_agents_stay():
    assert eta("ANumber#a · PDot") == "ANumber#a<n=0>() · PDot"


def test_dead_agents_receive_no_events():
    assert eta("ANumber#a", eDie(), eGrow()) == "PDot"


def test_newborns_receive_their_first_events_in_the_next_frame():
    assert eta("ANumber#a<n=3>", eGrow(), eAdd(1)) == (
        "ANumber#a<n=4, births=1>() · ANumber#a:1<n=3>()"
    )


def test_newborns_within_the_scope_wait_as_well():
    """The child of an inner agent is in the scope of the outer agent but does not evolve yet."""
    assert eta("ANumber#out(ANumber#in)", eGrow(receivers=["in"]), eAdd(1)) == (
        "ANumber#out<n=1>(ANumber#in<n=1, births=1>() · ANumber#in:1<n=0>())"
    )


def test_every_birth_has_an_id_of_its_own():
    assert eta("ANumber#a", eGrow(), eGrow()) == (
        "ANumber#a<n=0, births=2>() · ANumber#a:2<n=0>() · ANumber#a:1<n=0>()"
    )


def test_the_letter_makes_a_copy_for_each_event():
    assert eta("ANumber#a<n=1>", eAdd(1), eTimes(10), policy=Policy.LITERAL) == (
        "ANumber#a<n=2>() · ANumber#a:0-2<n=10>()"
    )


def test_the_letter_keeps_a_copy_for_an_event_that_does_not_concern_the_agent():
    """λ(a, e^f) = a if f ≠ d, and the product is over all of v."""
    assert eta("ANumber#a", eAdd(1, receivers=["b"]), eAdd(2), policy=Policy.LITERAL) == (
        "ANumber#a<n=0>() · ANumber#a:0-2<n=2>()"
    )


def test_the_letter_leaves_nothing_of_an_agent_without_events():
    assert eta("ANumber#a · PDot", policy=Policy.LITERAL) == "PDot"


def test_copies_of_copies_and_of_scopes_have_ids_of_their_own():
    once = eta("ANumber#a(ANumber#b)", eAdd(1), eAdd(1), policy=Policy.LITERAL)
    assert once == (
        "ANumber#a<n=1>(ANumber#b<n=1>() · ANumber#b:0-2<n=1>())"
        " · ANumber#a:0-2<n=1>(ANumber#b:0-2-2<n=1>() · ANumber#b:0-2:0-2-2<n=1>())"
    )
    again = eta(once, eAdd(1), eAdd(1), policy=Policy.LITERAL)
    assert again.count("ANumber") == 20
    assert "ANumber#a:0-2:1-2<n=2>(ANumber#b:0-2-2:1-2-2<n=2>()" in again


def test_children_of_copies_have_ids_of_their_own():
    assert eta("ANumber#a", eGrow(), eGrow(), policy=Policy.LITERAL) == (
        "ANumber#a<n=0, births=1>() · ANumber#a:1<n=0>()"
        " · ANumber#a:0-2<n=0, births=1>() · ANumber#a:0-2:1<n=0>()"
    )


def test_agents_of_other_hosts_stand_still_around_those_that_live():
    class Other(Agent, symbol="AOther"):
        @on("eDie")
        def die(self, event, moment):
            return PDot()

    vocabulary = Vocabulary.of(PDot, TMove, eAdd, eTimes, eGrow, eDie, eCount, Number, Other)
    w = vocabulary.read("AOther#o(ANumber#a)")
    assert str(evolve(w, [eDie()], [Number]).scene) == "AOther#o(PDot)"


def test_events_go_to_their_receivers_only_and_once():
    twice = eAdd(1, receivers=["b", "b"])
    assert twice.receivers == ("b",)
    assert eta("ANumber#a · ANumber#b", twice) == "ANumber#a<n=0>() · ANumber#b<n=1>()"
