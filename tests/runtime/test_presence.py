"""Tokens of members that come and go faster than the coordinator looks at them."""

from typing import Any

import pytest

from minerva_bus.frame.stimuli import Appeared, Vanished
from minerva_bus.runtime.admission import STRANGERS, AdmissionRules
from minerva_bus.runtime.receiver import GONE, HERE, TokenChanges, successor
from minerva_bus.wire.plain import Limits
from tests.simulator.sessions import Bytes, Sample


def sample(key, kind) -> Any:
    return Sample(f"minerva/w/{key}", Bytes(), kind)


class Door:
    """Tokens of a world with the processes `a` and `b`, and what it has requested."""

    def __init__(self, most=10, limits=None):
        self.now, self.requests = 0.0, []
        self.rules = AdmissionRules(limits or Limits(), clock=lambda: self.now)
        self.tokens = TokenChanges(lambda name: name in ("a", "b"), most, self.requests.append)

    def note(self, name, signs):
        """A token comes (+) and goes (-)."""
        for sign in signs:
            self.tokens.note(sample(f"alive/{name}", HERE if sign == "+" else GONE))

    def take(self):
        return self.tokens.take(self.rules.has_token)


@pytest.mark.parametrize("name", ["a", "guest"])
def test_of_a_token_that_comes_and_goes_the_last_state_counts(name):
    door = Door()
    door.note(name, "+-" * 1000)
    assert not door.tokens
    assert door.tokens.left_out() == {name if name == "a" else STRANGERS: 1000}
    door.note(name, "+")
    assert door.take() == [Appeared(name)]
    # A process that has vanished and is there again is another one.
    door.note(name, "-+" * 1000)
    assert door.take() == [Vanished(name), Appeared(name)]
    assert door.tokens.left_out() == {name: 999}
    door.note(name, "-+-")
    assert door.take() == [Vanished(name)]
    assert door.take() == []


@pytest.mark.parametrize("name", ["a", "guest"])
def test_a_flood_is_taken_at_the_rate_of_its_limit(name):
    door, requested, taken = Door(), 0, 0
    for _ in range(3):
        for sign in "+-" * 2000:
            door.note(name, sign)
            requested += len(door.requests)
            taken += sum(bool(door.take()) for _ in door.requests)
            door.requests.clear()
        door.now += 1.0
        taken += bool(door.take())  # What waits without room is taken by the clock.
    assert 58 <= taken <= 63
    assert requested <= 70


def test_names_without_number_neither_grow_nor_delay_the_processes():
    door = Door(most=10, limits=Limits(all_hellos=5))
    for number in range(1000):
        door.note(f"guest-{number}", "+")
    door.note("x" * 60_000, "+")
    door.note("b", "+")
    assert door.tokens.left_out() == {STRANGERS: 991}
    assert len(door.requests) == 1
    taken = [change.member for _ in range(20) for change in door.take()]
    assert taken == ["b", *(f"guest-{number}" for number in range(5))]
    door.now = 1.0
    assert len([True for _ in range(20) if door.take()]) == 5
    assert not door.tokens


def test_a_token_that_is_not_admitted_is_forgotten():
    door = Door()
    door.note("guest", "+")
    assert door.take() == [Appeared("guest")]
    door.tokens.forget("guest")
    door.note("guest", "-")
    assert door.take() == []


@pytest.mark.parametrize("epoch", ["4", "5", "x", "", "9" * 5000])
def test_only_a_later_coordinator_counts(epoch):
    assert successor(sample(f"epoch/{epoch}", HERE), 5) is None
