"""Moving boxes on the page of the view web: what a view costs, and how often a browser draws.

    python -m extensions.bodies.benchmarks.boxes [--boxes 50 5000] [--seconds 10] [--rate 20]

All boxes move between two views. CPU time and bytes are those of the page's server, from the string
to the browser. Chromium draws 1280 x 720 pixels with the processor. Needs chromium and playwright.
"""

from __future__ import annotations

import shutil
import time
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from benchmarks.command import Table, options
from minerva_bodies.pictures import SpacePictures
from minerva_bodies.rubble import yard
from minerva_bus import Scene, WorldInfo
from minerva_services.geometry.picture import Lists
from minerva_services.views.web.page_scene import PageScene
from minerva_services.views.web.serving import serve, stop, url

FLAGS = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"]
FLAGS += ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
COUNT = """
window.drawn = 0;
const draw = () => { window.drawn += 1; requestAnimationFrame(draw); };
requestAnimationFrame(draw);
"""
COLUMNS = {"boxes": ">6d", "views_per_second": ">17.1f", "cpu_ms_per_view": ">16.2f",
           "kb_per_view": ">12.0f", "drawn_per_second": ">17.1f"}  # fmt: skip
WARM = 40
"""Views before the measurement."""


def boxes(count: int, number: int) -> Scene:
    """Turning boxes that go up and down, in the view of this number."""
    at = np.arange(count)
    phase = 0.1 * number + at
    x, y, z = 0.6 * (at % 70 - 35.0), 0.6 * (at // 70 - 35.0), 1.0 + 0.5 * np.sin(phase)
    nothing = np.zeros(count)
    pose: Any = (x, y, z, np.cos(phase), nothing, nothing, np.sin(phase))
    names: Any = np.array([f"b{name}" for name in at], object)
    return yard.TPose(*pose)(yard.PBrick(names))


def measured(count: int, seconds: float, rate: float) -> dict[str, float]:
    """One page with this many boxes."""
    world = WorldInfo("boxes", yard.vocabulary, 0, 1.0 / rate)
    lists = Lists(world.vocabulary, SpacePictures(world))
    views = round(seconds * rate)
    shown = [boxes(count, number) for number in range(WARM + views)]
    server = serve("127.0.0.1", 0)
    try:
        scene = PageScene(server)

        def show(scenes: list[Scene]) -> float:
            begin = time.perf_counter()
            for number, view in enumerate(scenes, 1):
                scene.show(lists.picture(view, {}))
                time.sleep(max(0.0, begin + number / rate - time.perf_counter()))
            return time.perf_counter() - begin

        show(shown[:1])
        with sync_playwright() as player:
            browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            page = browser.new_page(viewport={"width": 1280, "height": 720})
            sizes = list[int]()
            page.on("websocket", lambda socket: socket.on(
                "framereceived", lambda data: sizes.append(len(data))))  # fmt: skip
            page.add_init_script(COUNT)
            page.goto(url(server))
            page.wait_for_selector("canvas")
            show(shown[1:WARM])
            # The library hears of messages only while one of its functions runs, so the CPU time
            # below is without it.
            page.wait_for_timeout(2000)
            sizes.clear()
            drawn, used = page.evaluate("drawn"), time.process_time()
            took = show(shown[WARM:])
            used = time.process_time() - used
            drawn = page.evaluate("drawn") - drawn
            page.wait_for_timeout(2000)
            browser.close()
    finally:
        stop(server)
    return {"boxes": count, "views_per_second": views / took,
            "cpu_ms_per_view": 1000 * used / views, "kb_per_view": sum(sizes) / views / 1000,
            "drawn_per_second": drawn / took}  # fmt: skip


def main() -> None:
    given = options(__doc__, boxes=[50, 5000], seconds=10.0, rate=20.0)
    table = Table(COLUMNS, as_json=given.json)
    for count in given.boxes:
        table.row(measured(count, given.seconds, given.rate))


if __name__ == "__main__":
    main()
