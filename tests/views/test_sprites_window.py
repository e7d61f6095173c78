"""A real window on a running world: its display, and the effects of clicks and keys."""

import json
import math
import os
import subprocess
import sys
import threading
from itertools import cycle

import pytest

pytest.importorskip("pygame")

from sprites_world import middle_of

from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import scene, vocabulary
from minerva_bus import visualize
from minerva_bus.frame.world_state import Phase
from minerva_bus.grammar.events import single
from minerva_bus.runtime.operator_client import Client
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Lists, Picture
from minerva_services.views.names import AgentName
from minerva_services.views.palette import BORDER
from minerva_services.views.sprites.painter import SpritePainter
from minerva_services.views.window.painter import Sight
from tests.patience import Late, eventually, patience
from tests.screen import Screen, needs_screen

pytestmark = needs_screen
SIZE = 900, 640
ROBOT, WALL, PAPER = (230, 159, 0), (154, 161, 171), (244, 240, 230)
LINE = rgb(BORDER)
OPTIONS = f"sprites:width={SIZE[0]},height={SIZE[1]}"


class Office:
    """The robot's world with a window, and a listener to all its events."""

    def __init__(self, folder, screen):
        self.screen, self.runtime = screen, folder / "runtime"
        environment = {
            key: value
            for key, value in os.environ.items()
            if not key.startswith(("MINERVA_", "SDL_", "WAYLAND_"))
        }
        environment |= {"DISPLAY": screen.display, "MINERVA_RUNTIME_DIR": str(self.runtime)}
        self.log = (folder / "log").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "minerva_bus.cli.main", "run", "robot", "--view", OPTIONS,
             "--rate", "8"],
            cwd=folder, env=environment, stdout=self.log, stderr=self.log,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        self.events, self.frame = [], -1
        try:
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self):
        endpoint = eventually(self._endpoint, "the world is there")
        self.client = Client(endpoint, "robot")
        self.operator = self.client.operator
        threading.Thread(target=self._listen, daemon=True).start()
        self.members("sprites", "present")
        self.painter = self._like_it()
        eventually(self._drawn, "a window shows the map")
        self.hide_legend()

    def _drawn(self):
        """Whether the window shows a map and accepts clicks."""
        window = self.screen.window()  # each time, because a window moves when it opens
        if window is None:
            return None
        self.window, self.left, self.top = window
        shown = self.seen()
        return middle_of(shown, WALL) and middle_of(shown[:10], PAPER)

    def _endpoint(self):
        assert self.process.poll() is None, self.said()
        try:
            return json.loads((self.runtime / "robot.json").read_text())["endpoint"]
        except (OSError, ValueError):
            return None

    def _listen(self):
        with Client(self._endpoint(), "robot") as client:
            for record in client.records():
                self.frame = record.frame
                self.events += single(record.events)

    def _like_it(self):
        """A painter with the initial drawing of the world, to locate items."""
        first = visualize(scene({}), [vocabulary.events["ePicture"]()], [ARobot, AParcel])
        self.first = Lists(vocabulary).picture(first, {})
        painter = SpritePainter()
        painter.offscreen(SIZE)
        painter.draw(Sight(self.first))
        return painter

    def hide_legend(self):
        """Without the legend, which grows with what has been drawn, the map stays in its place."""

        def hidden():
            # The legend begins with a line from edge to edge.
            lines = (self.seen()[: SIZE[1] - 40] == LINE).all(axis=(1, 2))
            return not lines.any()

        eventually(lambda: not hidden(), "a legend")
        self.screen.hands("key", "l")
        eventually(hidden, "no legend")

    def said(self):
        self.log.seek(0)
        return self.log.read()

    def members(self, name, state):
        """Wait until a member is in a state."""

        def there():
            members = self.operator.status().members
            return any((member.name, member.state) == (name, state) for member in members)

        eventually(there, f"{name} is {state}")

    def has(self, text):
        """Wait for an event with this text."""
        assert self.heard(text, 60), text

    def heard(self, text, seconds):
        """Whether an event with this text occurs within so many seconds."""
        try:
            return eventually(
                lambda: any(str(event) == text for event in list(self.events)), text, seconds
            )
        except Late:
            return False

    def click_on(self, label):
        box = next(drawn for drawn in self.painter.labels() if drawn.text == label)
        middle = (box.left + box.right) / 2, (box.top + box.bottom) / 2
        self.screen.click(self.left + middle[0], self.top + middle[1])

    def rests(self):
        """The frame at which the world is paused; None until the current frame has ended."""
        status = self.operator.status()
        still = status.paused and status.phase == Phase.READY.value
        return status.frame if still else None

    def step(self):
        """Press the key for one more frame, and wait for it."""
        frame = self.operator.status().frame
        self.screen.hands("key", "n")
        eventually(lambda: self.rests() == frame + 1, "one frame more")

    def seen(self):
        """The pixels of the window."""
        width, height = SIZE
        return self.screen.pixels()[self.top : self.top + height, self.left : self.left + width]

    def close(self):
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.wait(patience(20))
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.log.close()


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    with Screen() as screen:
        made = Office(tmp_path_factory.mktemp("office"), screen)
        yield made
        made.close()


