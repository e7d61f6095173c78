"""Spaces in worlds: one string, wherever they run."""

from space.worlds import Meadow, eStep, meadow

from minerva_bus import Vocabulary, World, each, run


def world(agents):
    string = meadow(name="north").string + meadow(sheep=20, name="south").string
    return World(string, agents=agents, services=[each(eStep)], name="meadows", seed=7)


def test_a_run_in_processes_gives_the_string_of_a_run_in_one():
    here = run(world([Meadow]), frames=5)
    there = run(world({"a": [Meadow], "b": [Meadow]}), frames=5, bus=True)
    assert there.digest == here.digest
    assert run(world([Meadow]), frames=4).digest != here.digest


def test_a_space_is_written_and_read_as_text():
    space = meadow(side=2, sheep=1, wolves=0).string
    assert Vocabulary.of(Meadow, eStep).read(str(space)).digest == space.digest
