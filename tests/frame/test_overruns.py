"""Frames that take longer than real time are counted, and logged with back-off."""

from itertools import pairwise
from types import SimpleNamespace

import pytest

from minerva_bus.frame.messages import EvolveReply, TickReply
from minerva_bus.frame.world_state import Phase
from minerva_bus.runtime.pace import Overruns
from minerva_bus.runtime.schedule import FrameSchedule


def run(overruns, took, period=0.1, frames=1, first=1):
    said = []
    for frame in range(first, first + frames):
        now = 100.0 + frame * took
        overruns.began(period, now)
        overruns.answered("events", "gLaser", now + 0.01)
        overruns.answered("events", "robot", now + took / 2)
        overruns.answered("evolution", "robots", now + took)
        said.append(overruns.done(frame, now + took))
    return [(first + n, text) for n, text in enumerate(said) if text]


def test_frames_in_time_are_not_counted():
    overruns = Overruns()
    assert run(overruns, 0.105, frames=50) == []
    assert (overruns.count, overruns.behind, overruns.figures()) == (0, 0.0, {})


def test_late_frames_are_reported_with_back_off():
    overruns = Overruns()
    said = run(overruns, 0.18, frames=50)
    # After 1, 2 and 4 s.
    assert [frame for frame, _ in said] == [5, 11, 23, 46]
    assert overruns.count == 50
    assert overruns.behind == pytest.approx(4.0)
    assert overruns.figures() == {"late_frames": 50, "seconds_behind": pytest.approx(4.0)}


@pytest.mark.parametrize(("took", "period"), [(0.002, 0.001), (0.18, 0.1), (3.0, 2.0)])
def test_reports_come_once_a_second_at_most_and_once_a_minute_at_least(took, period):
    frames = [frame for frame, _ in run(Overruns(), took, period, frames=round(600 / took))]
    pauses = [(after - before) * took for before, after in pairwise(frames)]
    assert min(pauses) >= 1.0 - 1e-6
    assert max(pauses) <= 60.0 + took
    assert len(pauses) == pytest.approx(6 + (600 - 63) / 60, abs=3)


def test_it_reports_the_delay_and_the_last_member():
    ((_, text),) = run(Overruns(), 0.18, frames=5)
    assert text == (
        "frame 5 took 0.180 s instead of 0.100 s (events 0.090 s until robot answered; evolution"
        " 0.090 s until robots answered); 5 frames were late so far, by 0.4 s altogether"
    )


def test_without_real_time_nothing_is_late():
    overruns = Overruns()
    assert run(overruns, 5.0, period=0.0, frames=9) == []
    assert overruns.count == 0


def test_the_first_frame_of_a_world_does_not_count():
    overruns = Overruns()
    run(overruns, 5.0, frames=1, first=0)
    assert overruns.count == 0


def test_it_names_the_member_that_took_the_longest_if_they_take_turns():
    overruns, text = Overruns(), ""
    for frame in range(1, 6):
        overruns.began(0.1, 100.0)
        overruns.answered("events", "clock", 100.01)
        for member, seconds in (("clock", 0.01), ("film", 0.08), ("log", 0.02), ("film", 0.08)):
            overruns.took(member, seconds)
        text = overruns.done(frame, 100.19)
    assert "(events 0.010 s until clock answered; film took the longest, 0.160 s)" in text


def test_replies_that_the_frame_does_not_wait_for_have_no_time():
    """A generator that answers late, or twice: its time would be after that of the hosts."""
    clock = iter([100.1, 100.2, 100.3])
    algorithm = SimpleNamespace(frame=7, phase=Phase.TICK)
    schedule = FrameSchedule(algorithm, 10.0, lambda: next(clock), print)
    schedule.overruns.began(0.1, 100.0)
    schedule.received(TickReply("clock", 6))
    schedule.received(TickReply("clock", 7))
    algorithm.phase = Phase.EVOLVE
    schedule.received(EvolveReply("robots", 7))
    schedule.received(TickReply("clock", 7))
    for _ in range(5):
        text = schedule.overruns.done(7, 100.3)
    assert "(events 0.100 s until clock answered; evolution 0.100 s until robots answered)" in text
