"""Deadlines while a frame waits for starting, queued and present members."""

from itertools import pairwise

from minerva_bus.runtime.timeouts import (
    MISSED_AFTER,
    START,
    STARTS_SAID_EVERY,
    TIMES_SLOWEST,
    TIMES_SLOWEST_SAID,
    Deadlines,
    Patience,
    Waits,
)

GATHERING, FRAME = "gathering", "frame 3"


def waits(queued=(), **own):
    return Waits(Deadlines(Patience(1.0, 2.0), own), queued)


def test_no_frame_waits_for_a_member_still_to_be_started():
    waiting = waits({"a", "b"})
    assert waiting.update(GATHERING, False, ["a", "b"], 0.0) == 0.0
    waiting.started("a", 5.0)
    assert waiting.update(GATHERING, False, ["a", "b"], 6.5) == 1.5
    assert waiting.reportable(6.5) == ["a"]
    assert waiting.overdue(1e9) == [("a", "restart")]


def test_a_member_that_is_restarted_in_a_step_is_not_reported_from_the_beginning():
    waiting = waits()
    waiting.update(FRAME, True, ["a"], 0.0)
    assert waiting.reportable(1.5) == ["a"]
    waiting.restart("a", 2.0)
    waiting.update(FRAME, True, ["a"], 3.5)
    assert waiting.reportable(3.5) == []
    waiting.update("frame 4", True, ["a"], 4.0)
    waiting.update("frame 4", True, ["a"], 5.5)
    assert waiting.reportable(5.5) == ["a"]


def test_a_member_is_waited_for_since_its_process_was_started():
    waiting = waits()
    waiting.update(GATHERING, False, ["a"], 0.0)
    waiting.started("a", 100.0)
    waiting.update(GATHERING, False, ["a"], 100.0 + START - 0.1)
    assert not waiting.overdue(100.0 + START - 0.1)
    assert waiting.overdue(100.0 + START) == [("a", "restart")]


def test_slow_starts_extend_every_deadline():
    waiting = waits({"a", "b"})
    waiting.started("a", 0.0)
    assert waiting.arrived("a", 20.0)
    waiting.started("b", 20.0)
    waiting.update(GATHERING, False, ["b"], 21.0)
    assert waiting.patience("b").soft == TIMES_SLOWEST_SAID * 20.0
    assert waiting.patience("b").hard == TIMES_SLOWEST * 20.0


def test_a_hello_counts_once_for_each_start():
    waiting = waits()
    assert not waiting.arrived("a", 0.0)
    waiting.started("a", 0.0)
    assert waiting.arrived("a", 0.1)
    assert not waiting.arrived("a", 0.2)


def test_a_member_restarted_in_a_frame_has_time_to_start():
    waiting = waits()
    waiting.update(FRAME, True, ["a"], 0.0)
    assert waiting.overdue(2.0) == [("a", "restart")]
    waiting.started("a", 3.0)
    waiting.update(FRAME, True, ["a"], 3.0 + START - 0.1)
    assert not waiting.overdue(3.0 + START - 0.1)
    waiting.arrived("a", 3.0 + START - 0.1)
    waiting.update(FRAME, True, ["a"], 40.0)
    assert not waiting.overdue(41.9)
    assert waiting.overdue(42.0) == [("a", "restart")]


def test_a_frame_that_skips_a_member_skips_it_while_it_starts_too():
    waiting = waits(a=Patience(0.1, 0.3, "skip"))
    waiting.update(FRAME, True, ["a"], 0.0)
    waiting.started("a", 0.1)
    waiting.update(FRAME, True, ["a"], 0.5)
    assert waiting.overdue(0.5) == [("a", "skip")]


def test_starts_are_spoken_of_now_and_then_in_one_line():
    names = [f"m{number}" for number in range(50)]
    waiting, said = waits(names), []
    for tick in range(600):
        now = tick / 10
        if tick < 500 and tick % 10 == 0:
            waiting.started(names[tick // 10], now)
        waiting.update(GATHERING, False, names, now)
        unsaid = waiting.reportable(now)
        said += [(now, text) for _, text in waiting.describe(unsaid, (), now)] if unsaid else []
    assert said
    assert all(b[0] - a[0] >= STARTS_SAID_EVERY - 1e-9 for a, b in pairwise(said))


def test_a_hello_that_overtakes_the_report_of_a_start_ends_it():
    waiting = waits()
    assert not waiting.arrived("a", 0.0)
    waiting.started("a", 0.1)
    waiting.started("b", 0.1)
    # Until then, "a" may be a former process whose end is not yet noticed.
    assert waiting.overtaken({"a"}, MISSED_AFTER) == []
    assert waiting.overtaken({"a"}, MISSED_AFTER + 0.1) == ["a"]
    assert waiting.overtaken({"a"}, 9.0) == []
    for frame in range(100):
        assert waiting.update(frame, True, ["a"], 10.0 + frame) == 0.0
        assert not waiting.overdue(10.0 + frame)
    waiting.update("frame 100", True, ["a", "b"], 200.0)
    assert waiting.overdue(200.0) == [("b", "restart")]
