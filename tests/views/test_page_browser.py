"""Real pages in Chromium as members of real runs: they draw, send events, and host agents."""

import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("websockets")
playwright = pytest.importorskip("playwright.sync_api")

from page_run import CHROMIUM, FLAGS, copied, eventually, running, shown  # noqa: E402

from minerva_agents.robot.vocabulary import eObjective  # noqa: E402
from minerva_agents.robot.world import scene, vocabulary  # noqa: E402
from minerva_bus import World  # noqa: E402
from minerva_services.geometry.picture import Lists, Texts, Tiles  # noqa: E402
from minerva_services.views.layout import extremes  # noqa: E402
from tests.patience import patience  # noqa: E402

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt install chromium)")

FRAMES = 90
STOPPED_AT = 30
PARTED_BY = 60
"""Milliseconds for an explanation: a process of its own, which a busy machine starts slowly."""


@pytest.fixture(scope="module")
def chromium():
    with playwright.sync_playwright() as player:
        started = player.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield started
        started.close()


@pytest.fixture
def visitors(chromium):
    """Makes people who know nothing of each other, and whom a test may close."""
    started = []

    def visitor(**options):
        started.append(chromium.new_context(**options))
        started[-1].set_default_timeout(1000 * patience())
        return started[-1]

    yield visitor
    for each in started:
        each.close()


@pytest.fixture
def garden(tmp_path):
    """The example in real time, with a page that hosts its snails."""
    with running(tmp_path, copied(tmp_path) / "phone.toml") as run:
        yield run


def digest_in_python(folder, frames):
    """The digest of the same world, whose snails a Python host evolves."""
    text = (folder / "phone.toml").read_text()
    text = re.sub(r"\[process\.page\].*?\n\n", "", text, flags=re.S).replace("elsewhere = true", "")
    (folder / "python.toml").write_text(text)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "minerva_bus.cli.main", "run", str(folder / "python.toml")),
            *("--frames", str(frames), "--in-process", "--json"),
        ],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (digest,) = re.findall(r'"digest": "(\w+)"', done.stdout)
    return digest


def test_a_page_that_closes_in_mid_frame_is_replaced_and_changes_nothing(tmp_path, visitors):
    """The first page never answers frame 30: its host is closed while it evolves an agent."""
    folder = copied(tmp_path)
    code = folder / "snails.js"
    stuck = f"""
      if (moment.frame === {STOPPED_AT}n && location.hash === "#first") {{
        console.log("in frame {STOPPED_AT}");
        for (;;);
      }}
      const snail = self.values;
      snail.x +="""
    text = code.read_text()
    assert text.count("\n      const snail = self.values;\n      snail.x +=") == 1
    code.write_text(text.replace("\n      const snail = self.values;\n      snail.x +=", stuck))
    with running(tmp_path, folder / "phone.toml", "--frames", FRAMES, "--rate", "50") as run:
        first = visitors()
        page = first.new_page()
        with page.expect_console_message(lambda said: f"in frame {STOPPED_AT}" in said.text):
            page.goto(f"{run.url}#first")
        assert run.client.operator.status().frame == STOPPED_AT
        first.close()
        successor = visitors().new_page()
        successor.goto(run.url)
        successor.get_by_text("The world has ended", exact=False).wait_for()
        summary = run.summary()
    assert summary["frames"] == FRAMES
    assert summary["digest"] == digest_in_python(folder, FRAMES)


def test_one_page_hosts_and_the_next_takes_over(garden, visitors):
    first, second = visitors(), visitors().new_page()
    page = first.new_page()
    page.goto(garden.url)
    garden.present("snails")
    second.goto(garden.url)
    second.get_by_text("snails: on another page").wait_for()
    first.close()
    second.locator("#members").get_by_text("snails", exact=True).wait_for()
    assert second.locator("#you").inner_text() == "page-2"
    garden.present("snails")
    before = garden.client.operator.status().frame
    shown(second, before + 5)


def test_a_tap_on_the_ground_is_an_order(garden, visitors):
    page = visitors(viewport={"width": 390, "height": 844}).new_page()
    page.goto(garden.url)
    shown(page)
    page.get_by_text("lettuce", exact=False).first.wait_for()
    box = page.locator("canvas").bounding_box()
    # The corner of the picture is free: the margin around everything drawn.
    page.mouse.click(box["x"] + 5, box["y"] + box["height"] - 30)
    event = garden.event("eLettuce")
    x, y = (float(number) for number in re.findall(r"=(-?[\d.]+)", event))
    assert x < -1
    assert y < -1
    page.get_by_text("sent eLettuce", exact=False).wait_for()


