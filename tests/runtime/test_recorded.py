"""Recorded runs: in many processes or one, killed or complete."""

import json

import pytest
from running import World, eventually, here, minerva, write_world

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")


def info(path):
    done = here(path.parent, "info", path, "--check", "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_run_on_the_bus_has_the_record_of_one_in_one_process(tmp_path):
    path = write_world(tmp_path, frames=40, record="alone.mcap")
    alone = json.loads(minerva(tmp_path, "run", path, "--in-process", "--json").stdout)
    done = minerva(tmp_path, "run", path, "--record", "bus.mcap", "--json")
    assert json.loads(done.stdout)["digest"] == alone["digest"]
    assert here(tmp_path, "diff", "alone.mcap", "bus.mcap").returncode == 0
    assert info(tmp_path / "bus.mcap")["frames"] == 40


def test_written_frames_survive_when_all_processes_are_killed(tmp_path):
    path = write_world(tmp_path, frames=0, rate=100, record="run.mcap", durable=True)
    with World(path) as world:
        world.runs("steps", "walkers")
        with world.client() as asked:
            eventually(lambda: asked.operator.status().frame > 20, "some frames")
            frame = asked.operator.status().frame
        world.kill()
        world.ends()
        world.gone()
    assert info(tmp_path / "run.mcap")["frames"] >= frame


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (
            ("--record", "run.txt"),
            "record: cannot write run.txt: expected a name that ends in .mcap",
        ),
        (("--record", "nowhere/run.mcap"), "nowhere/run.mcap"),
    ],
)
def test_a_record_that_cannot_be_created_is_reported(tmp_path, words, problem):
    done = minerva(tmp_path, "run", write_world(tmp_path, frames=3), *words)
    assert done.returncode != 0
    assert problem in done.stderr
    assert "Traceback" not in done.stderr
