"""A view has time to finish its last picture, and the report names one that is killed."""

import os
import signal

import pytest
from running import MEMBERS, Run, World, minerva, write_world

from minerva_bus.runtime.timeouts import OUTPUT_SECONDS, Deadlines, Patience

PAINTER = '\n[process.painter]\nservice = "yard:Painter"\n'


def test_a_slow_view_finishes_its_last_picture_and_its_file(tmp_path):
    members = MEMBERS + PAINTER + "drawing = 2.0\nclosing = 1.0\n"
    done = minerva(tmp_path, "run", write_world(tmp_path, members, frames=3), "--json")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "painted.txt").read_text() == "3"
    assert "killed" not in done.stderr


def test_the_member_with_awaited_output_is_named(tmp_path):
    path = write_world(tmp_path, MEMBERS + PAINTER + "drawing = 1.5\n", frames=3)
    with Run(tmp_path, "run", path) as run:
        run.says("painter │ the world has ended; finishing its last output (")
        assert run.ends() == 0


def test_the_last_output_of_many_is_awaited_in_one_line(tmp_path):
    painters = "".join(
        PAINTER.replace("painter", f"painter{n}") + "drawing = 1.5\n" for n in range(5)
    )
    path = write_world(
        tmp_path, MEMBERS + painters.replace("yard:painter", "yard:Painter"), frames=3
    )
    with Run(tmp_path, "run", path) as run:
        run.says("finishing the last output of painter0, painter1, painter2 and 2 more (")
        assert run.ends() == 0
    assert run.text.count("finishing") == 1


def test_ctrl_c_does_not_wait_for_a_slow_view(tmp_path):
    path = write_world(tmp_path, MEMBERS + PAINTER + "drawing = 30.0\n", frames=0)
    with World(path) as world:
        world.runs("steps", "walkers", "painter")
        world.kill(signal.SIGINT)
        world.ends(5)
    assert not (tmp_path / "painted.txt").exists()


def test_a_view_that_does_not_finish_is_named(tmp_path):
    path = write_world(tmp_path, MEMBERS + PAINTER, frames=0)
    with World(path) as world:
        os.kill(world.runs("steps", "walkers", "painter")["painter"], signal.SIGSTOP)
        world.kill(signal.SIGINT)
        world.says("painter │ after the last frame, its output did not come within 0.5 s")
        world.ends(5)


@pytest.mark.slow
def test_a_view_that_never_finishes_is_killed(tmp_path):
    path = write_world(tmp_path, MEMBERS + PAINTER, bus="soft = 1.0\nhard = 1.0", frames=0)
    with World(path) as world:
        os.kill(world.runs("steps", "walkers", "painter")["painter"], signal.SIGSTOP)
        assert minerva(tmp_path, "stop", path.stem).returncode == 0
        world.says("painter │ still running after the end of the world: killing it")
        assert world.ends(5) == 0


@pytest.mark.parametrize(
    ("hard", "own", "names", "seconds"),
    [
        (30.0, {}, ["a"], 30.0),
        (2.0, {}, ["a"], OUTPUT_SECONDS),
        (30.0, {"a": Patience(1.0, 300.0)}, ["a", "b"], 300.0),
        (30.0, {"a": Patience(1.0, 300.0)}, ["b"], 30.0),
        (2.0, {}, [], OUTPUT_SECONDS),
    ],
)
def test_the_last_output_may_take_as_long_as_a_frame(hard, own, names, seconds):
    assert Deadlines(Patience(1.0, hard), own).for_output(names) == seconds


@pytest.mark.parametrize(
    ("hard", "ended", "killed"),
    [
        (30.0, 5.0, 30.0),  # It reported after 5 s, and closes for the rest of its time.
        (30.0, 29.0, 29.0 + OUTPUT_SECONDS),
        (2.0, 1.0, 1.0 + OUTPUT_SECONDS),
        (300.0, 299.0, 299.0 + OUTPUT_SECONDS),
    ],
)
def test_a_member_has_its_time_only_once(hard, ended, killed):
    assert Deadlines(Patience(1.0, hard)).end_of_output(["a"], 0.0, ended) == killed
