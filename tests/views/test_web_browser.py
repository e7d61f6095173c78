"""A real browser at the page of a real run: it shows the world, and its orders arrive."""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import cast

import numpy as np
import pytest

pytest.importorskip("viser")
playwright = pytest.importorskip("playwright.sync_api")

from minerva_agents.robot.robot import ARobot  # noqa: E402
from minerva_agents.robot.world import scene, vocabulary  # noqa: E402
from minerva_bus import Raster  # noqa: E402
from minerva_bus.errors import BusError  # noqa: E402
from minerva_bus.grammar.scene import AgentNode  # noqa: E402
from minerva_bus.runtime.operator_client import Client  # noqa: E402
from minerva_bus.semantics.plane import Bounds  # noqa: E402
from minerva_services.geometry.picture import Lists, Texts  # noqa: E402
from minerva_services.views.web.camera_control import FIELD, bounds_of, camera_pose  # noqa: E402
from tests.patience import eventually, patience  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt install chromium)"),
    pytest.mark.timeout(300),
]

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
WIDTH, HEIGHT = 800, 400
WALL_HEIGHT = cast(Raster, vocabulary.primitives["PMap"].shape).height
COARSE = "&fixedDpr=0.2"  # Fewer pixels, because the processor draws them here.
RARE = "requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 200);"
"""Fewer pictures, for the same reason: the page would draw 60 in each second."""


