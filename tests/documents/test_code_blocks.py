"""The documentation's Python and TOML: all of it parses, and self-contained blocks run."""

import linecache
import textwrap
import tomllib

import pytest
from pages import PAGES, blocks

ELSEWHERE = {
    "README.md": "tests/examples/test_readme.py",
    "docs/geometries.md": "tests/examples/test_ascii.py",
    "extensions/messages/messages.md": "extensions/messages/tests/test_messages_document.py",
    "extensions/cosimulation/cosimulation.md": "extensions/cosimulation/tests/test_cosimulation_page.py",
    "docs/migration/1-mesa.md": "tests/examples/test_sir.py",
    "docs/migration/5-mosaik.md": "tests/examples/test_heating.py",
    "docs/populations.md": "tests/examples/test_populations_doc.py",
    "docs/python.md": "tests/api/test_python_document.py",
    "docs/records.md": "tests/log/test_document.py",
    "worlds/minerva_worlds/crowd/README.md": "tests/examples/test_crowd.py",
    "worlds/minerva_worlds/meadow/README.md": "tests/examples/test_meadow.py",
    "worlds/minerva_worlds/plants/README.md": "tests/examples/test_plants.py",
    "worlds/minerva_worlds/village/README.md": "tests/examples/test_village.py",
    "worlds/minerva_worlds/warehouse/README.md": "tests/examples/test_warehouse.py",
}
"""Tests that run the Python of a page, or compare it with its source files."""

EXCERPTS = {
    "extensions/exporters/datasets.md": ["from lerobot."],
    "docs/norms.md": ["moment.emit"],
    "docs/reference/portable.md": ["from minerva_bus import portable\n\nself."],
    "worlds/minerva_worlds/slime/README.md": ["    @on("],
}
"""Beginnings of blocks that cannot run: lines of an agent, or a library that needs gigabytes."""


def of(language):
    return [(page, block) for page in PAGES for block in blocks(page, language)]


def place(value):
    return value if isinstance(value, str) else f"line {value.line}"


@pytest.mark.parametrize(("page", "block"), of("python"), ids=place)
def test_python_can_be_read(page, block):
    compile(textwrap.dedent(block.text), f"{page}:{block.line}", "exec")


@pytest.mark.parametrize(("page", "block"), of("toml"), ids=place)
def test_toml_can_be_read(page, block):
    tomllib.loads(block.text)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")])
def test_the_python_of_a_page_runs_from_its_first_block_to_its_last(page, tmp_path, monkeypatch):
    if page in ELSEWHERE:
        assert (PAGES["README.md"].parent / ELSEWHERE[page]).exists()
        return
    monkeypatch.chdir(tmp_path)
    if any("StdioServerParameters" in block.text for block in blocks(page, "python")):
        # The SDK of MCP starts a server with few variables, which thus finds the worlds of the user.
        monkeypatch.delenv("MINERVA_RUNTIME_DIR")
    names = {"__name__": "page"}
    exec("from minerva_bus import *", names)
    for block in blocks(page, "python"):
        if not block.file and not block.text.startswith(tuple(EXCERPTS.get(page, ()))):
            file, lines = f"{page}:{block.line}", block.text.splitlines(keepends=True)
            # As of a file: what is compiled to machine code reads its source.
            linecache.cache[file] = len(block.text), None, lines, file
            exec(compile(block.text, file, "exec"), names)


def test_the_tables_name_pages_that_have_python():
    assert all(blocks(page, "python") for page in (*ELSEWHERE, *EXCERPTS))
    for page, starts in EXCERPTS.items():
        for start in starts:
            assert any(block.text.startswith(start) for block in blocks(page, "python"))
