"""The documentation site: it builds without warnings, its links lead somewhere, its search finds."""

import os
import re
import shutil
import tomllib
from html import escape
from importlib.metadata import entry_points
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
import typer

# Not importorskip: other processes import them, and the import takes 1 s in each test worker.
if not (find_spec("sphinx") and find_spec("myst_nb")):
    pytest.skip("the extra docs installs Sphinx", allow_module_level=True)

from pages import ROOT
from site_links import broken, broken_in_markdown, build, page

import minerva_bus
from minerva_bus.cli.main import COMMANDS, app, topics
from tests.patience import patience

ROBOT = ROOT / "agents" / "minerva_agents" / "robot" / "robot.toml"

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
OTHERS = ("build", "dist")
MARKDOWN = [
    path
    for path in sorted(ROOT.rglob("*.md"))
    if not any(part.startswith(".") or part in OTHERS for part in path.relative_to(ROOT).parts)
]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site") / "site"
    done = build(folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.timeout(600)
def test_the_site_builds_without_warnings(site):
    assert (site / "index.html").is_file()


def test_every_link_and_image_of_the_site_exists(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 30
    assert not {str(path.relative_to(site)): broken(path) for path in pages if broken(path)}


def test_the_site_needs_no_other_host(site):
    """Links to other sites are fine; files that a page loads are not."""
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert 'src="http' not in text, path
        assert 'rel="stylesheet" href="http' not in text, path


def test_every_image_of_the_site_has_an_alternative_text(site):
    silent = {path.name: page(path).silent for path in site.rglob("*.html")}
    assert not {name: images for name, images in silent.items() if images}


def test_documents_outside_docs_are_pages_and_folders_are_archives(site):
    assert (
        "reference/protocol.html#limits-and-invalid-messages"
        in page(site / "security.html").targets
    )
    deploy = page(site / "howto" / "deploy.html").targets
    assert "../_downloads/folders/deploy-docker.zip" in deploy


def test_the_reference_has_every_command_and_option(site):
    text = (site / "reference" / "cli.html").read_text(encoding="utf-8")
    anchors = page(site / "reference" / "cli.html").anchors
    program: Any = typer.main.get_command(app)
    for name in chain.from_iterable(COMMANDS.values()):
        assert f"minerva-{name}" in anchors
        options = program.commands[name].params
        assert not [o for each in options for o in each.opts if escape(o) not in text]
    assert "minerva-keys-issue" in anchors


def test_the_reference_has_every_public_name(site):
    pages = {path: page(path).anchors for path in (site / "reference" / "api").glob("*.html")}
    for name in minerva_bus.__all__:
        places = [path.name for path, names in pages.items() if f"minerva_bus.{name}" in names]
        assert len(places) == 1, f"{name}: add its module to a page in docs/reference/api"


def test_the_page_of_the_robot_world_has_all_its_options(site):
    text = (site / "reference" / "robot.html").read_text(encoding="utf-8")
    options = tomllib.loads(ROBOT.read_text(encoding="utf-8"))["options"]
    assert len(options) > 20
    assert not [name for name in options if f">--{name}<" not in text]


def test_the_gallery_shows_every_world_with_a_small_film(site):
    text = (site / "gallery" / "index.html").read_text(encoding="utf-8")
    worlds = [each.name for each in entry_points(group="minerva.worlds")]
    assert "robot" in worlds
    for name in [*worlds, "sir"]:
        assert f"{name}.webp" in text
        assert (ROOT / "docs" / "gallery" / f"{name}.webp").stat().st_size < 300_000
    assert "lines of Python" in text


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_page_of_a_notebook_shows_the_outputs_of_its_run(site, path):
    import nbformat  # late: each worker imports all test modules

    shown = page(site / "notebooks" / f"{path.stem}.html")
    code = "\n".join(
        cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"
    )
    pictures = [name for name in shown.targets if name.startswith("data:image/svg+xml")]
    plots = [name for name in shown.targets if name.startswith("../_images/")]
    assert len(pictures) >= 1
    assert len(plots) == code.count("plt.show()")
    assert ("<table>" in shown.path.read_text(encoding="utf-8")) == ("\ntable\n" in f"{code}\n")


def test_mermaid_blocks_are_drawings(site):
    for name, count in {
        "concepts/architecture.html": 1,
        "reference/protocol/first-member.html": 2,
    }.items():
        drawings = [target for target in page(site / name).targets if target.endswith(".svg")]
        assert sum("_images/mermaid-" in target for target in drawings) == 2 * count
        text = (site / name).read_text(encoding="utf-8")
        assert "sequenceDiagram" not in text
        assert "flowchart" not in text


def test_no_page_loads_a_mathematics_script(site):
    assert not list(site.rglob("*mathjax*"))


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt install chromium)")
def test_a_reader_finds_a_page_by_search_without_a_server(site):
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        view = browser.new_page(viewport={"width": 1280, "height": 900})
        view.set_default_timeout(1000 * patience())
        for name in ("index.html", "reference/index.html"):
            view.goto((site / name).as_uri())
            box = view.locator("input.sidebar-search")
            box.fill("certificates revoked")
            box.press("Enter")
            result = view.locator("#search-results a", has_text="Security").first
            result.click()
            view.wait_for_url("**/security.html*")
            assert "Security" in view.locator("h1").first.inner_text()
        browser.close()


def test_the_guides_are_grouped_as_the_commands_and_each_is_listed_once():
    folder = ROOT / "docs" / "howto"
    texts = {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.md")}
    listed = {name: re.findall(r"^([\w-]+)$", text, re.M) for name, text in texts.items()}
    groups = listed["index"]
    assert [texts[name].split("\n")[0] for name in groups] == [f"# {topic}" for topic in topics()]
    pages = chain.from_iterable(listed[name] for name in groups)
    assert sorted(pages) == sorted(texts.keys() - {"index", *groups})


def test_a_page_made_of_another_document_links_to_it_in_a_repository_browser():
    pages = {path: path.read_text("utf-8") for path in MARKDOWN if ROOT / "docs" in path.parents}
    shown = {path: text for path, text in pages.items() if "{document}" in text}
    assert len(shown) > 30
    for path, text in shown.items():
        target = text.split()[1]
        name = Path(os.path.relpath(path.parent / target, ROOT)).as_posix()
        link = f"The text of this page is in [{name}]({target})."
        assert text == f":::{{document}} {target}\n\n{link}\n\n:::\n", path


@pytest.mark.parametrize("path", MARKDOWN, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_of_a_markdown_file_exist_in_the_repository(path):
    assert not broken_in_markdown(path)
