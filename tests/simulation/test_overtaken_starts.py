"""A member whose `hello` arrives before its launcher's report that it starts it."""

from functools import partial

from minerva_bus.wire.keys import COORDINATOR
from tests.simulator.history import Fault, History
from tests.simulator.machine import SimulatedMachine
from tests.simulator.playing import play

LATE = 2.0
"""Seconds by which the report comes too late: longer than the member needs to join."""

FROZEN = Fault(40, 0.0, "freeze", "tide", 0.5)
"""Long after START seconds, a frame waits for the member."""


def test_a_start_that_is_reported_after_the_hello_ends(tmp_path, monkeypatch):
    carry_out = SimulatedMachine._command

    def late(machine, descriptor, data):
        if b"started tide" in data:
            later = partial(carry_out, machine, descriptor, data)
            machine.timeline.after(LATE, later)
        else:
            carry_out(machine, descriptor, data)

    monkeypatch.setattr(SimulatedMachine, "_command", late)
    # A history of this seed has no shared process, so that the process has the name of the member.
    played = play(History(1, 42, 1.0, 0.0, (FROZEN,)), tmp_path)
    assert played.frames == 42
    assert played.failure == ""
    for text in ("has been waiting", "did not answer"):
        assert not [line for line in played.trace if text in line]
    ends = [line for line in played.trace if " tide: ended" in line]
    assert len(ends) == 1
    began = next(line for line in played.trace if f"{COORDINATOR}: ends frame 41" in line)
    assert played.trace.index(ends[0]) > played.trace.index(began)
