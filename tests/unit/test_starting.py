"""The number of processes that start at the same time."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.launch.starting import SLOT_SECONDS, StartQueue


def taken(queue, now):
    """All processes that have a slot."""
    return list(iter(lambda: queue.next(now), None))


def test_no_more_processes_start_at_once_than_there_are_slots():
    queue = StartQueue(3)
    for name in "abcde":
        queue.add(name)
    assert queue.queued == frozenset("abcde")
    assert taken(queue, 0.0) == ["a", "b", "c"]
    queue.free("b")
    assert taken(queue, 0.1) == ["d"]
    assert queue.queued == {"e"}


def test_a_slow_start_does_not_keep_others_waiting():
    queue = StartQueue(1)
    queue.add("waits for a camera")
    queue.add("b")
    assert taken(queue, 0.0) == ["waits for a camera"]
    assert queue.next_at(0.5) == SLOT_SECONDS
    assert taken(queue, SLOT_SECONDS) == ["b"]
    assert queue.next_at(9.0) is None


def test_a_process_that_is_added_twice_starts_once():
    queue = StartQueue(4)
    queue.add("a")
    queue.add("a")
    assert taken(queue, 0.0) == ["a"]


def test_a_cleared_queue_starts_nothing():
    queue = StartQueue(1)
    queue.add("a")
    queue.clear()
    assert taken(queue, 0.0) == []


@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.sampled_from("abcdefgh"), st.sampled_from(["add", "over"]))),
)
def test_processes_start_in_order_and_never_too_many(at_once, steps):
    queue, running, asked = StartQueue(at_once), set(), []
    for name, step in steps:
        if step == "over" and name in running:
            running.discard(name)
            queue.free(name)
        elif step == "add" and name not in running and name not in asked:
            asked.append(name)
            queue.add(name)
        for turn in taken(queue, 0.0):
            assert turn == asked.pop(0)
            running.add(turn)
        assert len(running) <= at_once
        assert not asked or len(running) == at_once
