"""A real window: user input reaches a world that runs on the bus."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from opengl_world import at, like, needs_driver

from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.vocabulary import ePicture
from minerva_agents.robot.world import scene, vocabulary
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch import registry
from minerva_bus.runtime.operator_client import Client
from minerva_bus.world.visualization import visualize
from minerva_services.geometry.picture import Lists
from minerva_services.views.names import AgentName
from minerva_services.views.opengl.painter import GLPainter
from minerva_services.views.window.painter import Sight
from tests.patience import eventually, patience
from tests.screen import Screen, needs_screen

pytestmark = [needs_driver, needs_screen]
SIZE = 900, 600
ROBOT, PAPER = (230, 159, 0), (244, 240, 230)
START = scene({})


@pytest.fixture(scope="module")
def screen():
    with Screen() as screen:
        yield screen


@pytest.fixture
def said(screen, tmp_path, monkeypatch):
    """Run `minerva run robot` with a window; yields the file with its output."""
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("DISPLAY", screen.display)
    for name in [variable for variable in os.environ if variable.startswith(("SDL_", "WAYLAND_"))]:
        monkeypatch.delenv(name)
    words = ["-m", "minerva_bus", "run", "robot", "--rate", "8", "--view"]
    words.append(f"opengl:width={SIZE[0]},height={SIZE[1]}")
    path = tmp_path / "said.txt"
    with path.open("w") as file:
        run = subprocess.Popen([sys.executable, *words], cwd=tmp_path, stderr=file, stdout=file)
    yield path
    run.send_signal(signal.SIGINT)
    try:
        run.wait(patience(20))
    except subprocess.TimeoutExpired:
        run.kill()
        run.wait()


def drawn(string, *names):
    """A painter that has drawn a string without a window, and its pixels."""
    painter = GLPainter(-90.0, 60.0, 1.0)
    painter.offscreen(SIZE)
    view = visualize(string, [ePicture()], [ARobot, AParcel])
    painter.draw(Sight(Lists(vocabulary).picture(view, {}), names=names))
    return painter, painter.pixels()


def string_of(operator):
    """The current string of the world: static nodes, and agents in their current state."""
    texts = [operator.fragment(piece.id) if hasattr(piece, "id") else "" for piece in START.pieces]
    nodes = zip(START.pieces, texts, strict=True)
    return Scene(tuple(vocabulary.read(text).pieces[0] if text else node for node, text in nodes))


def test_a_persons_hands_reach_the_world(screen, said):
    worlds = eventually(registry.running, "the world is there")
    painter, _ = drawn(START)
    with Client(worlds[0].endpoint) as client:
        ask = client.operator
        window, left, top = eventually(screen.window, "there is a window")

        def seen():
            return screen.pixels()[top : top + SIZE[1], left : left + SIZE[0]]

        def happened(text):
            return any(text in happening.text for happening in ask.status().happenings)

        def shows(pixels, x, y):
            part = (
                slice(max(0, int(y) - 25), int(y) + 25),
                slice(max(0, int(x) - 25), int(x) + 25),
            )
            differs = np.abs(seen()[part].astype(int) - pixels[part]).max(axis=2) > 40
            return differs.mean() < 0.05

        eventually(lambda: len(like(seen(), ROBOT, 14)) > 10, "the robot is drawn")
        # Without the legend, which grows with what has been drawn, the world stays in its place.
        eventually(lambda: like(seen()[-20:], PAPER, 0).size, "a legend")
        screen.hands("key", "l")
        eventually(lambda: not like(seen()[-20:], PAPER, 0).size, "no legend")
        sign = next(box for box in reversed(painter.labels()) if box.text == "lab")
        middle = left + (sign.left + sign.right) / 2, top + (sign.top + sign.bottom) / 2

        def clicked():  # repeated, because the window may not have received the accepted orders yet
            screen.click(*middle)
            return happened('eObjective<marker="lab">')

        eventually(clicked, "the click arrives")
        screen.hands("key", "Up")
        eventually(lambda: happened("eSpeed<speed=0.9>"), "the key arrives")
        screen.hands("key", "space")
        eventually(lambda: rests(ask.status()), "the world is paused")
        screen.hands("key", "b")
        robot = ARobot.thaw(vocabulary.read(ask.fragment("r1")).pieces[0])
        name = AgentName("r1", *robot.metres(robot.position), robot.radius, 0.3)
        (painter, pixels), before = drawn(string_of(ask), name), ask.status().frame
        x, y = at(painter, *robot.metres(robot.position), 0.3)
        screen.hands("key", "n")
        eventually(lambda: ask.status().frame == before + 1, "one frame is run")
        eventually(lambda: shows(pixels, x, y), "the window shows the string of that frame")
        before = seen()
        screen.hands("mousemove", left + 450, top + 550, "mousedown", 1)
        for dx in (20, 40, 60):
            screen.hands("mousemove", left + 450 + dx, top + 550)
        screen.hands("mouseup", 1)
        eventually(lambda: (seen() != before).any(axis=2).mean() > 0.2, "the world is turned")

        screen.hands("key", "space")
        screen.ask_to_close(window)
        eventually(lambda: "opengl" not in present(ask), "the window leaves")
        before = ask.status().frame
        eventually(lambda: ask.status().frame > before + 5, "the world goes on")
    assert "Traceback" not in said.read_text()
    assert "exit code 1" not in said.read_text()


def rests(status):
    return status.paused and status.phase == "between frames"


def present(operator):
    return [member.name for member in operator.status().members if member.state == "present"]
