"""The coordinator is killed at every step of a run: a successor produces the same strings."""

from dataclasses import replace
from functools import partial

import pytest
from pond import VOCABULARY, Steps, service
from test_any_schedule import FRAMES, SETTINGS, both

from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.stimuli import Abandoned
from tests.memory_bus import BEGIN, MemoryBus


def run(setting, kills):
    """Run a world in a fixed order; kill the coordinator after the given steps."""
    bus = MemoryBus(setting.world, setting.members)
    bus.start()
    steps = 0
    while bus.ended is None:
        links = bus.ready()
        assert links, (bus.stuck, bus.algorithm.waiting_for(), bus.trace[-12:])
        bus.step(next((link for link in links if link != BEGIN), BEGIN))
        steps += 1
        if steps in kills:
            bus.kill_coordinator()
            for name in sorted(setting.members.keys() - bus.alive.keys()):
                if len(bus.records) == FRAMES:  # It was notified of the end and has left.
                    bus.handle(Abandoned(name))
    return bus, steps


@pytest.mark.parametrize("stride", [5, pytest.param(1, marks=pytest.mark.slow)])
@both
def test_killed_at_any_step_another_goes_on_to_the_same_strings(setting, stride):
    """Frames have other numbers of steps, so every fifth step is each step of some frame."""
    undisturbed, end = setting.undisturbed
    bus, steps = run(setting, ())
    assert bus.digests == undisturbed
    for kill in range(1, steps, stride):
        bus, _ = run(setting, {kill})
        assert bus.digests == undisturbed, f"killed after step {kill}"
        assert bus.ended.reason == end.reason


@pytest.mark.parametrize("every", [7, 23, 60])
@both
def test_killed_again_and_again(setting, every):
    undisturbed, _ = setting.undisturbed
    bus, _ = run(setting, set(range(every, 5000, every + 40)))
    assert bus.digests == undisturbed
    assert len(bus.digests) == FRAMES


class Unsaved(Steps):
    """Has a state that it does not save: a successor must get its latest answer again."""

    def save(self):
        return None


def test_a_generator_repeats_its_latest_answer():
    setting = SETTINGS["shoal"]
    setting = replace(setting, members={**setting.members, "steps": service("steps", Unsaved)})
    undisturbed, steps = run(setting, ())
    for kill in range(1, steps, 5):
        bus, _ = run(setting, {kill})
        assert bus.digests == undisturbed.digests, f"killed after step {kill}"


def test_a_trace_reports_a_killed_coordinator():
    bus, _ = run(SETTINGS["pond"], {30})
    assert "the coordinator was killed" in bus.trace


def test_a_member_restarted_during_the_first_frame_returns_to_its_start():
    """It received state saved in an incomplete frame; the next coordinator has no state for it."""
    asked = m.TickRequest(0)
    welcome = partial(m.Welcome, "pond", VOCABULARY, 5, 0.1, 0, "sequential")
    first, again = Member("steps", Steps()), Member("steps", Steps())
    first.receive(welcome(None))
    (said,) = first.receive(asked)
    again.receive(welcome(said.saved))
    again.receive(welcome(None))
    assert again.receive(asked) == [said]
