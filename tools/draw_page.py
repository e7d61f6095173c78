"""Draw the picture of the web page for the guides: python tools/draw_page.py docs/web.png.

Runs the robot's world with its page and takes a screenshot with Debian's chromium.
Needs `pip install playwright` and `apt install chromium`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
RUN = [sys.executable, "-m", "minerva_bus.cli.main", "run", "robot", "--robots", "2"]
SECONDS = 12.0
PATIENCE = 60_000


def photograph(url: str, path: Path) -> None:
    """Open the page, send orders to the robots, and take a screenshot."""
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 1400, "height": 1000})
        page.set_default_timeout(PATIENCE)
        page.goto(f"{url}&fixedDpr=0.2")  # the address ends with the token
        page.get_by_role("button", name="Send eErrand").wait_for()
        choose(page, "selected", "r1")
        choose(page, "target", "store")
        page.get_by_role("button", name="Send eErrand").click()
        page.wait_for_timeout(1000 * SECONDS)
        page.get_by_role("button", name="Pause").click()
        page.goto(url)
        page.get_by_text("ARobot#r1").wait_for()
        for notice in page.locator(".mantine-Notification-closeButton").all():
            notice.click()  # Software rendering does not matter for the picture.
        page.wait_for_timeout(8000)
        page.screenshot(path=path)
        browser.close()


def choose(page: Page, label: str, option: str) -> None:
    page.get_by_label(label, exact=True).first.click()
    page.get_by_role("option", name=option, exact=True).click()


def main() -> None:
    path = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/web.png").resolve()
    with tempfile.TemporaryDirectory() as folder:
        world = subprocess.Popen(
            [*RUN, "--view", "web"], cwd=folder, env={**os.environ, "MINERVA_RUNTIME_DIR": folder},
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert world.stderr is not None
            line = next(entry for entry in world.stderr if "http://" in entry)
            photograph(line[line.index("http://") :].strip(), path)
        finally:
            world.terminate()
            world.wait()
    print(path)


if __name__ == "__main__":
    main()
