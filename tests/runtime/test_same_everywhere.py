"""A world gives the same strings in one process, in many, on two hosts, and repeatedly."""

import pytest
from running import ALL_KINDS, alone, minerva, summary, write_world


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    return write_world(tmp_path_factory.mktemp("same"), ALL_KINDS, frames=40)


@pytest.fixture(scope="module")
def undisturbed(world):
    return alone(world)


def test_one_process(undisturbed):
    assert undisturbed["frames"] == 40
    assert undisturbed["ended"] == "the frames are over"
    assert undisturbed["pictures"] == 41
    assert len(undisturbed["digest"]) == 32


@pytest.mark.parametrize("words", [
    (), ("--set", "walkers.processes=2"), ("--set", "walkers.processes=3", "--rate", "200"),
])  # fmt: skip
def test_many_processes(world, undisturbed, words):
    ended = summary(minerva(world.parent, "run", world, "--json", *words))
    for figure in ("frames", "digest", "ended", "steps", "seed", "reached"):
        assert ended[figure] == undisturbed[figure], figure


def test_again(world, undisturbed):
    again = summary(minerva(world.parent, "run", world, "--in-process", "--json"))
    assert again["digest"] == undisturbed["digest"]


def test_another_seed_gives_another_string(world, undisturbed):
    assert alone(world, "--seed", 8)["digest"] != undisturbed["digest"]
