"""Cameras in a complete world: to swap one for another, a single line changes (4.3)."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.runtime.running import World, eventually

cv2 = pytest.importorskip("cv2")
from rendered import FX, SIZE, rendered  # noqa: E402

WORLD = """
[world]
string = "AWatcher#r"
vocabulary = "vision_yard:vocabulary"
rate = 20

[process.watchers]
agents = "vision_yard:Watcher"

[process.cameras]
service = "camera"

"""
LOOK = f'dictionary = "6X6_250"\nsize = {SIZE}\nfx = {FX}\nnames = {{ 7 = "door" }}\n'
BRIDGE = f'[process.eye]\nservice = "vision"\nsource = "one.png"\nloop = true\nrobot = "r"\n{LOOK}'
IN_STEP = (
    '[process.eyeball]\nservice = "vision_yard:Eyeball"\nfile = "one.npy"\n'
    f'[process.eye]\nservice = "markers"\n{LOOK}'
)


@pytest.mark.parametrize("camera", [BRIDGE, IN_STEP], ids=["vision", "markers"])
def test_a_camera_sighting_is_the_robots_event(tmp_path, monkeypatch, camera):
    image = rendered(cv2, (7, 1.5, 10.0, 0, 0))
    cv2.imwrite(str(tmp_path / "one.png"), image)
    np.save(tmp_path / "one.npy", image)
    shutil.copy(Path(__file__).parent / "vision_yard.py", tmp_path)
    (tmp_path / "world.toml").write_text(WORLD + camera)
    monkeypatch.chdir(tmp_path)
    with World(tmp_path / "world.toml") as world, world.client() as asked:

        def seen():
            text = asked.operator.fragment("r")
            return re.search(r'marker="door", dist=([\d.]+), angle=([\d.]+)', text)

        sighting = eventually(seen, "it sees the marker")
    assert float(sighting[1]) == pytest.approx(1.5, rel=0.02)
    assert float(sighting[2]) == pytest.approx(10.0, abs=0.4)