class Building:
    """`minerva run robot --view web`, with a record of the events of its frames."""

    def __init__(self, folder: Path):
        kept = {key: value for key, value in os.environ.items() if not key.startswith("MINERVA_")}
        runtime = folder / "runtime"
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "minerva_bus.cli.main", "run", "robot"),
                *("--robots", "2", "--parcels", "", "--rate", "5", "--view", "web"),
            ],
            env={**kept, "MINERVA_RUNTIME_DIR": str(runtime)}, cwd=folder, text=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        self.lines: list[str] = []
        threading.Thread(target=self._gather, daemon=True).start()
        line = eventually(
            lambda: next((line for line in list(self.lines) if "http://" in line), ""), "no page"
        )
        self.url = line[line.index("http://") :].strip()
        self.endpoint = json.loads((runtime / "robot.json").read_text())["endpoint"]
        self.client = Client(self.endpoint, "robot")
        self.events: list[str] = []
        self._watch = threading.Thread(target=self._record, daemon=True)
        self._watch.start()

    def _gather(self):
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append(line)

    def _record(self):
        try:
            for record in self.client.records():
                self.events += map(str, record.events)
        except BusError:
            return

    def has(self, event):
        """Wait until a frame has had an event."""
        eventually(lambda: event in self.events, f"no {event}")

    def publishes(self, event, datum):
        """Send an event to r1 as a person at another terminal."""
        words = "pub", event, datum, "--to", "r1", "--connect", self.endpoint, "--world", "robot"
        subprocess.run([sys.executable, "-m", "minerva_bus.cli.main", *words], check=True)

    def status(self):
        return self.client.operator.status()

    def end(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@pytest.fixture(scope="module")
def building(tmp_path_factory):
    made = Building(tmp_path_factory.mktemp("building"))
    try:
        # The threads of an open client keep the process of the tests alive.
        with made.client:
            yield made
    finally:
        made.end()


@pytest.fixture(scope="module")
def chromium():
    with playwright.sync_playwright() as player:
        yield lambda: player.chromium.launch(executable_path=CHROMIUM, args=FLAGS)


@pytest.fixture(scope="module")
def page(building, chromium):
    browser = chromium()
    opened = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    opened.set_default_timeout(1000 * patience())
    opened.asked = []
    opened.on("request", lambda request: opened.asked.append(request.url))
    opened.on("websocket", lambda socket: opened.asked.append(socket.url))
    visit(opened, building)
    yield opened
    browser.close()


def visit(page, building):
    page.add_init_script(RARE)
    page.goto(building.url + COARSE)
    page.get_by_text("frame ", exact=False).first.wait_for()
    page.get_by_text("Send eErrand").wait_for()
    # The browser's warning that it has no graphics card lies over the scene.
    page.locator(".mantine-Notification-closeButton").first.click()


def frame_on(page):
    words = page.get_by_text("frames/s", exact=False).first.inner_text().split()
    return int(words[words.index("frame") + 1])


def pixels(page):
    """The images of the canvases."""
    return page.evaluate("[...document.querySelectorAll('canvas')].map(one => one.toDataURL())")


START = Lists(vocabulary).picture(scene({}), {})
BOUNDS = cast(Bounds, bounds_of(START))
PIN_HEIGHT = 0.06 * math.hypot(BOUNDS.right - BOUNDS.left, BOUNDS.top - BOUNDS.bottom)
STEPS = 5
"""Frames between two looks at a robot, whose label moves by a small part of its size in each frame."""
LABEL_MIDDLE = 5
"""Pixels from the lower edge of a label to a place within it."""


def marker(name):
    """The position of a marker."""
    return next((text.x[0], text.y[0]) for text in START.of(Texts) if text.texts[0] == name)


def pixel_of(page, x, y, high):
    """The position on the page of a place."""
    box = page.locator("canvas").first.bounding_box()
    seen = camera_pose(BOUNDS, WALL_HEIGHT, box["width"] / box["height"])
    eye, aim = np.array(seen.position), np.array(seen.look_at)
    ahead = (aim - eye) / np.linalg.norm(aim - eye)
    to, right = np.array([x, y, high]) - eye, np.array([1.0, 0.0, 0.0])
    scale = box["height"] / 2 / math.tan(FIELD / 2) / (to @ ahead)
    return (
        box["x"] + box["width"] / 2 + to @ right * scale,
        box["y"] + box["height"] / 2 - to @ np.cross(right, ahead) * scale,
    )


def test_the_page_shows_a_world_that_moves(page, building):
    first, before = frame_on(page), pixels(page)
    eventually(lambda: frame_on(page) > first + 2, "the frame on the page stands still")
    eventually(lambda: pixels(page) != before, "nothing moves")


def test_the_page_requests_nothing_from_other_hosts(page, building):
    here = building.url.removeprefix("http://").partition("/")[0]
    allowed = (f"http://{here}", f"ws://{here}", f"blob:http://{here}", "data:")
    assert page.asked
    assert [url for url in page.asked if not url.startswith(allowed)] == []


def test_a_click_on_a_marker_in_the_world_sets_the_objective(page, building):
    page.mouse.click(*pixel_of(page, *marker("kitchen"), 0.7 * PIN_HEIGHT))
    building.has('eObjective<marker="kitchen">')
    page.get_by_text("eObjective(marker=kitchen) sent to all").wait_for()


def test_a_click_on_the_label_of_a_marker_sets_the_objective(page, building):
    x, y = pixel_of(page, *marker("workshop"), 1.12 * PIN_HEIGHT)
    page.mouse.click(x + 10, y - LABEL_MIDDLE)
    building.has('eObjective<marker="workshop">')


def test_the_title_is_the_name_of_the_world(page):
    assert page.title() == "robot"


def test_the_legend_explains_the_colours(page):
    for text in ("free, seen by the laser", "free, inspected by the camera", "marker of a room"):
        page.get_by_text(text).first.wait_for()


def test_the_scene_has_room_beside_the_controls_of_a_narrow_page(page, building):
    page.set_viewport_size({"width": 700, "height": HEIGHT})
    # The label stays, while each status replaces the line above it, perhaps before its place is read.
    canvas, panel = page.locator("canvas").first, page.locator("label", has_text="frames/s")

    def apart():
        scene, controls = canvas.bounding_box(), panel.bounding_box()
        if scene is None or controls is None:  # The page is being laid out.
            return False
        return scene["width"] >= 300 and scene["x"] + scene["width"] <= controls["x"]

    eventually(apart, "the controls cover the scene")
    page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    eventually(lambda: canvas.bounding_box()["width"] > 400, "the scene stays narrow")
    page.get_by_text("Send eErrand").wait_for()


def test_on_a_phone_the_controls_are_below_the_world(page, building):
    page.set_viewport_size({"width": 390, "height": 800})
    world, sheet = page.locator("canvas").first, page.locator(".mantine-Paper-root").first

    def apart():
        above, below = world.bounding_box(), sheet.bounding_box()
        if above is None or below is None:  # The page is being laid out.
            return False
        return below["width"] == 390 and above["y"] + above["height"] <= below["y"]

    try:
        eventually(apart, "the controls cover the world")
    finally:
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})


def test_names_do_not_wait_for_further_pictures(page):
    """viser's code draws letters without its limit; another version of viser may need another one."""
    code = (
        "[...document.scripts].some((each) => each.textContent.includes('performance.now()+ 1e3)'))"
    )
    assert page.evaluate(code)


