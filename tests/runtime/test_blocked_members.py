"""Blocked members report their line of code before they are killed."""

import os
import re
import signal

import pytest
from running import World, write_world

CODE = """\
import time

from minerva_bus import Agent, EventType, Generator, Vocabulary, on

eStep = EventType("eStep")


def waits(where):
    if where == BLOCKED:
        time.sleep(60)
    while BLOCKED == "prints":
        print("on and on", flush=True)


class Walker(Agent, symbol="AWalker"):
    x: float = 0.0

    @on("eStep")
    def walk(self, step, moment):
        waits("walk")


class Steps(Generator, events=("eStep",)):
    def generate(self, tick):
        waits("generate")
        yield eStep()


vocabulary = Vocabulary.of(eStep, Walker)
"""

MEMBERS = """
[process.steps]
service = "blocking:Steps"
restarts = 1

[process.walkers]
agents = "blocking:Walker"
restarts = 1
"""


def blocking_world(folder, blocked, **world):
    path = write_world(folder, MEMBERS, bus="soft = 0.1\nhard = 0.4", frames=0, **world)
    path.write_text(path.read_text().replace("yard:vocabulary", "blocking:vocabulary"))
    (folder / "blocking.py").write_text(CODE.replace("BLOCKED", repr(blocked)))
    return path


@pytest.mark.parametrize(("blocked", "member"), [("generate", "steps"), ("walk", "walkers")])
def test_a_blocked_member_is_killed_with_its_line(blocked, member, tmp_path):
    with World(blocking_world(tmp_path, blocked)) as world:
        world.says(f"{member} │ no answer for", "killing it; it is blocked in")
        world.says(f"{member} │", "blocking.py:10, in waits")
        world.says(f"{member} │     time.sleep(60)")
        world.says(f"{member} │ did not answer for", "(blocked as above)", "2 times in a row")
        assert world.ends() == 1
    assert "most recent call first" not in world.text
    assert world.text.count("time.sleep(60)") == 1
    assert not re.search(rf"{member} │ *$", world.text, re.M)
    assert len(world.lines) <= 16


def test_a_blocked_member_takes_one_line_per_restart(tmp_path):
    """A service is restarted as often as allowed: it may wait for something outside."""
    path = blocking_world(tmp_path, "generate")
    path.write_text(path.read_text().replace("restarts = 1", "restarts = 3"))
    with World(path) as world:
        assert world.ends() == 1
    lines = world.text.splitlines()
    first = next(n for n, line in enumerate(lines) if "restart 1 of 3" in line)
    again = [line for line in lines[first + 1 :] if line.startswith("steps │ did not answer")]
    assert len(again) == 3, world.text
    assert world.text.count("it is blocked in") == 1


def test_an_endless_method_of_agents_ends_the_world_in_ten_lines(tmp_path):
    """Methods depend on string and events only, so a third attempt is the last one."""
    path = blocking_world(tmp_path, "walk")
    path.write_text(path.read_text().replace("restarts = 1", "restarts = 9"))
    with World(path) as world:
        world.says("walkers │", "(blocked as above), 3 times in a row; the world stops")
        assert world.ends() == 1
    lines = [line for line in world.text.splitlines() if line.startswith("walkers │")]
    assert len(lines) <= 10, world.text


def test_the_log_has_all_frames_and_so_has_the_terminal_on_demand(tmp_path):
    path = blocking_world(tmp_path, "generate")
    path.write_text(path.read_text().replace("restarts = 1", "restarts = 9"))
    with World(path, "--traceback") as world:
        world.says("Current thread", "(most recent call first):")
        world.says("blocking.py", "line 25 in generate")
        world.says("made_events")
        world.says("restart 1 of 9")
        with world.client() as asked:
            kept = [line.text for line in asked.operator.logs(0, "steps")]
        world.kill(signal.SIGINT)
        world.ends()
    assert any(re.search(r"blocking\.py\", line 25 in generate", text) for text in kept)
    assert any("time.sleep(60)" in text for text in kept)


def test_a_member_that_prints_without_end_is_killed(tmp_path):
    with World(blocking_world(tmp_path, "prints")) as world:
        world.says("steps │ no answer for", "killing it")
        world.says("steps │ was killed by SIGKILL; restart 1 of 1")
        world.kill(signal.SIGINT)
        world.ends()


def test_a_frozen_member_is_killed_without_it(tmp_path):
    with World(blocking_world(tmp_path, "")) as world:
        os.kill(world.runs("steps", "walkers")["walkers"], signal.SIGSTOP)
        said = world.says("walkers │ no answer for", "killing it")
        assert said.endswith("killing it")
        world.says("walkers │ was killed by SIGKILL; restart 1 of 1")
        world.kill(signal.SIGINT)
        world.ends()
