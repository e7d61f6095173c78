"""One string, many geometric systems: all of them show the robot at the pose of its state.

A frame of the robot's world in mid-run, shown by sprites, OpenGL, the page and the picture.
"""

import re

import numpy as np
import pytest

pytest.importorskip("pygame", reason="pip install 'minerva-bus[sprites]'")

from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import vocabulary
from minerva_bus import View, WorldInfo, visualize
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from minerva_services.geometry.picture import Lists
from minerva_services.views.svg import Svg
from minerva_services.views.window.painter import Sight

FRAMES = 60
ORANGE = (230, 159, 0)
KINDS = [ARobot]


@pytest.fixture(scope="module")
def moment():
    """The robot's own figure on its floor after some frames, and its position from its state."""
    file = read_world_file(find_world("robot"), Overrides(options={"parcels": ""}))
    algorithm = FrameAlgorithm(file.world)
    runner = InProcessRunner(
        algorithm, [process.make_member() for process in file.processes], lambda _: None
    )
    runner.start()
    for _ in range(FRAMES):
        runner.handle(s.Begin())
    (robot,) = [node for node in algorithm.scene if node.symbol == "ARobot"]
    state = robot.state
    shown = visualize(algorithm.scene, [vocabulary.events["ePicture"]()], KINDS)
    known = {"PGrid", "PPath", "PGoal"}  # They would cover the robot or lie beneath it.
    still = type(shown)(tuple(node for node in shown.nodes if node.symbol not in known))
    x = state["x0"] + state["row"] * state["cell"]
    return still, x, state["y0"] + state["column"] * state["cell"]


def blob(pixels, color=ORANGE, tolerance=24):
    """The centre (x, y) of the bounding box of a colour."""
    near = (np.abs(pixels.astype(int) - np.array(color)) <= tolerance).all(axis=2)
    rows, columns = np.nonzero(near)
    assert len(rows) > 20
    return np.array([np.ptp(columns) / 2 + columns.min(), np.ptp(rows) / 2 + rows.min()])


def projected(painter, x, y, height):
    at = painter.project(*(np.array([value], float) for value in (x, y, height)))
    return np.array([at[0][0], at[1][0]])


def test_sprites(moment):
    from minerva_services.views.sprites.painter import SpritePainter

    scene, x, y = moment
    painter = SpritePainter()
    painter.offscreen((1000, 700))
    painter.draw(Sight(Lists(vocabulary).picture(scene, {})))
    assert blob(painter.pixels()) == pytest.approx(projected(painter, x, y, 0.0), abs=2)


def test_opengl(moment):
    opengl = pytest.importorskip("opengl_world")
    if not opengl.has_driver():
        pytest.skip("there is no OpenGL driver (EGL) here")
    scene, x, y = moment
    painter = opengl.GLPainter(-90.0, 90.0, 1.0)
    painter.offscreen((1000, 700))
    painter.draw(Sight(Lists(vocabulary).picture(scene, {})))
    assert blob(painter.pixels()) == pytest.approx(projected(painter, x, y, 0.3), abs=4)
    painter.close()


def test_the_page(moment):
    pytest.importorskip("viser", reason="pip install 'minerva-bus[web]'")
    from web_world import listened

    from minerva_services.views.web.page_scene import PageScene

    scene, x, y = moment
    with listened() as (server, _):
        PageScene(server).show(Lists(vocabulary).picture(scene, {}))
        bodies = server.scene.get_handle_by_name("/movers/bodies")
        assert bodies.batched_positions[0][:2] == pytest.approx((x, y), abs=1e-4)


def test_the_picture(moment, tmp_path):
    scene, x, y = moment
    service = Svg(str(tmp_path / "p.svg"), png=False)
    service.joined(WorldInfo("robot", vocabulary, 0, 0.1))
    service.show(View(FRAMES, "ePicture", scene))
    drawn = (tmp_path / "p.svg").read_text()
    (cx, cy) = re.search(
        r'<circle cx="([-\d.]+)" cy="([-\d.]+)"[^>]*fill="#e69f00"', drawn
    ).groups()
    assert (float(cx), float(cy)) == pytest.approx((x, y), abs=0.01)
