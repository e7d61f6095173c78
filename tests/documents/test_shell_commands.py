"""The tables of shell commands match the pages, and one test file types each page."""

from pathlib import Path

from pages import PAGES, shell
from reader import GROUPS, TABLES, means, of


def test_tables_name_commands_that_their_pages_have():
    for page, table in TABLES.items():
        known = [line for block in shell(page) for line in block]
        for key in ("first", "until", "runs", "joins", "stays", "codes", "skip", "pictures"):
            for name, text in table.get(key, {}).items():
                assert any(means(name, line) for line in known), f"{page} has no {name!r}"
                assert text, f"{page}: nothing is said of {name!r}"


def test_pages_have_commands():
    assert sum(len(block) for page in PAGES for block in shell(page)) > 100


def test_each_group_of_pages_has_a_file_that_types_it():
    assert sum(len(of(group)) for group in GROUPS) == len([page for page in PAGES if shell(page)])
    for group in GROUPS:
        path = Path(__file__).with_name(f"test_shell_commands_of_{group}.py")
        assert f'of("{group}")' in path.read_text(encoding="utf-8")
