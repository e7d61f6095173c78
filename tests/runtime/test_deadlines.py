"""Deadlines of members in a frame, and the policies after them: wait, skip or stop."""

import os
import re
import signal

import pytest
from running import World, alone, eventually, here, write_world

MEMBERS = """
[process.steps]
service = "yard:Steps"
{steps}

[process.walkers]
agents = "yard:Walker"
{walkers}
"""


def slow(steps="", walkers=""):
    return MEMBERS.format(steps=steps, walkers=walkers)


SKIP = 'soft = 0.1\nhard = 0.3\nlate = "skip"'


def test_a_frame_goes_on_without_a_host_whose_agents_stand_still(tmp_path):
    path = write_world(tmp_path, slow(walkers=SKIP), frames=0, rate=20)
    with World(path) as world:
        pid = world.runs("steps", "walkers")["walkers"]
        os.kill(pid, signal.SIGSTOP)
        world.says("walkers │ timed out in frame")
        with world.client() as asked:
            still = asked.ask("fragment", agent="a")["fragment"]
            frame = asked.operator.status().frame
            eventually(lambda: asked.operator.status().frame > frame + 1, "frames go on")
            assert asked.ask("fragment", agent="a")["fragment"] == still
            os.kill(pid, signal.SIGCONT)
            eventually(lambda: asked.ask("fragment", agent="a")["fragment"] != still, "it walks")
            assert len(re.findall("AWalker#[a-d]<", asked.ask("scene")["scene"])) == 4
            walkers = next(m for m in asked.operator.status().members if m.name == "walkers")
            assert walkers.pid == pid
            assert walkers.late >= 1
        world.kill(signal.SIGINT)
        world.ends()
    assert re.search(r"walkers │ frame \d+ \(evolution\) has been waiting for it for 0\.\d s; the frame"
                     r" continues without it in 0\.\d s", world.text)  # fmt: skip


def test_a_frame_goes_on_without_a_generator(tmp_path):
    path = write_world(tmp_path, slow(steps=SKIP), frames=0, rate=20)
    with World(path) as world:
        pid = world.runs("steps", "walkers")["steps"]
        os.kill(pid, signal.SIGSTOP)
        world.says("steps │ timed out in frame")
        with world.client() as asked:
            frame = asked.operator.status().frame
            eventually(lambda: asked.operator.status().frame > frame + 1, "frames go on")
            os.kill(pid, signal.SIGCONT)

            def back():
                member = next(m for m in asked.operator.status().members if m.name == "steps")
                return member.state == "present"

            eventually(back, "it answers again")
        world.kill(signal.SIGINT)
        world.ends()


def test_a_world_that_waits_without_end_goes_on_as_if_nothing_had_been(tmp_path):
    wait = 'soft = 0.1\nhard = 0.1\nlate = "wait"'
    path = write_world(tmp_path, slow(walkers=wait), frames=60, rate=40)
    undisturbed = alone(path)
    with World(path, "--json") as world:
        pid = world.runs("steps", "walkers")["walkers"]
        os.kill(pid, signal.SIGSTOP)
        said = world.says("walkers │ frame", "has been waiting for it for 0")
        assert said.endswith(" s; the world waits for it without limit")
        world.says("has been waiting for it for 0.")
        os.kill(pid, signal.SIGCONT)
        assert world.summary()["digest"] == undisturbed["digest"]
        assert "is killed" not in world.text


def test_a_world_stops_where_a_member_is_too_late(tmp_path):
    stop = 'soft = 0.1\nhard = 0.4\nlate = "stop"'
    path = write_world(tmp_path, slow(walkers=stop), frames=0, rate=20)
    with World(path) as world:
        pid = world.runs("steps", "walkers")["walkers"]
        os.kill(pid, signal.SIGSTOP)
        world.says("walkers │", "; the world stops in 0.")
        assert world.ends() == 1
        assert re.search(
            r"walkers │ did not answer for 0\.\d s in frame \d+; the world stops", world.text
        )
        world.gone()


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('late = "never"', "late must be one of restart, skip, wait, stop"),
        ("soft = 2.0\nhard = 1.0", "soft must be at most hard, 1"),
        ("hard = -1", "hard must be a number of seconds from 0.1"),
    ],
)
def test_a_deadline_that_is_none_is_refused(tmp_path, keys, said):
    path = write_world(tmp_path, slow(walkers=keys))
    done = here(tmp_path, "check", path)
    assert done.returncode == 1
    assert said in done.stderr + done.stdout
