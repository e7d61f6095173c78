"""The state of a running world, as operators see it."""

from dataclasses import replace

from minerva_bus.frame.description import World
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.watchers import Watchers
from minerva_bus.runtime.world_status import status_of

WORLD = World("w", EMPTY, Vocabulary.of())


def ignore(*_):
    """Watch nothing."""


def waited(world, seconds):
    """The awaited members of a world, and the seconds of which its state speaks."""
    watchers = Watchers(said=ignore, status=ignore, listening=ignore, stalled=ignore)
    coordinator = Coordinator(world, watchers)
    coordinator.status.waited = seconds
    status = status_of(coordinator._operated())
    return status.waiting, status.waited


def test_a_world_that_waits_for_nobody_has_not_waited():
    """The waiting time is measured at intervals, and who is awaited is known at once."""
    assert waited(WORLD, 3.8) == ((), 0.0)
    assert waited(replace(WORLD, expected=frozenset({"a"})), 3.8) == (("a",), 3.8)