def test_orders_go_to_the_robot_that_is_chosen(page, building):
    page.get_by_label("selected", exact=True).first.click()
    page.get_by_role("option", name="r2", exact=True).click()
    page.get_by_text("ARobot#r2").wait_for()
    page.get_by_role("button", name="Send eObjective").click()
    building.has('eObjective<marker="reception"> to #r2')
    page.get_by_role("button", name="Send eErrand").click()
    building.has('eErrand<source="reception", target="office"> to #r2')


def label_of(page, building, name):
    """The position on the page of the label of a robot."""
    (piece,) = vocabulary.read(building.client.operator.fragment(name)).pieces
    robot = ARobot.thaw(cast(AgentNode, piece))
    x, y = pixel_of(page, *robot.metres(robot.position), 0.3 + 0.3 * PIN_HEIGHT)
    return x, y - LABEL_MIDDLE


def test_a_click_on_the_name_of_a_robot_selects_it(page, building):
    texts = [text for text in START.of(Texts) if text.texts[0]]
    pins = {text.texts[0]: pixel_of(page, text.x[0], text.y[0], 0.8 * PIN_HEIGHT) for text in texts}
    # A robot may have come to rest beside a marker, whose pin is in front of its name.
    place = label_of(page, building, "r1")
    building.publishes(
        "eObjective", f"marker={max(pins, key=lambda name: math.dist(pins[name], place))}"
    )
    page.get_by_role("button", name="Pause").click()
    eventually(lambda: building.status().paused, "no pause")
    tried = []

    def free():
        """The label of r1 on the page, once no pin, no other robot and no control is near it."""
        frame = building.status().frame
        if frame_on(page) != frame:
            return None
        x, y = label_of(page, building, "r1")
        others = [*pins.values(), label_of(page, building, "r2")]
        top = page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.tagName", [x, y])
        if top == "CANVAS" and all(abs(x - a) > 40 or abs(y - b) > 25 for a, b in others):
            return x, y
        tried.append(f"frame {frame}: {top} at ({x:.0f}, {y:.0f})")
        building.client.operator.step(STEPS)
        eventually(lambda: building.status().frame == frame + STEPS, "no step")
        return None

    def selected():
        """Whether a click has selected r1; a busy browser may lose one, or draw a frame late."""
        place = free()
        if place is None:
            return False
        page.mouse.click(*place)
        with suppress(playwright.TimeoutError):
            page.get_by_text("ARobot#r1").wait_for(timeout=1000 * patience(5))
            return True
        tried.append(f"a click at ({place[0]:.0f}, {place[1]:.0f}) selects nothing")
        page.get_by_role("button", name="Step").click()
        return False

    eventually(selected, lambda: f"r1 cannot be selected: {tried[-20:]}", 80)
    page.get_by_role("button", name="Resume").click()


def test_the_slider_sets_the_speed_and_follows_it(page, building):
    thumbs = page.get_by_role("slider")
    speed = thumbs.nth(thumbs.count() - 1)
    eventually(lambda: speed.get_attribute("aria-valuenow") == "0.8", "the robot's speed is 0.8")
    speed.focus()
    # In a busy browser, the key turns the camera, too: clicks in the scene are tested before.
    speed.press("ArrowRight")
    building.has("eSpeed<speed=0.85> to #r1")


def test_two_browsers_show_the_same_and_are_independent(page, building, chromium):
    other = chromium()
    second = other.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    second.set_default_timeout(1000 * patience())
    visit(second, building)
    second.get_by_text("ARobot#r1").wait_for()
    killer = other.new_browser_cdp_session()
    with suppress(playwright.Error):  # The browser dies before it can respond.
        killer.send("Browser.crash")
    first = frame_on(page)
    eventually(lambda: frame_on(page) > first + 3, "the page of the other browser stands still")
    assert "present" in {
        member.state for member in building.status().members if member.name == "web"
    }


def test_pause_step_and_resume(page, building):
    page.get_by_role("button", name="Pause").click()
    eventually(lambda: building.status().paused, "no pause")
    page.get_by_text("paused").first.wait_for()
    frame = building.status().frame
    page.get_by_role("button", name="Step").click()
    eventually(lambda: building.status().frame == frame + 1, "no step")
    page.get_by_role("button", name="Resume").click()
    eventually(lambda: building.status().frame > frame + 2, "does not go on")


def test_the_end_is_on_the_page_soon(page, building):
    os.kill(building.process.pid, signal.SIGINT)
    building.process.wait()
    page.get_by_text("the world has ended").first.wait_for()
    assert not [line for line in building.lines if "Traceback" in line]
