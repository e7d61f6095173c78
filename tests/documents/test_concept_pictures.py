"""The drawings of docs/concepts are those that tools/draw_concepts.py makes."""

import re
import xml.etree.ElementTree as ElementTree

import pytest

from tools.draw_concepts import DRAWINGS, FOLDER

PAGES = sorted(FOLDER.glob("*.md"))


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_is_up_to_date_and_shown_by_a_page(name):
    text = DRAWINGS[name]().document()
    ElementTree.fromstring(text)
    path = FOLDER / f"{name}.svg"
    assert path.read_text(encoding="utf-8") == text, "run python -m tools.draw_concepts --write"
    assert any(f"]({name}.svg)" in page.read_text(encoding="utf-8") for page in PAGES)


def test_tests_that_the_pages_name_exist():
    names = {
        name
        for page in PAGES
        for name in re.findall(r"`(tests/[\w/]+\.py)`", page.read_text("utf-8"))
    }
    assert names
    assert [name for name in sorted(names) if not (FOLDER.parents[1] / name).exists()] == []
