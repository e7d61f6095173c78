"""A frame that takes long in one process is reported while it lasts."""

import sys
import threading
from functools import partial

from minerva_bus import Agent, EventType, World, each, on, run
from minerva_bus.launch import in_process
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import slow_frames_reported
from tests.patience import patience

eTick = EventType("eTick")


def test_a_blocked_frame_is_reported_with_its_line():
    reports, done = [], threading.Event()

    def report(waited, place):
        # The first look may come before the call.
        if place.function.endswith("blocking"):
            reports.append((waited, place))
            done.set()

    def blocking():
        assert done.wait(patience())  # which only the report ends

    with slow_frames_reported(lambda: 7, report, "no such file", seconds=0.01):
        blocking()
    waited, place = reports[0]
    assert waited >= 0.01
    assert place.file == __file__
    assert "done.wait(patience())" in place.shown[0]


def test_a_frame_without_a_line_is_shown_by_its_first_line(monkeypatch):
    frame = sys._getframe()
    monkeypatch.setattr(in_process.traceback, "walk_stack", lambda top: iter([(frame, None)]))
    place = in_process._executed(threading.get_ident(), "no such file")
    assert place.function == "test_a_frame_without_a_line_is_shown_by_its_first_line"
    assert place.shown[0].startswith(f"def {place.function}")


def test_frames_that_continue_and_code_of_the_caller_are_not_reported():
    looked, frames = threading.Semaphore(0), iter(range(10**9))
    reports = []

    def frame():
        looked.release()
        return next(frames)

    with slow_frames_reported(frame, lambda *args: reports.append(args), "x", seconds=0.001):
        for _ in range(9):
            assert looked.acquire(timeout=patience())

    def still():
        looked.release()
        return 0

    with slow_frames_reported(still, lambda *args: reports.append(args), __file__, seconds=0.001):
        for _ in range(9):
            assert looked.acquire(timeout=patience())
    assert not reports


def test_a_method_that_blocks_a_run_is_reported_with_its_member(monkeypatch):
    lines, done = [], threading.Event()

    def log(self, name, line, level="info"):
        if "it executes" in line:
            lines.append((name, line))
            done.set()

    class Sleeper(Agent, symbol="ASleeper"):
        @on("eTick")
        def sleep(self, tick, moment):
            assert done.wait(patience())  # which only the report ends

    monkeypatch.setattr(Console, "log", log)
    monkeypatch.setattr(
        in_process, "slow_frames_reported", partial(slow_frames_reported, seconds=0.01)
    )
    run(World("ASleeper#a", agents=[Sleeper], services=[each(eTick)]), frames=1)
    name, line = lines[0]
    assert name == "agents"
    assert line.startswith("frame 0 has been waiting for it for")
    assert "only an interrupt (Ctrl-C) ends it" in line
    assert "Sleeper.sleep" in line
    assert "done.wait(patience())" in line
