"""An intentionally broken engine is detected, and the failing history is shortened."""

from dataclasses import replace

import pytest

from minerva_bus.frame.collection_step import CollectionStep, FrameInbox
from minerva_bus.frame.evolution_step import EvolutionStep
from minerva_bus.frame.member_side import GeneratorSide
from minerva_bus.log.journal import Journal
from minerva_bus.runtime.pace import Pace
from tests.simulator.history import drawn
from tests.simulator.trying import LINES, report, shortest, tried, tried_seed

MOST = 110
"""Number of seeds within which each broken engine is detected: test_histories.py has many more."""


def lose_frames(patch):
    """Omit one frame of the journal."""
    whole = Journal.frame

    def frame(self, inputs):
        if inputs.frame != 2:
            whole(self, inputs)

    patch.setattr(Journal, "frame", frame)


def repeat_orders(patch):
    """Let a generator obey its orders again when a frame is requested again."""
    whole = GeneratorSide._ordered

    def ordered(self, frame):
        events = whole(self, frame)
        self._obeyed = {}
        self._orders[frame + 1] = events
        return events

    patch.setattr(GeneratorSide, "_ordered", ordered)


def keep_orders(patch):
    """Keep orders in the queue after they have been handed to a generator."""
    whole = FrameInbox.take_orders

    def take_orders(self, is_taken):
        taken = whole(self, is_taken)
        for source, events in taken.items():
            self.events.setdefault(source, []).extend(events)
        return taken

    patch.setattr(FrameInbox, "take_orders", take_orders)


def take_stale_answers(patch):
    """Accept replies to earlier frames or to earlier coordinators as current ones."""
    for step, name in ((CollectionStep, "tick_reply"), (EvolutionStep, "reply")):
        receive = getattr(step, name)

        def answer(self, reply, receive=receive):
            return receive(self, replace(reply, frame=self._now.frame))

        patch.setattr(step, name, answer)


def forget_orders(patch):
    """Do not write confirmed orders of people to the journal."""
    patch.setattr(Journal, "waiting", lambda self, events: None)


def step_twice(patch):
    """Run one frame too many per step."""
    whole = Pace.step
    patch.setattr(Pace, "step", lambda self, frames: whole(self, frames + 1))


def leave_pauses_out(patch):
    """Do not write pauses to the journal, so that a successor does not pause."""
    patch.setattr(Journal, "pace", lambda self, rate, left: None)


ENGINES = {
    lose_frames: 3,
    repeat_orders: 13,
    take_stale_answers: 106,
    forget_orders: 10,
    step_twice: 72,
    leave_pauses_out: 72,
}
"""Broken engines, each with the first seed that detects it, which is tried first.

If it detects nothing after a change of the simulation, the other seeds are tried, which takes longer.
"""


def first_failure(likely):
    tries = (tried_seed(seed) for seed in (likely, *range(MOST)))
    return next((tried for tried in tries if tried.wrong), None)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("breaking", ENGINES, ids=lambda breaking: breaking.__name__)
def test_a_broken_engine_is_caught(breaking, monkeypatch):
    breaking(monkeypatch)
    failed = first_failure(ENGINES[breaking])
    assert failed is not None
    print(breaking.__name__, report(failed))


def test_a_history_that_fails_is_shortened_to_what_it_takes(monkeypatch):
    """One order counts again in any circumstances, so nothing else remains."""
    keep_orders(monkeypatch)
    wanted = next(text for text in map(drawn, range(MOST)) if "pub eMark" in asks(text))
    failed = tried(replace(wanted, acts_from=0, frames=6))
    assert failed.wrong
    short = shortest(failed)
    assert short.wrong
    assert not short.history.faults
    assert [act.ask for act in short.history.acts] == ["pub eMark"]
    assert len(report(short).splitlines()) <= LINES


def asks(history):
    return [act.ask for act in history.acts]
