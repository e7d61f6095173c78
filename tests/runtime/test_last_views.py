"""After a pause and at the end, views of devices with a rate show the last frame."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from running import MEMBERS, World, eventually, write_world

SCREEN = """
from pathlib import Path

from minerva_bus import Device


class Slow(Device, draws=("eShow",), when="at 0.001 Hz"):
    def show(self, shown):
        with Path("shown").open("a") as file:
            file.write(f"{shown.frame}\\n")
"""
MEMBER = '\n[process.slow]\nservice = "slow_screen:Slow"\n'


FRAMES = 400


def last_view(folder):
    lines = (folder / "shown").read_text().split()
    return int(lines[-1]) if lines else -1


def test_the_last_view_before_a_pause_is_that_of_the_last_frame(tmp_path):
    (tmp_path / "slow_screen.py").write_text(SCREEN)
    path = write_world(tmp_path, MEMBERS + MEMBER, frames=FRAMES, rate=100)
    with World(path) as world, world.client() as asked:
        world.runs("steps", "walkers", "slow")
        eventually(lambda: asked.operator.status().frame > 20, "frames run")
        before = asked.ask("pause")["frame"]
        eventually(lambda: asked.operator.status().paused, "it pauses")
        eventually(lambda: last_view(tmp_path) == before - 1, "the last frame is shown")
        assert asked.ask("pause")["frame"] == before
        before = asked.ask("step", frames=5)["frame"]
        eventually(lambda: last_view(tmp_path) == before - 1, "the last of five is shown")
        asked.operator.set_rate(0)
        asked.operator.resume()
        assert world.ends() == 0
    assert last_view(tmp_path) == FRAMES


def test_a_pause_is_immediate_if_no_view_is_left_out(tmp_path):
    with World(write_world(tmp_path, frames=0, rate=100)) as world, world.client() as asked:
        world.runs("steps", "walkers")
        eventually(lambda: asked.operator.status().frame > 5, "frames run")
        before = asked.ask("pause")["frame"]
        eventually(lambda: asked.operator.status().paused, "it pauses")
        assert asked.operator.status().frame <= before


def test_a_stopped_world_has_shown_its_last_frame(tmp_path):
    (tmp_path / "slow_screen.py").write_text(SCREEN)
    path = write_world(tmp_path, MEMBERS + MEMBER, frames=0, rate=100)
    with World(path, "--json") as world, world.client() as asked:
        world.runs("steps", "walkers", "slow")
        eventually(lambda: asked.operator.status().frame > 20, "frames run")
        asked.ask("stop")
        frames = world.summary()["frames"]
    assert last_view(tmp_path) == frames - 1
