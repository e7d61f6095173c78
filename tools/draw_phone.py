"""Draw the picture of the garden on a phone for the guide: python tools/draw_phone.py.

Runs the example with its page, opens it in Debian's chromium at the size of a phone, feeds the
snails, and takes a screenshot. Needs `pip install playwright` and `apt install chromium`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[1]
WORLD = ROOT / "members" / "javascript" / "examples" / "phone" / "phone.toml"
PICTURE = ROOT / "docs" / "howto" / "phone.png"
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
PHONE = {"width": 390, "height": 700}
FRAME = 60
PATIENCE = 60_000


def photograph(url: str, path: Path) -> None:
    """Open the page, tap the ground, and take a screenshot."""
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport=PHONE, device_scale_factor=1.5)
        page.set_default_timeout(PATIENCE)
        page.goto(url)
        page.locator("body[data-frame]").wait_for()
        box = page.locator("canvas").bounding_box()
        assert box is not None
        page.get_by_text("lettuce", exact=False).first.wait_for()
        page.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.5)
        page.get_by_text("sent eLettuce", exact=False).wait_for()
        while int(page.get_attribute("body", "data-frame") or 0) < FRAME:
            page.wait_for_timeout(100)
        page.get_by_text("Legend", exact=True).click()
        page.screenshot(path=path)
        browser.close()


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        world = subprocess.Popen(
            [sys.executable, "-m", "minerva_bus.cli.main", "run", str(WORLD)],
            env={**os.environ, "MINERVA_RUNTIME_DIR": folder}, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert world.stderr is not None
            line = next(entry for entry in world.stderr if "http://" in entry)
            photograph(line[line.index("http://") :].strip(), PICTURE)
        finally:
            world.terminate()
            world.wait()
    print(PICTURE.relative_to(ROOT))


if __name__ == "__main__":
    main()
