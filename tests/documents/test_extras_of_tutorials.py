"""The tutorials install what their commands need."""

import re

import pytest
from pages import PAGES, blocks

EXTRA_OF = {
    r"--record\b": "record",
    r"--view svg": "picture",
    r"--view web": "web",
    r"--view sprites": "sprites",
    r"minerva plot\b": "plot",
    r"--listen tls": "tls",
    r"minerva top\b": "top",
}
"""Commands, and the extras that they need."""

TUTORIALS = [page for page in PAGES if re.match(r"docs/tutorials/\d", page)]


@pytest.mark.parametrize("page", TUTORIALS)
def test_a_tutorial_installs_what_its_commands_need(page):
    installed = re.findall(r"'minerva-bus\[(.*?)\]'", PAGES[page].read_text(encoding="utf-8"))
    extras = {extra for group in installed for extra in group.split(",")}
    typed = "\n".join(block.text for block in blocks(page, "console"))
    needed = {extra for pattern, extra in EXTRA_OF.items() if re.search(pattern, typed)}
    assert needed <= extras


def test_all_tutorials_are_checked():
    assert len(TUTORIALS) == 7
