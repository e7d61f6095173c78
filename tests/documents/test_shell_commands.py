"""Shell commands work as described; their tables match the pages; tutorials install what they need."""

import re

import pytest
from pages import PAGES, blocks, shell
from reader import TABLES, means, type_page

APART = True


@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", [page for page in PAGES if shell(page)])
def test_a_page_can_be_followed(page, tmp_path, island):
    """Every command of it works, with the files and outputs that it shows."""
    type_page(page, tmp_path, island)


def test_tables_name_commands_that_their_pages_have():
    for page, table in TABLES.items():
        known = [line for block in shell(page) for line in block]
        for key in ("first", "until", "runs", "joins", "stays", "codes", "skip", "pictures"):
            for name, text in table.get(key, {}).items():
                assert any(means(name, line) for line in known), f"{page} has no {name!r}"
                assert text, f"{page}: nothing is said of {name!r}"


def test_pages_have_commands():
    assert sum(len(block) for page in PAGES for block in shell(page)) > 100


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