def test_the_tilt_of_a_phone_is_an_event(garden, visitors):
    context = visitors(viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.goto(garden.url)
    shown(page)
    page.get_by_text("Push the snails by tilting").click()
    garden.present("tilt-1")
    sensor = context.new_cdp_session(page)
    sensor.send(
        "DeviceOrientation.setDeviceOrientationOverride", {"alpha": 0, "beta": -45, "gamma": 22.5}
    )
    assert garden.event("eTilt") == "eTilt<x=0.5, y=1>"


def pin_of(page, name):
    """Where the pin of a marker of the robots' world is on the page."""
    texts = Lists(vocabulary).picture(scene({}), {}).of(Texts)
    x, y = next((float(t.x[0]), float(t.y[0])) for t in texts if t.texts[0] == name)
    left, top = pixel_of(page, x, y)
    return left, top - 15


def pixel_of(page, x, y):
    """Where a point of the robots' world is on the page."""
    tiles = Lists(vocabulary).picture(scene({}), {}).of(Tiles)
    across, along = map(np.concatenate, zip(*map(extremes, tiles), strict=True))
    box = page.locator("canvas").bounding_box()
    scale = 0.94 * min(box["width"] / np.ptp(across), box["height"] / np.ptp(along))
    return (
        box["x"] + box["width"] / 2 + (x - (across.min() + across.max()) / 2) * scale,
        box["y"] + 0.03 * box["height"] + (along.max() - y) * scale,
    )


@pytest.mark.timeout(400)
def test_a_click_on_a_name_and_a_key_are_orders(tmp_path, visitors):
    """The robots' world: its markers are labels, and its speed has a unit."""
    words = "--robots", "1", "--parcels", "", "--record", "run.mcap"
    beside = tmp_path / "beside.mcap"
    order_late(beside)
    with running(tmp_path, "robot", *words, "--view", f"page:beside={beside}") as run:
        # However slow the browser is, its page has the frames from here on.
        run.client.operator.pause()
        page = visitors(viewport={"width": 390, "height": 844}).new_page()
        page.goto(run.url)
        run.present("page-1")
        run.client.operator.step(3)
        shown(page)
        select_by_touch(page, run)
        run.client.operator.resume()
        page.set_viewport_size({"width": 1000, "height": 700})
        # Labels can be clicked where they are drawn: the canvas has its new size in pixels.
        drawn = page.locator("canvas")
        eventually(lambda: drawn.get_attribute("width") == "1000", "it has the old size")
        page.mouse.click(*pin_of(page, "lab"))
        run.event('eObjective<marker="lab">')
        page.keyboard.press("ArrowUp")
        run.event("eSpeed")
        follow_an_order(page)
        compare_runs(page)
        # A hidden button keeps the focus until the page is drawn again.
        page.evaluate(
            "const close = document.querySelector('#inspector .close'); close.focus(); close.click();"
            "close.dispatchEvent(new KeyboardEvent('keydown', {key: ' ', bubbles: true}));"
        )
        eventually(lambda: run.client.operator.status().paused, "it is not paused")
        page.get_by_text("paused", exact=True).wait_for()
        page.locator("#orders").get_by_role("button", name="resume").click()
        eventually(lambda: not run.client.operator.status().paused, "it is paused")
        page.locator("#orders").get_by_role("button", name="step").click()
        eventually(lambda: run.client.operator.status().paused, "it is not paused")
        page.locator("#orders").get_by_role("button", name="rate +").click()
        page.get_by_text("target rate 20 frames", exact=False).wait_for()


def select_by_touch(page, run):
    """Select the robot on a phone by a touch below it, which does not move the picture."""
    robot = vocabulary.read(run.client.operator.fragment("r1")).nodes[0].state
    x, y = (
        robot[zero] + robot["cell"] * robot[at] for zero, at in (("x0", "row"), ("y0", "column"))
    )
    left, top = pixel_of(page, x, y)
    page.get_by_text("speed +").wait_for()
    before = page.locator("canvas").bounding_box()
    page.mouse.click(left, top + 21.5)
    page.get_by_text("tap a name to send it as objective to r1", exact=True).wait_for()
    page.locator("#inspector").get_by_role("button", name="objective").wait_for()
    assert page.locator("canvas").bounding_box() == before
    page.mouse.click(left, top + 21.5)
    page.get_by_text("tap a name to send it as objective", exact=True).wait_for()


def follow_an_order(page):
    """Choose a name, and find the order of this person by the inspector, now and in the past."""
    for name, answer in (("a b", "cannot name a person"), ("anna", "anna")):
        page.locator("#you").click()
        page.locator("#name").fill(name)
        page.keyboard.press("Enter")
        page.get_by_text(answer, exact=False).first.wait_for()
    page.mouse.click(*pin_of(page, "store"))
    page.locator("#fates li", has_text="anna").get_by_text("accepted in frame").wait_for()
    page.locator("#choose").fill("r1")
    page.keyboard.press("Enter")
    inspector = page.locator("#inspector")
    inspector.get_by_role("button", name="objective").click()
    inspector.get_by_text("set_objective", exact=False).first.wait_for(timeout=1000 * patience(100))
    # The file of the record may lack the last frames.
    inspector.get_by_text("the generator gObjective", exact=False).first.wait_for()
    # In one call, because the next frame moves the slider to the end.
    page.locator("#moment").evaluate(
        "(slider) => { slider.stepDown(20); slider.dispatchEvent(new Event('input')); }"
    )
    inspector.get_by_text("at the beginning of frame", exact=False).first.wait_for()
    inspector.get_by_text("Rejected").wait_for(timeout=1000 * patience(100))
    past = int(page.get_attribute("body", "data-frame"))
    page.locator("#live").click()
    shown(page, past + 21)


def order_late(path):
    """Record a run in which somebody sends an order in frame `PARTED_BY`."""
    world = World.load("robot", robots=1, parcels="")
    with world.start(record=path) as live:
        live.step(PARTED_BY)
        live.publish(eObjective("meeting"), by="bert")
        live.step(2)


def compare_runs(page):
    """Find the order that only one of the runs has, and show its frame."""
    eventually(lambda: int(page.get_attribute("body", "data-frame")) > PARTED_BY, "it is not there")
    panel = page.locator("#parting")

    def parted():
        """Ask again if the file of the record lacks the frame: equal runs may continue."""
        page.locator("#part").click()
        waiting = panel.get_by_text("comparing", exact=False)
        waiting.wait_for(state="hidden", timeout=1000 * patience(100))
        return panel.get_by_role("button", name="frame").count() > 0

    eventually(parted, lambda: panel.inner_text())
    panel.get_by_text("of the person ", exact=False).wait_for()
    button = panel.get_by_role("button", name="frame")
    frame = int(button.inner_text().removeprefix("frame "))
    assert frame <= PARTED_BY
    page.locator("#mark").wait_for()
    button.click()
    # A world that catches up has no view of some frames: the page shows the one before.
    page.locator("#shown").get_by_text("ago", exact=False).wait_for()
    assert int(page.locator("#shown").inner_text().split(",")[0].removeprefix("frame ")) <= frame
    panel.get_by_role("button", name="ARobot#r1").first.click()
    page.locator("#inspector").get_by_role("button", name="objective").wait_for()
    assert panel.is_hidden()
    page.locator("#live").click()


def test_interrupting_the_world_ends_its_pages(garden, visitors):
    page = visitors().new_page()
    page.route_web_socket(re.compile("/people"), without_explanations)
    page.goto(garden.url)
    shown(page)
    page.locator("#choose").fill("anna")
    page.keyboard.press("Enter")
    page.locator("#inspector").get_by_text("reading the last frames", exact=False).wait_for()
    # The state comes by itself, and the button with it is pressed below.
    page.locator("#inspector").get_by_role("button", name="water").wait_for()
    os.kill(garden.process.pid, signal.SIGINT)
    page.locator("#notice").get_by_text("ended", exact=False).wait_for()
    page.locator("#inspector").get_by_text("ended", exact=False).wait_for()
    page.locator("#inspector").get_by_role("button", name="water").click()
    page.locator("#inspector").get_by_text("no link to the world", exact=False).wait_for()
    garden.process.wait()


def without_explanations(socket):
    """Keep the answers of the inspector from a page, as if they took longer than the world."""
    server = socket.connect_to_server()
    server.on_message(lambda message: "explained" in message or socket.send(message))
