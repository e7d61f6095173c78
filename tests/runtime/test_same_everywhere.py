"""A world gives the same strings in one process, in many, on two hosts, and repeatedly."""

import pytest
from running import ALL_KINDS, minerva, summary, write_world


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    return write_world(tmp_path_factory.mktemp("same"), ALL_KINDS, frames=40)


@pytest.fixture(scope="module")
def alone(world):
    return summary(minerva(world.parent, "run", world, "--in-process", "--json"))


def test_one_process(alone):
    assert alone["frames"] == 40
    assert alone["ended"] == "the frames are over"
    assert alone["pictures"] == 41
    assert len(alone["digest"]) == 32


@pytest.mark.parametrize("words", [
    (), ("--set", "walkers.processes=2"), ("--set", "walkers.processes=3", "--rate", "200"),
])  # fmt: skip
def test_many_processes(world, alone, words):
    ended = summary(minerva(world.parent, "run", world, "--json", *words))
    for figure in ("frames", "digest", "ended", "steps", "seed", "reached"):
        assert ended[figure] == alone[figure], figure


def test_again(world, alone):
    again = summary(minerva(world.parent, "run", world, "--in-process", "--json"))
    assert again["digest"] == alone["digest"]


def test_another_seed_gives_another_string(world, alone):
    other = summary(minerva(world.parent, "run", world, "--in-process", "--json", "--seed", "8"))
    assert other["digest"] != alone["digest"]
