"""The drawings of the documents match the code and the tools that make them."""

import ast
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from minerva_bus.frame.world_state import TRANSITIONS, Awaited, Phase
from tools.draw_concepts import DRAWINGS, FOLDER

FRAME = Path(__file__).parents[2] / "minerva_bus" / "frame"
MAX_ATTRIBUTES = 15


def test_every_phase_can_be_reached_and_every_phase_but_the_last_ends():
    reached = {Phase.WAITING}
    for _ in Phase:
        reached |= {after for (before, _), after in TRANSITIONS.items() if before in reached}
    assert reached == set(Phase)
    assert {before for before, _ in TRANSITIONS} == set(Phase) - {Phase.ENDED}
    assert {awaited for _, awaited in TRANSITIONS} == set(Awaited)


def attributes(cls):
    """Names that a class assigns on `self`."""
    return {
        node.attr
        for node in ast.walk(cls)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }


@pytest.mark.parametrize("path", sorted(FRAME.glob("*.py")), ids=lambda path: path.stem)
def test_no_class_of_the_frame_sets_many_attributes(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            assert len(attributes(node)) <= MAX_ATTRIBUTES, f"{path.name} {node.name}"


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
