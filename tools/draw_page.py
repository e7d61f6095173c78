"""Draw the pictures of the web page for the guides: python tools/draw_page.py [PICTURE ...].

Runs the robot's world with its page and takes a screenshot with Debian's chromium.
Needs `pip install playwright` and `apt install chromium`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "documents"))

# tests/documents is no package.
from pages import blocks  # noqa: E402  # pyright: ignore[reportMissingImports]

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
RUN = [sys.executable, "-m", "minerva_bus.cli.main", "run", "robot", "--view", "web"]
SECONDS = 12.0
PATIENCE = 60_000


@dataclass(frozen=True)
class Picture:
    """What the page shows: options of the world and the target of an errand of `r1`.

    `guide`: the document whose files the world needs, and `script`, the one of them to run first.
    """

    options: tuple[str, ...]
    target: str
    guide: str = ""
    script: str = ""


PICTURES = {
    "docs/web.png": Picture(("--robots", "2"), "store"),
    "docs/tutorials/3-robots-page.png": Picture(
        ("--map", "house.yaml", "--robots", "2", "--objective", "desk"),
        "door",
        "docs/tutorials/3-robots.md",
        "draw_plan.py",
    ),
}


def photograph(url: str, target: str, path: Path) -> None:
    """Open the page, send orders to the robots, and take a screenshot."""
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 1100, "height": 1062})
        page.set_default_timeout(PATIENCE)
        page.goto(f"{url}&fixedDpr=0.2")  # the address ends with the token
        page.get_by_role("button", name="Send eErrand").wait_for()
        choose(page, "selected", "r1")
        choose(page, "target", target)
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


def draw(name: str) -> None:
    """Run the world of a picture and draw it."""
    picture = PICTURES[name]
    with tempfile.TemporaryDirectory() as folder:
        for block in blocks(picture.guide) if picture.guide else ():
            if block.file:
                Path(folder, block.file).write_text(block.text, encoding="utf-8")
        if picture.script:
            subprocess.run([sys.executable, picture.script], cwd=folder, check=True)
        world = subprocess.Popen(
            [*RUN, *picture.options], cwd=folder,
            env={**os.environ, "MINERVA_RUNTIME_DIR": folder}, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert world.stderr is not None
            line = next(entry for entry in world.stderr if "http://" in entry)
            photograph(line[line.index("http://") :].strip(), picture.target, ROOT / name)
        finally:
            world.terminate()
            world.wait()
    print(name)


def main() -> None:
    for name in sys.argv[1:] or PICTURES:
        draw(name)


if __name__ == "__main__":
    main()
