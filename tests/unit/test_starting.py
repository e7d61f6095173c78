"""How many processes start at once."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.launch.starting import MAKES_ROOM_AFTER, Starting


def taken(starting, now):
    """All whose turn it is."""
    return list(iter(lambda: starting.next(now), None))


def test_no_more_start_at_once_than_there_is_room_for():
    starting = Starting(3)
    for name in "abcde":
        starting.add(name)
    assert starting.queued == frozenset("abcde")
    assert taken(starting, 0.0) == ["a", "b", "c"]
    starting.over("b")
    assert taken(starting, 0.1) == ["d"]
    assert starting.queued == {"e"}


def test_one_that_takes_long_does_not_keep_others_from_starting():
    starting = Starting(1)
    starting.add("waits for a camera")
    starting.add("b")
    assert taken(starting, 0.0) == ["waits for a camera"]
    assert starting.look_at(0.5) == MAKES_ROOM_AFTER
    assert taken(starting, MAKES_ROOM_AFTER) == ["b"]
    assert starting.look_at(9.0) is None


def test_one_that_is_to_start_twice_starts_once():
    starting = Starting(4)
    starting.add("a")
    starting.add("a")
    assert taken(starting, 0.0) == ["a"]


def test_none_starts_any_more_when_it_is_over():
    starting = Starting(1)
    starting.add("a")
    starting.cancel()
    assert taken(starting, 0.0) == []


@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.sampled_from("abcdefgh"), st.sampled_from(["add", "over"]))),
)
def test_each_gets_its_turn_in_order_and_never_too_many(at_once, steps):
    starting, running, asked = Starting(at_once), set(), []
    for name, step in steps:
        if step == "over" and name in running:
            running.discard(name)
            starting.over(name)
        elif step == "add" and name not in running and name not in asked:
            asked.append(name)
            starting.add(name)
        for turn in taken(starting, 0.0):
            assert turn == asked.pop(0)
            running.add(turn)
        assert len(running) <= at_once
        assert not asked or len(running) == at_once
