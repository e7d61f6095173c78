"""The notebooks of the documentation in a real JupyterLab with a real browser."""

import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="needs pip install playwright")

from lab import PATIENCE, JupyterLab, OpenNotebook
from playwright import sync_api as playwright

from tests.patience import patience

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FOLDER = Path(__file__).parents[3] / "docs" / "notebooks"
LIVE = "4-live.ipynb"
FIRST, *OTHERS = sorted(path.name for path in FOLDER.glob("*.ipynb") if path.name != LIVE)

pytestmark = [
    # Not importorskip: another process imports it, and the import takes 2 s.
    pytest.mark.skipif(find_spec("jupyterlab") is None, reason="needs pip install jupyterlab"),
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt install chromium)"),
    pytest.mark.timeout(2 * PATIENCE),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """JupyterLab in one page for all tests: it takes longer to load than most notebooks to run."""
    lab = JupyterLab(tmp_path_factory.mktemp("lab"), sorted(FOLDER.glob("*.ipynb")))
    with lab, playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 1000})
        page.set_default_timeout(1000 * patience(PATIENCE))
        page.goto(lab.address)
        yield page
        browser.close()


def test_the_live_notebook_runs_and_its_buttons_work(page):
    notebook = OpenNotebook(page, LIVE)
    notebook.run_all()
    assert notebook.errors() == []
    steps = notebook.panel.get_by_role("button", name="Step", exact=True)
    playwright.expect(steps).to_have_count(2, timeout=1000 * patience(PATIENCE))
    assert notebook.pictures() == 2

    # The last cell has closed the world: start another one.
    cell = notebook.run("live = field.start")
    step, play, pause = (
        cell.get_by_role("button", name=name, exact=True) for name in ("Step", "Play", "Pause")
    )
    status = cell.locator("output")
    shows(status, r"field · frame 0$")
    picture = cell.locator("img").get_attribute("src")
    step.click()
    shows(status, r"field · frame 1$")
    assert cell.locator("img").get_attribute("src") != picture
    play.click()
    shows(status, r"field · frame [1-9]\d+$")
    assert step.is_disabled()
    pause.click()
    play.wait_for()
    # The kernel has handled all earlier messages of the browser when it has run a cell.
    notebook.run("print(live.frame")
    paused = status.inner_text()
    step.click()
    shows(status, rf"field · frame {int(paused.rpartition(' ')[2]) + 1}$")
    assert notebook.errors() == []


# tests/documents/test_site.py runs each notebook in a kernel: JupyterLab itself is tested here.
@pytest.mark.parametrize(
    "name", [FIRST, *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)]
)
def test_a_notebook_runs_and_shows_its_outputs(page, name):
    notebook = OpenNotebook(page, name)
    notebook.run_all()
    assert notebook.errors() == []
    plots = (FOLDER / name).read_text(encoding="utf-8").count("plt.show()")
    assert notebook.outputs("image/png").count() == plots
    assert notebook.outputs("text/html").count() >= 1
    assert notebook.pictures() > plots


def shows(output, pattern):
    playwright.expect(output).to_have_text(re.compile(pattern), timeout=1000 * patience(PATIENCE))
