"""A robot with a slow laser drives into walls, and the sound contains the bumps."""

import wave
from pathlib import Path

from minerva_bus.frame.member_side import Member
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from minerva_services.views.sound import Sound
from tests.one_process import run_file

FRAMES = 150


def test_bumps_of_the_robot_click(tmp_path: Path):
    overrides = Overrides(
        options={"planner": "random", "robots": "2"}, settings=("gLaser.every=60",), frames=FRAMES
    )
    file = read_world_file(find_world("robot"), overrides)
    sound = Sound(str(tmp_path / "w.wav"))
    runner = run_file(file, Member("sound", sound))
    sound.close()
    figures = dict(runner.ended.figures)
    assert 0 < int(figures["clicks"]) <= int(figures["collisions"])
    with wave.open(str(tmp_path / "w.wav")) as made:
        assert made.getnframes() / made.getframerate() >= FRAMES * file.world.dt
