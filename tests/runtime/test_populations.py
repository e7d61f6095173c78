"""A population on a real bus: its hosts join, leave and die; the string is the same."""

import os
import shutil
import signal
from pathlib import Path

import pytest
from running import Run, World, alone, eventually, minerva, summary

WORLD = """
[world]
scene = "shoal:scene"
vocabulary = "shoal:vocabulary"
seed = 11
frames = {frames}
rate = {rate}

[process.steps]
service = "shoal:Steps"

[process.fish]
agents = "shoal:Fish"
processes = {hosts}

[process.screen]
service = "shoal:Screen"
"""


@pytest.fixture
def shoal(tmp_path):
    """Write a world of fish."""

    def write(hosts=2, frames=120, rate=40):
        for module in ("shoal.py", "yard.py"):
            shutil.copy(Path(__file__).parent / module, tmp_path)
        path = tmp_path / "shoal.toml"
        path.write_text(WORLD.format(hosts=hosts, frames=frames, rate=rate))
        return path

    return write


def test_any_number_of_hosts_gives_the_string_of_one_process(shoal):
    digests = {
        hosts: summary(minerva(path.parent, "run", path, "--rate", "0", "--json"))["digest"]
        for hosts in (1, 2, 3)
        if (path := shoal(hosts, frames=30))
    }
    assert set(digests.values()) == {alone(shoal(1, frames=30))["digest"]}


def test_hosts_and_generators_that_are_killed_change_nothing(shoal):
    path = shoal()
    with World(path, "--json") as world:
        for name in ("fish-1", "steps", "fish-2"):
            os.kill(world.runs(name)[name], signal.SIGKILL)
            world.says(f"{name} │ was killed by SIGKILL; restart 1 of 5 in")
            eventually(
                lambda name=name: world.members()[name]["state"] == "present", f"a new {name}"
            )
        summary = world.summary()
        world.gone()
    assert (summary["frames"], summary["digest"]) == (120, alone(path)["digest"])


def test_a_host_and_a_view_that_join_later_get_their_share(shoal):
    path = shoal(hosts=1, rate=15)
    with World(path, "--json") as world:
        world.runs("steps")
        with Run(
            path.parent, "attach", "shoal:Screen", "--name", "late", "--said", "true"
        ) as screen:
            with Run(path.parent, "attach", "shoal:Fish", "--name", "more") as more:
                eventually(
                    lambda: world.members().get("more", {}).get("state") == "present", "it is in"
                )
                before = world.frame
                eventually(
                    lambda: world.members() and world.frame > before + 5, "the world goes on"
                )
                more.kill(signal.SIGINT)
                assert more.ends() == 0
            summary = world.summary()
            assert screen.ends() == 0
            seen = {int(line.split()[0]): line for line in screen.output if line[:1].isdigit()}
    assert summary["digest"] == alone(path)["digest"]
    shown = minerva(
        path.parent, "run", path, "--in-process", "--rate", "0", "--set", "screen.said=true"
    ).stderr
    said = [line.removeprefix("in-process │ ") for line in shown.splitlines()]
    whole = {int(line.split()[0]): line for line in said if line[:1].isdigit()}
    assert seen
    assert all(whole[frame] == line for frame, line in seen.items())