def robot(office):
    return ARobot.thaw(vocabulary.read(office.operator.fragment("r1")).pieces[0])


def test_a_click_on_a_label_is_an_order(office):
    def clicked():  # repeated, because the window may not have received the accepted orders yet
        office.click_on("lab")
        return office.heard('eObjective<marker="lab">', 2)

    eventually(clicked, "an order")


def test_keys_change_the_speed(office):
    before = robot(office).speed
    office.screen.hands("key", "Up")
    office.has(f"eSpeed<speed={before + 0.1:.1f}>")


def uncovered(office):
    """Whether no label covers the robot."""
    where = robot(office)
    x, y = office.painter.camera.to_screen(*where.metres(where.position))
    return not any(
        box.left - 30 < x < box.right + 30 and box.top - 30 < y < box.bottom + 30
        for box in office.painter.labels()
    )


def test_the_space_bar_pauses_and_n_is_one_frame(office):
    goals = cycle(["kitchen", "lab"])

    def is_seen():
        """Whether the robot is to be seen; it leaves a goal at which it has arrived meanwhile."""
        return uncovered(office) or office.click_on(next(goals))

    eventually(is_seen, "the robot is to be seen, for the next test", pace=1.0)
    office.screen.hands("key", "space")
    eventually(office.rests, "the world is paused")
    office.step()


def test_the_robot_is_at_the_pose_of_its_state(office):
    """The previous test paused the world; a frame's view shows the string before it."""
    where = robot(office)
    office.step()
    x, y = where.metres(where.position)
    right, down = office.painter.camera.to_screen(x, y)
    radius = where.radius * office.painter.camera.scale

    def near():
        left, top = round(right - radius - 1), round(down - radius - 1)
        side = round(2 * radius + 2)
        middle = middle_of(office.seen()[top : top + side, left : left + side], ROBOT, 30)
        return middle and math.hypot(middle[0] + left - right, middle[1] + top - down) < 3

    eventually(near, f"a robot at {right:.0f}, {down:.0f}")


def test_a_click_on_the_name_of_the_robot_selects_it(office):
    where = robot(office)
    name = AgentName("r1", *where.metres(where.position), where.radius, 0.3)
    office.painter.draw(Sight(Picture(), names=(name,)))
    office.click_on("r1")
    office.painter.draw(Sight(office.first))
    office.click_on("library")
    office.step()
    office.has('eObjective<marker="library"> to #r1')
    office.screen.hands("key", "Escape")


def test_a_click_on_the_robot_selects_it(office):
    where = robot(office)
    x, y = office.painter.camera.to_screen(*where.metres(where.position))
    office.screen.click(office.left + x, office.top + y)
    office.click_on("office")
    office.screen.hands("key", "space")
    office.has('eObjective<marker="office"> to #r1')
    office.screen.hands("key", "Escape")


def test_a_question_mark_shows_the_keys_and_hides_them(office):
    before = office.seen()
    office.screen.hands("key", "question")
    eventually(lambda: (office.seen() != before).mean() > 0.1, "the keys")
    office.screen.hands("key", "question")
    eventually(lambda: (office.seen() != before).mean() < 0.1, "no keys")


def test_a_window_may_be_zoomed_moved_and_resized(office):
    before = office.seen()
    hands = office.screen.hands
    hands("mousemove", office.left + 300, office.top + 300, "click", 4, "click", 4)
    hands("mousedown", 1, "mousemove", office.left + 350, office.top + 320, "mouseup", 1)
    hands("key", "h")
    eventually(lambda: (office.seen() != before).mean() > 0.3, "another picture")
    hands("windowsize", office.window, 700, 500)
    beyond = (office.top + 250, office.left + 690), (office.top + 250, office.left + 720)
    eventually(
        lambda: [bool(office.screen.pixels()[place].any()) for place in beyond] == [True, False],
        "a smaller window that is drawn up to its edge",
    )
    assert office.operator.status().orders


def test_closing_the_window_leaves_the_world_to_go_on(office):
    office.screen.ask_to_close(office.window)
    office.members("sprites", "left")
    eventually(lambda: office.screen.window() is None, "the window is gone")
    frame = office.operator.status().frame
    eventually(lambda: office.operator.status().frame > frame + 3, "the world goes on")
    assert "Traceback" not in office.said()
